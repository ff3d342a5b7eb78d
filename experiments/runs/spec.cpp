#include "experiments/runs/spec.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <set>

#include "core/check.h"
#include "core/config.h"
#include "core/error.h"
#include "core/file_io.h"
#include "experiments/internal/numbers_in_range.h"
#include "renderer/training/heads/panoptic_head.h"
#include "sim/robot.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;
using core::ConfigNode;

/// Replaces ${data}, ${work} and ${spec} in a path.
class Variables {
 public:
  Variables(const SpecFolders& folders, const fs::path& spec_file)
      : values_{{"data", folders.data.string()},
                {"work", folders.work.string()},
                {"spec", spec_file.parent_path().empty() ? std::string(".")
                                                         : spec_file.parent_path().string()}} {
  }

  [[nodiscard]] fs::path expand(const ConfigNode& node) const {
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

 private:
  [[nodiscard]] std::string value_of(const std::string& name, const ConfigNode& node) const {
    for (const auto& [known, value] : values_) {
      if (name != known) continue;
      if (value.empty()) node.fail("the folder of the data (flag --data DIR)", "none");
      return value;
    }
    node.fail("${data}, ${work} or ${spec}", "${" + name + "}");
  }

  std::vector<std::pair<std::string, std::string>> values_;
};

std::uint64_t read_seed(const ConfigNode& node, std::uint64_t fallback) {
  const std::int64_t value = node.integer_or("seed", static_cast<std::int64_t>(fallback));
  if (value < 0) node.child("seed").fail("a seed >= 0", node.text("seed"));
  return static_cast<std::uint64_t>(value);
}

/// A name that can be part of a file name.
std::string read_name(const ConfigNode& node, const std::string& key) {
  const std::string name = node.text(key);
  const bool plain = !name.empty() && std::all_of(name.begin(), name.end(), [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ||
           c == '-' || c == '_';
  });
  if (!plain) node.child(key).fail("letters, digits, - and _", "\"" + name + "\"");
  return name;
}

CaptureSpec read_capture(const ConfigNode& source) {
  CaptureSpec capture;
  const std::optional<ConfigNode> node = source.optional_child("capture");
  if (!node) return capture;
  capture.frames = count_within(*node, "frames", capture.frames, 1, 100000);
  capture.width_px = count_within(*node, "width", capture.width_px, 16, 8192);
  capture.height_px = count_within(*node, "height", capture.height_px, 16, 8192);
  capture.hfov_deg = number_within(*node, "hfov_deg", capture.hfov_deg, 10.0, 150.0);
  capture.camera_height_m =
      number_within(*node, "camera_height_m", capture.camera_height_m, 0.05, 3.0);
  node->finish();
  return capture;
}

ReconstructSpec read_reconstruct(const ConfigNode& node, const Variables& variables) {
  ReconstructSpec reconstruct;
  if (node.has("config")) reconstruct.config = variables.expand(node.child("config"));
  constexpr int kMost = 10'000'000;
  if (node.has("iterations")) {
    reconstruct.iterations = count_within(node, "iterations", 0, 0, kMost);
  }
  if (node.has("label_iterations")) {
    reconstruct.label_iterations = count_within(node, "label_iterations", 1, 1, kMost);
  }
  if (node.has("head")) {
    std::vector<std::string> heads = renderer::panoptic_head_names();
    heads.emplace_back("none");
    reconstruct.head = heads[core::choice(node, "head", heads)];
  }
  reconstruct.seed = read_seed(node, reconstruct.seed);
  node.finish();
  return reconstruct;
}

SourceSpec read_source(const ConfigNode& node, const Variables& variables) {
  SourceSpec source;
  source.type =
      static_cast<SourceType>(core::choice(node, "type", {"flat", "gazebo", "mesh", "rgbd"}));
  switch (source.type) {
    case SourceType::kFlat:
      source.seed = read_seed(node, 0);
      break;
    case SourceType::kGazebo:
    case SourceType::kMesh:
      source.world = variables.expand(node.child("world"));
      source.seed = read_seed(node, 0);  // Of the capture path.
      break;
    case SourceType::kRgbd:
      source.folder = variables.expand(node.child("folder"));
      if (node.has("boxes")) source.boxes = variables.expand(node.child("boxes"));
      source.frame_step = count_within(node, "frame_step", 1, 1, 1000);
      if (node.has("floor_height_m")) {
        source.floor_height_m = number_within(node, "floor_height_m", 0.0, -1000.0, 1000.0);
      }
      break;
  }
  if (source.type != SourceType::kRgbd) source.capture = read_capture(node);
  source.voxel_m = number_within(node, "voxel_m", source.voxel_m, 0.002, 0.5);
  if (const auto reconstruct = node.optional_child("reconstruct")) {
    source.reconstruct = read_reconstruct(*reconstruct, variables);
  }
  node.finish();
  return source;
}

SceneSpec read_scene(const ConfigNode& node, const Variables& variables,
                     const SpecFolders& folders) {
  SceneSpec scene;
  scene.name = read_name(node, "name");
  scene.title = node.text_or("title", scene.name);
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
    scene.goals = node.texts("goals");
    if (scene.goals.empty()) node.child("goals").fail("at least one class name", "none");
  }
  scene.allow_trivial = node.boolean_or("allow_trivial", false);
  scene.episodes = count_within(node, "episodes", scene.episodes, 1, 100000);
  scene.camera_height_m =
      number_within(node, "camera_height_m", scene.camera_height_m, 0.05, 3.0);
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

PretrainSpec read_pretrain(const ConfigNode& node) {
  PretrainSpec pretrain;
  pretrain.seed = read_seed(node, pretrain.seed);
  pretrain.rooms = count_within(node, "rooms", pretrain.rooms, 1, 100000);
  pretrain.views_per_room =
      count_within(node, "views_per_room", pretrain.views_per_room, 1, 100000);
  pretrain.steps = count_within(node, "steps", pretrain.steps, 1, 10000000);
  node.finish();
  return pretrain;
}

FinetuneSpec read_finetune(const ConfigNode& node, const std::vector<SceneSpec>& scenes) {
  FinetuneSpec finetune;
  finetune.seed = read_seed(node, finetune.seed);
  std::vector<std::string> names;
  for (const SceneSpec& scene : scenes) names.push_back(scene.name);
  finetune.scenes = names;
  if (node.has("scenes")) {
    finetune.scenes.clear();
    for (const ConfigNode& element : node.list("scenes")) {
      finetune.scenes.push_back(element.as_text());
      if (std::find(names.begin(), names.end(), finetune.scenes.back()) == names.end()) {
        const std::string near = core::nearest_word(finetune.scenes.back(), names);
        element.fail("the name of a scene of this spec",
                     "\"" + finetune.scenes.back() + "\"" +
                         (near.empty() ? "" : " (near: " + near + ")"));
      }
    }
  }
  finetune.views_per_scene =
      count_within(node, "views_per_scene", finetune.views_per_scene, 1, 100000);
  finetune.width_px = count_within(node, "width", 0, 0, 8192);
  finetune.height_px = count_within(node, "height", 0, 0, 8192);
  finetune.steps = count_within(node, "steps", finetune.steps, 1, 10000000);
  finetune.learning_rate = number_within(node, "learning_rate", 0.0, 0.0, 1.0);
  finetune.mix_share = number_within(node, "mix_share", 0.0, 0.0, 0.9);
  finetune.mix_rooms = count_within(node, "mix_rooms", finetune.mix_rooms, 1, 100000);
  finetune.start_clearance_m = number_within(node, "start_clearance_m", 0.0, 0.0, 10.0);
  node.finish();
  return finetune;
}

DetectorSpec read_detectors(const ConfigNode& root, const Variables& variables,
                            const SpecFolders& folders, const std::vector<SceneSpec>& scenes) {
  DetectorSpec detectors;
  detectors.before = folders.work / "detector-before.bin";
  detectors.after = folders.work / "detector-after.bin";
  const std::optional<ConfigNode> node = root.optional_child("detectors");
  if (!node) return detectors;
  if (node->has("before")) detectors.before = variables.expand(node->child("before"));
  if (node->has("after")) detectors.after = variables.expand(node->child("after"));
  if (const auto child = node->optional_child("pretrain")) {
    detectors.pretrain = read_pretrain(*child);
  }
  if (const auto child = node->optional_child("finetune")) {
    detectors.finetune = read_finetune(*child, scenes);
  }
  node->finish();
  return detectors;
}

nav::PolicySettings read_policy(const ConfigNode& node, const Variables& variables) {
  return nav::read_policy_settings(
      node.child("policy"), [&](const ConfigNode& path) { return variables.expand(path); });
}

ArmSpec read_arm(const ConfigNode& node, const Variables& variables) {
  ArmSpec arm;
  arm.name = read_name(node, "name");
  const std::string detector = node.text("detector");
  if (detector == "before") {
    arm.detector = ArmDetector::kBefore;
  } else if (detector == "after") {
    arm.detector = ArmDetector::kAfter;
  } else if (detector == "oracle") {
    arm.detector = ArmDetector::kOracle;
  } else if (detector.find_first_of("/.$") != std::string::npos) {
    arm.detector = ArmDetector::kFile;
    arm.weights = variables.expand(node.child("detector"));
  } else {
    (void)core::choice(node, "detector",
                       {"before", "after", "oracle", "a path of weights or of a model"});
  }
  if (node.has("policy")) arm.policy = read_policy(node, variables);
  if (node.has("score_threshold")) {
    arm.score_threshold = number_within(node, "score_threshold", 0.5, 0.0, 1.0);
  }
  arm.clock =
      read_arm_clock(node, [&](const ConfigNode& path) { return variables.expand(path); });
  node.finish();
  return arm;
}

CameraSpec read_camera(const ConfigNode& root) {
  CameraSpec camera;
  const std::optional<ConfigNode> node = root.optional_child("camera");
  if (!node) return camera;
  camera.width_px = count_within(*node, "width", camera.width_px, 16, 8192);
  camera.height_px = count_within(*node, "height", camera.height_px, 16, 8192);
  camera.hfov_deg = number_within(*node, "hfov_deg", camera.hfov_deg, 10.0, 150.0);
  camera.pitch_down_deg = number_within(*node, "pitch_down_deg", 0.0, -60.0, 60.0);
  camera.depth_range_m =
      number_within(*node, "depth_range_m", camera.depth_range_m, 0.5, 100.0);
  using renderer::Backend;
  constexpr std::array kBackends{Backend::kCpu, Backend::kCuda, Backend::kAuto};
  if (node->has("backend")) {
    camera.backend = kBackends[core::choice(*node, "backend", {"cpu", "cuda", "auto"})];
  }
  node->finish();
  return camera;
}

SuccessSpec read_success(const ConfigNode& root) {
  SuccessSpec success;
  const std::optional<ConfigNode> node = root.optional_child("success");
  if (!node) return success;
  std::vector<std::string> names;
  for (const sim::SuccessProfile& p : sim::success_profiles()) names.push_back(p.name);
  const sim::SuccessProfile& profile =
      sim::success_profiles()[core::choice(*node, "profile", names)];
  success.profile = profile.name;
  success.distance_m = profile.distance_m;
  success.require_visible = profile.require_visible;
  if (success.profile == SuccessSpec{}.profile) {
    success.distance_m = number_within(*node, "distance_m", success.distance_m, 0.01, 100.0);
    success.require_visible = node->boolean_or("require_visible", true);
  } else {
    // With another number it would not be the rule of that name.
    for (const char* key : {"distance_m", "require_visible"}) {
      if (node->has(key)) {
        node->child(key).fail("none with profile " + profile.name + ", which says \"" +
                                  sim::in_words(profile) + "\"",
                              node->text(key));
      }
    }
  }
  success.visible_pixels =
      count_within(*node, "visible_pixels", success.visible_pixels, 1, 100000000);
  node->finish();
  return success;
}

Recorded read_recorded(const ConfigNode& node, const std::string& key) {
  return static_cast<Recorded>(core::choice(node, key, {"none", "first", "all"}));
}

FramesSpec read_frames(const ConfigNode& root) {
  FramesSpec frames;
  const std::optional<ConfigNode> node = root.optional_child("frames");
  if (!node) return frames;
  frames.of = read_recorded(*node, "of");
  frames.every_s = number_within(*node, "every_s", frames.every_s, 0.005, 3600.0);
  node->finish();
  return frames;
}

ReplaysSpec read_replays(const ConfigNode& root) {
  ReplaysSpec replays;
  const std::optional<ConfigNode> node = root.optional_child("replays");
  if (!node) return replays;
  if (node->has("of")) replays.of = read_recorded(*node, "of");
  replays.images = node->boolean_or("images", false);
  node->finish();
  return replays;
}

/// Of everything that decides what the trials are.
std::string spec_hash(const ExperimentSpec& spec) {
  std::string all = spec.text;
  const auto add = [&all](const std::optional<BudgetFile>& budget) {
    if (budget) all += "\n" + budget->sha256;
  };
  add(spec.clock.budget);
  for (const ArmSpec& arm : spec.arms) add(arm.clock.budget);
  return core::sha256_hex(all);
}

/// Refuses a second element of the same name.
template <class Element>
void check_new_name(const std::vector<Element>& before, const std::string& name,
                    const ConfigNode& node) {
  for (const Element& element : before) {
    if (element.name == name) node.child("name").fail("a new name", "\"" + name + "\" again");
  }
}

void read_lists(const ConfigNode& root, const Variables& variables, const SpecFolders& folders,
                ExperimentSpec& spec) {
  for (const ConfigNode& node : root.child("scenes").as_list()) {
    SceneSpec scene = read_scene(node, variables, folders);
    check_new_name(spec.scenes, scene.name, node);
    spec.scenes.push_back(std::move(scene));
  }
  if (spec.scenes.empty()) root.child("scenes").fail("at least one scene", "none");
  spec.detectors = read_detectors(root, variables, folders, spec.scenes);
  for (const ConfigNode& node : root.child("arms").as_list()) {
    ArmSpec arm = read_arm(node, variables);
    check_new_name(spec.arms, arm.name, node);
    check_arm_clock(spec.clock, arm.clock, node);
    spec.arms.push_back(std::move(arm));
  }
  if (spec.arms.empty()) root.child("arms").fail("at least one arm", "none");
}

}  // namespace

const char* to_string(SourceType type) {
  constexpr const char* kNames[] = {"flat", "gazebo", "mesh", "rgbd"};
  return kNames[static_cast<std::size_t>(type)];
}

core::CameraIntrinsics CameraSpec::intrinsics() const {
  return core::CameraIntrinsics::from_fov(width_px, height_px,
                                          hfov_deg * std::numbers::pi / 180.0);
}

double CameraSpec::pitch_down_rad() const { return pitch_down_deg * std::numbers::pi / 180.0; }

const SceneSpec* ExperimentSpec::find_scene(const std::string& scene_name) const {
  for (const SceneSpec& scene : scenes) {
    if (scene.name == scene_name) return &scene;
  }
  return nullptr;
}

const ArmSpec* ExperimentSpec::find_arm(const std::string& arm_name) const {
  for (const ArmSpec& arm : arms) {
    if (arm.name == arm_name) return &arm;
  }
  return nullptr;
}

bool ExperimentSpec::leaks(const ArmSpec& arm, const SceneSpec& scene) const {
  if (arm.detector != ArmDetector::kAfter || !detectors.finetune) return false;
  const std::vector<std::string>& tuned = detectors.finetune->scenes;
  return std::find(tuned.begin(), tuned.end(), scene.name) != tuned.end();
}

sim::SuccessProfile SuccessSpec::rule() const {
  const sim::SuccessProfile* named = sim::find_success_profile(profile);
  SEGSIM_CHECK(named != nullptr, "a spec names a known profile");
  sim::SuccessProfile rule = *named;
  rule.distance_m = distance_m;
  rule.require_visible = require_visible;
  rule.visible_px = visible_pixels;
  return rule;
}

SourceSpec read_source_spec(const ConfigNode& node, const SpecFolders& folders,
                            const fs::path& file) {
  return read_source(node, Variables(folders, file));
}

CameraSpec read_camera_spec(const ConfigNode& root) { return read_camera(root); }

sim::CollisionMode read_collision_mode(const ConfigNode& root) {
  if (!root.has("collision")) return sim::CollisionMode::kFootprint;
  return static_cast<sim::CollisionMode>(
      core::choice(root, "collision", {"footprint", "navmesh"}));
}

fs::path read_spec_path(const ConfigNode& node, const SpecFolders& folders,
                        const fs::path& file) {
  return Variables(folders, file).expand(node);
}

ExperimentSpec load_spec(const fs::path& file, SpecFolders& folders) {
  return parse_spec(core::read_file(file), file, folders);
}

ExperimentSpec parse_spec(const std::string& text, const fs::path& origin,
                          SpecFolders& folders) {
  const ConfigNode root = ConfigNode::parse(text, origin.string());
  ExperimentSpec spec;
  spec.file = origin;
  spec.text = text;

  (void)core::choice(root, "schema", {ExperimentSpec::kSchema});
  spec.name = read_name(root, "name");
  spec.title = root.text_or("title", spec.name);
  if (folders.work.empty()) folders.work = fs::path("out") / spec.name;
  const Variables variables(folders, origin);

  spec.seed = read_seed(root, spec.seed);
  spec.clock =
      read_clock_spec(root, [&](const ConfigNode& path) { return variables.expand(path); });
  read_lists(root, variables, folders, spec);
  if (root.has("policy")) spec.policy = read_policy(root, variables);
  if (root.has("robot")) {
    spec.robot = root.text("robot");
    (void)core::choice(root, "robot", sim::RobotModel::names());
  }
  spec.localisation = read_localisation(root);
  spec.sensors = read_sensors(root);
  if (root.has("contact"))
    spec.slide_on_contact = core::choice(root, "contact", {"stop", "slide"}) == 1;
  spec.collision = read_collision_mode(root);
  spec.control_period_s =
      number_within(root, "control_period_s", spec.control_period_s, 0.005, 2.0);
  const double steps = spec.control_period_s / 0.005;
  if (std::abs(steps - std::round(steps)) > 1e-6) {
    root.child("control_period_s")
        .fail("a multiple of the simulation step, 0.005 s", root.text("control_period_s"));
  }
  spec.time_limit_s = number_within(root, "time_limit_s", spec.time_limit_s, 1.0, 100000.0);
  spec.repetitions = count_within(root, "repetitions", spec.repetitions, 1, 10000);
  spec.camera = read_camera(root);
  spec.success = read_success(root);
  spec.planned_n = count_within(root, "planned_n", 0, 0, 1000000);
  if (root.has("videos")) spec.videos = read_recorded(root, "videos");
  spec.frames = read_frames(root);
  spec.replays = read_replays(root);
  spec.pictures = root.boolean_or("pictures", true);
  root.finish();
  spec.sha256 = spec_hash(spec);
  return spec;
}

}  // namespace segsim::experiments
