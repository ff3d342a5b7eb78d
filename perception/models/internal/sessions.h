#pragma once

/// @file
/// The ways to run a model file; open_model() chooses.

#include <filesystem>
#include <memory>

#include "perception/models/model_session.h"

namespace segsim::perception {

[[nodiscard]] std::unique_ptr<ModelSession> open_onnx(const std::filesystem::path& file);
[[nodiscard]] std::unique_ptr<ModelSession> open_torchscript(
    const std::filesystem::path& file);
/// Only with the CMake option SEGSIM_ONNXRUNTIME.
[[nodiscard]] std::unique_ptr<ModelSession> open_onnxruntime(
    const std::filesystem::path& file);

}  // namespace segsim::perception
