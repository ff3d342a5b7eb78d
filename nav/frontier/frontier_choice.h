#pragma once

/// @file
/// Which frontier VLFM visits next: the most valuable one. It prefers the frontier that it
/// chose last, and remembers states so that it does not go in circles.

#include <functional>
#include <optional>
#include <set>
#include <span>
#include <tuple>
#include <vector>

#include <glm/vec2.hpp>

#include "nav/mapping/vlfm_rules.h"

namespace segsim::nav {

struct FrontierChoiceOptions {
  double stick_radius_m = 0.5;
  double stick_margin = 0.01;  ///< Keep the last one while value_now + margin > value_last.
  double unseen_value = -1.0;  ///< Of a frontier without values around it.
  /// Values that differ by less count as equal, and the nearest of them is taken; published: 0
  /// (the order of the list decides). A prior that has seen nothing yet values all places
  /// alike.
  double tie_margin = 0.0;
};

/// One candidate.
struct ValuedFrontier {
  glm::dvec2 place_m{0.0};
  double value = -1.0;
};

/// Remembers states (robot, frontier, two best values) of one episode. As published (Q1) it
/// never recognises one: the original compares object identities. Fixed: equality after
/// rounding to 5 cm, 5 cm and 1e-3.
class AcyclicMemory {
 public:
  explicit AcyclicMemory(const VlfmRules& rules) : rules_(rules) {}
  void reset() { states_.clear(); }
  [[nodiscard]] bool seen(const glm::dvec2& robot_m, const glm::dvec2& frontier_m,
                          double best_value, double second_value) const;
  void add(const glm::dvec2& robot_m, const glm::dvec2& frontier_m, double best_value,
           double second_value);
  [[nodiscard]] std::size_t size() const { return states_.size(); }

 private:
  using State = std::tuple<long, long, long, long, long, long>;
  VlfmRules rules_;
  std::set<State> states_;
};

/// Ways along the floor from the robot to the frontiers of one choice. Each question takes a
/// search, so they are asked as late as possible. Frontiers are named by their index.
struct FloorWays {
  /// Length of the way; infinity if there is none [m].
  std::function<double(std::size_t)> length_m;
  /// Position in the list of the frontier with the shortest way, the first of equals; the list
  /// is not empty. Null: by `length_m`.
  std::function<std::size_t(std::span<const std::size_t>)> nearest;
};

class FrontierChooser {
 public:
  explicit FrontierChooser(const FrontierChoiceOptions& options = {},
                           const VlfmRules& rules = VlfmRules());
  void reset();
  /// @param ways  For ties and for the fallback (Q2). Without `length_m`: straight lines.
  /// @return  Index into `frontiers`; nullopt if there are none.
  [[nodiscard]] std::optional<std::size_t> choose(const glm::dvec2& robot_m,
                                                  std::span<const ValuedFrontier> frontiers,
                                                  const FloorWays& ways = {});

 private:
  // These return positions in `order`, the indices of the frontiers by descending value.
  [[nodiscard]] std::optional<std::size_t> sticky(std::span<const ValuedFrontier> frontiers,
                                                  std::span<const std::size_t> order) const;
  /// May bring ties into the order of their ways. @param seen  Whether the state that the
  ///     frontier with this index leads to was there before.
  [[nodiscard]] std::optional<std::size_t> first_unseen(
      std::span<const ValuedFrontier> frontiers, const FloorWays& ways,
      const std::function<bool(std::size_t)>& seen, std::vector<std::size_t>& order) const;
  [[nodiscard]] std::size_t fallback(const FloorWays& ways,
                                     std::span<const std::size_t> order) const;

  FrontierChoiceOptions options_;
  VlfmRules rules_;
  AcyclicMemory memory_;
  std::optional<ValuedFrontier> last_;
};

}  // namespace segsim::nav
