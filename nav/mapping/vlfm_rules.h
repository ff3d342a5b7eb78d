#pragma once

/// @file
/// Where the published VLFM (Yokoyama et al. 2024; bdaiinstitute/vlfm at 584ed56) does
/// something that looks unintended, each such quirk can be switched between the published
/// behaviour and a repaired one. docs/navigation.md lists them with the place of either
/// behaviour.

#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace segsim::nav {

enum class Quirk : std::uint8_t {
  kAcyclicMemory,   ///< Q1 Repeated states are never recognised.
  kVetoFallback,    ///< Q2 All vetoed: farthest frontier, index into the other list.
  kEmptyCone,       ///< Q3 A cone without obstacles reveals nothing.
  kObstaclesStay,   ///< Q4 Nothing clears an occupied cell.
  kLocalStop,       ///< Q5 STOP of the local policy ends the episode while exploring.
  kNoRecovery,      ///< Q6 No stuck handling.
  kFarthestDepth,   ///< Q7 The value map looks as far as each column's farthest pixel.
  kZeroDepth,       ///< Q8 Depth 0 is "near" and "hole"; unfilled holes count as far.
  kMapEdge,         ///< Q9 Off the map indices wrap, or end the episode.
  kOneComponent,    ///< Q10 The explored area keeps one component.
  kEndlessClouds,   ///< Q11 Clouds are never thinned; random subsets.
  kFloatIds,        ///< Q12 Detections are told apart by random numbers.
  kInferredOffset,  ///< Q13 Inferred depth is scaled without subtracting the minimum.
  kClosedSetRoute   ///< Q14 COCO names never reach the open-set detector.
};
inline constexpr std::size_t kQuirks = 14;

enum class Rule : std::uint8_t { kVlfm, kFixed };

/// The behaviour chosen for each quirk.
class VlfmRules {
 public:
  /// All quirks alike.
  explicit VlfmRules(Rule all = Rule::kFixed) { rules_.fill(all); }
  [[nodiscard]] bool published(Quirk quirk) const {
    return rules_[static_cast<std::size_t>(quirk)] == Rule::kVlfm;
  }
  void set(Quirk quirk, Rule rule) { rules_[static_cast<std::size_t>(quirk)] = rule; }
  /// "fixed", "vlfm", or "fixed, vlfm: Q4 Q7" for a mixture.
  [[nodiscard]] std::string text() const;

 private:
  std::array<Rule, kQuirks> rules_;
};

/// "Q1" .. "Q14", in the order of the enumeration.
[[nodiscard]] const std::vector<std::string>& quirk_names();

}  // namespace segsim::nav
