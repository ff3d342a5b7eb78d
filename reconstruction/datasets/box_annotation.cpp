#include "reconstruction/datasets/box_annotation.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <utility>

#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "core/formatted.h"
#include "core/input/bounds.h"
#include "core/input/json_depth.h"
#include "reconstruction/datasets/internal/box_index.h"

namespace segsim::reconstruction {
namespace {

using core::InputError;
using nlohmann::json;

/// Every pixel may have to ask all boxes, and every box all cells of their index.
constexpr std::size_t kMostBoxes = 10'000;

/// COCO's word for classes that annotators call otherwise.
std::string coco_word(const std::string& name) {
  static const std::map<std::string, std::string> words{
      {"sofa", "couch"},          {"plant", "potted plant"},     {"pot plant", "potted plant"},
      {"table", "dining table"},  {"television", "tv"},          {"monitor", "tv"},
      {"fridge", "refrigerator"}, {"mobile phone", "cell phone"}};
  const auto found = words.find(name);
  return found == words.end() ? name : found->second;
}

/// One object of the file with the words for messages about it.
struct Entry {
  const json& value;
  std::string place;  ///< "file: objects[3]"

  const json& require(const char* key, const char* expected) const {
    if (!value.is_object() || !value.contains(key)) {
      throw InputError::expected(place, std::string("key '") + key + "' (" + expected + ")",
                                 "none");
    }
    return value[key];
  }
  double number(const json& node, const char* key) const {
    if (!node.is_number() || !core::within_world(node.get<double>())) {
      throw InputError::expected(place + "." + key,
                                 core::print("a finite number within %g", core::kFarthest_m),
                                 node.dump().substr(0, 40));
    }
    return node.get<double>();
  }
  glm::dvec3 vector(const char* key) const {
    const json& node = require(key, "3 numbers");
    if (!node.is_array() || node.size() != 3) {
      throw InputError::expected(place + "." + key, "3 numbers", node.dump());
    }
    return {number(node[0], key), number(node[1], key), number(node[2], key)};
  }
};

OrientedBox read_box(const Entry& entry) {
  OrientedBox box;
  box.center_m = entry.vector("center");
  box.size_m = entry.vector("size");
  box.yaw_rad = entry.number(entry.require("yaw_rad", "a number"), "yaw_rad");
  if (!(box.size_m.x > 0.0 && box.size_m.y > 0.0 && box.size_m.z > 0.0)) {
    throw InputError::expected(entry.place + ".size", "3 extents > 0",
                               entry.value["size"].dump());
  }
  return box;
}

AnnotatedBox read_entry(const Entry& entry, std::set<int>& used_ids) {
  AnnotatedBox annotated;
  const json& id = entry.require("id", "an integer");
  if (!id.is_number_integer() || id.get<std::int64_t>() < 1 ||
      id.get<std::int64_t>() > 65535) {
    throw InputError::expected(entry.place + ".id", "an integer in [1, 65535]", id.dump());
  }
  annotated.id = id.get<std::uint16_t>();
  if (!used_ids.insert(annotated.id).second) {
    throw InputError::expected(entry.place + ".id", "an id that is not used above", id.dump());
  }
  const json& class_name = entry.require("class", "a word");
  if (!class_name.is_string() || class_name.get<std::string>().empty()) {
    throw InputError::expected(entry.place + ".class", "a word", class_name.dump());
  }
  annotated.class_name = coco_word(class_name.get<std::string>());
  annotated.box = read_box(entry);
  if (entry.value.contains("parts")) {
    std::size_t k = 0;
    for (const json& part : entry.value["parts"]) {
      annotated.parts.push_back(
          read_box({part, entry.place + ".parts[" + std::to_string(k++) + "]"}));
    }
  }
  if (const auto core = entry.value.find("core");
      core != entry.value.end() && core->is_boolean()) {
    annotated.core = core->get<bool>();
  }
  if (const auto note = entry.value.find("note");
      note != entry.value.end() && note->is_string()) {
    annotated.note = note->get<std::string>();
  }
  return annotated;
}

/// Numbers the boxes of each class ("chair 1", ...) and lists classes and instances.
void name_boxes(BoxAnnotation& annotation) {
  std::map<std::string, std::uint16_t> class_ids;
  std::map<std::string, int> counts;
  for (AnnotatedBox& box : annotation.boxes) {
    box.name = box.class_name + " " + std::to_string(++counts[box.class_name]);
    auto& class_id = class_ids[box.class_name];
    if (class_id == 0) {
      class_id = static_cast<std::uint16_t>(annotation.classes.size() + 1);
      annotation.classes.push_back({class_id, box.class_name, !box.structure});
    }
    if (box.structure) continue;
    annotation.instances.push_back(
        {box.id, class_id, box.name, box.box.world_min_m(), box.box.world_max_m()});
  }
}

void read_list(const json& list, const std::string& place, bool structure,
               std::set<int>& used_ids, BoxAnnotation& annotation) {
  if (!list.is_array()) throw InputError::expected(place, "a list of boxes", list.dump());
  std::size_t k = 0;
  for (const json& value : list) {
    AnnotatedBox box = read_entry({value, place + "[" + std::to_string(k++) + "]"}, used_ids);
    box.structure = structure;
    if (structure) box.core = false;
    annotation.boxes.push_back(std::move(box));
  }
}

/// Half of the world-aligned extents.
glm::dvec3 world_half(const OrientedBox& box) {
  const double c = std::abs(std::cos(box.yaw_rad)), s = std::abs(std::sin(box.yaw_rad));
  return 0.5 * glm::dvec3(c * box.size_m.x + s * box.size_m.y,
                          s * box.size_m.x + c * box.size_m.y, box.size_m.z);
}

class BoxLabelledSequence final : public RgbdSequence {
 public:
  BoxLabelledSequence(std::unique_ptr<RgbdSequence> inner, BoxAnnotation annotation,
                      const BoxOptions& options)
      : inner_(std::move(inner)),
        annotation_(std::move(annotation)),
        index_(annotation_, options.margin_m),
        notes_(inner_->notes()) {
    notes_.emplace_back("masks: from " + std::to_string(annotation_.boxes.size()) +
                        " annotated boxes; pixels without depth have no label");
  }

  const std::string& name() const override { return inner_->name(); }
  const core::CameraIntrinsics& intrinsics() const override { return inner_->intrinsics(); }
  std::size_t frame_count() const override { return inner_->frame_count(); }
  const std::string& frame_name(std::size_t i) const override { return inner_->frame_name(i); }
  const core::CameraPose& pose(std::size_t i) const override { return inner_->pose(i); }
  std::optional<double> time_s(std::size_t i) const override { return inner_->time_s(i); }
  std::optional<double> depth_time_s(std::size_t i) const override {
    return inner_->depth_time_s(i);
  }
  const PoseTrack& pose_track() const override { return inner_->pose_track(); }
  DepthSensor sensor() const override { return inner_->sensor(); }
  core::Transform<core::frame::World, core::frame::World> T_world_source() const override {
    return inner_->T_world_source();
  }
  bool has_depth() const override { return inner_->has_depth(); }
  bool has_masks() const override { return true; }
  const std::vector<core::SceneClass>& classes() const override { return annotation_.classes; }
  const std::vector<core::SceneInstance>& instances() const override {
    return annotation_.instances;
  }
  const std::vector<std::string>& warnings() const override { return inner_->warnings(); }
  const std::vector<std::string>& notes() const override { return notes_; }
  std::vector<glm::dvec3> seen_points_m(std::size_t i) const override {
    return inner_->seen_points_m(i);
  }
  const WorldPlacement* placement() const override { return inner_->placement(); }

  RgbdFrame load(std::size_t i) const override {
    RgbdFrame frame = inner_->load(i);
    const int width = frame.rgb.width_px(), height = frame.rgb.height_px();
    const int depth_width = frame.depth_m.width_px(), depth_height = frame.depth_m.height_px();
    const core::CameraIntrinsics& camera = inner_->intrinsics();
    frame.semantic = core::Image<std::uint16_t>(width, height);
    frame.instance = core::Image<std::uint16_t>(width, height);
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) {
        const double z = frame.depth_m(x * depth_width / width, y * depth_height / height);
        if (!(z > 0.0)) continue;
        const core::Point<core::frame::Camera> p{camera.back_project({x + 0.5, y + 0.5}, z)};
        const internal::BoxLabel label = index_.at((frame.T_world_camera * p).xyz_m);
        frame.semantic(x, y) = label.class_id;
        frame.instance(x, y) = label.instance_id;
      }
    }
    return frame;
  }

 private:
  std::unique_ptr<RgbdSequence> inner_;
  BoxAnnotation annotation_;
  internal::BoxIndex index_;
  std::vector<std::string> notes_;
};

}  // namespace

bool OrientedBox::contains(const glm::dvec3& point_m, double margin_m) const {
  const glm::dvec3 d = point_m - center_m;
  const double c = std::cos(yaw_rad), s = std::sin(yaw_rad);
  return std::abs(d.x * c + d.y * s) <= 0.5 * size_m.x + margin_m &&
         std::abs(d.y * c - d.x * s) <= 0.5 * size_m.y + margin_m &&
         std::abs(d.z) <= 0.5 * size_m.z + margin_m;
}

glm::dvec3 OrientedBox::world_min_m() const { return center_m - world_half(*this); }
glm::dvec3 OrientedBox::world_max_m() const { return center_m + world_half(*this); }

BoxAnnotation read_box_annotation(const std::filesystem::path& file) {
  const std::string text = core::read_file(file);
  if (core::is_too_deep(text)) {
    throw InputError::expected(file.string(), "JSON", "brackets nested beyond any use");
  }
  json root;
  try {
    root = json::parse(text);
  } catch (const json::exception& error) {
    throw InputError::expected(file.string(), "JSON", error.what());
  }
  if (!root.is_object() || !root.contains("objects")) {
    throw InputError::expected(file.string(), "an object with the key 'objects'",
                               "another document");
  }
  BoxAnnotation annotation;
  std::set<int> used_ids;
  const std::string place = file.string() + ": ";
  read_list(root["objects"], place + "objects", false, used_ids, annotation);
  if (const auto planes = root.find("planes"); planes != root.end()) {
    if (!planes->is_object() || !planes->contains("list")) {
      throw InputError::expected(place + "planes", "an object with the key 'list'", "none");
    }
    read_list((*planes)["list"], place + "planes.list", true, used_ids, annotation);
  }
  std::size_t boxes = 0;
  for (const AnnotatedBox& box : annotation.boxes) {
    boxes += std::max<std::size_t>(1, box.parts.size());
  }
  if (boxes > kMostBoxes) {
    throw InputError::expected(file.string(),
                               "at most " + std::to_string(kMostBoxes) + " boxes and parts",
                               std::to_string(boxes));
  }
  name_boxes(annotation);
  return annotation;
}

std::unique_ptr<RgbdSequence> with_box_labels(std::unique_ptr<RgbdSequence> sequence,
                                              const std::filesystem::path& boxes_file,
                                              const BoxOptions& options) {
  SEGSIM_CHECK(sequence != nullptr, "with_box_labels");
  if (!sequence->has_depth()) {
    throw InputError::expected(sequence->name(),
                               "depth in every frame: boxes label the points of pixels",
                               "frames without depth");
  }
  return std::make_unique<BoxLabelledSequence>(std::move(sequence),
                                               read_box_annotation(boxes_file), options);
}

}  // namespace segsim::reconstruction
