#pragma once

/// @file
/// The way that the oracle-path arm is shown. The shortest way touches every corner that it
/// passes, and a follower that cuts a corner by centimetres is stuck there; so the oracle
/// keeps away from obstacles where that costs little. Lengths for SPL stay those of the
/// shortest way.

#include <memory>
#include <span>
#include <vector>

#include <glm/vec2.hpp>

#include "sim/ground/world.h"

namespace segsim::sim {

class OracleWay {
 public:
  /// Room beside the robot's disc that is tried, widest first.
  static constexpr double kMargins_m[] = {0.15, 0.10, 0.05};
  /// A wider way is taken while it is at most so much longer than the shortest.
  static constexpr double kLongerShare = 1.25, kLonger_m = 0.25;

  /// @param world  Must outlive it.
  OracleWay(const World& world, std::span<const glm::dvec2> goals_m);

  /// Corners from here to a goal; empty if there is no way.
  [[nodiscard]] std::vector<glm::dvec2> from(const glm::dvec2& p_m) const;

 private:
  /// A base may stand beside the room of its disc, as in sim/trial/trial.cpp.
  static constexpr double kSnap_m = 0.30;

  DistanceField shortest_;
  std::vector<std::unique_ptr<const FreeSpace>> spaces_;
  std::vector<DistanceField> wider_;
};

}  // namespace segsim::sim
