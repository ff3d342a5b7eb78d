#pragma once

#include "perception/checkpoint/tensor_file.h"

namespace segsim::perception {

/// Fill `tensors` and `class_names` from `bytes`. read_tfjs() puts the files that the model
/// names in the place of `bytes`.
void read_torch_zip(TensorFile& file);
void read_safetensors(TensorFile& file);
void read_tfjs(TensorFile& file);

/// Number of elements, -1 if a side is negative or the product leaves 2^40.
[[nodiscard]] std::int64_t element_count(const std::vector<std::int64_t>& shape);
/// Elements from the first to behind the last one, or -1 for a negative stride or a span that
/// leaves 2^40; 0 for an empty tensor.
[[nodiscard]] std::int64_t element_span(const StoredTensor& tensor);
/// Row-major.
[[nodiscard]] std::vector<std::int64_t> dense_strides(const std::vector<std::int64_t>& shape);

}  // namespace segsim::perception
