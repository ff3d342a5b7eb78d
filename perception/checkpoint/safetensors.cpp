#include <map>
#include <nlohmann/json.hpp>

#include "core/check.h"
#include "core/file_io.h"
#include "core/input/json_depth.h"
#include "perception/checkpoint/byte_reader.h"
#include "perception/checkpoint/internal/formats.h"
#include "perception/data/checked_json.h"

namespace segsim::perception {
namespace {

using Json = OrderedCheckedJson;

constexpr std::uint64_t kMaxHeaderBytes = std::uint64_t{100} << 20U;

const std::map<std::string, ElementType>& types() {
  static const std::map<std::string, ElementType> kTypes = {
      {"F16", ElementType::kF16},  {"BF16", ElementType::kBf16}, {"F32", ElementType::kF32},
      {"F64", ElementType::kF64},  {"I8", ElementType::kI8},     {"U8", ElementType::kU8},
      {"I16", ElementType::kI16},  {"I32", ElementType::kI32},   {"I64", ElementType::kI64},
      {"BOOL", ElementType::kBool}};
  return kTypes;
}

StoredTensor read_entry(const std::string& name, const Json& entry, const TensorFile& file,
                        std::size_t data_begin) {
  const std::string place = file.place + ": " + name;
  const std::string type = entry.at("dtype").get<std::string>();
  const auto known = types().find(type);
  if (known == types().end()) {
    throw core::InputError::expected(place, "a known type of element", type);
  }
  StoredTensor tensor{
      name, entry.at("shape").get<std::vector<std::int64_t>>(), {}, known->second, 0};
  const std::int64_t count = element_count(tensor.shape);
  const auto& offsets = entry.at("data_offsets");
  const auto begin = offsets.at(0).get<std::uint64_t>(),
             end = offsets.at(1).get<std::uint64_t>();
  const std::size_t data_bytes = file.bytes.size() - data_begin;
  if (count < 0 || begin > end || end > data_bytes ||
      end - begin != static_cast<std::uint64_t>(count) * bytes_of(tensor.type)) {
    throw core::InputError::expected(
        place, "as many bytes as the shape needs, inside the file",
        "[" + std::to_string(begin) + ", " + std::to_string(end) + ")");
  }
  tensor.strides = dense_strides(tensor.shape);
  tensor.offset = data_begin + begin;
  return tensor;
}

}  // namespace

void read_safetensors(TensorFile& file) {
  ByteReader reader(file.bytes, file.place);
  constexpr std::size_t kLengthBytes = 8;
  const std::uint64_t length =
      file.bytes.size() < kLengthBytes ? 0 : reader.number<std::uint64_t>();
  if (length < 2 || length > kMaxHeaderBytes || length > file.bytes.size() - kLengthBytes ||
      file.bytes[kLengthBytes] != '{') {
    throw core::InputError::expected(
        file.place, "a .pt file (zip, torch 1.6 or later) or a safetensors file",
        "neither, in " + std::to_string(file.bytes.size()) + " bytes");
  }
  const std::string header(reader.take(length));
  if (core::is_too_deep(header)) {
    throw core::InputError::expected(file.place, "a safetensors header",
                                     "brackets nested beyond any use");
  }
  try {
    const Json json = Json::parse(header);
    for (const auto& [name, entry] : json.items()) {
      if (name == "__metadata__") continue;
      file.tensors.push_back(read_entry(name, entry, file, reader.position()));
    }
  } catch (const nlohmann::json::exception& error) {
    throw core::InputError::expected(file.place, "a safetensors header", error.what());
  }
}

void write_safetensors(const std::filesystem::path& file,
                       const std::vector<NamedTensor>& tensors) {
  Json header = Json::object();
  std::uint64_t offset = 0;
  for (const NamedTensor& tensor : tensors) {
    SEGSIM_CHECK(
        element_count(tensor.shape) == static_cast<std::int64_t>(tensor.values.size()),
        tensor.name);
    const std::uint64_t end = offset + tensor.values.size() * sizeof(float);
    header[tensor.name] = {
        {"dtype", "F32"}, {"shape", tensor.shape}, {"data_offsets", {offset, end}}};
    offset = end;
  }
  const std::string text = header.dump();
  const std::uint64_t length = text.size();
  core::write_file_atomically(file, [&](std::ostream& out) {
    out.write(reinterpret_cast<const char*>(&length), sizeof length);
    out << text;
    for (const NamedTensor& tensor : tensors) {
      out.write(reinterpret_cast<const char*>(tensor.values.data()),
                static_cast<std::streamsize>(tensor.values.size() * sizeof(float)));
    }
  });
}

}  // namespace segsim::perception
