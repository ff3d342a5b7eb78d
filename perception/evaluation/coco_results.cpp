// Reads truth and detections of the COCO formats, in double precision.
#include <limits>
#include <map>

#include "core/file_io.h"
#include "perception/data/dataset.h"
#include "perception/data/json_node.h"
#include "perception/evaluation/coco_evaluation.h"

namespace segsim::perception {
namespace {

RegionPx region_from(const JsonNode& node) {
  const std::vector<JsonNode> items = node.items();
  if (items.size() != 4) node.fail("[x, y, width, height] with sizes >= 0");
  const RegionPx region{items[0].finite(), items[1].finite(), items[2].finite(),
                        items[3].finite()};
  if (region.width < 0.0 || region.height < 0.0) {
    node.fail("[x, y, width, height] with sizes >= 0");
  }
  return region;
}

/// Index that a result's id stands for.
int index_from(const std::map<std::int64_t, int>& index_of, const JsonNode& node,
               const std::string& expected) {
  const auto found =
      node.is_integer() ? index_of.find(node.json().get<std::int64_t>()) : index_of.end();
  if (found == index_of.end()) node.fail(expected);
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
  const Json truth = parse_json(core::read_file(truth_json), truth_json.string());
  const Numbering numbering = numbering_of(truth);
  files.images.resize(numbering.image.size());
  for (const Json& annotation : truth.at("annotations")) {
    TruthRegion object;
    object.class_index = numbering.category.at(annotation.at("category_id"));
    object.region = region_from({annotation.at("bbox"), truth_json.string() + ": bbox"});
    object.area_px2 = annotation.value("area", object.region.area_px2());
    object.crowd = annotation.value("iscrowd", 0) == 1;
    object.ignore = rules.honour_ignore && annotation.value("ignore", 0) == 1;
    object.distance_m =
        annotation.value("distance_m", std::numeric_limits<double>::quiet_NaN());
    const int image = numbering.image.at(annotation.at("image_id"));
    files.images[static_cast<std::size_t>(image)].truth.push_back(object);
  }

  const Json results = parse_json(core::read_file(results_json), results_json.string());
  for (const JsonNode& node : JsonNode(results, results_json.string() + ": ").items()) {
    ScoredRegion detection;
    detection.class_index =
        index_from(numbering.category, node.at("category_id"), "the id of a category");
    detection.region = region_from(node.at("bbox"));
    detection.score = node.at("score").finite();
    const int image = index_from(numbering.image, node.at("image_id"), "the id of an image");
    files.images[static_cast<std::size_t>(image)].detections.push_back(detection);
  }
  return files;
}

}  // namespace segsim::perception
