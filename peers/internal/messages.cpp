#include "peers/internal/messages.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "core/error.h"

namespace segsim::peers::internal {
namespace {

constexpr int kLargestImage_px = 32768;
constexpr std::int64_t kMostBytes = std::int64_t{1} << 40;

const char* const kModeKey = "mode";
constexpr std::size_t kLongestQuote = 60;
/// Of pixels and metres: beyond it a number is no place.
constexpr double kFarthest = 1e6;

template <class To, class From>
Json transform_json(const core::Transform<To, From>& T) {
  const glm::dquat& q = T.rotation();
  const glm::dvec3& p_m = T.translation_m();
  return {{"rotation_wxyz", {q.w, q.x, q.y, q.z}}, {"translation_m", {p_m.x, p_m.y, p_m.z}}};
}

template <class To, class From>
core::Transform<To, From> read_transform(const Fields& fields) {
  const std::vector<double> q = fields.numbers("rotation_wxyz", 4);
  const std::vector<double> p_m = fields.numbers("translation_m", 3);
  return {glm::dquat(q[0], q[1], q[2], q[3]), {p_m[0], p_m[1], p_m[2]}};
}

Json points_json(const std::vector<glm::dvec2>& points_m) {
  Json list = Json::array();
  for (const glm::dvec2& p_m : points_m) list.push_back({p_m.x, p_m.y});
  return list;
}

glm::dvec2 read_point(const Fields& fields, const char* key) {
  const std::vector<double> xy_m = fields.numbers(key, 2);
  if (std::max(std::abs(xy_m[0]), std::abs(xy_m[1])) > kFarthest) {
    fields.fail(key, "[x, y] within 1e6 m");
  }
  return {xy_m[0], xy_m[1]};
}

/// Numbers x, y, x, y, ... of the pairs.
std::vector<glm::dvec2> read_points(const Fields& fields, const char* key) {
  std::vector<glm::dvec2> points_m;
  if (!fields.has(key)) return points_m;
  for (const Fields& point : fields.list(key)) points_m.push_back(read_point(point, nullptr));
  return points_m;
}

Json image_json(const ImagePlace& image, bool colours) {
  Json shape = {image.height_px, image.width_px};
  if (colours) shape.push_back(3);
  return {{"offset", image.offset_bytes},
          {"shape", shape},
          {"dtype", colours ? "uint8" : "float32"}};
}

ImagePlace read_image(const Fields& fields, std::size_t channels) {
  const std::vector<double> shape = fields.numbers("shape", channels == 1 ? 2 : 3);
  for (const double side_px : {shape[0], shape[1]}) {
    if (!(side_px >= 1.0 && side_px <= kLargestImage_px && side_px == std::floor(side_px))) {
      fields.fail("shape", "[height, width] of at most 32768");
    }
  }
  return {static_cast<std::size_t>(fields.integer("offset", 0, kMostBytes)),
          static_cast<int>(shape[1]), static_cast<int>(shape[0])};
}

/// Every number of the robot, by its name in messages.
template <class Robot, class Visit>
void visit_robot(Robot& robot, const Visit& visit) {
  visit("length_m", robot.length_m);
  visit("width_m", robot.width_m);
  visit("body_top_m", robot.body_top_m);
  visit("clearance_m", robot.clearance_m);
  visit("mast_height_m", robot.mast_height_m);
  visit("mast_radius_m", robot.mast_radius_m);
  visit("max_forward_mps", robot.max_forward_mps);
  visit("max_turn_radps", robot.max_turn_radps);
  visit("max_acceleration_mps2", robot.max_acceleration_mps2);
  visit("max_deceleration_mps2", robot.max_deceleration_mps2);
  visit("max_turn_acceleration_radps2", robot.max_turn_acceleration_radps2);
}

core::PolicyMode read_mode(const Fields& fields) {
  using core::PolicyMode;
  const std::string name = fields.text(kModeKey);
  for (const PolicyMode mode :
       {PolicyMode::kInitialize, PolicyMode::kExplore, PolicyMode::kNavigate,
        PolicyMode::kRecover, PolicyMode::kStop}) {
    if (name == core::to_string(mode)) return mode;
  }
  fields.fail(kModeKey, "initialize, explore, navigate, recover or stop");
}

}  // namespace

std::string to_text(const Json& message) {
  return message.dump(-1, ' ', false, Json::error_handler_t::replace);
}

Json parse_message(const std::string& text, const std::string& from) {
  Json message = Json::parse(text, nullptr, false);
  if (!message.is_object() || !message.contains("type") || !message["type"].is_string()) {
    throw core::InputError::expected(from, "a JSON object with a \"type\"",
                                     text.substr(0, kLongestQuote));
  }
  return message;
}

bool Fields::has(const char* key) const {
  return object_.is_object() && object_.contains(key) && !object_[key].is_null();
}

void Fields::fail(const char* key, const std::string& expected) const {
  const bool own = key == nullptr;
  const Json* found = own ? &object_ : has(key) ? &object_[key] : nullptr;
  // Of lists and objects only the kind: writing them would be as deep as they are.
  std::string text = found == nullptr         ? "none"
                     : found->is_structured() ? found->type_name()
                                              : to_text(*found);
  if (text.size() > kLongestQuote) text = text.substr(0, kLongestQuote) + "...";
  throw core::InputError::expected(own ? place_ : place_ + "." + key, expected, text);
}

/// Without a key the node itself.
const Json& Fields::member(const char* key, const char* expected) const {
  if (key == nullptr) return object_;
  if (!has(key)) fail(key, expected);
  return object_[key];
}

std::string Fields::text(const char* key) const {
  const Json& found = member(key, "a text");
  if (!found.is_string()) fail(key, "a text");
  return found.get<std::string>();
}

double Fields::number(const char* key) const {
  const Json& found = member(key, "a finite number");
  if (!found.is_number() || !std::isfinite(found.get<double>())) fail(key, "a finite number");
  return found.get<double>();
}

double Fields::number_or(const char* key, double fallback) const {
  // JSON writes infinity as null, which is not the fallback.
  return object_.contains(key) ? number(key) : fallback;
}

std::int64_t Fields::integer(const char* key, std::int64_t least, std::int64_t most) const {
  const std::string expected =
      "a whole number in [" + std::to_string(least) + ", " + std::to_string(most) + "]";
  const Json& found = member(key, expected.c_str());
  const bool fits = found.is_number_integer() &&
                    !(found.is_number_unsigned() &&
                      found.get<std::uint64_t>() > static_cast<std::uint64_t>(most)) &&
                    found.get<std::int64_t>() >= least && found.get<std::int64_t>() <= most;
  if (!fits) fail(key, expected);
  return found.get<std::int64_t>();
}

std::uint64_t Fields::unsigned_number(const char* key) const {
  const Json& found = member(key, "a whole number >= 0");
  if (!found.is_number_unsigned()) fail(key, "a whole number >= 0");
  return found.get<std::uint64_t>();
}

std::vector<double> Fields::numbers(const char* key, std::size_t count) const {
  const std::string expected =
      "a list of " + (count > 0 ? std::to_string(count) + " " : "") + "finite numbers";
  const Json& found = member(key, expected.c_str());
  if (!found.is_array() || (count > 0 && found.size() != count)) fail(key, expected);
  std::vector<double> values;
  for (const Json& value : found) {
    if (!value.is_number() || !std::isfinite(value.get<double>())) fail(key, expected);
    values.push_back(value.get<double>());
  }
  return values;
}

std::vector<std::string> Fields::texts(const char* key) const {
  const Json& found = member(key, "a list of texts");
  if (!found.is_array()) fail(key, "a list of texts");
  std::vector<std::string> values;
  for (const Json& value : found) {
    if (!value.is_string()) fail(key, "a list of texts");
    values.push_back(value.get<std::string>());
  }
  return values;
}

Fields Fields::map(const char* key) const {
  const Json& found = member(key, "an object");
  if (!found.is_object()) fail(key, "an object");
  return {found, place_ + "." + key};
}

std::vector<Fields> Fields::list(const char* key) const {
  const Json& found = member(key, "a list");
  if (!found.is_array()) fail(key, "a list");
  std::vector<Fields> values;
  for (std::size_t k = 0; k < found.size(); ++k) {
    values.emplace_back(found[k], place_ + "." + key + "[" + std::to_string(k) + "]");
  }
  return values;
}

Json to_json(const EpisodeStart& start) {
  Json robot = Json::object();
  visit_robot(start.robot, [&](const char* key, double value) { robot[key] = value; });
  Json goal = {{"class_name", start.goal.class_name}, {"class_index", start.goal.class_index}};
  if (!start.goal.phrase.empty()) goal["phrase"] = start.goal.phrase;
  return {{"type", "reset"},    {"goal", std::move(goal)},
          {"seed", start.seed}, {"class_names", start.class_names},
          {"robot", robot},     {"camera_height_m", start.camera_height_m}};
}

EpisodeStart read_start(const Fields& fields) {
  EpisodeStart start;
  const Fields goal = fields.map("goal");
  start.goal.class_name = goal.text("class_name");
  start.goal.class_index = static_cast<int>(goal.integer("class_index", -1, 1'000'000));
  if (goal.has("phrase")) start.goal.phrase = goal.text("phrase");
  start.seed = fields.unsigned_number("seed");
  start.class_names = fields.texts("class_names");
  const Fields robot = fields.map("robot");
  visit_robot(start.robot, [&](const char* key, double& value) { value = robot.number(key); });
  start.camera_height_m = fields.number("camera_height_m");
  return start;
}

Json to_json(const core::Observation& observation, const ImagePlaces& places) {
  const core::CameraIntrinsics& K = observation.intrinsics;
  Json images = {{"file", places.file}, {"bytes", places.bytes}};
  if (places.rgb.width_px > 0) images["rgb"] = image_json(places.rgb, true);
  if (places.depth_m.width_px > 0) images["depth_m"] = image_json(places.depth_m, false);
  return {{"time_ns", observation.capture_time_ns},
          {"capture_index", observation.capture_index},
          {"intrinsics",
           {{"width_px", K.width_px},
            {"height_px", K.height_px},
            {"fx_px", K.fx_px},
            {"fy_px", K.fy_px},
            {"cx_px", K.cx_px},
            {"cy_px", K.cy_px}}},
          {"T_odom_robot", transform_json(observation.T_odom_robot)},
          {"T_robot_camera", transform_json(observation.T_robot_camera)},
          {"images", images}};
}

core::Observation read_observation(const Fields& fields, ImagePlaces& places) {
  core::Observation seen;
  seen.capture_time_ns =
      fields.integer("time_ns", 0, std::numeric_limits<std::int64_t>::max());
  seen.capture_index = fields.unsigned_number("capture_index");
  const Fields K = fields.map("intrinsics");
  seen.intrinsics.width_px = static_cast<int>(K.integer("width_px", 1, kLargestImage_px));
  seen.intrinsics.height_px = static_cast<int>(K.integer("height_px", 1, kLargestImage_px));
  seen.intrinsics.fx_px = K.number("fx_px");
  seen.intrinsics.fy_px = K.number("fy_px");
  seen.intrinsics.cx_px = K.number("cx_px");
  seen.intrinsics.cy_px = K.number("cy_px");
  seen.T_odom_robot =
      read_transform<core::frame::Odom, core::frame::Robot>(fields.map("T_odom_robot"));
  seen.T_robot_camera =
      read_transform<core::frame::Robot, core::frame::Camera>(fields.map("T_robot_camera"));
  const Fields images = fields.map("images");
  places = {};
  places.file = images.text("file");
  places.bytes = static_cast<std::size_t>(images.integer("bytes", 0, kMostBytes));
  if (images.has("rgb")) places.rgb = read_image(images.map("rgb"), 3);
  if (images.has("depth_m")) places.depth_m = read_image(images.map("depth_m"), 1);
  return seen;
}

Json to_json(std::span<const core::Detection> detections) {
  Json list = Json::array();
  for (const core::Detection& d : detections) {
    list.push_back({{"class_index", d.class_index},
                    {"score", d.score},
                    {"box_px", {d.box.x0, d.box.y0, d.box.x1, d.box.y1}}});
  }
  return list;
}

std::vector<core::Detection> read_detections(const Fields& fields, int classes) {
  std::vector<core::Detection> detections;
  for (const Fields& found : fields.list("detections")) {
    core::Detection d;
    d.class_index = static_cast<int>(found.integer("class_index", 0, classes - 1));
    const double score = found.number("score");
    if (!(score >= 0.0 && score <= 1.0)) found.fail("score", "a number in [0, 1]");
    d.score = static_cast<float>(score);
    const std::vector<double> box = found.numbers("box_px", 4);
    const bool near = std::all_of(box.begin(), box.end(),
                                  [](double px) { return std::abs(px) <= kFarthest; });
    if (!near) found.fail("box_px", "pixels within 1e6");
    d.box = {static_cast<float>(box[0]), static_cast<float>(box[1]),
             static_cast<float>(box[2]), static_cast<float>(box[3])};
    if (d.box.x0 > d.box.x1 || d.box.y0 > d.box.y1) {
      found.fail("box_px", "[x0, y0, x1, y1] with x0 <= x1 and y0 <= y1");
    }
    detections.push_back(d);
  }
  std::stable_sort(
      detections.begin(), detections.end(),
      [](const core::Detection& a, const core::Detection& b) { return a.score > b.score; });
  return detections;
}

Json to_json(const core::Decision& decision, const core::PolicyView& view) {
  Json message = {{"type", "decision"},
                  {"forward_mps", decision.command.forward_mps},
                  {"turn_radps", decision.command.turn_radps},
                  {kModeKey, core::to_string(decision.mode)}};
  if (decision.stop) message["stop"] = core::to_string(*decision.stop);
  if (!view.path_m.empty()) message["path_m"] = points_json(view.path_m);
  if (!view.frontiers_m.empty()) message["frontiers_m"] = points_json(view.frontiers_m);
  if (view.target_m) message["target_m"] = {view.target_m->x, view.target_m->y};
  return message;
}

core::Decision read_decision(const Fields& fields) {
  core::Decision decision;
  decision.command.forward_mps = fields.number_or("forward_mps", 0.0);
  decision.command.turn_radps = fields.number_or("turn_radps", 0.0);
  if (fields.has(kModeKey)) decision.mode = read_mode(fields);
  if (fields.has("stop")) {
    const std::string reason = fields.text("stop");
    if (reason.empty()) fields.fail("stop", "a reason, or no such field");
    decision.stop = core::stop_reason_from(reason, fields.place() + ".stop");
    if (!fields.has(kModeKey)) decision.mode = core::PolicyMode::kStop;
  }
  return decision;
}

core::PolicyView read_view(const Fields& fields) {
  core::PolicyView view;
  view.path_m = read_points(fields, "path_m");
  view.frontiers_m = read_points(fields, "frontiers_m");
  if (fields.has("target_m")) view.target_m = read_point(fields, "target_m");
  return view;
}

}  // namespace segsim::peers::internal
