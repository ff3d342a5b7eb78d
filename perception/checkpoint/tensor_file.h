#pragma once

/// @file
/// Tensors by name out of files of others, none of which is executed:
///
///     .pt of Python     torch.save() since 1.6: a state dict, a whole module, or a dict with
///                       one of them under "ema", "model" or "state_dict" (in that order; as
///                       Ultralytics writes them)
///     torch archive     torch::save() of C++ and TorchScript: the tensors of the module tree
///     safetensors
///     TensorFlow.js     a model's .json, with the files that hold its weights beside it
///
/// A module tree is read as data: attributes `_modules`, `_parameters` and `_buffers` of
/// Python modules, tensor and module attributes of TorchScript ones.

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "perception/checkpoint/weights_file.h"

namespace segsim::perception {

enum class ElementType { kF16, kBf16, kF32, kF64, kI8, kU8, kI16, kI32, kI64, kBool };
[[nodiscard]] std::size_t bytes_of(ElementType type);

/// A tensor that is still inside the file.
struct StoredTensor {
  std::string name;
  std::vector<std::int64_t> shape, strides;  ///< Strides in elements.
  ElementType type = ElementType::kF32;
  std::size_t offset = 0;  ///< Byte of the first element; all elements lie inside the file.
};

struct TensorFile {
  std::string place;  ///< The file's name, for messages.
  std::string bytes;
  std::string data_name;  ///< Name of the file that `bytes` come from, the first if several.
  std::vector<StoredTensor> tensors;     ///< In the order of the file; each name once.
  std::vector<std::string> class_names;  ///< Of an Ultralytics model; empty if not stated.

  /// The tensor's values as float.
  [[nodiscard]] NamedTensor read(const StoredTensor& tensor) const;
};

/// The format is told by the content, not by the extension.
/// @throws core::InputError with the place for anything damaged, unknown or refused.
[[nodiscard]] TensorFile read_tensor_file(const std::filesystem::path& file);

/// float32, little-endian. @throws core::InputError if the place cannot be written.
void write_safetensors(const std::filesystem::path& file,
                       const std::vector<NamedTensor>& tensors);

}  // namespace segsim::perception
