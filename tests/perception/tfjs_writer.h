#pragma once

/// @file
/// Makes TensorFlow.js models, for the tests of the readers.

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "checkpoint_writer.h"
#include "core/file_io.h"
#include "perception/checkpoint/weights_file.h"
#include "tests/temporary_folder.h"

namespace segsim::perception {

inline void write_bytes(const std::filesystem::path& file, const std::string& bytes) {
  core::write_file_atomically(file, [&](std::ostream& out) { out << bytes; });
}

/// As the model's file says it.
inline nlohmann::ordered_json tfjs_manifest(const std::vector<NamedTensor>& tensors,
                                            const std::string& data_name) {
  auto weights = nlohmann::ordered_json::array();
  for (const NamedTensor& tensor : tensors) {
    weights.push_back({{"name", tensor.name},
                       {"shape", tensor.shape},
                       {"dtype", "float32"},
                       {"quantization", {{"dtype", "float16"}}}});
  }
  return {{"format", "graph-model"},
          {"weightsManifest", {{{"paths", {data_name}}, {"weights", weights}}}}};
}

/// float16, one tensor after the other.
inline std::string tfjs_data(const std::vector<NamedTensor>& tensors) {
  std::string bytes;
  for (const NamedTensor& tensor : tensors) {
    for (const float value : tensor.values) append(bytes, to_half(value));
  }
  return bytes;
}

/// "model.json" with "model.bin" beside it.
inline std::filesystem::path write_tfjs(const tests::TemporaryFolder& folder,
                                        const std::vector<NamedTensor>& tensors) {
  write_bytes(folder / "model.bin", tfjs_data(tensors));
  write_bytes(folder / "model.json", tfjs_manifest(tensors, "model.bin").dump());
  return folder / "model.json";
}

}  // namespace segsim::perception
