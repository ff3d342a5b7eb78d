#pragma once

/// @file
/// The network from tensors in a file to tensors in a file, for comparison with other
/// implementations on equal weights and inputs.

#include <filesystem>
#include <optional>

#include "perception/yolov13/head_output.h"

namespace segsim::perception::yolov13 {

/// @param weights  A weights file of a YOLOv13.
/// @param input  A file that checkpoint/tensor_file.h reads, with
///
///     images  [batch, 3, height, width]  RGB in [0, 1], sides multiples of 32
///     truth   [objects, 6]               optional: image, class, x0, y0, x1, y1 in pixels
///
/// @param output  A safetensors file with
///
///     predictions   [batch, 4 + classes, anchors]  as decode() says
///     box_logits    [batch, anchors, 64]
///     class_logits  [batch, anchors, classes]
///
/// @returns the loss of these images if there is a truth.
/// @throws core::InputError for other weights, shapes or numbers.
std::optional<LossValues> run_on_tensors(const std::filesystem::path& weights,
                                         const std::filesystem::path& input,
                                         const std::filesystem::path& output);

}  // namespace segsim::perception::yolov13
