#pragma once

/// @file
/// Frontiers: where the reachable explored floor ends at the unknown, and which one to visit
/// next.
///
/// As in VLFM (after Yamauchi 1997) unknown cells too near to an obstacle for the robot do not
/// count, and neither do small unexplored pockets, which CostMap fills. Unlike VLFM all
/// reachable components of the explored area are kept (quirk Q10) and the fallback is the
/// nearest frontier, not the farthest (Q2).

#include <functional>
#include <optional>
#include <vector>

#include "nav/planning/cost_map.h"
#include "nav/planning/grid_planner.h"

namespace segsim::nav {

struct FrontierOptions {
  /// Shorter runs are gaps between rays. Of a door of 0.9 m the inflation leaves 0.2 m; VLFM
  /// keeps runs from two cells on.
  double min_length_m = 0.10;
  double max_length_m = 3.0;  ///< Longer runs are cut in equal parts.
};

struct Frontier {
  glm::dvec2 waypoint_m{0.0};  ///< Centre of the reachable cell nearest to the run's middle.
  Cell waypoint{0};
  glm::dvec2 outward{0.0};  ///< Unit vector towards the unknown side; 0 if it is all around.
  double length_m = 0.0;    ///< Number of cells times resolution.
  double distance_m = 0.0;  ///< Weighted geodesic distance from the robot.
  double value = 0.0;       ///< Filled by FrontierSelector.
};

/// Frontiers reachable in `field`, in order of their first cell (row-major), without
/// `distance_m`, which is what takes time on large maps; FrontierSelector asks the field for
/// those that matter.
[[nodiscard]] std::vector<Frontier> find_reachable_frontiers(const CostMap& map,
                                                             const GeodesicField& field,
                                                             const FrontierOptions& options);

/// How much a frontier promises; larger is better. VLFM's value map is one of these.
using FrontierScorer = std::function<double(const Frontier&)>;

struct FrontierSelectorOptions {
  double size_bonus_m_per_m =
      0.5;                      ///< A metre of frontier makes up for this much distance ...
  double size_cap_m = 2.0;      ///< ... up to this length.
  double stick_radius_m = 0.5;  ///< VLFM: the last frontier moved by at most this much.
  double stick_margin = 1.0;    ///< Keep it unless another is better by this [score].
  double blacklist_radius_m = 0.5;  ///< Frontiers this near to a failed one are vetoed.
};

/// Nearest frontier with a bonus for size: -distance_m + bonus.
[[nodiscard]] FrontierScorer make_nearest_scorer(const FrontierSelectorOptions& options);

/// Remembers the last choice and the frontiers that could not be reached.
class FrontierSelector {
 public:
  explicit FrontierSelector(const FrontierSelectorOptions& options = {},
                            FrontierScorer scorer = {});
  void reset();
  /// The frontier to visit, nullopt if none is left that is not vetoed. Fills `value` of all.
  [[nodiscard]] std::optional<Frontier> select(std::vector<Frontier>& frontiers);
  /// The same for frontiers without distances: fills them from the field as far out as the
  /// choice depends on them; what is farther away gets infinity. A scorer of one's own gets
  /// all of them.
  [[nodiscard]] std::optional<Frontier> select(std::vector<Frontier>& frontiers,
                                               const GeodesicField& field);
  /// Vetoes frontiers near this place until clear_blacklist().
  void blacklist(const glm::dvec2& waypoint_odom_m);
  void clear_blacklist() { blacklist_.clear(); }
  [[nodiscard]] bool blacklisted(const glm::dvec2& waypoint_odom_m) const;

 private:
  void settle_enough(std::vector<Frontier>& frontiers, const GeodesicField& field) const;
  /// The frontier nearest to the last choice, if near enough.
  [[nodiscard]] const Frontier* last_among(const std::vector<Frontier>& frontiers) const;

  FrontierSelectorOptions options_;
  bool nearest_ = true;  ///< The scorer is make_nearest_scorer().
  FrontierScorer scorer_;
  std::optional<glm::dvec2> last_m_;
  std::vector<glm::dvec2> blacklist_;
};

}  // namespace segsim::nav
