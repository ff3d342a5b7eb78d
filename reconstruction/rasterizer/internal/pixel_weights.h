#pragma once

/// @file
/// Rows of blending weights for a list of pixels.

#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "core/check.h"
#include "reconstruction/rasterizer/differentiable_rasterizer.h"
#include "renderer/scene/parallel.h"

namespace segsim::reconstruction::internal {

struct SurfelWeight {
  std::int32_t surfel;
  float weight;
};

/// Keeps the `count` heaviest (ties by lower index), in their order; 0 keeps all.
/// @param scratch  Memory to reuse.
inline void keep_heaviest(std::vector<SurfelWeight>& row, int count,
                          std::vector<SurfelWeight>& scratch) {
  if (count == 0 || row.size() <= static_cast<std::size_t>(count)) return;
  const auto heavier = [](const SurfelWeight& a, const SurfelWeight& b) {
    return a.weight != b.weight ? a.weight > b.weight : a.surfel < b.surfel;
  };
  // Weights mostly fall along the ray, so few of them enter the sorted scratch late.
  const auto size = static_cast<std::size_t>(count);
  scratch.clear();
  for (const SurfelWeight& w : row) {
    if (scratch.size() == size) {
      if (!heavier(w, scratch.back())) continue;
      scratch.pop_back();
    }
    scratch.insert(std::upper_bound(scratch.begin(), scratch.end(), w, heavier), w);
  }
  const SurfelWeight last = scratch.back();
  std::erase_if(row, [&](const SurfelWeight& w) { return heavier(last, w); });
}

/// The memory behind a PixelWeights.
class WeightRows {
 public:
  /// @param pixels  Any order; called for in the order of `group`, so that neighbours meet.
  /// @param group  group(pixel) < group_count.
  /// @param make_fill  Called by each task; what it returns is called as fill(pixel, row) and
  ///     appends the pixel's weights to the empty `row`, front to back.
  template <class Group, class MakeFill>
  PixelWeights collect(std::span<const std::int32_t> pixels, int max_per_pixel,
                       renderer::internal::Workers& workers, std::size_t group_count,
                       const Group& group, const MakeFill& make_fill) {
    constexpr std::size_t kPixelsPerTask = 1024;
    sort_by_group(pixels, group_count, group);
    const std::size_t tasks = (pixels.size() + kPixelsPerTask - 1) / kPixelsPerTask;
    parts_.resize(std::max(parts_.size(), tasks));
    row_start_.assign(pixels.size() + 1, 0);
    workers.for_each(tasks, [&](std::size_t task) {
      std::vector<SurfelWeight>& part = parts_[task];
      part.clear();
      std::vector<SurfelWeight> row, scratch;
      auto fill = make_fill();
      for (const std::uint32_t p : rows_of_task(task, kPixelsPerTask)) {
        row.clear();
        fill(pixels[p], row);
        keep_heaviest(row, max_per_pixel, scratch);
        row_start_[p + 1] = static_cast<std::int32_t>(row.size());
        part.insert(part.end(), row.begin(), row.end());
      }
    });
    std::int64_t entries = 0;
    for (std::int32_t& start : row_start_) {
      entries += start;
      SEGSIM_CHECK(entries < (std::int64_t{1} << 31U), "more than 2^31 weights");
      start = static_cast<std::int32_t>(entries);
    }
    surfel_.resize(static_cast<std::size_t>(entries));
    weight_.resize(static_cast<std::size_t>(entries));
    workers.for_each(tasks, [&](std::size_t task) {
      auto from = parts_[task].begin();
      for (const std::uint32_t p : rows_of_task(task, kPixelsPerTask)) {
        for (std::int32_t at = row_start_[p]; at < row_start_[p + 1]; ++at, ++from) {
          surfel_[static_cast<std::size_t>(at)] = from->surfel;
          weight_[static_cast<std::size_t>(at)] = from->weight;
        }
      }
    });
    return {static_cast<std::int64_t>(pixels.size()), entries, row_start_.data(),
            surfel_.data(), weight_.data()};
  }

 private:
  template <class Group>
  void sort_by_group(std::span<const std::int32_t> pixels, std::size_t group_count,
                     const Group& group) {
    place_.assign(group_count + 1, 0);
    for (const std::int32_t pixel : pixels) ++place_[group(pixel) + 1];
    for (std::size_t g = 0; g < group_count; ++g) place_[g + 1] += place_[g];
    sorted_.resize(pixels.size());
    for (std::size_t p = 0; p < pixels.size(); ++p) {
      sorted_[place_[group(pixels[p])]++] = static_cast<std::uint32_t>(p);
    }
  }
  [[nodiscard]] std::span<const std::uint32_t> rows_of_task(std::size_t task,
                                                            std::size_t size) const {
    const std::span<const std::uint32_t> all(sorted_);
    return all.subspan(task * size, std::min(size, all.size() - task * size));
  }

  std::vector<std::uint32_t> place_, sorted_;  ///< Rows by group.
  std::vector<std::vector<SurfelWeight>> parts_;
  std::vector<std::int32_t> row_start_, surfel_;
  std::vector<float> weight_;
};

}  // namespace segsim::reconstruction::internal
