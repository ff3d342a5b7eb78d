#include "perception/yolov13/import.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "perception/checkpoint/lineage.h"
#include "perception/checkpoint/tensor_file.h"
#include "perception/data/coco_names.h"
#include "perception/yolov13/model.h"

namespace segsim::perception::yolov13 {
namespace {

constexpr const char* kFirstLayer = "model.0.conv.weight";
constexpr const char* kClassLayer = "model.32.cv3.0.2.weight";
constexpr const char* kBins = "model.32.dfl.conv.weight";

bool is_counter(const std::string& name) {
  constexpr std::string_view kEnd = "num_batches_tracked";
  return name.size() >= kEnd.size() &&
         name.compare(name.size() - kEnd.size(), kEnd.size(), kEnd) == 0;
}

/// Takes away what wrappers put before the official names.
void strip_wrapper(std::vector<StoredTensor>& tensors) {
  for (const std::string prefix : {"module.", "model.", "module.model."}) {
    const bool wrapped = std::any_of(tensors.begin(), tensors.end(), [&](const auto& tensor) {
      return tensor.name == prefix + kFirstLayer;
    });
    if (!wrapped) continue;
    for (StoredTensor& tensor : tensors) {
      if (tensor.name.rfind(prefix, 0) == 0) tensor.name.erase(0, prefix.size());
    }
    return;
  }
}

std::string shape_text(const std::vector<std::int64_t>& shape) {
  return nlohmann::json(shape).dump();
}

const StoredTensor& find_key_layer(const TensorFile& file, const char* name) {
  const auto found = std::find_if(file.tensors.begin(), file.tensors.end(),
                                  [&](const auto& tensor) { return tensor.name == name; });
  if (found == file.tensors.end() || found->shape.size() != 4) {
    throw core::InputError::expected(file.place, std::string("a YOLOv13 with ") + name,
                                     std::to_string(file.tensors.size()) +
                                         " tensors without it, the first " +
                                         file.tensors.front().name.substr(0, 80));
  }
  return *found;
}

Scale scale_of(const TensorFile& file, const std::optional<Scale>& wanted) {
  const std::int64_t channels = find_key_layer(file, kFirstLayer).shape[0];
  for (const Scale scale : kAllScales) {
    if (table_of(scale).channels(64) != channels) continue;
    if (wanted && *wanted != scale) {
      throw core::InputError::expected(file.place,
                                       std::string("scale ") + table_of(*wanted).letter,
                                       std::string("scale ") + table_of(scale).letter);
    }
    return scale;
  }
  throw core::InputError::expected(file.place + ": " + kFirstLayer,
                                   "16, 32, 64 or 96 channels (n, s, l, x)",
                                   std::to_string(channels));
}

std::vector<std::string> choose_names(const TensorFile& file, const ImportOptions& options) {
  constexpr std::int64_t kMostClasses = 10'000;
  const std::int64_t count = find_key_layer(file, kClassLayer).shape[0];
  if (count < 1 || count > kMostClasses) {
    throw core::InputError::expected(file.place + ": " + kClassLayer, "1 to 10000 classes",
                                     std::to_string(count));
  }
  std::vector<std::string> names =
      options.class_names.empty() ? file.class_names : options.class_names;
  if (names.empty() && count == static_cast<std::int64_t>(coco_names().size())) {
    names = coco_names();
  }
  for (std::int64_t i = 0; names.size() < static_cast<std::size_t>(count) && i < count &&
                           options.class_names.empty() && file.class_names.empty();
       ++i) {
    names.push_back("class " + std::to_string(i));
  }
  if (static_cast<std::int64_t>(names.size()) != count) {
    throw core::InputError::expected(file.place, std::to_string(count) + " class names",
                                     std::to_string(names.size()));
  }
  return names;
}

TensorDifferences compare(const std::vector<StoredTensor>& found,
                          const std::vector<NamedTensor>& wanted) {
  std::map<std::string, const StoredTensor*> by_name;
  for (const StoredTensor& tensor : found) by_name[tensor.name] = &tensor;
  TensorDifferences differences;
  for (const NamedTensor& tensor : wanted) {
    const auto match = by_name.find(tensor.name);
    if (match == by_name.end()) {
      differences.missing.push_back(tensor.name + " " + shape_text(tensor.shape));
      continue;
    }
    if (match->second->shape != tensor.shape) {
      differences.reshaped.push_back(tensor.name + " " + shape_text(match->second->shape) +
                                     " instead of " + shape_text(tensor.shape));
    }
    by_name.erase(match);
  }
  for (const auto& [name, tensor] : by_name) {
    differences.unexpected.push_back(name + " " + shape_text(tensor->shape));
  }
  return differences;
}

void check_values(const NamedTensor& tensor, const std::string& place) {
  for (std::size_t i = 0; i < tensor.values.size(); ++i) {
    if (!std::isfinite(tensor.values[i])) {
      throw core::InputError::expected(place + ": " + tensor.name, "finite values",
                                       std::to_string(tensor.values[i]));
    }
    if (tensor.name == kBins && tensor.values[i] != static_cast<float>(i)) {
      throw core::InputError::expected(place + ": " + tensor.name, "0 ... 15",
                                       std::to_string(tensor.values[i]));
    }
  }
}

}  // namespace

ImportedWeights read_official_weights(const ImportOptions& options) {
  TensorFile file = read_tensor_file(options.source);
  file.tensors.erase(
      std::remove_if(file.tensors.begin(), file.tensors.end(),
                     [](const auto& tensor) { return is_counter(tensor.name); }),
      file.tensors.end());
  strip_wrapper(file.tensors);
  if (file.tensors.empty()) {
    throw core::InputError::expected(file.place, "tensors of a YOLOv13", "none");
  }
  const Scale scale = scale_of(file, options.scale);

  ImportedWeights imported;
  DetectorWeights& weights = imported.weights;
  weights.architecture = architecture_of(scale);
  weights.width = table_of(scale).width;
  weights.input_px = options.input_px;
  weights.score_threshold = options.score_threshold;
  weights.class_names = choose_names(file, options);
  const std::string source = options.source.filename().string();
  const std::string sha256 = core::sha256_hex(file.bytes);
  weights.training =
      with_data(nlohmann::ordered_json{{"imported", source}, {"sha256", sha256}}.dump(),
                {foreign_data(source, sha256)});

  const Model model(scale, static_cast<int>(weights.class_names.size()));
  const std::vector<NamedTensor> wanted = model.tensors();
  imported.differences = compare(file.tensors, wanted);
  if (!imported.differences.empty()) return imported;
  std::map<std::string, const StoredTensor*> by_name;
  for (const StoredTensor& tensor : file.tensors) by_name[tensor.name] = &tensor;
  for (const NamedTensor& tensor : wanted) {
    weights.tensors.push_back(file.read(*by_name.at(tensor.name)));
    check_values(weights.tensors.back(), file.place);
  }
  return imported;
}

DetectorWeights import_weights(const ImportOptions& options,
                               const std::filesystem::path& output,
                               const std::function<void(const TensorDifferences&)>& report) {
  ImportedWeights imported = read_official_weights(options);
  const TensorDifferences& differences = imported.differences;
  if (!differences.empty()) {
    if (report) report(differences);
    const std::string parts = list_some("missing", differences.missing) +
                              list_some("unexpected", differences.unexpected) +
                              list_some("shape of", differences.reshaped);
    throw core::InputError::expected(
        options.source.string(),
        "the tensors of " + imported.weights.architecture + " for " +
            std::to_string(imported.weights.class_names.size()) + " classes",
        parts.substr(0, parts.size() - 2));
  }
  write_weights(output, imported.weights);
  return std::move(imported.weights);
}

}  // namespace segsim::perception::yolov13
