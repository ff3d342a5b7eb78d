#pragma once

/// @file
/// Several environments of one scene, stepped together on threads. Each has its own episodes
/// and random numbers, so nothing depends on how many threads there are or who is first.

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "sim/trial/environment/episode_pool.h"
#include "sim/trial/environment/object_nav_environment.h"

namespace segsim::sim {

class VectorEnvironment {
 public:
  /// @param threads  Of the renderer, at least 1.
  using MakeRenderer = std::function<std::unique_ptr<core::Renderer>(int threads)>;
  /// Called for every environment, on its thread, when its new image is there.
  using Observe = std::function<void(std::size_t environment, const ObjectNavEnvironment&)>;

  struct Size {
    std::size_t environments = 1;
    int threads = 1;  ///< Those that have no environment to step help to draw.
  };

  /// @param pool  Outlives it.
  VectorEnvironment(const EpisodePool& pool, const EnvironmentOptions& options,
                    const Size& size, EpisodeOrder::Kind order, const MakeRenderer& renderer);
  ~VectorEnvironment();

  /// What one environment does next.
  struct Reset {
    bool restart = false;  ///< Its order of episodes begins anew, from this seed.
    std::uint64_t seed = 0;
    std::int64_t episode = -1;  ///< In the pool; -1: the next one.
  };
  /// Begins an episode in every environment. @param resets  One for each.
  void reset(std::span<const Reset> resets, const Observe& observe);

  struct Step {
    EnvironmentStep step;
    bool reset = false;  ///< The episode was over: instead of the action the next one began.
  };
  /// One step in every environment. @param actions  One for each.
  [[nodiscard]] std::vector<Step> step(std::span<const EnvironmentAction> actions,
                                       const Observe& observe);

  [[nodiscard]] std::size_t size() const { return environments_.size(); }
  [[nodiscard]] const ObjectNavEnvironment& environment(std::size_t index) const {
    return environments_[index];
  }
  /// Index in the pool of what runs there.
  [[nodiscard]] std::size_t episode(std::size_t index) const { return episode_of_[index]; }

 private:
  struct Workers;
  void begin(std::size_t index, std::size_t episode, core::Renderer& renderer);
  void for_each(const std::function<void(std::size_t index, core::Renderer&)>& work);

  const EpisodePool& pool_;
  std::deque<ObjectNavEnvironment> environments_;  ///< They do not move.
  std::vector<EpisodeOrder> orders_;
  std::vector<std::size_t> episode_of_;
  std::unique_ptr<Workers> workers_;
};

}  // namespace segsim::sim
