#pragma once

#include <ATen/ATen.h>

#include <string>

#include "perception/models/model_session.h"

namespace segsim::perception {

/// Copies; floating types become float, all others int64.
[[nodiscard]] HostTensor to_host_tensor(const at::Tensor& tensor);

/// A tensor that owns its numbers, of type `type`.
/// @throws core::InputError that starts with `place` if shape and numbers do not agree.
[[nodiscard]] at::Tensor to_tensor(const HostTensor& tensor, at::ScalarType type,
                                   const std::string& place);

/// The first line of what a library threw, without its stack.
[[nodiscard]] std::string first_line(const std::string& message);

}  // namespace segsim::perception
