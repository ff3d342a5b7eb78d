#pragma once

/// @file
/// Detectors of others behind core::Detector, each with its own pre- and post-processing:
///
///     YOLO v8 to v13     letterbox (grey 114, INTER_LINEAR), RGB / 255; then by shape
///                        [1, 4 + classes, n]  centre, size, scores: NMS per class is done
///                        here [1, n, 6] or [n, 6]  x0, y0, x1, y1, score, class: the graph
///                        did it [n, 7]               image, x0, y0, x1, y1, class, score (v7)
///                        [1, n, 5 + classes]  with objectness (v5, v7)
///                        four outputs         count, boxes, scores, classes (EfficientNMS)
///     Grounding DINO     text prompt -> token spans; shortest side 800, longest at most 1333,
///                        ImageNet colours; sigmoid of token logits; a box takes the phrase
///                        with its best token (the reference joins all tokens above the text
///                        threshold to a phrase, which need not be one of the prompt)
///
/// Class names of a YOLO: the description's, else the exporter's metadata.

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/stages.h"

namespace segsim::perception {

struct ObjectDetectorOptions {
  /// Phrases of an open-vocabulary detector: its class names. A YOLO refuses phrases that it
  /// has no class for, and keeps only those named, in this order.
  std::vector<std::string> prompts;
  std::optional<float> score_threshold;  ///< Default: the description's, else 0.25 (YOLO) or
                                         ///< 0.35 (Grounding DINO).
  int max_detections = 300;
};

/// @param model  A model file (a YOLO) or a description (model_description.h).
/// @throws core::InputError for damaged files, another signature, a class without a name, a
/// model of another task.
[[nodiscard]] std::unique_ptr<core::Detector> load_object_detector(
    const std::filesystem::path& model, const ObjectDetectorOptions& options = {});

/// Whether a file is a detector of others rather than weights of this program.
[[nodiscard]] bool is_foreign_detector(const std::filesystem::path& file);

/// Whether its classes are those of a prompt.
[[nodiscard]] bool needs_prompt(const std::filesystem::path& model);

/// "chair. office table." -> {"chair", "office table"}: separated by '.', trimmed, lower case,
/// empty ones dropped. @throws core::InputError if nothing is left or a phrase comes twice.
[[nodiscard]] std::vector<std::string> parse_prompt(const std::string& prompt);

}  // namespace segsim::perception
