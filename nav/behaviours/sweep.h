#pragma once

/// @file
/// A second look around when no frontier is left: the robot drives to one place after the
/// other and turns around there. Which places these are is the policy's business.

#include <deque>
#include <optional>
#include <vector>

#include <glm/vec2.hpp>

#include "core/stages.h"

namespace segsim::nav {

struct SweepOptions {
  int most_places = 3;       ///< In an episode; 0: no sweep.
  double patience_s = 30.0;  ///< A place that is not reached in so long is left out.
  double apart_m = 1.0;      ///< A place nearer to a former one counts as visited.
};

class Sweep {
 public:
  explicit Sweep(const SweepOptions& options = {}) : options_(options) {}

  /// Visits these places, in this order; those that were planned before are dropped.
  void begin(const std::vector<glm::dvec2>& places_m, core::TimeNs time_ns);
  /// The place that the robot is on its way to, frame Odom.
  [[nodiscard]] std::optional<glm::dvec2> place_m() const;
  /// The robot is there, or there is no way, or something better to do: on to the next one.
  void leave(core::TimeNs time_ns);
  /// The way to the present place takes too long.
  [[nodiscard]] bool late(core::TimeNs time_ns) const;

  /// How many more places may be visited.
  [[nodiscard]] int places_left() const { return options_.most_places - count_; }
  [[nodiscard]] bool visited(const glm::dvec2& place_m) const;
  /// Places may be visited again; they still count.
  void forget_visited() { visited_m_.clear(); }

 private:
  void start(core::TimeNs time_ns);

  SweepOptions options_;
  std::deque<glm::dvec2> places_m_;  ///< The present one first.
  std::vector<glm::dvec2> visited_m_;
  core::TimeNs since_ns_ = 0;
  int count_ = 0;
};

}  // namespace segsim::nav
