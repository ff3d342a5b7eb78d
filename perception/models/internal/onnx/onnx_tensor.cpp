#include "perception/models/internal/onnx/onnx_tensor.h"

#include <algorithm>
#include <cstring>
#include <fstream>
#include <optional>

#include "core/error.h"
#include "perception/models/internal/onnx/onnx_model.h"

namespace segsim::perception::graph {
namespace {

namespace fs = std::filesystem;
using core::InputError;
using Proto = ::onnx::TensorProto;

struct Type {
  int onnx;
  const char* name;
  at::ScalarType computed;
  std::size_t stored_bytes;
};

constexpr Type kTypes[] = {
    {Proto::FLOAT, "float", at::kFloat, 4},       {Proto::UINT8, "uint8", at::kByte, 1},
    {Proto::INT8, "int8", at::kChar, 1},          {Proto::UINT16, "uint16", at::kInt, 2},
    {Proto::INT16, "int16", at::kShort, 2},       {Proto::INT32, "int32", at::kInt, 4},
    {Proto::INT64, "int64", at::kLong, 8},        {Proto::BOOL, "bool", at::kBool, 1},
    {Proto::FLOAT16, "float16", at::kFloat, 2},   {Proto::DOUBLE, "double", at::kDouble, 8},
    {Proto::UINT32, "uint32", at::kLong, 4},      {Proto::UINT64, "uint64", at::kLong, 8},
    {Proto::BFLOAT16, "bfloat16", at::kFloat, 2},
};

const Type* find_type(int onnx_type) {
  const auto* found = std::find_if(std::begin(kTypes), std::end(kTypes),
                                   [&](const Type& type) { return type.onnx == onnx_type; });
  return found == std::end(kTypes) ? nullptr : found;
}

const Type& require_type(int onnx_type, const std::string& place) {
  const Type* type = find_type(onnx_type);
  if (type == nullptr) {
    throw InputError::expected(place, "a floating, integer or bool type",
                               type_name(onnx_type) + ", which is not supported");
  }
  return *type;
}

/// Where bytes of a tensor lie in another file.
struct External {
  std::string location;
  std::uint64_t offset = 0;
  std::optional<std::uint64_t> length;
};

std::uint64_t read_count(const std::string& text, const std::string& place) {
  const bool digits =
      !text.empty() && text.size() <= 18 &&
      std::all_of(text.begin(), text.end(), [](char c) { return c >= '0' && c <= '9'; });
  if (!digits) throw InputError::expected(place, "a count of bytes", "'" + text + "'");
  return std::stoull(text);
}

/// A file in the model's folder or below, links resolved.
fs::path inside_folder(const fs::path& folder, const std::string& location,
                       const std::string& place) {
  const fs::path relative = fs::path(location).lexically_normal();
  const fs::path base = fs::weakly_canonical(folder.empty() ? fs::path(".") : folder);
  fs::path file = fs::weakly_canonical(base / relative);
  const auto [end, rest] = std::mismatch(base.begin(), base.end(), file.begin(), file.end());
  if (location.empty() || relative.is_absolute() || end != base.end() || rest == file.end()) {
    throw InputError::expected(place, "external data in the folder of the model",
                               "'" + location + "'");
  }
  return file;
}

std::string read_external(const Proto& proto, std::size_t bytes, const fs::path& folder,
                          const std::string& place) {
  External external;
  for (const auto& entry : proto.external_data()) {
    if (entry.key() == "location") external.location = entry.value();
    if (entry.key() == "offset") external.offset = read_count(entry.value(), place);
    if (entry.key() == "length") external.length = read_count(entry.value(), place);
  }
  const fs::path file = inside_folder(folder, external.location, place);
  std::error_code error;
  const std::uint64_t file_bytes = fs::file_size(file, error);
  if (error) {
    throw InputError::expected(place, "external data in " + file.string(), "no such file");
  }
  if (external.length.value_or(bytes) != bytes || external.offset > file_bytes ||
      bytes > file_bytes - external.offset) {
    throw InputError::expected(place,
                               std::to_string(bytes) + " bytes at " +
                                   std::to_string(external.offset) + " of " + file.string(),
                               "a length of " +
                                   std::to_string(external.length.value_or(bytes)) +
                                   " and a file of " + std::to_string(file_bytes));
  }
  std::string data(bytes, '\0');
  std::ifstream stream(file, std::ios::binary);
  stream.seekg(static_cast<std::streamoff>(external.offset));
  if (!stream.read(data.data(), static_cast<std::streamsize>(bytes))) {
    throw InputError::expected(place, "to read " + file.string(), "an error");
  }
  return data;
}

/// Numbers of one stored type as a tensor of the computed one.
template <class Stored>
at::Tensor from_bytes(const std::string& bytes, at::IntArrayRef shape, at::ScalarType stored,
                      at::ScalarType computed) {
  at::Tensor tensor = at::empty(shape, stored);
  if (!bytes.empty()) std::memcpy(tensor.data_ptr(), bytes.data(), bytes.size());
  static_assert(std::is_trivially_copyable_v<Stored>);
  return tensor.to(computed);
}

/// Unsigned integers that libtorch lacks, widened.
template <class Stored, class Computed>
at::Tensor widened(const std::string& bytes, at::IntArrayRef shape, at::ScalarType computed) {
  at::Tensor tensor = at::empty(shape, computed);
  auto* out = static_cast<Computed*>(tensor.data_ptr());
  for (std::size_t i = 0; i * sizeof(Stored) < bytes.size(); ++i) {
    Stored value;
    std::memcpy(&value, bytes.data() + i * sizeof(Stored), sizeof value);
    out[i] = static_cast<Computed>(value);
  }
  return tensor;
}

at::Tensor from_raw(const Type& type, std::string bytes, at::IntArrayRef shape) {
  switch (type.onnx) {
    case Proto::FLOAT16:
      return from_bytes<std::uint16_t>(bytes, shape, at::kHalf, at::kFloat);
    case Proto::BFLOAT16:
      return from_bytes<std::uint16_t>(bytes, shape, at::kBFloat16, at::kFloat);
    case Proto::UINT16:
      return widened<std::uint16_t, std::int32_t>(bytes, shape, at::kInt);
    case Proto::UINT32:
      return widened<std::uint32_t, std::int64_t>(bytes, shape, at::kLong);
    case Proto::BOOL:  // Any byte but 0 is true; a bool must be 0 or 1.
      for (char& byte : bytes) byte = byte == 0 ? 0 : 1;
      return from_bytes<bool>(bytes, shape, at::kBool, at::kBool);
    default:
      return from_bytes<char>(bytes, shape, type.computed, type.computed);
  }
}

template <class Stored, class Field>
std::string packed(const Field& field) {
  std::string bytes;
  bytes.reserve(static_cast<std::size_t>(field.size()) * sizeof(Stored));
  for (const auto& value : field) {
    const auto stored = static_cast<Stored>(value);
    bytes.append(reinterpret_cast<const char*>(&stored), sizeof stored);
  }
  return bytes;
}

/// The typed fields of the message as raw bytes.
std::string field_bytes(const Proto& proto) {
  switch (proto.data_type()) {
    case Proto::FLOAT:
      return packed<float>(proto.float_data());
    case Proto::DOUBLE:
      return packed<double>(proto.double_data());
    case Proto::INT64:
      return packed<std::int64_t>(proto.int64_data());
    case Proto::UINT32:
      return packed<std::uint32_t>(proto.uint64_data());
    case Proto::UINT64:
      return packed<std::uint64_t>(proto.uint64_data());
    case Proto::INT32:
      return packed<std::int32_t>(proto.int32_data());
    case Proto::INT16:
    case Proto::UINT16:
    case Proto::FLOAT16:
    case Proto::BFLOAT16:
      return packed<std::uint16_t>(proto.int32_data());
    default:
      return packed<std::uint8_t>(proto.int32_data());
  }
}

}  // namespace

std::string type_name(int onnx_type) {
  const Type* type = find_type(onnx_type);
  return type == nullptr ? "type " + std::to_string(onnx_type) : type->name;
}

at::ScalarType scalar_type(int onnx_type, const std::string& place) {
  return require_type(onnx_type, place).computed;
}

at::Tensor read_tensor(const Proto& proto, const fs::path& folder, const std::string& place) {
  const Type& type = require_type(proto.data_type(), place);
  std::vector<std::int64_t> shape(proto.dims().begin(), proto.dims().end());
  std::int64_t count = 1;
  for (const std::int64_t side : shape) {
    if (side < 0 || (side > 0 && count > kMaxElements / side)) {
      throw InputError::expected(place, "a shape of at most 2^30 elements", shape_text(shape));
    }
    count *= side;
  }
  const std::size_t bytes = static_cast<std::size_t>(count) * type.stored_bytes;
  std::string data;
  if (proto.data_location() == Proto::EXTERNAL) {
    data = read_external(proto, bytes, folder, place);
  } else {
    data = proto.has_raw_data() ? proto.raw_data() : field_bytes(proto);
  }
  if (data.size() != bytes) {
    throw InputError::expected(
        place, std::to_string(bytes) + " bytes for " + type.name + " " + shape_text(shape),
        std::to_string(data.size()));
  }
  return from_raw(type, std::move(data), shape);
}

}  // namespace segsim::perception::graph
