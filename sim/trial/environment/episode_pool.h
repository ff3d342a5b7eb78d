#pragma once

/// @file
/// The episodes that environments of one world draw from, and in which order.

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "sim/ground/world.h"
#include "sim/trial/trial.h"

namespace segsim::sim {

/// Immutable to its users, who may ask from several threads.
class EpisodePool {
 public:
  /// @param world  Outlives it.  @param episodes  At least one.
  EpisodePool(const World& world, std::vector<Episode> episodes);
  ~EpisodePool();
  EpisodePool(const EpisodePool&) = delete;
  EpisodePool& operator=(const EpisodePool&) = delete;

  [[nodiscard]] const World& world() const { return world_; }
  [[nodiscard]] std::size_t size() const { return episodes_.size(); }
  [[nodiscard]] const Episode& episode(std::size_t index) const { return episodes_[index]; }
  /// Distances to the view points of the episode; made when they are first asked for, once for
  /// all episodes with the same goal. Null if the episode has no view points.
  [[nodiscard]] std::shared_ptr<const DistanceField> to_goal(std::size_t index) const;

 private:
  struct Goal;

  const World& world_;
  std::vector<Episode> episodes_;
  std::vector<std::unique_ptr<Goal>> goals_;
  std::vector<std::size_t> goal_of_;  ///< By episode.
};

/// Which episode comes next in one environment. Equal seeds give equal orders.
class EpisodeOrder {
 public:
  enum class Kind : std::uint8_t {
    kShuffled,  ///< All of them in random order, then all of them in another.
    kInTurn,    ///< As they stand: environment i of n has i, i + n, i + 2 n, ...
  };

  EpisodeOrder(Kind kind, std::size_t episodes, std::size_t environment,
               std::size_t environments)
      : kind_(kind), episodes_(episodes), first_(environment), stride_(environments) {}

  /// Begins anew. @param seed  Of kShuffled.
  void restart(std::uint64_t seed);
  [[nodiscard]] std::size_t next();

 private:
  Kind kind_;
  std::size_t episodes_, first_, stride_;
  std::uint64_t seed_ = 0, drawn_ = 0;
  std::vector<std::size_t> round_;  ///< Of kShuffled.
};

}  // namespace segsim::sim
