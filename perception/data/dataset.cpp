#include "perception/data/dataset.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>

#include "core/error.h"
#include "core/file_io.h"
#include "core/input/bounds.h"
#include "perception/data/image_file.h"
#include "perception/data/json_node.h"
#include "perception/data/scene_json.h"

namespace segsim::perception {
namespace {

constexpr std::int64_t kMaxId = std::int64_t{1} << 53;  // What a double can count.
constexpr std::int64_t kMaxInstance = std::numeric_limits<int>::max();
constexpr std::int64_t kMaxSide_px = 32768;
constexpr double kHuge = 1e12;
/// COCO's own boxes leave the image by rounding; by more than this it is an error [px].
constexpr double kBorderSlack_px = 2.0;
constexpr const char* kScenes = "segsim_scenes";

std::map<std::int64_t, int> read_categories(const JsonNode& root, CocoDataset& dataset) {
  std::map<std::int64_t, std::string> names;
  std::set<std::string> seen;
  for (const JsonNode& node : root.at("categories").items()) {
    const std::string name = node.at("name").text();
    if (!seen.insert(name).second) node.at("name").fail("a name used once");
    if (!names.emplace(node.at("id").integer(0, kMaxId), name).second) {
      node.at("id").fail("an id used once");
    }
  }
  std::map<std::int64_t, int> index_of;
  for (const auto& [id, name] : names) {
    index_of[id] = static_cast<int>(dataset.class_names.size());
    dataset.class_names.push_back(name);
  }
  return index_of;
}

core::Pose2 read_view(const JsonNode& node) {
  const std::vector<JsonNode> items = node.items();
  if (items.size() != 3) node.fail("[x, y, yaw]");
  const auto value = [&](std::size_t i) { return items[i].number(-kHuge, kHuge, "a number"); };
  return {value(0), value(1), value(2)};
}

std::map<std::int64_t, std::size_t> read_images(const JsonNode& root, CocoDataset& dataset) {
  std::map<std::int64_t, std::size_t> index_of;
  for (const JsonNode& node : root.at("images").items()) {
    LabeledImage image;
    image.id = node.at("id").integer(0, kMaxId);
    image.file = node.at("file_name").text();
    if (std::filesystem::path(image.file).is_absolute()) {
      node.at("file_name").fail("a path relative to the JSON file");
    }
    image.width_px = static_cast<int>(node.at("width").integer(1, kMaxSide_px));
    image.height_px = static_cast<int>(node.at("height").integer(1, kMaxSide_px));
    if (std::int64_t{image.width_px} * image.height_px > core::kMostPixels) {
      node.at("height").fail("at most " + std::to_string(core::kMostPixels) +
                             " pixels, width " + std::to_string(image.width_px));
    }
    if (!index_of.emplace(image.id, dataset.images.size()).second) {
      node.at("id").fail("an id used once");
    }
    if (node.has("scene")) image.scene = node.at("scene").text();
    if (node.has("view")) image.view = read_view(node.at("view"));
    dataset.images.push_back(std::move(image));
  }
  return index_of;
}

core::BoxPx read_box(const JsonNode& node, const LabeledImage& image) {
  const std::vector<JsonNode> items = node.items();
  if (items.size() != 4) node.fail("[x, y, width, height]");
  double v[4];
  for (std::size_t i = 0; i < 4; ++i) v[i] = items[i].number(-kHuge, kHuge, "a number");
  if (v[2] <= 0.0 || v[3] <= 0.0) node.fail("a box with positive width and height");
  if (v[0] < -kBorderSlack_px || v[1] < -kBorderSlack_px ||
      v[0] + v[2] > image.width_px + kBorderSlack_px ||
      v[1] + v[3] > image.height_px + kBorderSlack_px) {
    node.fail("a box inside the image (" + std::to_string(image.width_px) + " x " +
              std::to_string(image.height_px) + ")");
  }
  return {static_cast<float>(v[0]), static_cast<float>(v[1]), static_cast<float>(v[0] + v[2]),
          static_cast<float>(v[1] + v[3])};
}

void read_annotation(const JsonNode& node, const std::map<std::int64_t, int>& class_of,
                     const std::map<std::int64_t, std::size_t>& image_of,
                     CocoDataset& dataset) {
  const auto image_index = image_of.find(node.at("image_id").integer(0, kMaxId));
  if (image_index == image_of.end()) node.at("image_id").fail("the id of an image");
  const auto class_index = class_of.find(node.at("category_id").integer(0, kMaxId));
  if (class_index == class_of.end()) node.at("category_id").fail("the id of a category");
  LabeledImage& image = dataset.images[image_index->second];
  LabeledBox box;
  box.class_index = class_index->second;
  box.box = read_box(node.at("bbox"), image);
  box.area_px2 = node.has("area") ? node.at("area").number(0.0, kHuge, "a number >= 0")
                                  : static_cast<double>(box.box.area_px2());
  if (node.has("iscrowd")) box.crowd = node.at("iscrowd").integer(0, 1) == 1;
  if (node.has("ignore")) box.ignore = node.at("ignore").integer(0, 1) == 1;
  if (node.has("visible_fraction")) {
    box.visible_fraction = node.at("visible_fraction").number(0.0, 1.0, "a number in [0, 1]");
  }
  const auto flag = [&node](const char* key) {
    return node.has(key) && node.at(key).integer(0, 1) == 1;
  };
  box.truncated = flag("truncated");
  box.occluded = flag("occluded");
  if (node.has("distance_m")) {
    box.distance_m = node.at("distance_m").number(0.0, kHuge, "a number >= 0");
  }
  if (node.has("instance_id")) {
    box.instance_id = static_cast<int>(node.at("instance_id").integer(1, kMaxInstance));
  }
  image.boxes.push_back(box);
}

Json annotation_json(const LabeledBox& box, std::int64_t id, std::int64_t image_id) {
  Json json = {{"id", id},
               {"image_id", image_id},
               {"category_id", box.class_index + 1},
               {"bbox", {box.box.x0, box.box.y0, box.box.width_px(), box.box.height_px()}},
               {"area", box.area_px2},
               {"iscrowd", box.crowd ? 1 : 0}};
  if (box.ignore) json["ignore"] = 1;
  if (box.visible_fraction) json["visible_fraction"] = *box.visible_fraction;
  if (box.truncated) json["truncated"] = 1;
  if (box.occluded) json["occluded"] = 1;
  if (box.distance_m) json["distance_m"] = *box.distance_m;
  if (box.instance_id) json["instance_id"] = *box.instance_id;
  return json;
}

}  // namespace

bool is_same_place(const ImagedScene& a, const ImagedScene& b) {
  if (!a.generator.empty() || !b.generator.empty()) {
    return a.generator == b.generator && a.first_seed <= b.last_seed &&
           b.first_seed <= a.last_seed;
  }
  return a.surfels_sha256 == b.surfels_sha256;
}

CocoDataset read_coco(const std::filesystem::path& json_file) {
  const std::string text = core::read_file(json_file);
  const Json json = parse_json(text, json_file.string());
  const JsonNode root(json, json_file.string() + ": ");
  CocoDataset dataset;
  dataset.folder = json_file.parent_path();
  dataset.sha256 = core::sha256_hex(text);
  if (root.has(kScenes)) dataset.scenes = read_scenes(root.at(kScenes));
  const auto class_of = read_categories(root, dataset);
  const auto image_of = read_images(root, dataset);
  std::set<std::int64_t> ids;
  for (const JsonNode& node : root.at("annotations").items()) {
    if (!ids.insert(node.at("id").integer(0, kMaxId)).second)
      node.at("id").fail("an id used once");
    read_annotation(node, class_of, image_of, dataset);
  }
  return dataset;
}

void write_coco(const std::filesystem::path& json_file, const CocoDataset& dataset) {
  Json categories = Json::array(), images = Json::array(), annotations = Json::array();
  for (std::size_t i = 0; i < dataset.class_names.size(); ++i) {
    categories.push_back({{"id", i + 1}, {"name", dataset.class_names[i]}});
  }
  for (const LabeledImage& image : dataset.images) {
    images.push_back({{"id", image.id},
                      {"file_name", image.file},
                      {"width", image.width_px},
                      {"height", image.height_px}});
    if (!image.scene.empty()) images.back()["scene"] = image.scene;
    if (image.view) {
      images.back()["view"] = {image.view->x_m, image.view->y_m, image.view->yaw_rad};
    }
    for (const LabeledBox& box : image.boxes) {
      const auto id = static_cast<std::int64_t>(annotations.size() + 1);
      annotations.push_back(annotation_json(box, id, image.id));
    }
  }
  Json json = {{"images", images}, {"annotations", annotations}, {"categories", categories}};
  if (dataset.scenes) json[kScenes] = scenes_json(*dataset.scenes);
  core::write_file_atomically(json_file,
                              [&json](std::ostream& out) { out << json.dump() << '\n'; });
}

int views_near(const CocoDataset& dataset, const std::string& scene,
               const std::vector<glm::dvec2>& places_m, double radius_m,
               const std::string& showing) {
  const auto is_near = [&](const LabeledImage& image) {
    return std::any_of(places_m.begin(), places_m.end(), [&](const glm::dvec2& p_m) {
      return std::hypot(image.view->x_m - p_m.x, image.view->y_m - p_m.y) < radius_m;
    });
  };
  const auto shows = [&](const LabeledImage& image) {
    return showing.empty() ||
           std::any_of(image.boxes.begin(), image.boxes.end(), [&](const auto& box) {
             return dataset.class_names[static_cast<std::size_t>(box.class_index)] == showing;
           });
  };
  return static_cast<int>(std::count_if(
      dataset.images.begin(), dataset.images.end(), [&](const LabeledImage& image) {
        return image.scene == scene && image.view && is_near(image) && shows(image);
      }));
}

}  // namespace segsim::perception
