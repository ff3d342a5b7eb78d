#pragma once

#include <torch/torch.h>

#include "perception/internal/network/network.h"
#include "perception/yolov13/head_output.h"

namespace segsim::perception::yolov13 {

/// Copies to the host.
[[nodiscard]] HeadOutput to_head_output(const RawOutput& raw, int height_px, int width_px);
/// Tensors that own their memory.
[[nodiscard]] RawOutput to_raw_output(const HeadOutput& output);

}  // namespace segsim::perception::yolov13
