#include "perception/checkpoint/lineage.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <utility>

#include "core/file_io.h"
#include "perception/data/image_file.h"
#include "perception/data/scene_json.h"

namespace segsim::perception {
namespace {

constexpr std::array kPurposes{"train", "mix", "validation", "foreign"};
constexpr const char* kData = "data";
constexpr const char* kUnknown = "unknown";
/// 48 bits: that two sets of 10^5 images share one by chance has a probability of 4e-5.
constexpr std::size_t kHashDigits = 12;

std::string image_sha256(const std::filesystem::path& file) {
  const core::Image<core::Rgb8> image = read_image(file);
  std::string bytes =
      std::to_string(image.width_px()) + "x" + std::to_string(image.height_px()) + ":";
  bytes.append(reinterpret_cast<const char*>(image.data()), image.size() * sizeof(core::Rgb8));
  return core::sha256_hex(bytes);
}

bool is_listed(const std::vector<ImagedScene>& scenes, const std::string& name) {
  return std::any_of(scenes.begin(), scenes.end(),
                     [&](const ImagedScene& scene) { return scene.name == name; });
}

bool knows_scenes(const CocoDataset& dataset) {
  return dataset.scenes.has_value() &&
         std::all_of(dataset.images.begin(), dataset.images.end(),
                     [&](const LabeledImage& image) {
                       return image.scene.empty() || is_listed(*dataset.scenes, image.scene);
                     });
}

std::string hashes_text(const std::vector<std::uint64_t>& hashes) {
  std::string text;
  for (const std::uint64_t hash : hashes) {
    char digits[kHashDigits + 1];
    std::snprintf(digits, sizeof digits, "%012llx", static_cast<unsigned long long>(hash));
    text += digits;
  }
  return text;
}

std::vector<std::uint64_t> read_hashes(const JsonNode& node, int images) {
  const std::string text = node.text();
  const bool fits = text.size() == kHashDigits * static_cast<std::size_t>(images) &&
                    text.find_first_not_of("0123456789abcdef") == std::string::npos;
  if (!fits)
    node.fail("12 hexadecimal digits for each of " + std::to_string(images) + " images");
  std::vector<std::uint64_t> hashes;
  for (std::size_t at = 0; at < text.size(); at += kHashDigits) {
    hashes.push_back(std::stoull(text.substr(at, kHashDigits), nullptr, 16));
  }
  if (!std::is_sorted(hashes.begin(), hashes.end())) node.fail("hashes in ascending order");
  return hashes;
}

DataPurpose read_purpose(const JsonNode& node) {
  const auto found = std::find(kPurposes.begin(), kPurposes.end(), node.text());
  if (found == kPurposes.end()) node.fail("train, mix, validation or foreign");
  return static_cast<DataPurpose>(found - kPurposes.begin());
}

DataUse read_use(const JsonNode& node) {
  constexpr std::int64_t kMaxImages = 100'000'000;
  const DataPurpose purpose = read_purpose(node.at("what"));
  if (purpose == DataPurpose::kForeign) {
    return foreign_data(node.at("file").text(), read_sha256(node.at("sha256")));
  }
  DataUse use{purpose, static_cast<int>(node.at("images").integer(1, kMaxImages)),
              read_sha256(node.at("labels_sha256"))};
  if (node.has("views_sha256")) use.views_sha256 = read_sha256(node.at("views_sha256"));
  if (node.has("image_hashes")) {
    use.image_hashes = read_hashes(node.at("image_hashes"), use.images);
  }
  const JsonNode scenes = node.at("scenes");
  if (scenes.json() != Json(kUnknown)) use.scenes = read_scenes(scenes);
  return use;
}

Json use_json(const DataUse& use) {
  Json json{{"what", to_string(use.purpose)}};
  if (use.purpose == DataPurpose::kForeign) {
    json["file"] = use.file;
    json["sha256"] = use.labels_sha256;
  } else {
    json["images"] = use.images;
    json["labels_sha256"] = use.labels_sha256;
    if (!use.views_sha256.empty()) json["views_sha256"] = use.views_sha256;
    if (!use.image_hashes.empty()) json["image_hashes"] = hashes_text(use.image_hashes);
  }
  json["scenes"] = use.scenes ? scenes_json(*use.scenes) : Json(kUnknown);
  return json;
}

}  // namespace

const char* to_string(DataPurpose purpose) {
  return kPurposes[static_cast<std::size_t>(purpose)];
}

DataUse data_use(DataPurpose purpose, const CocoDataset& dataset) {
  DataUse use{purpose, static_cast<int>(dataset.images.size()), dataset.sha256};
  std::vector<std::string> hashes;
  for (const LabeledImage& image : dataset.images) {
    hashes.push_back(image_sha256(dataset.image_file(image)));
  }
  std::sort(hashes.begin(), hashes.end());
  std::string all;
  for (const std::string& hash : hashes) {
    all += hash;
    use.image_hashes.push_back(std::stoull(hash.substr(0, kHashDigits), nullptr, 16));
  }
  use.views_sha256 = core::sha256_hex(all);
  if (knows_scenes(dataset)) use.scenes = dataset.scenes;
  return use;
}

std::optional<std::vector<DataUse>> recorded_data(const std::string& training,
                                                  const std::string& place) {
  const Json json = parse_json(training, place + ": training");
  if (!json.is_object() || !json.contains(kData)) return std::nullopt;
  std::vector<DataUse> data;
  const JsonNode list(json.at(kData), place + ": training." + kData);
  for (const JsonNode& node : list.items()) data.push_back(read_use(node));
  if (data.empty()) list.fail("at least one data set");
  return data;
}

std::vector<DataUse> data_of(const DetectorWeights& weights,
                             const std::filesystem::path& file) {
  if (auto data = recorded_data(weights.training, file.string())) return *std::move(data);
  return {foreign_data(file.filename().string(), core::sha256_of_file(file))};
}

DataUse foreign_data(const std::string& name, const std::string& sha256) {
  DataUse use{DataPurpose::kForeign, 0, sha256};
  use.file = name;
  return use;
}

std::string with_data(const std::string& training, const std::vector<DataUse>& data) {
  Json json = Json::parse(training);
  std::vector<DataUse> written;
  json[kData] = Json::array();
  for (const DataUse& use : data) {
    if (std::find(written.begin(), written.end(), use) != written.end()) continue;
    written.push_back(use);
    json[kData].push_back(use_json(use));
  }
  return json.dump();
}

void add_data(DetectorWeights& weights, const std::filesystem::path& file, DataUse use) {
  std::vector<DataUse> data = data_of(weights, file);
  data.push_back(std::move(use));
  weights.training = with_data(weights.training, data);
}

bool has_image(const DataUse& use, std::uint64_t hash) {
  return std::binary_search(use.image_hashes.begin(), use.image_hashes.end(), hash);
}

}  // namespace segsim::perception
