#pragma once

/// @file
/// Which frontier VLFM visits next (A9 of the design notes): the most valuable one, with
/// stickiness to the last choice and a memory of states against going in circles.

#include <functional>
#include <optional>
#include <set>
#include <span>
#include <tuple>

#include <glm/vec2.hpp>

#include "nav/vlfm_rules.h"

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

class FrontierChooser {
 public:
  explicit FrontierChooser(const FrontierChoiceOptions& options = {},
                           const VlfmRules& rules = VlfmRules());
  void reset();
  /// @param distance_m  From the robot to a place along the floor; infinity if unreachable.
  ///     Used for ties and for the fixed fallback (Q2). Null: straight lines.
  /// @return  Index into `frontiers`; nullopt if there are none.
  [[nodiscard]] std::optional<std::size_t> choose(
      const glm::dvec2& robot_m, std::span<const ValuedFrontier> frontiers,
      const std::function<double(const glm::dvec2&)>& distance_m = {});

 private:
  [[nodiscard]] std::optional<std::size_t> sticky(
      std::span<const ValuedFrontier> sorted) const;

  FrontierChoiceOptions options_;
  VlfmRules rules_;
  AcyclicMemory memory_;
  std::optional<ValuedFrontier> last_;
};

}  // namespace segsim::nav
