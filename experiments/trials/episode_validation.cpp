#include "experiments/trials/episode_validation.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>
#include <mutex>
#include <thread>

#include <glm/geometric.hpp>

#include "core/error.h"
#include "core/progress.h"
#include "experiments/trials/trial_runner.h"
#include "renderer/cpu_renderer.h"

namespace segsim::experiments::trials {
namespace {

/// An experiment with one scene and the oracle-path arm.
specs::ExperimentSpec spec_for(const std::filesystem::path& file,
                               const episodes::EpisodeSet& set,
                               const ValidationOptions& options) {
  const episodes::EpisodeViewer& viewer = set.viewer ? *set.viewer : options.viewer;
  specs::ExperimentSpec spec;
  spec.name = spec.title = "validation";
  specs::SceneSpec scene;
  scene.name = scene.title = set.scene;
  scene.episode_file = file;
  scene.camera_height_m = viewer.camera_height_m;
  spec.scenes.push_back(scene);
  specs::ArmSpec arm;
  arm.name = "oracle-path";
  arm.policy = nav::PolicyRegistry::instance().usual("oracle-path");
  spec.arms.push_back(arm);
  const std::string& robot = options.robot.empty() ? set.robot : options.robot;
  spec.robot = sim::RobotModel::by_name(robot.empty() ? "jackal-gentle" : robot);
  spec.camera.width_px = viewer.camera.width_px;
  spec.camera.height_px = viewer.camera.height_px;
  constexpr double kDegrees = 180.0 / 3.14159265358979323846;
  spec.camera.hfov_deg = viewer.camera.horizontal_fov_rad() * kDegrees;
  spec.camera.pitch_down_deg = viewer.camera_pitch_down_rad * kDegrees;
  const sim::SuccessProfile* profile = sim::find_success_profile(options.profile);
  if (profile == nullptr) {
    std::string names;
    for (const sim::SuccessProfile& p : sim::success_profiles()) {
      names += (names.empty() ? "" : " | ") + p.name;
    }
    throw core::InputError::expected("--profile", names, "\"" + options.profile + "\"");
  }
  spec.success = {profile->name, profile->distance_m, profile->require_visible,
                  profile->visible_px};
  spec.control_period_s = options.control_period_s;
  spec.time_limit_s = options.time_limit_s;
  return spec;
}

/// The oracle-path arm needs images only where its way ends, to turn to the goal: elsewhere
/// nothing is drawn, which makes a validation about ten times as fast. The trials are the
/// same.
class NearGoalRenderer final : public core::Renderer {
 public:
  static constexpr double kNear_m = 0.6;  // Several times the follower's goal tolerance.

  explicit NearGoalRenderer(std::unique_ptr<core::Renderer> scene)
      : scene_(std::move(scene)) {}
  void aim_at(const std::vector<glm::dvec2>& view_points_m) {
    view_points_m_ = &view_points_m;
  }

  void render(const core::CameraPose& T_world_camera, const core::CameraIntrinsics& intrinsics,
              core::Channels channels, core::Frame& frame) override {
    const glm::dvec2 at_m(T_world_camera.translation_m());
    const bool near =
        std::any_of(view_points_m_->begin(), view_points_m_->end(),
                    [&](const glm::dvec2& p_m) { return glm::distance(p_m, at_m) < kNear_m; });
    if (near) {
      scene_->render(T_world_camera, intrinsics, channels, frame);
      return;
    }
    const int width = intrinsics.width_px, height = intrinsics.height_px;
    frame.intrinsics = intrinsics;
    frame.T_world_camera = T_world_camera;
    frame.rgb = core::Image<core::Rgb8>(width, height);
    frame.depth_m = core::Image<float>(width, height, std::numeric_limits<float>::quiet_NaN());
    frame.alpha = core::Image<float>(width, height, 1.0F);
    frame.semantic = core::Image<std::uint16_t>(width, height);
    frame.instance = core::Image<std::uint16_t>(width, height);
  }

 private:
  std::unique_ptr<core::Renderer> scene_;
  const std::vector<glm::dvec2>* view_points_m_ = nullptr;
};

/// Runs the tasks on some threads; rows in the order of the tasks.
std::vector<records::TrialRow> run_all(const specs::ExperimentSpec& spec,
                                       const std::vector<TrialTask>& tasks, int workers) {
  std::vector<records::TrialRow> rows(tasks.size());
  std::atomic<std::size_t> next{0};
  std::mutex mutex;  // Guards what follows.
  std::int64_t done = 0;
  int successes = 0;
  core::Progress progress("oracle", static_cast<std::int64_t>(tasks.size()));
  const auto work = [&] {
    TrialRunner runner(spec, {}, {});
    const LoadedScene& scene = *tasks.front().scene;
    renderer::RenderOptions one_thread;
    one_thread.threads = 1;
    auto owned = std::make_unique<NearGoalRenderer>(
        renderer::make_cpu_renderer(scene.surfels, one_thread, scene.labels));
    NearGoalRenderer& eye = *owned;
    runner.set_renderer(scene.spec->name, std::move(owned));
    for (std::size_t k = next++; k < tasks.size(); k = next++) {
      eye.aim_at(tasks[k].episode->view_points_m);
      rows[k] = runner.run(tasks[k]);
      const std::lock_guard<std::mutex> lock(mutex);
      successes += rows[k].success ? 1 : 0;
      ++done;
      progress.update(done, std::to_string(successes) + "/" + std::to_string(done));
    }
  };
  std::vector<std::thread> threads;
  for (int k = 1; k < workers; ++k) threads.emplace_back(work);
  work();
  for (std::thread& thread : threads) thread.join();
  progress.finish();
  return rows;
}

}  // namespace

Validation validate_episodes(const std::filesystem::path& file,
                             const std::filesystem::path& bundle_folder,
                             const ValidationOptions& options) {
  episodes::EpisodeSet as_written = episodes::read_episodes(file);
  const specs::ExperimentSpec spec = spec_for(file, as_written, options);
  const LoadedScene scene = load_scene(spec, spec.scenes.front(), bundle_folder, {});
  Validation validation;
  validation.findings =
      episodes::bind_episodes(as_written, file.string(), scene.bundle, scene.world);
  std::vector<TrialTask> tasks;
  for (const sim::Episode& episode : scene.episodes.episodes) {
    TrialTask task;
    task.scene = &scene;
    task.episode = &episode;
    task.arm = &spec.arms.front();
    task.record = false;
    if (std::isfinite(episode.shortest_path_m) && episode.shortest_path_m > 0.0) {
      tasks.push_back(task);
    }
  }
  if (!tasks.empty()) validation.trials = run_all(spec, tasks, options.workers);
  episodes::OracleRecord& oracle = validation.oracle;
  oracle.profile = options.profile;
  // What cannot be done at all counts against the set.
  oracle.episodes = static_cast<int>(scene.episodes.episodes.size());
  for (const records::TrialRow& trial : validation.trials) {
    if (trial.failed()) throw core::InputError(trial.episode + ": " + trial.error);
    oracle.successes += trial.success ? 1 : 0;
    oracle.spl += trial.spl / oracle.episodes;
  }
  return validation;
}

}  // namespace segsim::experiments::trials
