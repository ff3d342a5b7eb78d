#pragma once

/// @file
/// Classes as logits on surfels, with the losses that Panoptic Lifting published for them: of
/// every head that learns classes apart from instances.

#include "reconstruction/internal/tensors/adam.h"
#include "reconstruction/labels/internal/head_support.h"
#include "reconstruction/labels/internal/sparse_blend.h"
#include "renderer/scene/panoptic_field.h"

namespace segsim::reconstruction::internal {

class ClassLogits {
 public:
  ClassLogits(std::int64_t surfels, std::int64_t classes, const at::Device& device);

  /// What one batch renders, with derivatives.
  struct Rendered {
    Tensor rows;         ///< Leaf: logits of the batch's surfels.
    Tensor probability;  ///< [n, classes] at the pixels of the masks.
  };
  [[nodiscard]] Rendered render(const BlendMatrix& matrix, const MaskTargets& masks) const;

  /// Cross entropy of the given classes.
  void add_class_loss(LossSum& sum, double factor, const Rendered& rendered,
                      const BatchTargets& targets, const MaskTargets& masks) const;
  /// A mask's pixels should agree with the class that the model itself gives the mask.
  void add_segment_loss(LossSum& sum, double factor, const Rendered& rendered,
                        const MaskTargets& masks) const;
  void step(const BlendMatrix& matrix, const Rendered& rendered, double rate);

  /// [surfels, classes].
  [[nodiscard]] Tensor probabilities() const;

  void save(StateWriter& out) const { logits_.save(out, "surfel.semantic"); }
  void load(const StateReader& in);

 private:
  AdamTensor logits_;
};

/// A field with this table of classes, of surfels with these probabilities.
/// @param probability  [surfels, classes].
[[nodiscard]] renderer::PanopticField field_of_classes(
    const std::vector<core::SceneClass>& classes, const Tensor& probability);

/// Probabilities as scores of a field. @param probability  [surfels, channels].
[[nodiscard]] renderer::SparseScores scores_of_probabilities(const Tensor& probability);

/// Logits as scores of a field: an affine map to [0, 1] that is the same for all surfels, so
/// that the largest blended score is the largest blended logit. A logit alone always wins.
/// @param logits  [surfels, instances].
[[nodiscard]] renderer::SparseScores scores_of_logits(const Tensor& logits);

}  // namespace segsim::reconstruction::internal
