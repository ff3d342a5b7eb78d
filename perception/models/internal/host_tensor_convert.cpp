#include "perception/models/internal/host_tensor_convert.h"

#include "core/error.h"

namespace segsim::perception {

HostTensor to_host_tensor(const at::Tensor& tensor) {
  HostTensor result;
  result.shape = tensor.sizes().vec();
  const bool floating = at::isFloatingType(tensor.scalar_type());
  const at::Tensor flat =
      tensor.detach().to(at::kCPU).to(floating ? at::kFloat : at::kLong).contiguous();
  const auto count = static_cast<std::size_t>(flat.numel());
  if (floating) {
    const auto* data = flat.data_ptr<float>();
    result.values = std::vector<float>(data, data + count);
  } else {
    const auto* data = flat.data_ptr<std::int64_t>();
    result.values = std::vector<std::int64_t>(data, data + count);
  }
  return result;
}

at::Tensor to_tensor(const HostTensor& tensor, at::ScalarType type, const std::string& place) {
  std::int64_t count = 1;
  for (const std::int64_t side : tensor.shape) count *= side;
  const auto convert = [&](const auto& values, at::ScalarType from) {
    if (static_cast<std::int64_t>(values.size()) != count) {
      throw core::InputError::expected(
          place, std::to_string(count) + " numbers for " + shape_text(tensor.shape),
          std::to_string(values.size()));
    }
    at::Tensor result = at::empty(tensor.shape, from);
    using Number = typename std::decay_t<decltype(values)>::value_type;
    std::copy(values.begin(), values.end(), result.data_ptr<Number>());
    return result.to(type);
  };
  if (const auto* floats = std::get_if<std::vector<float>>(&tensor.values)) {
    return convert(*floats, at::kFloat);
  }
  return convert(std::get<std::vector<std::int64_t>>(tensor.values), at::kLong);
}

std::string first_line(const std::string& message) {
  const std::string line = message.substr(0, message.find('\n'));
  constexpr std::size_t kLongest = 300;
  return line.size() <= kLongest ? line : line.substr(0, kLongest) + " ...";
}

}  // namespace segsim::perception
