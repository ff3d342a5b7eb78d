// Scenes of a spec and where they come from.
#include <algorithm>

#include "experiments/specs/gazebo_spec.h"
#include "experiments/specs/home_spec.h"
#include "experiments/specs/internal/spec_readers.h"
#include "experiments/support/numbers_in_range.h"
#include "reconstruction/labels/panoptic_head.h"

namespace segsim::experiments::specs::internal {
namespace {

namespace fs = std::filesystem;
using core::ConfigNode;

CaptureSpec read_capture(const ConfigNode& source) {
  CaptureSpec capture;
  const std::optional<ConfigNode> node = source.optional_child("capture");
  if (!node) return capture;
  capture.frames = support::count_within(*node, "frames", capture.frames, 1, 100000);
  capture.width_px = support::count_within(*node, "width", capture.width_px, 16, 8192);
  capture.height_px = support::count_within(*node, "height", capture.height_px, 16, 8192);
  capture.hfov_deg = support::number_within(*node, "hfov_deg", capture.hfov_deg, 10.0, 150.0);
  capture.camera_height_m =
      support::number_within(*node, "camera_height_m", capture.camera_height_m, 0.05, 3.0);
  node->finish();
  return capture;
}

GazeboSpec read_gazebo(const ConfigNode& source, const Variables& variables) {
  GazeboSpec gazebo;
  worlds::GazeboImportOptions& options = gazebo.options;
  for (const ConfigNode& folder : source.list("resource_paths")) {
    options.resource_paths.push_back(variables.expand(folder));
  }
  if (source.has("on_missing")) {
    const ConfigNode node = source.child("on_missing");
    options.on_missing = parse_on_missing(node.as_text(), node.where());
  }
  if (source.has("ceiling")) {
    const ConfigNode node = source.child("ceiling");
    options.ceiling = parse_ceiling(node.as_text(), node.where());
  }
  if (source.has("class_map")) gazebo.class_map = variables.expand(source.child("class_map"));
  return gazebo;
}

HomeSpec read_home(const ConfigNode& source, const Variables& variables) {
  HomeSpec home;
  if (source.has("plan")) {
    const ConfigNode node = source.child("plan");
    home.plan = worlds::kHomePlanNames.read(node.as_text(), node.where());
  }
  home.rooms = support::count_within(source, "rooms", 0, 0, 8);
  if (source.has("furniture")) {
    const ConfigNode node = source.child("furniture");
    parse_furniture(node.as_text(), node.where(), home);
  }
  if (source.has("furniture_folder")) {
    home.furniture_folder = variables.expand(source.child("furniture_folder"));
  }
  return home;
}

ReconstructSpec read_reconstruct(const ConfigNode& node, const Variables& variables) {
  ReconstructSpec reconstruct;
  if (node.has("config")) reconstruct.config = variables.expand(node.child("config"));
  constexpr int kMost = 10'000'000;
  if (node.has("iterations")) {
    reconstruct.iterations = support::count_within(node, "iterations", 0, 0, kMost);
  }
  if (node.has("label_iterations")) {
    reconstruct.label_iterations =
        support::count_within(node, "label_iterations", 1, 1, kMost);
  }
  if (node.has("head")) {
    std::vector<std::string> heads = reconstruction::panoptic_head_names();
    heads.emplace_back("none");
    reconstruct.head = heads[core::choice(node, "head", heads)];
  }
  reconstruct.seed = read_seed(node, reconstruct.seed);
  node.finish();
  return reconstruct;
}

/// One of the keys of MaskSource.
MaskSpec read_masks(const ConfigNode& node, const Variables& variables) {
  MaskSpec masks;
  const auto simulate = node.optional_child("simulate");
  const auto detect = node.optional_child("detect");
  const bool folder = node.has("folder");
  const int given = static_cast<int>(simulate.has_value()) +
                    static_cast<int>(detect.has_value()) + static_cast<int>(folder);
  if (given != 1) {
    node.fail("one of the keys simulate, folder and detect", std::to_string(given));
  }
  if (simulate) {
    masks.level = support::number_within(*simulate, "level", masks.level, 0.0, 10.0);
    masks.fit = simulate->boolean_or("fit", false);
    masks.seed = read_seed(*simulate, masks.seed);
    simulate->finish();
  } else if (folder) {
    masks.source = MaskSource::kFolder;
    masks.folder = variables.expand(node.child("folder"));
  } else {
    masks.source = MaskSource::kDetect;
    masks.detector = variables.expand(detect->child("detector"));
    masks.prompt = detect->text_or("prompt", "");
    if (detect->has("threshold")) {
      masks.score_threshold =
          static_cast<float>(support::number_within(*detect, "threshold", 0.0, 0.0, 1.0));
    }
    detect->finish();
  }
  node.finish();
  return masks;
}

}  // namespace

Variables::Variables(const SpecFolders& folders, const fs::path& spec_file)
    : values_{{"data", folders.data.string()},
              {"work", folders.work.string()},
              {"spec", spec_file.parent_path().empty() ? std::string(".")
                                                       : spec_file.parent_path().string()}} {}

fs::path Variables::expand(const ConfigNode& node) const {
  std::string text = node.as_text();
  for (std::size_t start = text.find("${"); start != std::string::npos;
       start = text.find("${", start)) {
    const std::size_t end = text.find('}', start);
    if (end == std::string::npos) node.fail("a closing } after ${", "\"" + text + "\"");
    const std::string name = text.substr(start + 2, end - start - 2);
    const std::string value = value_of(name, node);
    text.replace(start, end - start + 1, value);
    start += value.size();
  }
  return fs::path(text).lexically_normal();
}

std::string Variables::value_of(const std::string& name, const ConfigNode& node) const {
  for (const auto& [known, value] : values_) {
    if (name != known) continue;
    if (value.empty()) node.fail("the folder of the data (flag --data DIR)", "none");
    return value;
  }
  node.fail("${data}, ${work} or ${spec}", "${" + name + "}");
}

std::uint64_t read_seed(const ConfigNode& node, std::uint64_t fallback) {
  const std::int64_t value = node.integer_or("seed", static_cast<std::int64_t>(fallback));
  if (value < 0) node.child("seed").fail("a seed >= 0", node.text("seed"));
  return static_cast<std::uint64_t>(value);
}

/// A name that can be part of a file name.
std::string read_name(const ConfigNode& node, const std::string& key) {
  std::string name = node.text(key);
  const bool plain = !name.empty() && std::all_of(name.begin(), name.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
           c == '-' || c == '_';
  });
  if (!plain) node.child(key).fail("letters, digits, - and _", "\"" + name + "\"");
  return name;
}

SourceSpec read_source(const ConfigNode& node, const Variables& variables) {
  SourceSpec source;
  source.type = static_cast<SourceType>(
      core::choice(node, "type", {"flat", "gazebo", "mesh", "rgbd", "home"}));
  switch (source.type) {
    case SourceType::kFlat:
      source.seed = read_seed(node, 0);
      break;
    case SourceType::kHome:
      source.seed = read_seed(node, 0);
      source.home = read_home(node, variables);
      break;
    case SourceType::kGazebo:
      source.gazebo = read_gazebo(node, variables);
      [[fallthrough]];
    case SourceType::kMesh:
      source.world = variables.expand(node.child("world"));
      source.seed = read_seed(node, 0);  // Of the capture path.
      break;
    case SourceType::kRgbd:
      source.folder = variables.expand(node.child("folder"));
      if (node.has("boxes")) source.boxes = variables.expand(node.child("boxes"));
      source.frame_step = support::count_within(node, "frame_step", 1, 1, 1000);
      if (node.has("floor_height_m")) {
        source.floor_height_m =
            support::number_within(node, "floor_height_m", 0.0, -1000.0, 1000.0);
      }
      source.rig = read_rig(node, variables);
      break;
  }
  if (source.type != SourceType::kRgbd) source.capture = read_capture(node);
  source.voxel_m = support::number_within(node, "voxel_m", source.voxel_m, 0.002, 0.5);
  if (const auto reconstruct = node.optional_child("reconstruct")) {
    source.reconstruct = read_reconstruct(*reconstruct, variables);
  }
  if (const auto masks = node.optional_child("masks")) {
    source.masks = read_masks(*masks, variables);
    if (!source.reconstruct || source.reconstruct->head == "none") {
      masks->fail(
          "source.reconstruct with a head beside it: labels of single views agree by "
          "training",
          source.reconstruct ? "head none" : "none");
    }
  }
  node.finish();
  return source;
}

SceneSpec read_scene(const ConfigNode& node, const Variables& variables,
                     const SpecFolders& folders, const sim::RobotModel& robot) {
  SceneSpec scene;
  scene.name = scene.family = read_name(node, "name");
  scene.title = node.text_or("title", scene.name);
  if (node.has("pool")) scene.pool = read_name(node, "pool");
  scene.bundle = node.has("bundle") ? variables.expand(node.child("bundle"))
                                    : folders.work / "scenes" / scene.name;
  if (const auto source = node.optional_child("source")) {
    scene.source = read_source(*source, variables);
  }
  if (node.has("episode_file")) {
    scene.episode_file = variables.expand(node.child("episode_file"));
    for (const char* key : {"goals", "episodes", "start_distance_m", "allow_visible_start"}) {
      if (node.has(key)) node.child(key).fail("no rule beside episode_file", key);
    }
  } else {
    read_goals(node, scene);
  }
  scene.allow_trivial = node.boolean_or("allow_trivial", false);
  scene.episodes = support::count_within(node, "episodes", scene.episodes, 1, 100000);
  scene.camera_height_m =
      support::number_within(node, "camera_height_m", robot.camera_height_m, 0.05, 3.0);
  if (node.has("start_distance_m")) {
    const std::vector<double> range = node.numbers("start_distance_m");
    if (range.size() != 2 || range[0] < 0.0 || range[1] <= range[0]) {
      node.child("start_distance_m").fail("[nearest, farthest] in metres", "another list");
    }
    scene.min_start_distance_m = range[0];
    scene.max_start_distance_m = range[1];
  }
  scene.allow_visible_start = node.boolean_or("allow_visible_start", false);
  node.finish();
  return scene;
}

}  // namespace segsim::experiments::specs::internal
