#include "experiments/specs/spec.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/check.h"
#include "core/config.h"
#include "core/error.h"
#include "core/file_io.h"
#include "experiments/specs/internal/spec_readers.h"
#include "experiments/specs/tuning_set.h"
#include "experiments/support/numbers_in_range.h"
#include "sim/ground/robot.h"

namespace segsim::experiments::specs {
namespace {

namespace fs = std::filesystem;
using core::ConfigNode;
using internal::Variables;

CameraSpec read_camera(const ConfigNode& root, renderer::Backend usual) {
  CameraSpec camera;
  camera.backend = usual;
  const std::optional<ConfigNode> node = root.optional_child("camera");
  if (!node) return camera;
  camera.width_px = support::count_within(*node, "width", camera.width_px, 16, 8192);
  camera.height_px = support::count_within(*node, "height", camera.height_px, 16, 8192);
  camera.hfov_deg = support::number_within(*node, "hfov_deg", camera.hfov_deg, 10.0, 150.0);
  camera.pitch_down_deg = support::number_within(*node, "pitch_down_deg", 0.0, -60.0, 60.0);
  camera.depth_range_m =
      support::number_within(*node, "depth_range_m", camera.depth_range_m, 0.5, 100.0);
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
    success.distance_m =
        support::number_within(*node, "distance_m", success.distance_m, 0.01, 100.0);
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
      support::count_within(*node, "visible_pixels", success.visible_pixels, 1, 100000000);
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
  frames.every_s = support::number_within(*node, "every_s", frames.every_s, 0.005, 3600.0);
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
  if (!spec.robot.file.empty()) all += "\n" + spec.robot.name;  // It names what the file says.
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

bool has_masks(const SceneSpec& scene) {
  return scene.source && scene.source->masks.has_value();
}

/// What an arm needs whose detector is tuned otherwise than that of `after`.
void check_tuning(const ExperimentSpec& spec, const ArmSpec& arm, const ConfigNode& node) {
  const DetectorSpec& detectors = spec.detectors;
  const bool exact = arm.detector == ArmDetector::kAfterExact;
  if (!exact && !is_tuned_by_scene(arm.detector)) return;
  const ConfigNode detector = node.child("detector");
  if (!detectors.finetune) {
    detector.fail("a section detectors.finetune for " + detector.as_text(), "none");
  }
  if (arm.detector == ArmDetector::kAfterElsewhere && detectors.finetune->scenes.size() < 2) {
    detector.fail(
        "two or more scenes that detectors.finetune is for, so that there are others",
        std::to_string(detectors.finetune->scenes.size()));
  }
  if (exact && std::none_of(spec.scenes.begin(), spec.scenes.end(), has_masks)) {
    detector.fail("a scene with source.masks, without which after-exact is as after", "none");
  }
}

void read_lists(const ConfigNode& root, const Variables& variables, const SpecFolders& folders,
                ExperimentSpec& spec) {
  for (const ConfigNode& node : root.child("scenes").as_list()) {
    SceneSpec scene = internal::read_scene(node, variables, folders, spec.robot);
    check_new_name(spec.scenes, scene.name, node);
    spec.scenes.push_back(std::move(scene));
  }
  if (spec.scenes.empty()) root.child("scenes").fail("at least one scene", "none");
  spec.detectors = internal::read_detectors(root, variables, folders, spec.scenes);
  for (const ConfigNode& node : root.child("arms").as_list()) {
    ArmSpec arm = internal::read_arm(node, variables);
    check_new_name(spec.arms, arm.name, node);
    check_arm_clock(spec.clock, arm.clock, node);
    check_tuning(spec, arm, node);
    spec.arms.push_back(std::move(arm));
  }
  if (spec.arms.empty()) root.child("arms").fail("at least one arm", "none");
}

}  // namespace

const char* to_string(SourceType type) {
  constexpr const char* kNames[] = {"flat", "gazebo", "mesh", "rgbd", "home"};
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
  if (!is_fine_tuned(arm.detector) || !detectors.finetune) return false;
  const std::vector<std::string> tuned = tuning_set(*this, arm.detector, scene).scenes;
  return arm.reconstruction == scene.reconstruction &&
         std::find(tuned.begin(), tuned.end(), scene.family) != tuned.end();
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
  return internal::read_source(node, Variables(folders, file));
}

CameraSpec read_camera_spec(const ConfigNode& root) {
  return read_camera(root, renderer::Backend::kCpu);
}

sim::CollisionMode read_collision_mode(const ConfigNode& root) {
  if (!root.has("collision")) return sim::CollisionMode::kFootprint;
  return static_cast<sim::CollisionMode>(
      core::choice(root, "collision", {"footprint", "navmesh"}));
}

fs::path read_spec_path(const ConfigNode& node, const SpecFolders& folders,
                        const fs::path& file) {
  return Variables(folders, file).expand(node);
}

std::string with_backend(std::string text, renderer::Backend backend) {
  // At the end, so that lines keep their numbers.
  if (!text.empty() && text.back() != '\n') text += '\n';
  return text + "backend: " + renderer::backend_name(backend) + '\n';
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
  spec.name = internal::read_name(root, "name");
  spec.title = root.text_or("title", spec.name);
  if (folders.work.empty()) folders.work = fs::path("out") / spec.name;
  const Variables variables(folders, origin);

  spec.seed = internal::read_seed(root, spec.seed);
  spec.clock =
      read_clock_spec(root, [&](const ConfigNode& path) { return variables.expand(path); });
  if (root.has("robot")) {
    spec.robot = sim::RobotModel::read(
        root.child("robot"), [&](const ConfigNode& node) { return variables.expand(node); });
  }
  read_lists(root, variables, folders, spec);
  if (root.has("policy")) spec.policy = internal::read_policy(root, variables);
  spec.localisation = read_localisation(root);
  spec.sensors = read_sensors(root);
  if (root.has("contact"))
    spec.slide_on_contact = core::choice(root, "contact", {"stop", "slide"}) == 1;
  spec.collision = read_collision_mode(root);
  spec.control_period_s =
      support::number_within(root, "control_period_s", spec.control_period_s, 0.005, 2.0);
  const double steps = spec.control_period_s / 0.005;
  if (std::abs(steps - std::round(steps)) > 1e-6) {
    root.child("control_period_s")
        .fail("a multiple of the simulation step, 0.005 s", root.text("control_period_s"));
  }
  spec.time_limit_s =
      support::number_within(root, "time_limit_s", spec.time_limit_s, 1.0, 100000.0);
  internal::read_repetitions(root, spec);
  internal::read_phrase_model(root, variables, spec);
  if (root.has("backend")) {
    spec.backend = core::choice(root, "backend", {"cpu", "cuda"}) == 1
                       ? renderer::Backend::kCuda
                       : renderer::Backend::kCpu;
  }
  spec.camera = read_camera(root, spec.backend);
  spec.success = read_success(root);
  spec.planned_n = support::count_within(root, "planned_n", 0, 0, 1000000);
  if (root.has("videos")) spec.videos = read_recorded(root, "videos");
  spec.frames = read_frames(root);
  spec.replays = read_replays(root);
  spec.pictures = root.boolean_or("pictures", true);
  internal::read_motion(root, spec);
  root.finish();
  spec.sha256 = spec_hash(spec);
  return spec;
}

}  // namespace segsim::experiments::specs
