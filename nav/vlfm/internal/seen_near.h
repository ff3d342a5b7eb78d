#pragma once

/// @file
/// VLFM's explored area knows no depth: a corner that the sector covered counts as explored
/// although it was only seen from far away, or not at all. This keeps in mind what was seen
/// from near.

#include <functional>
#include <optional>
#include <span>
#include <unordered_set>

#include "nav/behaviours/moment.h"
#include "nav/planning/grid_planner.h"

namespace segsim::nav::internal {

class SeenNear {
 public:
  /// Adds a view. @param limits_m  How far forward each column of the image sees.
  void add(const Moment& now, std::span<const float> limits_m);
  /// Whether no view showed anything from near for the first time during so long.
  [[nodiscard]] bool nothing_new_for(double duration_s, core::TimeNs time_ns);
  /// That time counts from now on.
  void wait_anew(core::TimeNs time_ns) { news_ns_ = time_ns; }
  /// The reachable place around which most free floor was never seen from near, less the way
  /// there; nullopt if no place is worth it. @param visited  Places to leave out.
  [[nodiscard]] std::optional<glm::dvec2> place_to_look_from(
      const CostMap& map, const GeodesicField& field,
      const std::function<bool(const glm::dvec2&)>& visited) const;

 private:
  [[nodiscard]] std::vector<glm::dvec2> unseen_floor_m(const CostMap& map) const;

  std::unordered_set<std::uint64_t> cells_;  ///< Coarse ones.
  std::size_t news_ = 0;                     ///< Of cells_, when it grew last.
  std::optional<core::TimeNs> news_ns_;
};

}  // namespace segsim::nav::internal
