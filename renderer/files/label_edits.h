#pragma once

/// @file
/// Labels that a person set by hand (`segsim scene label`, docs/scene_label.md), as a file of
/// their own beside the surfels and label distributions, which stay as they were made.

#include <cstdint>
#include <filesystem>
#include <vector>

#include "renderer/scene/panoptic_field.h"
#include "renderer/scene/surfels.h"

namespace segsim::renderer {

struct LabelEdits {
  /// Neighbouring surfels of one label, whatever they were before.
  struct Run {
    std::uint32_t first = 0, count = 0;  ///< Indices in the cloud; count > 0.
    std::uint16_t class_id = 0;          ///< 0 = void.
    std::uint16_t instance_id = 0;       ///< 0 = none: then the class is no thing, or void.
    bool operator==(const Run&) const = default;
  };
  /// In label distributions, all surfels' shares of one instance go to another.
  struct Move {
    std::uint16_t from = 0;  ///< > 0.
    std::uint16_t to = 0;    ///< 0: they are dropped.
    bool operator==(const Move&) const = default;
  };
  std::vector<Run> runs;    ///< Ascending; no surfel is in two.
  std::vector<Move> moves;  ///< Ascending by `from`, each once; `to` is moved no further.

  [[nodiscard]] bool empty() const { return runs.empty() && moves.empty(); }
  bool operator==(const LabelEdits&) const = default;
};

/// Sets the ids of the surfels. In a field, the distribution of a surfel in a run becomes
/// certain: all of its class, all of its instance. Classes and instances that the field lacks
/// are added to it; the class of an edited instance becomes that of its runs, where instances
/// have classes. Surfels in no run keep their distributions but for the moves.
/// @param surfels  With ids.
/// @param field  Of these surfels; nullptr: there are no distributions.
/// @throws core::ContractViolation if a run ends beyond the surfels.
void apply_label_edits(const LabelEdits& edits, SurfelCloud& surfels, PanopticField* field);

/// Layout of internal/checked_file.h, magic "SEGSIMLE", version 1; little-endian. Payload:
///
///     u32 surfels, u32 runs, u32 moves
///
///     run: u32 first, u32 count, u16 class, u16 instance
///
///     move: u16 from, u16 to
///
/// @param surfels  That the scene has.
void write_label_edits(const std::filesystem::path& file, const LabelEdits& edits,
                       std::size_t surfels);

/// @param surfels  That the scene has.
/// @throws core::InputError for a file that is missing, damaged, newer, of another number of
///     surfels, or whose runs or moves are not in order.
[[nodiscard]] LabelEdits read_label_edits(const std::filesystem::path& file,
                                          std::size_t surfels);

}  // namespace segsim::renderer
