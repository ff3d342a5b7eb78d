#pragma once

/// @file
/// What heads have in common: devices, the class table, targets as tensors, sums of losses.

#include <string>
#include <vector>

#include "reconstruction/internal/tensors/tensors.h"
#include "reconstruction/labels/internal/batch_targets.h"
#include "reconstruction/labels/panoptic_head.h"
#include "renderer/scene/surfels.h"

namespace segsim::reconstruction::internal {

/// @throws core::InputError if there is no such CUDA device or libtorch has no CUDA.
[[nodiscard]] at::Device device_of(int cuda_device);

/// The class table by kind. Indices are in the table.
struct ClassSplit {
  std::vector<std::int64_t> stuff, things;
  std::vector<std::int64_t> stuff_index, thing_index;  ///< [classes], -1 for the other kind.
};
[[nodiscard]] ClassSplit split_classes(const std::vector<core::SceneClass>& classes);

/// [surfels, 3].
[[nodiscard]] Tensor positions_tensor(const std::vector<glm::vec3>& position_m,
                                      const at::Device& device);

/// [rows] int64: the values, and -1 for rows beyond them.
[[nodiscard]] Tensor padded_indices(std::vector<std::int64_t> values, std::int64_t rows,
                                    const at::Device& device);

/// The masks of a batch at some of its pixels.
struct MaskTargets {
  Tensor pixels;      ///< [n] int64.
  Tensor one_hot;     ///< [n, masks] float.
  Tensor importance;  ///< [n] float, of the sample.
  Tensor weight;      ///< [n] float, times the confidence of the mask.
};
[[nodiscard]] MaskTargets mask_targets(const BatchTargets& targets,
                                       const std::vector<std::int64_t>& pixels,
                                       const at::Device& device);

/// Which slot each mask takes so that the probabilities of its own pixels are largest; masks
/// beyond the slots get none (Panoptic Lifting).
/// @param probability  [n, slots] at the pixels of the masks.
/// @return  [masks], -1 = none.
[[nodiscard]] std::vector<std::int64_t> assign_slots(const Tensor& probability,
                                                     const MaskTargets& masks);

/// Losses of one step.
class LossSum {
 public:
  void add(const std::string& name, double factor, const Tensor& loss);
  /// Back-propagates the sum.
  /// @throws core::InputError if it is not finite.
  [[nodiscard]] std::vector<NamedLoss> finish(std::int64_t iteration);

 private:
  std::vector<NamedLoss> losses_;
  Tensor total_;
};

/// All rates at this share of training: constant, then exponential decay.
[[nodiscard]] double rate_factor(const HeadRateConfig& rate, double progress);

/// Rows of the class table with the decoder's weights.
/// @param weight  [classes, 16], host.  @param bias  [classes], host.
[[nodiscard]] std::vector<renderer::PanopticClass> decoder_classes(
    const std::vector<core::SceneClass>& classes, const Tensor& weight, const Tensor& bias);

template <class Row>
[[nodiscard]] std::vector<Row> rows_of(const Tensor& values) {
  const Tensor host = values.detach().cpu().contiguous();
  std::vector<Row> rows(static_cast<std::size_t>(host.size(0)));
  const auto* from = host.data_ptr<float>();
  for (Row& row : rows) {
    std::copy(from, from + row.size(), row.begin());
    from += row.size();
  }
  return rows;
}

/// Places and features, and any shape: what folding a model reads.
[[nodiscard]] renderer::SurfelCloud feature_cloud(
    const std::vector<glm::vec3>& position_m,
    const std::vector<core::SemanticFeature>& semantic,
    const std::vector<core::InstanceFeature>& instance);

}  // namespace segsim::reconstruction::internal
