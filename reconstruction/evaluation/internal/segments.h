#pragma once

/// @file
/// From labels to the segments that panoptic metrics compare.

#include <cstdint>
#include <map>
#include <span>
#include <vector>

#include "core/scene_bundle.h"
#include "reconstruction/evaluation/contingency.h"

namespace segsim::reconstruction::internal {

inline constexpr int kVoid = -1;

struct Segment {
  std::uint16_t class_id = 0;
  bool thing_instance = false;  ///< An id > 0 of a thing class.
  std::uint64_t pixels = 0;
  std::uint64_t void_pixels = 0;  ///< On void of the other side; filled by `cross`.
};

/// Segments of one side (truth or prediction).
struct Segmentation {
  std::vector<Segment> segments;
  std::map<Label, int> index;  ///< Label -> segment, or kVoid.
};

/// Pixels of each label of one side.
using LabelPixels = std::map<Label, std::uint64_t>;
[[nodiscard]] LabelPixels truth_pixels(std::span<const Overlap> overlaps);
[[nodiscard]] LabelPixels predicted_pixels(std::span<const Overlap> overlaps);

/// One segment per (class, id) of a thing, one per stuff class; other classes are void.
[[nodiscard]] Segmentation segments_by_label(const LabelPixels& labels,
                                             std::span<const core::SceneClass> classes);

/// An id is one segment, whatever its pixels say: its class is that of most of its pixels
/// (ties: the lower class id), void if that one is not evaluated; ids of a stuff class are
/// merged. The pixels without an id are a segment of their own for each class. (PVLFF,
/// PanopticRecon++.)
[[nodiscard]] Segmentation segments_by_id(const LabelPixels& labels,
                                          std::span<const core::SceneClass> classes);

/// Common pixels of a true and a predicted segment, neither of them void.
struct SegmentOverlap {
  int truth = 0, predicted = 0;
  std::uint64_t pixels = 0;
};

/// Intersects the two sides and fills their `void_pixels`.
[[nodiscard]] std::vector<SegmentOverlap> cross(std::span<const Overlap> overlaps,
                                                Segmentation& truth, Segmentation& predicted);

/// nullptr if the class is not evaluated.
[[nodiscard]] const core::SceneClass* find_class(std::span<const core::SceneClass> classes,
                                                 std::uint16_t class_id);

}  // namespace segsim::reconstruction::internal
