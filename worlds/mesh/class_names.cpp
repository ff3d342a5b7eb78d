#include "worlds/mesh/class_names.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <limits>

#include <glm/common.hpp>

#include "core/error.h"

namespace segsim::worlds {
namespace {

struct Rule {
  std::string_view words;  ///< Lower case, words of a row written as one.
  std::string_view class_name;
};

constexpr auto kRules = std::to_array<Rule>({
    {"actor", "person"},
    {"adjtable", "table"},
    {"airconditioner", "air conditioner"},
    {"anesthesiamachine", "anesthesia machine"},
    {"armchair", "chair"},
    {"backpack", "backpack"},
    {"balconytable", "table"},
    {"ball", "ball"},
    {"barrier", "barrier"},
    {"basin", "sink"},
    {"bathroom", "wall"},
    {"bathtub", "bathtub"},
    {"beanbag", "bean bag"},
    {"bed", "bed"},
    {"bedroom", "wall"},
    {"bedsidetable", "nightstand"},
    {"bedtable", "table"},
    {"bench", "bench"},
    {"bin", "trash bin"},
    {"biscuitspack", "box"},
    {"blackboard", "whiteboard"},
    {"bloodpressuremonitor", "blood pressure monitor"},
    {"bmwcart", "cart"},
    {"board", "board"},
    {"book", "book"},
    {"bookcase", "bookshelf"},
    {"bookrack", "bookshelf"},
    {"bookshelf", "bookshelf"},
    {"bottle", "bottle"},
    {"bowl", "bowl"},
    {"box", "box"},
    {"bpcart", "cart"},
    {"bucket", "bucket"},
    {"building", "wall"},
    {"cabinet", "cabinet"},
    {"cafe", "wall"},
    {"cafecounter", "kitchen counter"},
    {"cafetable", "table"},
    {"can", "can"},
    {"cardboardbox", "box"},
    {"carpet", "carpet"},
    {"carpettile", "floor"},
    {"cart", "cart"},
    {"ceiling", "ceiling"},
    {"ceilinglamp", "lamp"},
    {"cgmclassic", "bed"},
    {"chair", "chair"},
    {"chandelier", "lamp"},
    {"chestofdrawers", "cabinet"},
    {"chipchair", "chair"},
    {"clock", "clock"},
    {"closet", "wardrobe"},
    {"cluttering", "box"},
    {"cocacola", "can"},
    {"coffeemachine", "coffee maker"},
    {"coffeemaker", "coffee maker"},
    {"coffeetable", "coffee table"},
    {"cokecan", "can"},
    {"cokecanslim", "can"},
    {"column", "wall"},
    {"computer", "computer"},
    {"computertower", "computer"},
    {"cone", "traffic cone"},
    {"conferenceroom", "wall"},
    {"conferencetable", "table"},
    {"constructioncone", "traffic cone"},
    {"cookingbench", "kitchen counter"},
    {"copier", "printer"},
    {"corridor", "wall"},
    {"couch", "couch"},
    {"counter", "kitchen counter"},
    {"cubicle", "partition"},
    {"cubiclewall", "partition"},
    {"cup", "cup"},
    {"cupboard", "cabinet"},
    {"curtain", "curtain"},
    {"desk", "desk"},
    {"deskcabinet", "cabinet"},
    {"desklamp", "lamp"},
    {"deskportrait", "picture"},
    {"diningtable", "dining table"},
    {"dish", "plate"},
    {"dishwasher", "dishwasher"},
    {"door", "door"},
    {"doorframe", "door"},
    {"doorway", "door"},
    {"drawer", "cabinet"},
    {"dresser", "cabinet"},
    {"dryer", "dryer"},
    {"dumbbell", "dumbbell"},
    {"dustbin", "trash bin"},
    {"elevator", "elevator"},
    {"elevatorcar", "elevator"},
    {"elevatordoor", "door"},
    {"elevatorportal", "elevator"},
    {"entrance", "wall"},
    {"extinguisher", "fire extinguisher"},
    {"fan", "fan"},
    {"filingcabinet", "cabinet"},
    {"fireextinguisher", "fire extinguisher"},
    {"fitnessbench", "fitness bench"},
    {"fitnessequipment", "fitness bench"},
    {"floor", "floor"},
    {"floorlamp", "lamp"},
    {"flower", "potted plant"},
    {"flowerpot", "potted plant"},
    {"foldingdoor", "door"},
    {"freezer", "refrigerator"},
    {"fridge", "refrigerator"},
    {"garbage", "trash bin"},
    {"ground", "floor"},
    {"groundplane", "floor"},
    {"hall", "wall"},
    {"hallway", "wall"},
    {"handle", "handle"},
    {"handrail", "handrail"},
    {"hangoutchair", "chair"},
    {"heater", "radiator"},
    {"hospitalbed", "bed"},
    {"housewall", "wall"},
    {"human", "person"},
    {"instrumentcart", "cart"},
    {"ivstand", "iv stand"},
    {"kettle", "kettle"},
    {"keyboard", "keyboard"},
    {"kitchen", "kitchen counter"},
    {"kitchencabinet", "kitchen cabinet"},
    {"kitchencounter", "kitchen counter"},
    {"kitchenfridge", "refrigerator"},
    {"kitchensink", "sink"},
    {"kitchentable", "dining table"},
    {"kitchenunit", "kitchen counter"},
    {"kitchenutensils", "kitchen utensils"},
    {"lamp", "lamp"},
    {"laptop", "laptop"},
    {"light", "lamp"},
    {"lightswitch", "light switch"},
    {"livingroom", "wall"},
    {"lobby", "wall"},
    {"loungechair", "chair"},
    {"loungesofa", "couch"},
    {"malepatientbed", "bed"},
    {"meetingdesk", "table"},
    {"meetingroom", "wall"},
    {"meetingtable", "table"},
    {"metalcabinet", "cabinet"},
    {"microwave", "microwave"},
    {"minifridge", "refrigerator"},
    {"mirror", "mirror"},
    {"monitor", "tv"},
    {"mopcart", "cart"},
    {"mouse", "mouse"},
    {"mug", "cup"},
    {"nightstand", "nightstand"},
    {"nursesstation", "reception desk"},
    {"office", "wall"},
    {"officechair", "chair"},
    {"oven", "oven"},
    {"painting", "picture"},
    {"pallet", "pallet"},
    {"palletjack", "pallet jack"},
    {"parkingtrolley", "cart"},
    {"parkingtrolleymax", "cart"},
    {"parkingtrolleymin", "cart"},
    {"partition", "partition"},
    {"patient", "person"},
    {"patientbed", "bed"},
    {"patientsit", "person"},
    {"patientwheelchair", "wheelchair"},
    {"person", "person"},
    {"phone", "phone"},
    {"photocopier", "printer"},
    {"piano", "piano"},
    {"picture", "picture"},
    {"pillar", "wall"},
    {"pillow", "pillow"},
    {"plant", "potted plant"},
    {"plate", "plate"},
    {"portrait", "picture"},
    {"poster", "picture"},
    {"pottedplant", "potted plant"},
    {"pringle", "can"},
    {"printer", "printer"},
    {"quilt", "quilt"},
    {"rack", "shelf"},
    {"radiator", "radiator"},
    {"ramp", "floor"},
    {"rangehood", "range hood"},
    {"raymachine", "x-ray machine"},
    {"readingdesk", "desk"},
    {"receptiondesk", "reception desk"},
    {"refrigerator", "refrigerator"},
    {"roof", "ceiling"},
    {"room", "wall"},
    {"roomceiling", "ceiling"},
    {"roomwall", "wall"},
    {"roomwindow", "window"},
    {"rug", "carpet"},
    {"scrubs", "clothes"},
    {"seasoningbox", "seasoning box"},
    {"securitycamera", "security camera"},
    {"settee", "couch"},
    {"shelf", "shelf"},
    {"shelve", "shelf"},
    {"shoerack", "shoe rack"},
    {"shower", "shower"},
    {"sideboard", "cabinet"},
    {"sidetable", "nightstand"},
    {"sink", "sink"},
    {"sofa", "couch"},
    {"speaker", "speaker"},
    {"sprite", "can"},
    {"stair", "stairs"},
    {"staircase", "stairs"},
    {"stand", "stand"},
    {"stool", "stool"},
    {"storagerack", "shelf"},
    {"storagerackcovered", "shelf"},
    {"storagerackcoveropen", "shelf"},
    {"stove", "oven"},
    {"suitcase", "suitcase"},
    {"surgicaltrolley", "cart"},
    {"surgicaltrolleymed", "cart"},
    {"table", "table"},
    {"tablecoffee", "coffee table"},
    {"tablelamp", "lamp"},
    {"tablet", "tablet"},
    {"tableware", "tableware"},
    {"television", "tv"},
    {"tile", "floor"},
    {"toaster", "toaster"},
    {"toilet", "toilet"},
    {"toiletpaper", "toilet paper"},
    {"towel", "towel"},
    {"trash", "trash bin"},
    {"trashbin", "trash bin"},
    {"trashcan", "trash bin"},
    {"treadmill", "treadmill"},
    {"tree", "tree"},
    {"trolley", "cart"},
    {"trolleybed", "bed"},
    {"trolleybedpatient", "bed"},
    {"tv", "tv"},
    {"tvcabinet", "tv stand"},
    {"tvstand", "tv stand"},
    {"umbrella", "umbrella"},
    {"vase", "vase"},
    {"vendingmachine", "vending machine"},
    {"visitor", "person"},
    {"visitorkidsit", "person"},
    {"visitoronphone", "person"},
    {"visitorsit", "person"},
    {"wall", "wall"},
    {"wardrobe", "wardrobe"},
    {"washer", "washing machine"},
    {"washingmachine", "washing machine"},
    {"wastebasket", "trash bin"},
    {"watercooler", "water dispenser"},
    {"waterdispenser", "water dispenser"},
    {"wheelchair", "wheelchair"},
    {"whiteboard", "whiteboard"},
    {"window", "window"},
});

constexpr auto kStuff =
    std::to_array<std::string_view>({"carpet", "ceiling", "floor", "partition", "wall"});

constexpr std::string_view kUnknown = "unknown";

bool is_upper(char c) { return std::isupper(static_cast<unsigned char>(c)) != 0; }
bool is_lower(char c) { return std::islower(static_cast<unsigned char>(c)) != 0; }
bool is_letter(char c) { return is_upper(c) || is_lower(c); }

/// Whether a new word begins at a letter behind another letter: "tvS|tand", "TV|Stand".
bool begins_word(std::string_view name, std::size_t i) {
  if (!is_upper(name[i])) return false;
  const bool next_is_lower = i + 1 < name.size() && is_lower(name[i + 1]);
  return is_lower(name[i - 1]) || next_is_lower;
}

static_assert(std::is_sorted(kRules.begin(), kRules.end(),
                             [](const Rule& a, const Rule& b) { return a.words < b.words; }));

/// The rule for these words written as one; also that for their singular.
const Rule* rule_for(const std::string& words) {
  const auto find = [](std::string_view word) -> const Rule* {
    const auto* rule =
        std::lower_bound(kRules.begin(), kRules.end(), word,
                         [](const Rule& a, std::string_view b) { return a.words < b; });
    return rule != kRules.end() && rule->words == word ? rule : nullptr;
  };
  if (const Rule* rule = find(words)) return rule;
  const std::string_view text(words);
  if (text.ends_with("es")) {
    if (const Rule* rule = find(text.substr(0, text.size() - 2))) return rule;
  }
  return text.ends_with('s') ? find(text.substr(0, text.size() - 1)) : nullptr;
}

}  // namespace

std::vector<std::string> words_of_name(std::string_view name) {
  std::vector<std::string> words(1);
  for (std::size_t i = 0; i < name.size(); ++i) {
    const bool letter = is_letter(name[i]);
    if (!letter || (i > 0 && is_letter(name[i - 1]) && begins_word(name, i))) {
      words.emplace_back();
    }
    if (letter) {
      words.back() += static_cast<char>(std::tolower(static_cast<unsigned char>(name[i])));
    }
  }
  std::erase_if(words, [](const std::string& w) { return w.size() < 2 || w == "clone"; });
  return words;
}

ModelClass class_named(const std::string& name) {
  const bool stuff = std::find(kStuff.begin(), kStuff.end(), name) != kStuff.end();
  return {name, !stuff, name != kUnknown};
}

ModelClass class_of_model(std::string_view model_name) {
  const std::vector<std::string> words = words_of_name(model_name);
  for (std::size_t end = words.size(); end > 0; --end) {
    for (std::size_t begin = 0; begin < end; ++begin) {
      std::string row;
      for (std::size_t i = begin; i < end; ++i) row += words[i];
      if (const Rule* rule = rule_for(row)) return class_named(std::string(rule->class_name));
    }
  }
  return class_named(std::string(kUnknown));
}

std::uint16_t LabelTable::class_id(const ModelClass& model_class) {
  for (const core::SceneClass& known : scene_.classes) {
    if (known.name == model_class.name) return known.id;
  }
  const auto id = static_cast<std::uint16_t>(scene_.classes.size() + 1);
  scene_.classes.push_back({id, model_class.name, model_class.thing});
  return id;
}

sim::ClassGuess& LabelTable::guess(const std::string& model_name, std::uint16_t class_id) {
  std::string words;
  for (const std::string& word : words_of_name(model_name)) {
    words += (words.empty() ? "" : " ") + word;
  }
  for (sim::ClassGuess& known : scene_.class_guesses) {
    if (known.words == words && known.class_id == class_id) return known;
  }
  return scene_.class_guesses.emplace_back(sim::ClassGuess{words, class_id, 0});
}

LabelTable::Ids LabelTable::add(const std::string& model_name) {
  return add(model_name, class_of_model(model_name));
}

LabelTable::Ids LabelTable::add(const std::string& model_name, const ModelClass& model_class) {
  Ids ids{class_id(model_class), 0};
  if (guess(model_name, ids.class_id).count++ == 0 && !model_class.known) {
    scene_.warnings.push_back("no class is known for the model name " + model_name +
                              ": it is called \"" + model_class.name + "\"");
  }
  if (model_class.thing) {
    if (scene_.instances.size() >= std::numeric_limits<std::uint16_t>::max()) {
      throw core::InputError::expected(scene_.name, "at most 65535 instances", "more");
    }
    ids.instance_id = static_cast<std::uint16_t>(scene_.instances.size() + 1);
    core::SceneInstance instance;
    instance.id = ids.instance_id;
    instance.class_id = ids.class_id;
    instance.name = model_name;
    scene_.instances.push_back(instance);
  }
  return ids;
}

void set_instance_boxes(sim::MeshScene& scene) {
  constexpr double kFar = std::numeric_limits<double>::infinity();
  for (core::SceneInstance& instance : scene.instances) {
    glm::dvec3 low(kFar);
    glm::dvec3 high(-kFar);
    for (const sim::SubMesh& mesh : scene.meshes) {
      if (mesh.instance_id != instance.id) continue;
      for (const glm::vec3& vertex : mesh.positions_m) {
        low = glm::min(low, glm::dvec3(vertex));
        high = glm::max(high, glm::dvec3(vertex));
      }
    }
    if (low.x > high.x) low = high = glm::dvec3(0.0);
    instance.box_min_m = low;
    instance.box_max_m = high;
  }
}

}  // namespace segsim::worlds
