#pragma once

/// @file
/// What a model is for and what it wants, as a YAML file beside it:
///
///     schema: segsim.model/1
///     task: grounding-dino        yolo | grounding-dino | sam | clip | siglip | itm | depth
///     files: {model: gdino.onnx, tokenizer: vocab.txt}      relative to this file
///     input_px: [800, 800]        height, width; or one number; default: the model's own
///     class_names: [chair, ...]   yolo; default: the model's metadata
///     score_threshold: 0.35       yolo, grounding-dino
///     text_threshold: 0.25        grounding-dino
///     nms_iou: 0.8                yolo, grounding-dino
///     logit_scale: 117.3          siglip: score = sigmoid(scale * cosine + bias)
///     logit_bias: -12.9
///
/// Files: yolo and grounding-dino `model` (and `tokenizer`), sam `encoder` and `decoder`, clip
/// and siglip `model` or `image` and `text` (and `tokenizer`), itm `model` and `tokenizer`.

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace segsim::perception {

enum class ModelTask : std::uint8_t {
  kYolo,
  kGroundingDino,
  kSam,
  kClip,
  kSiglip,
  kItm,
  kDepth
};

struct ModelDescription {
  std::string place;  ///< Of the description, for messages.
  ModelTask task = ModelTask::kYolo;
  std::map<std::string, std::filesystem::path> files;
  std::optional<int> height_px, width_px;
  std::vector<std::string> class_names;
  std::optional<float> score_threshold, text_threshold, nms_iou;
  std::optional<float> logit_scale, logit_bias;
  bool centred_colours = false;  ///< Of depth: to [-1, 1] (ZoeDepth), not by ImageNet's mean.

  /// @throws core::InputError if the description does not name it.
  [[nodiscard]] const std::filesystem::path& file(const std::string& role) const;
};

/// Reads a description (.yaml, .yml). Any other file is taken for a YOLO model by itself.
/// @throws core::InputError with file, line and key.
[[nodiscard]] ModelDescription read_model_description(const std::filesystem::path& file);

}  // namespace segsim::perception
