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
  std::string_view word;  ///< Lower case, without blanks, '_' and '-'.
  std::string_view class_name;
  bool thing = true;
};

constexpr bool kStuff = false;

constexpr auto kRules = std::to_array<Rule>({
    {"airconditioner", "air conditioner"},
    {"armchair", "chair"},
    {"balconytable", "table"},
    {"ball", "ball"},
    {"basin", "sink"},
    {"bath", "bathtub"},
    {"bed", "bed"},
    {"bench", "bench"},
    {"board", "board"},
    {"bookcase", "bookshelf"},
    {"bookshelf", "bookshelf"},
    {"book", "book"},
    {"cabinet", "cabinet"},
    {"carpet", "carpet", kStuff},
    {"ceiling", "ceiling", kStuff},
    {"ceilinglamp", "lamp"},
    {"chair", "chair"},
    {"chandelier", "lamp"},
    {"coffeetable", "coffee table"},
    {"cookingbench", "kitchen counter"},
    {"counter", "kitchen counter"},
    {"couch", "couch"},
    {"curtain", "curtain"},
    {"desk", "desk"},
    {"deskportrait", "picture"},
    {"diningtable", "dining table"},
    {"door", "door"},
    {"doorway", "door"},
    {"dumbbell", "dumbbell"},
    {"fitnessbench", "fitness bench"},
    {"fitnessequipment", "fitness bench"},
    {"floor", "floor", kStuff},
    {"floorlamp", "lamp"},
    {"foldingdoor", "door"},
    {"fridge", "refrigerator"},
    {"handle", "handle"},
    {"housewall", "wall", kStuff},
    {"kitchencabinet", "kitchen cabinet"},
    {"kitchencounter", "kitchen counter"},
    {"kitchenfridge", "refrigerator"},
    {"kitchensink", "sink"},
    {"kitchentable", "dining table"},
    {"kitchenutensils", "kitchen utensils"},
    {"lamp", "lamp"},
    {"laptop", "laptop"},
    {"light", "lamp"},
    {"loungechair", "chair"},
    {"loungesofa", "couch"},
    {"microwave", "microwave"},
    {"nightstand", "nightstand"},
    {"oven", "oven"},
    {"picture", "picture"},
    {"pillow", "pillow"},
    {"plant", "potted plant"},
    {"portrait", "picture"},
    {"pottedplant", "potted plant"},
    {"quilt", "quilt"},
    {"rangehood", "range hood"},
    {"readingdesk", "desk"},
    {"refrigerator", "refrigerator"},
    {"roomceiling", "ceiling", kStuff},
    {"roomwall", "wall", kStuff},
    {"roomwindow", "window"},
    {"rug", "carpet", kStuff},
    {"seasoningbox", "seasoning box"},
    {"securitycamera", "security camera"},
    {"shelf", "bookshelf"},
    {"shoerack", "shoe rack"},
    {"shower", "shower"},
    {"sidetable", "nightstand"},
    {"sink", "sink"},
    {"sofa", "couch"},
    {"stool", "stool"},
    {"stove", "oven"},
    {"table", "table"},
    {"tablelamp", "lamp"},
    {"tablecoffee", "coffee table"},
    {"tablet", "tablet"},
    {"tableware", "tableware"},
    {"television", "tv"},
    {"toilet", "toilet"},
    {"trash", "trash bin"},
    {"tv", "tv"},
    {"tvcabinet", "tv stand"},
    {"tvstand", "tv stand"},
    {"vase", "vase"},
    {"wall", "wall", kStuff},
    {"wardrobe", "wardrobe"},
    {"washer", "washing machine"},
    {"washingmachine", "washing machine"},
    {"window", "window"},
});

constexpr std::string_view kVendorPrefix = "awsrobomakerresidential";

std::string letters_only(std::string_view name) {
  std::string letters;
  for (const char c : name) {
    const auto byte = static_cast<unsigned char>(c);
    if (std::isalnum(byte) != 0) letters += static_cast<char>(std::tolower(byte));
  }
  if (letters.starts_with(kVendorPrefix)) letters.erase(0, kVendorPrefix.size());
  return letters;
}

template <class Fits>
const Rule* longest_rule(const Fits& fits) {
  const Rule* best = nullptr;
  for (const Rule& rule : kRules) {
    if ((best == nullptr || rule.word.size() > best->word.size()) && fits(rule.word))
      best = &rule;
  }
  return best;
}

}  // namespace

ModelClass class_of_model(std::string_view model_name) {
  const std::string name = letters_only(model_name);
  const Rule* rule =
      longest_rule([&](std::string_view word) { return name.starts_with(word); });
  if (rule == nullptr) {
    rule = longest_rule([&](std::string_view word) {
      // Two letters occur in too many other words.
      return word.size() > 2 && name.find(word) != std::string::npos;
    });
  }
  if (rule == nullptr) return {"object", true, false};
  return {rule->class_name, rule->thing, true};
}

std::uint16_t LabelTable::class_id(const ModelClass& model_class) {
  for (const core::SceneClass& known : scene_.classes) {
    if (known.name == model_class.name) return known.id;
  }
  const auto id = static_cast<std::uint16_t>(scene_.classes.size() + 1);
  scene_.classes.push_back({id, std::string(model_class.name), model_class.thing});
  return id;
}

LabelTable::Ids LabelTable::add(const std::string& model_name) {
  const ModelClass model_class = class_of_model(model_name);
  if (!model_class.known) {
    scene_.warnings.push_back("no class is known for the model name " + model_name +
                              ": it is called \"object\"");
  }
  Ids ids{class_id(model_class), 0};
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
