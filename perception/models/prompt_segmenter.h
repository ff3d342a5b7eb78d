#pragma once

/// @file
/// Box -> mask, by Segment Anything or MobileSAM as two graphs:
///
///     encoder   image [1, 3, 1024, 1024] (ImageNet colours, scaled to its longest side, zero
///               right and below) or [h, w, 3] in 0 ... 255 (the graph normalises)
///     decoder   the official export: image_embeddings, point_coords, point_labels,
///     mask_input,
///               has_mask_input, orig_im_size -> masks, iou_predictions, low_res_masks; or
///               Hugging Face's: input_boxes (needed), image_embeddings and
///               image_positional_embeddings -> iou_scores, pred_masks
///
/// A box is its two corners with labels 2 and 3. Of several masks the one with the best
/// predicted IoU is taken; logits above 0 are inside.

#include <filesystem>
#include <memory>
#include <span>
#include <vector>

#include "core/image.h"
#include "core/stages.h"

namespace segsim::perception {

struct PromptMask {
  core::Image<std::uint8_t> inside;  ///< 1 in the mask, else 0; size of the image.
  float predicted_iou = 0.0F;        ///< As the model says; [0, 1] by its training.
};

class PromptSegmenter {
 public:
  PromptSegmenter() = default;
  virtual ~PromptSegmenter() = default;
  PromptSegmenter(const PromptSegmenter&) = delete;
  PromptSegmenter& operator=(const PromptSegmenter&) = delete;

  /// One mask per box, in pixels of the image. The image is encoded once.
  [[nodiscard]] virtual std::vector<PromptMask> segment(
      const core::Image<core::Rgb8>& image, std::span<const core::BoxPx> boxes) = 0;
};

/// @param model  A description with task sam (model_description.h).
/// @throws core::InputError for damaged files, another signature or task.
[[nodiscard]] std::unique_ptr<PromptSegmenter> load_prompt_segmenter(
    const std::filesystem::path& model);

}  // namespace segsim::perception
