#include "perception/centernet/import.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "perception/checkpoint/lineage.h"
#include "perception/data/coco_names.h"
#include "perception/internal/centernet/network.h"

namespace segsim::perception::centernet {
namespace {

constexpr const char* kFirstLayer = "tower_0/MobilenetV3/Conv/Conv2D_weights";
constexpr const char* kClassBias = "CenternetHead/centernet_cls_output/biases";
constexpr const char* kStem = "stem.weight";
constexpr float kLevels = 255.0F;

class NameList {
 public:
  /// TensorFlow has [height, width, in, out].
  void convolution(const std::string& ours, const std::string& weight,
                   const std::string& bias) {
    names.push_back({ours + ".weight", weight, {3, 2, 0, 1}});
    if (!bias.empty()) names.push_back({ours + ".bias", bias, {}});
  }
  /// And [height, width, channels, 1] here.
  void depthwise(const std::string& ours, const std::string& weight, const std::string& bias) {
    names.push_back({ours + ".weight", weight, {2, 3, 0, 1}});
    if (!bias.empty()) names.push_back({ours + ".bias", bias, {}});
  }
  void merged_norm(const std::string& ours, const std::string& layer) {
    convolution(ours, layer + "/Conv2D_weights", layer + "/Conv2D_bn_offset");
  }
  void separable(const std::string& ours, const std::string& layer) {
    const std::string point = "tower_0/" + layer + "/separable_conv2d_";
    depthwise(ours + ".depthwise", layer + "/depthwise_weights", "");
    convolution(ours + ".pointwise", point + "weights", point + "bn_offset");
  }
  void head(const std::string& ours, const std::string& layer) {
    depthwise(ours + ".depthwise", layer + "/depthwise_weights", "");
    convolution(ours + ".last", layer + "/pointwise_weights", layer + "/biases");
  }
  void block(int number) {
    const std::string ours = "blocks." + std::to_string(number);
    const std::string layer =
        "MobilenetV3/expanded_conv" + (number == 0 ? "" : "_" + std::to_string(number));
    const std::string tower = "tower_0/" + layer, squeeze = layer + "/squeeze_excite/";
    const bool squeezed = (number >= 3 && number <= 5) || number >= 10;
    if (number > 0) merged_norm(ours + ".expand", tower + "/expand");
    depthwise(ours + ".depthwise", tower + "/depthwise/depthwise_weights",
              tower + "/depthwise/depthwise_bn_offset");
    if (squeezed) {
      convolution(ours + ".squeeze.reduce", squeeze + "Conv/weights", squeeze + "Conv/biases");
      convolution(ours + ".squeeze.expand", squeeze + "Conv_1/weights",
                  squeeze + "Conv_1/biases");
    }
    merged_norm(ours + ".project", tower + "/project");
  }
  void merge(int level) {
    const std::string ours = "merge" + std::to_string(level);
    const std::string skip = "CenternetHead/c" + std::to_string(level) + "_reverse";
    const std::string up = "CenternetHead/c" + std::to_string(level + 1) + "_upsample/branch_";
    merged_norm(ours + ".lateral", "tower_0/" + skip + "/1x1");
    separable(ours + ".skip", skip + "/3x3");  // Named so; its kernel is 5 x 5.
    separable(ours + ".up3", up + "x_upsample_resize");
    separable(ours + ".up5", up + "y_upsample_resize");
  }

  std::vector<PublishedName> names;
};

const StoredTensor& find(const TensorFile& file, const std::string& name) {
  const auto found = std::find_if(file.tensors.begin(), file.tensors.end(),
                                  [&](const auto& tensor) { return tensor.name == name; });
  if (found == file.tensors.end()) {
    throw core::InputError::expected(file.place + ": " + name, "a tensor of CenterNet",
                                     "no such tensor");
  }
  return *found;
}

/// The tensor with its axes in our order.
StoredTensor permuted(const StoredTensor& stored, const PublishedName& name,
                      const std::string& place) {
  const std::size_t wanted = name.axes.empty() ? 1 : name.axes.size();
  if (stored.shape.size() != wanted) {
    throw core::InputError::expected(place + ": " + name.published,
                                     std::to_string(wanted) + " axes",
                                     shape_text(stored.shape));
  }
  StoredTensor result = stored;
  result.name = name.ours;
  for (std::size_t i = 0; i < name.axes.size(); ++i) {
    result.shape[i] = stored.shape[static_cast<std::size_t>(name.axes[i])];
    result.strides[i] = stored.strides[static_cast<std::size_t>(name.axes[i])];
  }
  return result;
}

/// The same order backwards: what the file should say.
std::vector<std::int64_t> published_shape(const std::vector<std::int64_t>& ours,
                                          const PublishedName& name) {
  std::vector<std::int64_t> shape = ours;
  for (std::size_t i = 0; i < name.axes.size(); ++i) {
    shape[static_cast<std::size_t>(name.axes[i])] = ours[i];
  }
  return shape;
}

NamedTensor read_one(const TensorFile& file, const PublishedName& name,
                     const std::vector<std::int64_t>& shape) {
  const StoredTensor& stored = find(file, name.published);
  const std::string place = file.place + ": " + name.published;
  const StoredTensor turned = permuted(stored, name, file.place);
  if (turned.shape != shape) {
    throw core::InputError::expected(place, shape_text(published_shape(shape, name)),
                                     shape_text(stored.shape));
  }
  NamedTensor tensor = file.read(turned);
  for (float& value : tensor.values) {
    if (!std::isfinite(value)) {
      throw core::InputError::expected(place, "finite values", std::to_string(value));
    }
    if (name.ours == kStem) value *= kLevels;
  }
  return tensor;
}

std::vector<std::string> choose_names(const TensorFile& file, const ImportOptions& options) {
  constexpr std::int64_t kMostClasses = 10'000;
  const StoredTensor& bias = find(file, kClassBias);
  const std::int64_t count = bias.shape.size() == 1 ? bias.shape[0] : 0;
  if (count < 1 || count > kMostClasses) {
    throw core::InputError::expected(file.place + ": " + kClassBias, "1 to 10000 classes",
                                     shape_text(bias.shape));
  }
  std::vector<std::string> names = options.class_names;
  if (names.empty() && count == static_cast<std::int64_t>(coco_names().size())) {
    names = coco_names();
  } else if (names.empty()) {
    for (std::int64_t i = 0; i < count; ++i) names.push_back("class " + std::to_string(i));
  }
  if (static_cast<std::int64_t>(names.size()) != count) {
    throw core::InputError::expected(file.place, std::to_string(count) + " class names",
                                     std::to_string(names.size()));
  }
  return names;
}

}  // namespace

std::vector<PublishedName> published_names() {
  NameList list;
  list.merged_norm("stem", "tower_0/MobilenetV3/Conv");
  for (int i = 0; i < kBlockCount; ++i) list.block(i);
  list.merged_norm("widen", "tower_0/extern1");
  for (const int level : {4, 3, 2}) list.merge(level);
  list.merged_norm("gate.reduce", "tower_0/CenternetHead/conv1x1_se_a");
  list.convolution("gate.expand", "CenternetHead/conv1x1_se_b/weights", "");
  list.head("class_head", "CenternetHead/centernet_cls_output");
  list.head("box_head", "CenternetHead/centernet_wh_output");
  return list.names;
}

bool is_published(const TensorFile& file) {
  return std::any_of(file.tensors.begin(), file.tensors.end(),
                     [](const auto& tensor) { return tensor.name == kFirstLayer; });
}

DetectorWeights read_published_weights(const TensorFile& file,
                                       const std::filesystem::path& source,
                                       const ImportOptions& options) {
  DetectorWeights weights;
  weights.architecture = DetectorWeights::kCenterNet;
  weights.width = 1.0;
  weights.input_px = options.input_px;
  weights.score_threshold = options.score_threshold;
  weights.class_names = choose_names(file, options);
  const std::string data_sha256 = core::sha256_hex(file.bytes);
  weights.training = with_data(nlohmann::ordered_json{{"imported", source.filename().string()},
                                                      {"sha256", core::sha256_of_file(source)},
                                                      {"data_sha256", data_sha256}}
                                   .dump(),
                               {foreign_data(file.data_name, data_sha256)});

  const Network network(static_cast<int>(weights.class_names.size()));
  std::map<std::string, PublishedName> by_name;
  for (PublishedName& name : published_names()) by_name.emplace(name.ours, name);
  for (const NamedTensor& wanted : export_tensors(*network)) {
    weights.tensors.push_back(read_one(file, by_name.at(wanted.name), wanted.shape));
  }
  return weights;
}

}  // namespace segsim::perception::centernet
