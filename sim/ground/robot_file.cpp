// Robots as YAML files; sim/robots/jackal.yaml shows every key.
#include <cmath>

#include "core/error.h"
#include "core/file_io.h"
#include "sim/ground/internal/robot_data.h"
#include "sim/ground/robot.h"

namespace segsim::sim {
namespace {

using core::ConfigNode;

constexpr const char* kSchema = "segsim.robot/1";
/// Farther from an obstacle than this no planner here looks; it must see past its own edge.
constexpr double kLargestRadius_m = 0.8;

/// A number in (0, most].
double positive(const ConfigNode& node, const std::string& key, double most) {
  const double value = node.number(key);
  if (!(value > 0.0 && value <= most)) {
    std::string limit = std::to_string(most);
    limit.erase(limit.find_last_not_of('0') + 1);
    if (limit.back() == '.') limit.pop_back();
    node.child(key).fail("a number above 0, at most " + limit, node.text(key));
  }
  return value;
}

void read_shape(const ConfigNode& root, RobotModel& model) {
  const ConfigNode base = root.child("base");
  model.length_m = positive(base, "length_m", 2.0);
  model.width_m = positive(base, "width_m", 2.0);
  model.height_m = positive(base, "height_m", 2.0);
  if (model.circumscribed_radius_m() > kLargestRadius_m) {
    base.fail("a base within a circle of 0.8 m radius",
              base.text("length_m") + " by " + base.text("width_m") + " m");
  }
  base.finish();
  model.clearance_m = positive(root, "clearance_m", 0.5);
  model.body_top_m = positive(root, "body_top_m", 2.5);
  if (model.body_top_m < model.clearance_m + 0.1) {
    root.child("body_top_m").fail("at least 0.1 m above clearance_m", root.text("body_top_m"));
  }
  model.mast_height_m = 0.0;
  if (const auto mast = root.optional_child("mast")) {
    model.mast_height_m = positive(*mast, "height_m", 3.0);
    model.mast_radius_m = positive(*mast, "radius_m", 0.5);
    mast->finish();
  }
  model.camera_height_m = positive(root, "camera_height_m", 3.0);
}

void read_drive(const ConfigNode& root, RobotModel& model) {
  const ConfigNode limits = root.child("limits");
  model.max_forward_mps = positive(limits, "forward_mps", 20.0);
  model.max_turn_radps = positive(limits, "turn_radps", 50.0);
  model.max_acceleration_mps2 = positive(limits, "acceleration_mps2", 1000.0);
  model.max_deceleration_mps2 = positive(limits, "deceleration_mps2", 1000.0);
  model.max_turn_acceleration_radps2 = positive(limits, "turn_acceleration_radps2", 1000.0);
  limits.finish();
  const ConfigNode wheels = root.child("wheels");
  model.wheel_radius_m = positive(wheels, "radius_m", 1.0);
  model.track_m = positive(wheels, "track_m", 2.0);
  if (wheels.has("separation_multiplier")) {
    model.separation_multiplier = positive(wheels, "separation_multiplier", 10.0);
  }
  model.max_wheel_mps = positive(wheels, "max_mps", 50.0);
  wheels.finish();
  if (root.has("command_timeout_s")) {
    model.command_timeout_s = positive(root, "command_timeout_s", 10.0);
  }
}

RobotModel parse(const std::string& text, const std::string& origin) {
  const ConfigNode root = ConfigNode::parse(text, origin);
  (void)core::choice(root, "schema", {kSchema});
  RobotModel model;
  model.name = root.text("name");
  if (model.name.empty() || model.name.find_first_of("/@ \n\"") != std::string::npos) {
    root.child("name").fail("a name without spaces, slashes and @", "\"" + model.name + "\"");
  }
  model.title = root.text_or("title", model.name);
  read_shape(root, model);
  read_drive(root, model);
  root.finish();
  return model;
}

bool is_file(const std::string& name) {
  return name.find('/') != std::string::npos || name.ends_with(".yaml");
}

const internal::RobotText* find_built_in(const std::string& name) {
  for (const internal::RobotText& robot : internal::robot_texts()) {
    if (robot.name == name) return &robot;
  }
  return nullptr;
}

std::string choices() {
  std::string all;
  for (const std::string& name : RobotModel::names()) all += name + " | ";
  return all + "a file (.yaml)";
}

}  // namespace

const std::vector<std::string>& RobotModel::names() {
  static const std::vector<std::string> kNames = [] {
    std::vector<std::string> names;
    for (const internal::RobotText& robot : internal::robot_texts()) {
      names.emplace_back(robot.name);
    }
    return names;
  }();
  return kNames;
}

RobotModel RobotModel::load(const std::filesystem::path& file) {
  constexpr std::size_t kDigits = 8;
  const std::string text = core::read_file(file);
  RobotModel model = parse(text, file.string());
  model.file = file.string();
  model.name += "@" + core::sha256_hex(text).substr(0, kDigits);
  return model;
}

RobotModel RobotModel::by_name(const std::string& name) {
  if (const internal::RobotText* robot = find_built_in(name)) {
    return parse(robot->yaml, "sim/robots/" + name + ".yaml");
  }
  if (is_file(name)) return load(name);
  throw core::InputError::expected("robot", choices(), "'" + name + "'");
}

RobotModel RobotModel::read(
    const core::ConfigNode& node,
    const std::function<std::filesystem::path(const core::ConfigNode&)>& expand) {
  const std::string name = node.as_text();
  if (find_built_in(name) != nullptr) return by_name(name);
  if (is_file(name)) return load(expand(node));
  const std::string near = core::nearest_word(name, names());
  node.fail(choices(), "\"" + name + "\"" + (near.empty() ? "" : " (near: " + near + ")"));
}

}  // namespace segsim::sim
