#include "perception/checkpoint/tensor_file.h"

#include <bit>
#include <cstring>
#include <set>

#include "core/check.h"
#include "core/error.h"
#include "core/file_io.h"
#include "perception/checkpoint/internal/formats.h"
#include "perception/checkpoint/zip_file.h"

namespace segsim::perception {
namespace {

/// Tied weights share a storage, and a file may hold a second view of each.
constexpr std::uint64_t kMostViews = 4;
constexpr std::size_t kMostSides = 8;

constexpr std::int64_t kMaxElements = std::int64_t{1} << 40U;

template <class Number>
float read_as(const char* at) {
  Number value;
  std::memcpy(&value, at, sizeof value);
  return static_cast<float>(value);
}

float read_element(ElementType type, const char* at) {
  switch (type) {
    case ElementType::kF32:
      return read_as<float>(at);
    case ElementType::kF64:
      return read_as<double>(at);
    case ElementType::kI8:
      return read_as<std::int8_t>(at);
    case ElementType::kU8:
    case ElementType::kBool:
      return read_as<std::uint8_t>(at);
    case ElementType::kI16:
      return read_as<std::int16_t>(at);
    case ElementType::kI32:
      return read_as<std::int32_t>(at);
    case ElementType::kI64:
      return read_as<std::int64_t>(at);
    case ElementType::kF16:
    case ElementType::kBf16:
      break;
  }
  std::uint16_t bits = 0;
  std::memcpy(&bits, at, sizeof bits);
  if (type == ElementType::kF16) return from_half(bits);
  return std::bit_cast<float>(static_cast<std::uint32_t>(bits) << 16U);
}

/// A table of a page can name the numbers of a file so often that memory does not hold them.
void check_budget(const TensorFile& file) {
  std::uint64_t bytes_left = kMostViews * file.bytes.size();
  for (const StoredTensor& tensor : file.tensors) {
    if (tensor.shape.size() > kMostSides) {
      throw core::InputError::expected(file.place + ": " + tensor.name,
                                       "at most " + std::to_string(kMostSides) + " sides",
                                       std::to_string(tensor.shape.size()));
    }
    const auto count = static_cast<std::uint64_t>(element_count(tensor.shape));
    const std::uint64_t bytes = count * bytes_of(tensor.type);
    if (bytes > bytes_left) {
      throw core::InputError::expected(
          file.place + ": " + tensor.name,
          "tensors of at most " + std::to_string(kMostViews) + " times the file's bytes",
          "more");
    }
    bytes_left -= bytes;
  }
}

void check_names(const TensorFile& file) {
  std::set<std::string> names;
  for (const StoredTensor& tensor : file.tensors) {
    if (!names.insert(tensor.name).second) {
      throw core::InputError::expected(file.place, "each tensor once", tensor.name + " again");
    }
  }
}

}  // namespace

std::size_t bytes_of(ElementType type) {
  switch (type) {
    case ElementType::kI8:
    case ElementType::kU8:
    case ElementType::kBool:
      return 1;
    case ElementType::kF16:
    case ElementType::kBf16:
    case ElementType::kI16:
      return 2;
    case ElementType::kF32:
    case ElementType::kI32:
      return 4;
    case ElementType::kF64:
    case ElementType::kI64:
      break;
  }
  return 8;
}

std::int64_t element_count(const std::vector<std::int64_t>& shape) {
  std::int64_t count = 1;
  for (const std::int64_t side : shape) {
    if (side < 0 || (side > 0 && count > kMaxElements / side)) return -1;
    count *= side;
  }
  return count;
}

std::int64_t element_span(const StoredTensor& tensor) {
  if (element_count(tensor.shape) <= 0) return element_count(tensor.shape);
  std::int64_t last = 0;
  for (std::size_t i = 0; i < tensor.shape.size(); ++i) {
    const std::int64_t steps = tensor.shape[i] - 1, stride = tensor.strides[i];
    if (stride < 0 || (steps > 0 && stride > (kMaxElements - last) / steps)) return -1;
    last += steps * stride;
  }
  return last + 1;
}

std::vector<std::int64_t> dense_strides(const std::vector<std::int64_t>& shape) {
  std::vector<std::int64_t> strides(shape.size(), 1);
  for (std::size_t i = shape.size(); i-- > 1;) strides[i - 1] = strides[i] * shape[i];
  return strides;
}

NamedTensor TensorFile::read(const StoredTensor& tensor) const {
  const std::int64_t count = element_count(tensor.shape), span = element_span(tensor);
  const std::size_t item_bytes = bytes_of(tensor.type);
  SEGSIM_CHECK(
      count >= 0 && span >= 0 && tensor.offset <= bytes.size() &&
          static_cast<std::size_t>(span) <= (bytes.size() - tensor.offset) / item_bytes,
      tensor.name);
  NamedTensor result{tensor.name, tensor.shape, {}};
  result.values.reserve(static_cast<std::size_t>(count));
  // Counts through the indices, the last one fastest.
  std::vector<std::int64_t> index(tensor.shape.size(), 0);
  std::int64_t element = 0;
  for (std::int64_t i = 0; i < count; ++i) {
    result.values.push_back(read_element(
        tensor.type,
        bytes.data() + tensor.offset + static_cast<std::size_t>(element) * item_bytes));
    for (std::size_t d = index.size(); d-- > 0;) {
      element += tensor.strides[d];
      if (++index[d] < tensor.shape[d]) break;
      element -= tensor.strides[d] * tensor.shape[d];
      index[d] = 0;
    }
  }
  return result;
}

TensorFile read_tensor_file(const std::filesystem::path& path) {
  TensorFile file;
  file.place = path.string();
  file.bytes = core::read_file(path);
  file.data_name = path.filename().string();
  if (is_zip(file.bytes)) {
    read_torch_zip(file);
  } else if (file.bytes.rfind('{', 0) == 0) {
    read_tfjs(file);
  } else {
    read_safetensors(file);
  }
  check_names(file);
  check_budget(file);
  return file;
}

}  // namespace segsim::perception
