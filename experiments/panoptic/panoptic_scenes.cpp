#include "experiments/panoptic/panoptic_scenes.h"

#include <algorithm>
#include <charconv>
#include <optional>
#include <sstream>

#include "core/error.h"

namespace segsim::experiments::panoptic {
namespace {

namespace fs = std::filesystem;
using core::InputError;

constexpr const char* kSchema = "segsim.table1/1";
constexpr const char* kWhere = "--scenes";
constexpr const char* kPaperScenes =
    "the paper's scenes: ScanNet 0087_02, 0088_00, 0420_01, 0628_02; ScanNet++ 5748ce6f01, "
    "1ada7a0617, f6659a3107";
constexpr const char* kPaperScenesWhy =
    "their licences forbid passing them on; with the data, "
    "`--scenes experiments/scene_lists/table1_paper.yaml --data DIR`";

PanopticScene flat(std::uint64_t seed) {
  PanopticScene scene;
  scene.name = "flat-" + std::to_string(seed);
  scene.title = "Flat " + std::to_string(seed);
  scene.data = "procedural";
  scene.source.type = specs::SourceType::kFlat;
  scene.source.seed = seed;
  scene.source.voxel_m = 0.04;
  scene.source.capture = {.frames = 300, .width_px = 320, .height_px = 240, .hfov_deg = 90.0};
  return scene;
}

PanopticScene house(const fs::path& data) {
  PanopticScene scene;
  scene.name = "house";
  scene.title = "Small house";
  scene.data = "Gazebo";
  scene.source.type = specs::SourceType::kGazebo;
  scene.source.world = data / "small_house" / "worlds" / "small_house.world";
  scene.source.gazebo.options.ceiling = {worlds::CeilingKind::kModel, 2.5,
                                         "aws_robomaker_residential_RoomCeiling_01"};
  scene.source.seed = 1;
  scene.source.voxel_m = 0.025;
  scene.source.capture = {.frames = 420, .width_px = 640, .height_px = 480, .hfov_deg = 90.0};
  return scene;
}

PanopticScene breakroom(const fs::path& data) {
  PanopticScene scene;
  scene.name = "breakroom";
  scene.title = "Break room";
  scene.data = "HoloLens";
  scene.source.type = specs::SourceType::kRgbd;
  scene.source.folder = data / "hololens_breakroom";
  scene.source.boxes = scene.source.folder / "annotation" / "breakroom_boxes.json";
  scene.source.floor_height_m = -1.53;
  scene.source.voxel_m = 0.025;
  return scene;
}

/// Which data set a folder's layout belongs to.
std::string data_set_of(const fs::path& folder) {
  if (fs::is_directory(folder / "pose") && fs::is_directory(folder / "color"))
    return "ScanNet";
  if (fs::is_directory(folder / "dslr") || fs::is_directory(folder / "iphone")) {
    return "ScanNet++";
  }
  if (fs::exists(folder / "traj_w_c.txt") || fs::exists(folder / "traj.txt")) return "Replica";
  return "recording";
}

PanopticScene recording(const fs::path& folder) {
  PanopticScene scene;
  const fs::path plain = folder.has_filename() ? folder : folder.parent_path();
  for (const char c : plain.filename().string()) {
    const bool word = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
                      (c >= '0' && c <= '9') || c == '-' || c == '_';
    scene.name += word ? c : '_';
  }
  scene.title = plain.filename().string();
  scene.data = data_set_of(folder);
  scene.source.type = specs::SourceType::kRgbd;
  scene.source.folder = folder;
  scene.source.voxel_m = 0.025;
  // PanopticRecon++ takes every third frame of ScanNet.
  if (scene.data == "ScanNet") scene.source.frame_step = 3;
  return scene;
}

std::optional<std::uint64_t> flat_seed(const std::string& word) {
  constexpr std::string_view kPrefix = "flat-";
  if (!word.starts_with(kPrefix) || word.size() == kPrefix.size()) return std::nullopt;
  std::uint64_t seed = 0;
  const char* end = word.data() + word.size();
  const auto [stop, error] = std::from_chars(word.data() + kPrefix.size(), end, seed);
  if (error != std::errc() || stop != end) return std::nullopt;
  return seed;
}

PanopticScene named_scene(const std::string& word, const fs::path& data) {
  if (const auto seed = flat_seed(word)) return flat(*seed);
  if (word == "house" || word == "breakroom") {
    if (data.empty()) {
      throw InputError::expected(std::string(kWhere) + " " + word,
                                 "the folder of the data (--data DIR)", "none");
    }
    PanopticScene scene = word == "house" ? house(data) : breakroom(data);
    if (!fs::exists(scene.needs())) {
      throw InputError::expected(scene.needs().string(), "the data of " + word, "nothing");
    }
    return scene;
  }
  if (fs::is_directory(word)) return recording(word);
  const std::string near = core::nearest_word(word, {"house", "breakroom", "flat-3"});
  throw InputError::expected(
      kWhere, "flat-N | house | breakroom | folder of a recording | YAML file",
      "\"" + word + "\"" + (near.empty() ? "" : " (near: " + near + ")"));
}

void add_scene(PanopticScene scene, PanopticScenes& list) {
  for (const PanopticScene& other : list.scenes) {
    if (other.name == scene.name) {
      throw InputError::expected(kWhere, "each scene once", scene.name + " again");
    }
  }
  list.scenes.push_back(std::move(scene));
}

PanopticScenes scenes_of_file(const fs::path& file, const fs::path& data) {
  const core::ConfigNode root = core::ConfigNode::load(file);
  if (root.text("schema") != kSchema) {
    root.child("schema").fail(kSchema, "\"" + root.text("schema") + "\"");
  }
  specs::SpecFolders folders;
  // A place that no file has: scenes that need data are then missing, not an error.
  folders.data = data.empty() ? fs::path("(no --data)") : data;
  PanopticScenes list;
  for (const core::ConfigNode& node : root.child("scenes").as_list()) {
    PanopticScene scene;
    scene.name = node.text("name");
    scene.title = node.text_or("title", scene.name);
    scene.data = node.text("data");
    scene.source = specs::read_source_spec(node.child("source"), folders, file);
    if (node.has("label_map")) {
      scene.label_map = specs::read_spec_path(node.child("label_map"), folders, file);
    }
    if (node.has("masks"))
      scene.masks = specs::read_spec_path(node.child("masks"), folders, file);
    scene.shrink = static_cast<int>(node.integer_or("shrink", 1));
    if (scene.shrink < 1) node.child("shrink").fail("a number >= 1", node.text("shrink"));
    const bool plain = scene.name.find_first_of("/\\ ") == std::string::npos;
    if (!plain || scene.name.empty()) node.child("name").fail("a plain name", scene.name);
    node.finish();
    if (!scene.needs().empty() && !fs::exists(scene.needs())) {
      list.missing.push_back({scene.data + " " + scene.title,
                              "nothing at " + scene.needs().string() +
                                  " (data sets that need a licence are not part of this "
                                  "project)"});
      continue;
    }
    add_scene(std::move(scene), list);
  }
  root.finish();
  if (list.scenes.empty()) {
    throw InputError::expected(
        file.string(), "a scene whose data is there",
        list.missing.empty() ? "no scene"
                             : list.missing.front().title + ": " + list.missing.front().why);
  }
  return list;
}

PanopticScenes default_scenes(const fs::path& data) {
  PanopticScenes list;
  list.scenes = {flat(3), flat(8)};
  for (const PanopticScene& scene : {breakroom(data), house(data)}) {
    if (!data.empty() && fs::exists(scene.needs())) {
      list.scenes.push_back(scene);
    } else {
      list.missing.push_back({scene.title, data.empty()
                                               ? "needs --data DIR"
                                               : "nothing at " + scene.needs().string()});
    }
  }
  return list;
}

}  // namespace

fs::path PanopticScene::needs() const {
  switch (source.type) {
    case specs::SourceType::kFlat:
    case specs::SourceType::kHome:
      return {};
    case specs::SourceType::kGazebo:
    case specs::SourceType::kMesh:
      return source.world;
    case specs::SourceType::kRgbd:
      return source.folder;
  }
  return {};
}

PanopticScenes panoptic_scenes(const std::string& text, const fs::path& data) {
  PanopticScenes list;
  if (text.empty()) {
    list = default_scenes(data);
  } else if (fs::is_regular_file(text)) {
    list = scenes_of_file(text, data);
  } else {
    std::istringstream words(text);
    for (std::string word; std::getline(words, word, ',');) {
      add_scene(named_scene(word, data), list);
    }
  }
  const bool licensed =
      std::any_of(list.scenes.begin(), list.scenes.end(),
                  [](const PanopticScene& s) { return s.data.starts_with("ScanNet"); }) ||
      std::any_of(list.missing.begin(), list.missing.end(),
                  [](const MissingScene& s) { return s.title.starts_with("ScanNet"); });
  if (!licensed) list.missing.push_back({kPaperScenes, kPaperScenesWhy});
  return list;
}

}  // namespace segsim::experiments::panoptic
