#pragma once

/// @file
/// Where predicted labels fell on true ones, in pixels. Every label metric is read off this
/// one table, so images are walked once, whatever is reported.
///
///     images --add_frame--> (true label, predicted label) -> pixels, per frame
///                             |-> panoptic_quality.h, semantic_quality.h,
///                                 instance_coverage.h, view_quality.h

#include <compare>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "core/frame_masks.h"
#include "core/image.h"

namespace segsim::reconstruction {

/// Class and instance of a pixel. Class 0 is void, instance 0 is none.
struct Label {
  std::uint16_t class_id = 0, instance_id = 0;
  // NOLINTNEXTLINE(modernize-use-nullptr): it means the 0 of <=>.
  auto operator<=>(const Label&) const = default;
};

/// Number of pixels that carry a pair of labels.
struct Overlap {
  Label truth, predicted;
  std::uint64_t pixels = 0;
};

/// The two label images of a view, of equal size. Borrowed for the call.
struct LabelImages {
  const core::Image<std::uint16_t>& semantic;
  const core::Image<std::uint16_t>& instance;
  /// Of the truth alone: the labels that are crowds (core::MaskSegment::crowd).
  std::vector<Label> crowds = {};
};

/// The truth of a view with its crowds.
[[nodiscard]] LabelImages images_of(const core::FrameMasks& masks);

class ContingencyTable {
 public:
  /// Counts one view. Instance ids mean the same object in all views of a table: the metrics
  /// of a scene depend on it, those of single views do not.
  /// @throws ContractViolation if the four images differ in size.
  void add_frame(const LabelImages& truth, const LabelImages& predicted);

  /// Adds a view that was counted elsewhere, for example a frame of another table.
  /// @param overlaps  Ascending by (truth, predicted), each pair once.
  void add_overlaps(std::span<const Overlap> overlaps) {
    frames_.push_back({{overlaps.begin(), overlaps.end()}, {}});
  }

  [[nodiscard]] std::size_t frame_count() const { return frames_.size(); }
  /// Ascending by (truth, predicted), each pair once.
  [[nodiscard]] std::span<const Overlap> frame(std::size_t i) const {
    return frames_.at(i).overlaps;
  }
  /// True labels of the frame that are crowds, as they were given.
  [[nodiscard]] std::span<const Label> crowds(std::size_t i) const {
    return frames_.at(i).crowds;
  }
  /// The sum of all frames, in the same order.
  [[nodiscard]] std::vector<Overlap> scene() const;

 private:
  struct Frame {
    std::vector<Overlap> overlaps;
    std::vector<Label> crowds;
  };
  std::vector<Frame> frames_;
};

}  // namespace segsim::reconstruction
