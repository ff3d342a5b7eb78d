#pragma once

/// @file
/// What a person may do to labels. Each function looks at the state and says what has to
/// change; none changes it.
///
/// Every surfel of an instance that is edited gets its label by hand, also where it keeps it:
/// in a scene with label distributions the edited instance then has sharp borders.

#include <optional>
#include <span>
#include <string>

#include "experiments/scene_labels/label_state.h"
#include "experiments/scene_labels/surfel_split.h"

namespace segsim::experiments::scene_labels {

/// Pieces with a smaller share of an instance's surfels are no objects.
inline constexpr double kLeastPiece = 0.02;
inline constexpr double kDefaultGap_m = 0.04;

/// A class by its name.
struct NamedClass {
  std::string name;   ///< Lower case.
  bool thing = true;  ///< Of a class that the scene lacks; else the scene's.
};

/// All functions: @throws core::InputError if there is no such instance, or nothing to do.
/// @param surfels  Where they are; their ids do not count.

/// The instance gets a class. If that is stuff (floor, wall), its surfels join it and the
/// instance is no more.
/// @param name  Of the instance; empty: its name, or after the class if that is another one.
[[nodiscard]] LabelEdit rename_instance(const LabelState& state,
                                        const renderer::SurfelCloud& surfels,
                                        std::uint16_t instance, const NamedClass& to,
                                        const std::string& name = {});

/// All surfels of `instance` become `into`'s.
[[nodiscard]] LabelEdit merge_instances(const LabelState& state,
                                        const renderer::SurfelCloud& surfels,
                                        std::uint16_t instance, std::uint16_t into);

/// The largest piece keeps the instance's number, every other one becomes an instance of the
/// same class.
/// @param gap_m  Surfels that are farther apart do not touch, in [0, 1].
[[nodiscard]] LabelEdit split_into_pieces(const LabelState& state,
                                          const renderer::SurfelCloud& surfels,
                                          std::uint16_t instance,
                                          double gap_m = kDefaultGap_m);

/// Part 0 keeps the instance's number, every other part becomes an instance of the same class.
/// @param seeds  Of two parts at least; parts are numbered from 0, none is left out.
[[nodiscard]] LabelEdit split_at_seeds(const LabelState& state,
                                       const renderer::SurfelCloud& surfels,
                                       std::uint16_t instance, std::span<const Seed> seeds,
                                       double gap_m = kDefaultGap_m);

/// The surfels become void.
[[nodiscard]] LabelEdit delete_instance(const LabelState& state, std::uint16_t instance);

}  // namespace segsim::experiments::scene_labels
