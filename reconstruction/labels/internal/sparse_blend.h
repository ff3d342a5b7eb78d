#pragma once

/// @file
/// out = W L: pixels from the labels of their surfels, with derivatives by L. Only the surfels
/// that the batch sees have rows. Weights are renormalised to a sum of 1 per pixel, as the
/// renderers do when they resolve labels, so training sees what will be drawn.

#include "reconstruction/internal/tensors/tensors.h"
#include "reconstruction/labels/panoptic_head.h"
#include "reconstruction/rasterizer/differentiable_rasterizer.h"

namespace segsim::reconstruction::internal {

/// W in compressed rows and, for the backward pass, in compressed columns. Rows and columns
/// are summed in the order of their entries: the result does not depend on threads.
struct BlendMatrix {
  std::int64_t pixels = 0;
  Tensor surfel;  ///< [surfels] int64, ids in the cloud, ascending; row s of L is surfel[s].
  Tensor alpha;   ///< [pixels] float, sum of the weights before they were normalised.
  Tensor row_start, row_surfel;       ///< [pixels + 1], [entries] int64.
  Tensor column_start, column_pixel;  ///< [surfels + 1], [entries] int64; CPU only.
  Tensor row_weight, column_weight;   ///< [entries] float; the second CPU only. The first
                                      ///< collects derivatives if it requires them.
  Tensor row_pixel;                   ///< [entries] int64; not on the CPU.

  [[nodiscard]] std::int64_t surfels() const { return surfel.size(0); }
};

/// Finds the surfels of a batch: a table over the whole cloud, kept between batches.
class BlendMatrixMaker {
 public:
  BlendMatrixMaker(std::int64_t cloud_size, const at::Device& device)
      : cloud_size_(cloud_size), device_(device) {}
  /// @param more  Rows below those of `weights`; may be null.
  /// @param differentiable  Also by the weights: on the CPU only.
  /// @throws core::ContractViolation for a surfel outside the cloud.
  [[nodiscard]] BlendMatrix make(const PixelWeights& weights,
                                 const PixelWeights* more = nullptr,
                                 bool differentiable = false);

 private:
  [[nodiscard]] BlendMatrix make_on_cpu(const std::vector<const PixelWeights*>& parts);
  [[nodiscard]] BlendMatrix make_on_device(
      const std::vector<const PixelWeights*>& parts) const;
  [[nodiscard]] Tensor number_surfels(const std::vector<const PixelWeights*>& parts);
  std::int64_t cloud_size_;
  at::Device device_;
  std::vector<std::int32_t> local_;  ///< By id: row in L, or -1.
};

/// What row_weight collected, as derivatives by the weights of the batch before they were
/// normalised, and those by the places of its surfels. Rows below the batch's are left out.
/// @param position_rows  [surfels, 3], a leaf.
[[nodiscard]] GeometryGradient geometry_gradient(const BlendMatrix& matrix,
                                                 const PanopticBatch& batch,
                                                 const Tensor& position_rows);

/// @param labels  [surfels, channels], float or double.  @return  [pixels, channels].
[[nodiscard]] Tensor blend(const BlendMatrix& matrix, const Tensor& labels);

/// One channel of each pixel, without blending the others: sum_s w_s scale_s labels_s,channel.
/// @param channel  [pixels] int64; -1 = none: the result is 0.
/// @param scale  [surfels].
/// @return  [pixels].
[[nodiscard]] Tensor blend_channel(const BlendMatrix& matrix, const Tensor& labels,
                                   const Tensor& channel, const Tensor& scale);
[[nodiscard]] Tensor blend_channel(const BlendMatrix& matrix, const Tensor& labels,
                                   const Tensor& channel);

}  // namespace segsim::reconstruction::internal
