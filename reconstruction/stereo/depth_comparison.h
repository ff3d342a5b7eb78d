#pragma once

/// @file
/// How good estimated depth is, where the recording has measured depth to compare with.

#include <cstdint>
#include <filesystem>
#include <optional>
#include <vector>

#include "core/image.h"
#include "reconstruction/datasets/rgbd_sequence.h"

namespace segsim::reconstruction {

/// Of pixels with measured depth within the range that lifting uses (0.2 ... 6 m).
struct DepthComparison {
  std::uint64_t measured = 0;                   ///< Pixels.
  std::uint64_t estimated = 0;                  ///< Of these.
  double median_m = 0.0, high_m = 0.0;          ///< Absolute error: median, 90 % quantile.
  double median_share = 0.0, high_share = 0.0;  ///< Error / measured depth, of the same kinds.
  double within_5_percent = 0.0;                ///< Of the estimated ones, in [0, 1].

  /// In [0, 1]. @pre measured > 0
  [[nodiscard]] double completeness() const {
    return static_cast<double>(estimated) / static_cast<double>(measured);
  }
};

/// Collects pixels of many images.
class DepthComparer {
 public:
  /// @param estimated_m, measured_m  The same view along +z, NaN = none; sizes may differ:
  ///     every pixel of the estimate is compared with the measurement at its centre.
  void add(const core::Image<float>& estimated_m, const core::Image<float>& measured_m);
  /// Nothing if no pixel was measured or none of these was estimated.
  [[nodiscard]] std::optional<DepthComparison> result() const;

 private:
  std::uint64_t measured_ = 0;
  std::vector<float> error_m_, error_share_;
};

/// @param folder  Of estimate_depth(); frames without an image in it are left out.
/// @param sequence  With the recording's own depth.
/// @return Nothing if the recording has none.
/// @throws core::InputError if a frame cannot be read.
[[nodiscard]] std::optional<DepthComparison> compare_with_recorded(
    const std::filesystem::path& folder, const RgbdSequence& sequence);

}  // namespace segsim::reconstruction
