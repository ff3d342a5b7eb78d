// Reads truth and detections of the COCO formats, in double precision.
#include <algorithm>
#include <cmath>
#include <map>

#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "perception/coco_evaluation.h"
#include "perception/dataset.h"

namespace segsim::perception {
namespace {

using core::InputError;
using Json = nlohmann::json;

std::string shortened(const Json& json) {
  std::string text = json.dump(-1, ' ', false, Json::error_handler_t::replace);
  return text.size() > 60 ? text.substr(0, 57) + "..." : text;
}

Json parse_file(const std::filesystem::path& file) {
  try {
    return Json::parse(core::read_file(file));
  } catch (const Json::exception& error) {
    throw InputError(file.string() + ": not JSON: " + error.what());
  }
}

const Json& member(const Json& json, const std::string& place, const char* key) {
  if (!json.is_object()) throw InputError::expected(place, "an object", shortened(json));
  const auto found = json.find(key);
  if (found == json.end()) {
    throw InputError::expected(place + "." + key, "a value", "nothing");
  }
  return *found;
}

RegionPx region_from(const Json& json, const std::string& place) {
  const bool is_box = json.is_array() && json.size() == 4 &&
                      std::all_of(json.begin(), json.end(), [](const Json& value) {
                        return value.is_number() && std::isfinite(value.get<double>());
                      });
  if (!is_box || json[2].get<double>() < 0.0 || json[3].get<double>() < 0.0) {
    throw InputError::expected(place, "[x, y, width, height] with sizes >= 0",
                               shortened(json));
  }
  return {json[0], json[1], json[2], json[3]};
}

/// Index that a result's id stands for.
int index_from(const std::map<std::int64_t, int>& index_of, const Json& json,
               const std::string& place, const std::string& expected) {
  const auto found =
      json.is_number_integer() ? index_of.find(json.get<std::int64_t>()) : index_of.end();
  if (found == index_of.end()) throw InputError::expected(place, expected, shortened(json));
  return found->second;
}

struct Numbering {
  std::map<std::int64_t, int> image, category;
};

Numbering numbering_of(const Json& truth) {
  Numbering numbering;
  for (const Json& image : truth.at("images")) numbering.image[image.at("id")] = 0;
  for (const Json& category : truth.at("categories")) {
    numbering.category[category.at("id")] = 0;
  }
  for (auto* ids : {&numbering.image, &numbering.category}) {
    int next = 0;
    for (auto& [id, index] : *ids) index = next++;
  }
  return numbering;
}

}  // namespace

CocoFiles read_coco_results(const std::filesystem::path& truth_json,
                            const std::filesystem::path& results_json,
                            const CocoRules& rules) {
  // read_coco names every fault of the truth, so the second look may trust it.
  CocoFiles files;
  files.class_names = read_coco(truth_json).class_names;
  const Json truth = parse_file(truth_json);
  const Numbering numbering = numbering_of(truth);
  files.images.resize(numbering.image.size());
  for (const Json& annotation : truth.at("annotations")) {
    TruthRegion object;
    object.class_index = numbering.category.at(annotation.at("category_id"));
    object.region = region_from(annotation.at("bbox"), truth_json.string());
    object.area_px2 = annotation.value("area", object.region.area_px2());
    object.crowd = annotation.value("iscrowd", 0) == 1;
    object.ignore = rules.honour_ignore && annotation.value("ignore", 0) == 1;
    object.distance_m =
        annotation.value("distance_m", std::numeric_limits<double>::quiet_NaN());
    const int image = numbering.image.at(annotation.at("image_id"));
    files.images[static_cast<std::size_t>(image)].truth.push_back(object);
  }

  const Json results = parse_file(results_json);
  if (!results.is_array()) {
    throw InputError::expected(results_json.string(), "a list of detections",
                               shortened(results));
  }
  for (std::size_t i = 0; i < results.size(); ++i) {
    const std::string place = results_json.string() + ": [" + std::to_string(i) + "]";
    ScoredRegion detection;
    detection.class_index =
        index_from(numbering.category, member(results[i], place, "category_id"),
                   place + ".category_id", "the id of a category");
    detection.region = region_from(member(results[i], place, "bbox"), place + ".bbox");
    const Json& score = member(results[i], place, "score");
    if (!score.is_number() || !std::isfinite(score.get<double>())) {
      throw InputError::expected(place + ".score", "a finite number", shortened(score));
    }
    detection.score = score;
    const int image = index_from(numbering.image, member(results[i], place, "image_id"),
                                 place + ".image_id", "the id of an image");
    files.images[static_cast<std::size_t>(image)].detections.push_back(detection);
  }
  return files;
}

}  // namespace segsim::perception
