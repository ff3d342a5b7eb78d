#pragma once

/// @file
/// Tensors in ONNX files: inside the file, or in a file of their own beside it.

#include <ATen/ATen.h>
#include <onnx/onnx_pb.h>

#include <filesystem>
#include <string>

namespace segsim::perception::graph {

/// "float", "int64", ...; "type 8" for those that are not supported.
[[nodiscard]] std::string type_name(int onnx_type);
/// The type it is computed in (onnx_model.h).
/// @throws core::InputError that starts with `place` for types that are not supported.
[[nodiscard]] at::ScalarType scalar_type(int onnx_type, const std::string& place);

/// @param folder  Of the model; external data must lie in it or below.
/// @throws core::InputError that starts with `place`: shape and bytes disagree, data missing.
[[nodiscard]] at::Tensor read_tensor(const ::onnx::TensorProto& proto,
                                     const std::filesystem::path& folder,
                                     const std::string& place);

}  // namespace segsim::perception::graph
