#pragma once

/// @file
/// Environments of one scene for Python: a bundle, its episodes, and steps as arrays.

#include <atomic>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include <nanobind/nanobind.h>

#include "python/native/environments/settings.h"
#include "python/native/frame_arrays.h"
#include "sim/trial/environment/vector_environment.h"

namespace segsim::python {

/// Observations of several environments, as the threads that step them write them.
class ObservationArrays {
 public:
  ObservationArrays(const EnvironmentSettings& settings, std::size_t count);
  /// Needs no Python. @param goal  Number of the goal's class.
  void put(std::size_t index, const sim::ObjectNavEnvironment& environment, std::int64_t goal);
  [[nodiscard]] nanobind::dict take();

 private:
  std::size_t count_;
  int width_px_, height_px_;
  ChannelChoice choice_;  ///< What comes as it was drawn.
  FrameBatch images_;
  bool with_depth_;
  std::unique_ptr<float[]> depth_m_;
  std::vector<float> pose_;
  std::vector<std::int64_t> goal_;
};

/// What no robot knows of several environments, likewise.
class InformationArrays {
 public:
  explicit InformationArrays(std::size_t count);
  /// Needs no Python. @param episode  In the pool.
  void put(std::size_t index, const sim::ObjectNavEnvironment& environment,
           std::size_t episode);
  /// What was touched in the step.
  void put_collided(std::span<const sim::VectorEnvironment::Step> steps);
  [[nodiscard]] nanobind::dict take();

 private:
  std::size_t count_;
  std::vector<std::uint8_t> success_, collided_;
  std::vector<double> spl_, soft_spl_, distance_m_, path_m_, shortest_path_m_, time_s_, pose_;
  std::vector<std::int64_t> collisions_, episode_, outcome_;
};

class EnvironmentBatch {
 public:
  /// @param episodes  File of a set; none: episodes are made.
  /// @throws core::InputError naming the file or the setting.
  EnvironmentBatch(const std::filesystem::path& scene,
                   const std::optional<std::filesystem::path>& episodes,
                   const EnvironmentSettings& settings, int count, int threads);

  /// @param seeds  For each environment; none: its order of episodes goes on.
  /// @param episodes  For each environment; -1: the next one.
  /// @return  Observations and information.
  [[nodiscard]] nanobind::tuple reset(const std::vector<std::optional<std::uint64_t>>& seeds,
                                      const std::vector<std::int64_t>& episodes);
  /// @return  Observations, rewards, terminated, truncated, information.
  [[nodiscard]] nanobind::tuple step(nanobind::handle actions);

  [[nodiscard]] const std::vector<std::string>& goal_classes() const { return goal_classes_; }
  [[nodiscard]] std::vector<std::string> episode_ids() const;
  [[nodiscard]] int infeasible() const { return infeasible_; }
  [[nodiscard]] const sim::RobotModel& robot() const { return world_->robot(); }
  /// Ids of the goal classes in semantic images; 0 for what the scene lacks.
  [[nodiscard]] std::vector<int> goal_class_ids() const;
  /// (v, w) for each control period of a discrete action.
  [[nodiscard]] std::vector<std::pair<double, double>> commands(int action) const;

 private:
  void bind(experiments::episodes::EpisodeSet set, const std::string& place);
  /// Writes down what an environment shows.
  void put(std::size_t index, const sim::ObjectNavEnvironment& environment,
           ObservationArrays& seen, InformationArrays& known) const;

  EnvironmentSettings settings_;
  core::SceneBundle bundle_;
  std::unique_ptr<const sim::World> world_;
  std::vector<std::string> goal_classes_;
  std::vector<std::int64_t> goal_of_;  ///< By episode.
  int infeasible_ = 0;
  std::unique_ptr<const sim::EpisodePool> pool_;
  std::unique_ptr<const sim::DiscreteActions> discrete_;
  std::unique_ptr<sim::VectorEnvironment> environments_;
  std::atomic<bool> begun_ = false;
  std::mutex mutex_;  ///< One call at a time.
};

/// EnvironmentBatch.
void bind_environment_batch(nanobind::module_& module);

}  // namespace segsim::python
