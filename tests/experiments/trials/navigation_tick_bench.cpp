/// What navigation costs on what it is given in `segsim run`: depth rendered from a
/// reconstructed flat, the boxes that a detector makes in those very images, and the policies
/// with the value scorer that a spec gives them. Whole trials run (sim/trial/trial.h), but
/// only Policy::decide() is timed: drawing, detecting and the simulator are not in the
/// figures.
///
///     BM_NavigationTick/<place>/<policy>/<detector>    a decision; images of 640 x 480
///     BM_ReplayedSearch/...    500 recorded decisions once more; images of the spec's size
///
/// The label is a hash over all ticks of the trials: equal hashes, equal decisions. The flat
/// is captured and lifted at first use (a minute), into the folder SEGSIM_BENCH_WORK if that
/// is set, else into one that is removed again.

#include <algorithm>
#include <array>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <string>
#include <vector>

#include <benchmark/benchmark.h>

#include "core/quantile.h"
#include "core/random.h"
#include "experiments/runs/prepare.h"
#include "experiments/trials/trial_options.h"
#include "experiments/trials/trial_runner.h"
#include "nav/policies/policy_registry.h"
#include "perception/detector/detector.h"
#include "renderer/cpu_renderer.h"
#include "sim/trial/oracle_detector.h"
#include "sim/trial/thing_names.h"
#include "tests/experiments/tiny_scene.h"
#include "tests/experiments/tiny_spec.h"
#include "tests/thread_time.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;
using tests::thread_cpu_s;

constexpr std::size_t kTicks = 1000, kSmokeTicks = 40, kReplayed = 500;

/// A scene with its episodes, as a run has them in memory.
struct Place {
  specs::ExperimentSpec spec;
  std::unique_ptr<trials::LoadedScene> scene;
  std::size_t ticks = kTicks;
};

const fs::path& work_folder() {
  static const TemporaryFolder temporary("navigation_bench");
  static const char* const given = std::getenv("SEGSIM_BENCH_WORK");
  static const fs::path folder = given != nullptr ? fs::path(given) : temporary.path();
  return folder;
}

std::unique_ptr<Place> make_flat() {
  auto place = std::make_unique<Place>();
  specs::SpecFolders folders{{}, work_folder() / "flat"};
  place->spec = specs::load_spec(fs::path(SEGSIM_SPECS) / "policies.yaml", folders);
  const specs::SceneSpec& scene = place->spec.scenes.front();
  const fs::path bundle = runs::prepare_scene(place->spec, scene, folders.work);
  place->scene = std::make_unique<trials::LoadedScene>(
      trials::load_scene(place->spec, scene, bundle, folders.work));
  return place;
}

/// Two rooms of a few surfels: the benchmark's own test.
std::unique_ptr<Place> make_tiny() {
  auto place = std::make_unique<Place>();
  specs::SpecFolders folders{work_folder(), work_folder() / "tiny_work"};
  const fs::path bundle = TinyScene().write(work_folder() / "tiny");
  place->spec = specs::parse_spec(TinySpec().text(), "tiny.yaml", folders);
  place->scene = std::make_unique<trials::LoadedScene>(
      trials::load_scene(place->spec, place->spec.scenes.front(), bundle, folders.work));
  place->ticks = kSmokeTicks;
  return place;
}

Place& place_called(const std::string& name) {
  if (name == "tiny") {
    static const std::unique_ptr<Place> tiny = make_tiny();
    return *tiny;
  }
  static const std::unique_ptr<Place> flat = make_flat();
  return *flat;
}

/// As TrialRunner makes them.
struct Eyes {
  std::unique_ptr<core::Detector> detector;
  sim::GroundTruthSink* truth = nullptr;
};

Eyes make_eyes(const Place& place, const std::string& name) {
  if (name == "small") {
    return {perception::load_detector(fs::path(SEGSIM_SPECS) /
                                      "../../perception/weights/source_rooms.weights"),
            nullptr};
  }
  const std::vector<core::SceneClass>& classes = place.scene->bundle.manifest.classes;
  sim::OracleDetectorOptions options;
  options.min_pixels = place.spec.success.visible_pixels;
  options.seed = place.spec.seed;
  auto oracle =
      std::make_unique<sim::OracleDetector>(classes, sim::thing_names(classes), options);
  sim::GroundTruthSink* const truth = oracle.get();
  return {std::move(oracle), truth};
}

std::unique_ptr<core::Policy> make_policy(const Place& place, const std::string& type,
                                          const core::Detector& detector) {
  nav::PolicyContext context;
  context.class_names = detector.class_names();
  context.robot = place.spec.robot;
  context.camera_height_m = place.spec.scenes.front().camera_height_m;
  return nav::PolicyRegistry::instance().usual(type).make(context);
}

/// What a policy was given at one tick, to keep.
struct Given {
  core::Observation observation;
  core::Image<float> depth_m;
  std::vector<core::Detection> detections;
  core::Decision answer;
};
struct Search {
  core::ObjectGoal goal;
  std::uint64_t seed = 0;
  std::vector<Given> ticks;
};

/// Times the decisions of the policy behind it, and keeps what it was given if asked to.
class WatchedPolicy final : public core::Policy {
 public:
  explicit WatchedPolicy(bool keeps) : keeps_(keeps) {}
  /// Of the next trial; a run makes a new one for each, too.
  void begin(std::unique_ptr<core::Policy> inner) { inner_ = std::move(inner); }

  void reset(const core::ObjectGoal& goal, std::uint64_t seed) override {
    inner_->reset(goal, seed);
    goal_ = goal;
    if (keeps_) searches.push_back({goal, seed, {}});
  }
  [[nodiscard]] core::Decision decide(const core::Observation& observation,
                                      std::span<const core::Detection> detections) override {
    const double start_s = thread_cpu_s();
    core::Decision decision = inner_->decide(observation, detections);
    ms.push_back(1e3 * (thread_cpu_s() - start_s));
    boxes += static_cast<double>(detections.size());
    if (std::any_of(detections.begin(), detections.end(), [&](const core::Detection& d) {
          return d.class_index == goal_.class_index;
        })) {
      goal_ticks += 1.0;
    }
    if (keeps_) {
      searches.back().ticks.push_back({observation,
                                       *observation.depth_m,
                                       {detections.begin(), detections.end()},
                                       decision});
      searches.back().ticks.back().observation.rgb = nullptr;  // No policy looks at it.
    }
    return decision;
  }
  [[nodiscard]] core::PolicyView view() const override { return inner_->view(); }

  std::vector<double> ms;
  double boxes = 0.0;       ///< Of any class, over all ticks.
  double goal_ticks = 0.0;  ///< With a box of the goal.
  std::vector<Search> searches;

 private:
  bool keeps_;
  std::unique_ptr<core::Policy> inner_;
  core::ObjectGoal goal_;
};

/// Trials of the place's episodes, one after another, until there are enough ticks.
/// @return  A hash of all that happened.
std::uint64_t run_trials(const Place& place, const core::CameraIntrinsics& camera,
                         const std::string& policy_type, const std::string& detector_name,
                         std::size_t ticks, WatchedPolicy& watched) {
  const Eyes eyes = make_eyes(place, detector_name);
  renderer::RenderOptions render;
  render.threads = 1;
  const auto renderer =
      renderer::make_cpu_renderer(place.scene->surfels, render, place.scene->labels);
  sim::TrialOptions options = trials::base_trial_options(
      place.spec, place.spec.scenes.front().camera_height_m, nullptr);
  options.camera = camera;
  std::uint64_t hash = 0;
  for (const sim::Episode& episode : place.scene->episodes.episodes) {
    if (watched.ms.size() >= ticks) break;
    watched.begin(make_policy(place, policy_type, *eyes.detector));
    const sim::World& world = place.scene->world;
    const sim::TrialResult result = sim::run_trial({.episode = episode,
                                                    .options = options,
                                                    .world = world,
                                                    .robot = world.robot(),
                                                    .renderer = *renderer,
                                                    .detector = *eyes.detector,
                                                    .policy = watched,
                                                    .truth = eyes.truth});
    hash = core::hash64(std::to_string(result.state_hash), hash);
  }
  return hash;
}

void tell(benchmark::State& state, const WatchedPolicy& watched, std::uint64_t hash) {
  const auto ticks = static_cast<double>(watched.ms.size());
  state.counters["ticks"] = ticks;
  state.counters["boxes"] = watched.boxes / ticks;
  state.counters["goal_share"] = watched.goal_ticks / ticks;
  char text[24];
  std::snprintf(text, sizeof text, "%016llx", static_cast<unsigned long long>(hash));
  state.SetLabel(text);
}

void BM_NavigationTick(benchmark::State& state, const std::string& place_name,
                       const std::string& policy, const std::string& detector) {
  perception::set_threads(1);  // OpenCV's as well: all work is this thread's.
  const Place& place = place_called(place_name);
  const core::CameraIntrinsics camera = place.spec.camera.intrinsics().resized(640, 480);
  for (auto _ : state) {
    WatchedPolicy watched(false);
    const std::uint64_t hash =
        run_trials(place, camera, policy, detector, place.ticks, watched);
    tell(state, watched, hash);
    state.SetIterationTime(1e-3 * core::interpolated_quantile(watched.ms, 0.99));
    state.counters["p50_ms"] = core::interpolated_quantile(watched.ms, 0.5);
    state.counters["p99_ms"] = core::interpolated_quantile(watched.ms, 0.99);
    state.counters["max_ms"] = core::interpolated_quantile(watched.ms, 1.0);
  }
}

bool same(const core::Decision& a, const core::Decision& b) {
  return a.command.forward_mps == b.command.forward_mps &&
         a.command.turn_radps == b.command.turn_radps && a.mode == b.mode && a.stop == b.stop;
}

/// The searches again, from what was kept of them. @return  How many decisions differ.
std::size_t replay(const Place& place, const std::string& policy_type,
                   const core::Detector& detector, const std::vector<Search>& searches,
                   std::size_t ticks, double& took_s) {
  std::size_t replayed = 0, different = 0;
  const double start_s = thread_cpu_s();
  for (const Search& search : searches) {
    const auto policy = make_policy(place, policy_type, detector);
    policy->reset(search.goal, search.seed);
    for (const Given& given : search.ticks) {
      if (replayed++ == ticks) break;
      core::Observation observation = given.observation;
      observation.depth_m = &given.depth_m;
      const core::Decision decision = policy->decide(observation, given.detections);
      different += same(decision, given.answer) ? 0 : 1;
    }
    if (replayed > ticks) break;
  }
  took_s = thread_cpu_s() - start_s;
  return different;
}

void BM_ReplayedSearch(benchmark::State& state, const std::string& place_name,
                       const std::string& policy, const std::string& detector) {
  perception::set_threads(1);
  const Place& place = place_called(place_name);
  WatchedPolicy watched(true);
  const std::uint64_t hash = run_trials(place, place.spec.camera.intrinsics(), policy,
                                        detector, std::min(place.ticks, kReplayed), watched);
  const Eyes eyes = make_eyes(place, detector);
  for (auto _ : state) {
    double took_s = 0.0;
    if (replay(place, policy, *eyes.detector, watched.searches,
               std::min(place.ticks, kReplayed), took_s) > 0) {
      state.SkipWithError("another decision than in the trial");
    }
    state.SetIterationTime(took_s);
  }
  tell(state, watched, hash);
}

/// Every case with both benchmarks; replays are repeated, as they cost nothing.
[[maybe_unused]] const bool kRegistered = [] {
  const std::array<std::array<const char*, 3>, 6> cases{{{"tiny", "vlfm", "oracle"},
                                                         {"flat", "vlfm", "oracle"},
                                                         {"flat", "vlfm", "small"},
                                                         {"flat", "frontier-value", "oracle"},
                                                         {"flat", "frontier", "oracle"},
                                                         {"flat", "frontier", "small"}}};
  for (const auto& [place, policy, detector] : cases) {
    const std::string name = std::string("/") + place + "/" + policy + "/" + detector;
    benchmark::RegisterBenchmark(("BM_NavigationTick" + name).c_str(), BM_NavigationTick,
                                 place, policy, detector)
        ->UseManualTime()
        ->Iterations(1)
        ->Unit(benchmark::kMillisecond);
    benchmark::RegisterBenchmark(("BM_ReplayedSearch" + name).c_str(), BM_ReplayedSearch,
                                 place, policy, detector)
        ->UseManualTime()
        ->Iterations(5)
        ->Unit(benchmark::kMillisecond);
  }
  return true;
}();

}  // namespace
}  // namespace segsim::experiments
