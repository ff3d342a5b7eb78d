#include "reconstruction/evaluation/contingency.h"

#include <algorithm>

#include "core/check.h"

namespace segsim::reconstruction {
namespace {

struct KeyCount {
  std::uint64_t key = 0, pixels = 0;
};

std::uint64_t key_of(const Label& truth, const Label& predicted) {
  return std::uint64_t{truth.class_id} << 48U | std::uint64_t{truth.instance_id} << 32U |
         std::uint64_t{predicted.class_id} << 16U | predicted.instance_id;
}

Overlap overlap_of(const KeyCount& entry) {
  const auto part = [&](unsigned shift) {
    return static_cast<std::uint16_t>(entry.key >> shift);
  };
  return {{part(48), part(32)}, {part(16), part(0)}, entry.pixels};
}

/// Sorts by key and adds up equal keys.
std::vector<Overlap> merge(std::vector<KeyCount>& counts) {
  std::sort(counts.begin(), counts.end(),
            [](const KeyCount& a, const KeyCount& b) { return a.key < b.key; });
  std::vector<Overlap> merged;
  for (std::size_t i = 0; i < counts.size();) {
    KeyCount sum{counts[i].key, 0};
    for (; i < counts.size() && counts[i].key == sum.key; ++i) sum.pixels += counts[i].pixels;
    merged.push_back(overlap_of(sum));
  }
  return merged;
}

}  // namespace

LabelImages images_of(const core::FrameMasks& masks) {
  LabelImages images{masks.semantic, masks.instance};
  for (const core::MaskSegment& segment : masks.segments) {
    if (segment.crowd) images.crowds.push_back({segment.class_id, segment.id});
  }
  return images;
}

void ContingencyTable::add_frame(const LabelImages& truth, const LabelImages& predicted) {
  const auto& size = truth.semantic;
  for (const auto* image : {&truth.instance, &predicted.semantic, &predicted.instance}) {
    SEGSIM_CHECK(
        image->width_px() == size.width_px() && image->height_px() == size.height_px(),
        "label images of one view");
  }
  // Neighbouring pixels mostly agree: runs are some 50 times fewer than pixels.
  std::vector<KeyCount> runs;
  for (std::size_t i = 0; i < size.size(); ++i) {
    const std::uint64_t key =
        key_of({truth.semantic.pixels()[i], truth.instance.pixels()[i]},
               {predicted.semantic.pixels()[i], predicted.instance.pixels()[i]});
    if (runs.empty() || runs.back().key != key) runs.push_back({key, 0});
    ++runs.back().pixels;
  }
  frames_.push_back({merge(runs), truth.crowds});
}

std::vector<Overlap> ContingencyTable::scene() const {
  std::vector<KeyCount> counts;
  for (const Frame& frame : frames_) {
    for (const Overlap& cell : frame.overlaps) {
      counts.push_back({key_of(cell.truth, cell.predicted), cell.pixels});
    }
  }
  return merge(counts);
}

}  // namespace segsim::reconstruction
