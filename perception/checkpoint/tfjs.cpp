#include <set>

#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "core/input/json_depth.h"
#include "perception/checkpoint/internal/formats.h"
#include "perception/data/checked_json.h"

namespace segsim::perception {
namespace {

namespace fs = std::filesystem;
using Json = OrderedCheckedJson;

/// How the numbers lie in the file: `dtype` is what they are after loading.
ElementType stored_type(const Json& entry, const std::string& place) {
  const std::string type = entry.at("dtype").get<std::string>();
  const auto quantization = entry.find("quantization");
  if (quantization != entry.end()) {
    const std::string stored = quantization->at("dtype").get<std::string>();
    if (type == "float32" && stored == "float16") return ElementType::kF16;
    throw core::InputError::expected(place, "float32, stored as it is or as float16",
                                     type + " stored as " + stored);
  }
  if (type == "float32") return ElementType::kF32;
  if (type == "int32") return ElementType::kI32;
  if (type == "bool") return ElementType::kBool;
  throw core::InputError::expected(place, "float32, int32 or bool", type);
}

/// Appends the files that hold one group, one after the other.
/// @param read  Names of all files so far.
void append_shards(const Json& paths, const fs::path& model, TensorFile& file,
                   std::set<std::string>& read) {
  for (const Json& entry : paths) {
    const std::string name = entry.get<std::string>();
    if (name.empty() || name == "." || name == ".." ||
        name.find_first_of("/\\") != std::string::npos) {
      throw core::InputError::expected(file.place + ": weightsManifest: paths",
                                       "names of files beside it", "'" + name + "'");
    }
    if (!read.insert(name).second) {  // A page of names of one file would fill the memory.
      throw core::InputError::expected(file.place + ": weightsManifest: paths",
                                       "each file once", "'" + name + "' again");
    }
    file.bytes += core::read_file(model.parent_path() / name);
    if (file.data_name.empty()) file.data_name = name;
  }
}

/// @param offset  Byte of the first number; moves behind the last.
StoredTensor read_entry(const Json& entry, const TensorFile& file, std::size_t& offset) {
  StoredTensor tensor{entry.at("name").get<std::string>(),
                      entry.at("shape").get<std::vector<std::int64_t>>(),
                      {},
                      ElementType::kF32,
                      offset};
  const std::string place = file.place + ": " + tensor.name;
  tensor.type = stored_type(entry, place);
  tensor.strides = dense_strides(tensor.shape);
  const std::int64_t count = element_count(tensor.shape);
  const std::size_t left_bytes = file.bytes.size() - offset;
  if (count < 0 || static_cast<std::size_t>(count) > left_bytes / bytes_of(tensor.type)) {
    throw core::InputError::expected(
        place, "a tensor inside " + file.data_name,
        shape_text(tensor.shape) + " with " + std::to_string(left_bytes) + " bytes left");
  }
  offset += static_cast<std::size_t>(count) * bytes_of(tensor.type);
  return tensor;
}

}  // namespace

void read_tfjs(TensorFile& file) {
  const fs::path model = file.place;
  const std::string text = std::move(file.bytes);
  file.bytes.clear();
  file.data_name.clear();
  if (core::is_too_deep(text)) {
    throw core::InputError::expected(file.place, "a TensorFlow.js model",
                                     "brackets nested beyond any use");
  }
  try {
    const Json json = Json::parse(text);
    std::set<std::string> read;
    std::size_t offset = 0;
    for (const Json& group : json.at("weightsManifest")) {
      append_shards(group.at("paths"), model, file, read);
      for (const Json& entry : group.at("weights")) {
        file.tensors.push_back(read_entry(entry, file, offset));
      }
      if (offset != file.bytes.size()) {
        throw core::InputError::expected(
            file.place + ": weightsManifest",
            std::to_string(offset) + " bytes in " + file.data_name,
            std::to_string(file.bytes.size()));
      }
    }
  } catch (const nlohmann::json::exception& error) {
    throw core::InputError::expected(file.place, "a TensorFlow.js model", error.what());
  }
}

}  // namespace segsim::perception
