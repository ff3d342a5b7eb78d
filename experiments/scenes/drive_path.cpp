// Scripted drives: from way-points to camera poses.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <numbers>

#include "core/config.h"
#include "core/error.h"
#include "experiments/scenes/view_sampler.h"
#include "reconstruction/datasets/labels_file.h"

namespace segsim::experiments::scenes {
namespace {

using core::ConfigNode;
using core::InputError;

constexpr double kDegree_rad = std::numbers::pi / 180.0;

double positive(const ConfigNode& root, const std::string& key, double fallback) {
  const double value = root.number_or(key, fallback);
  if (!(value > 0.0) || !std::isfinite(value)) {
    root.child(key).fail("a number > 0", std::to_string(value));
  }
  return value;
}

std::string place_of(const Drive& drive, std::size_t i) {
  char text[80];
  std::snprintf(text, sizeof text, ": way point %zu (%.2f, %.2f)", i + 1,
                drive.way_points_m[i].x, drive.way_points_m[i].y);
  return drive.origin + text;
}

/// Corners of the whole path; those of one leg end where the next begins.
std::vector<glm::dvec2> corners_of(const sim::World& world, const Drive& drive) {
  std::vector<glm::dvec2> corners{drive.way_points_m.front()};
  for (std::size_t i = 1; i < drive.way_points_m.size(); ++i) {
    const glm::dvec2 from = drive.way_points_m[i - 1], to = drive.way_points_m[i];
    const std::array goal{to};
    const std::vector<glm::dvec2> path = world.distance_to(goal).path_from(from);
    if (path.empty()) {
      throw InputError::expected(
          place_of(drive, i),
          "a place that the robot reaches from way point " + std::to_string(i), "none");
    }
    for (const glm::dvec2& corner : path) {
      if (std::hypot(corner.x - corners.back().x, corner.y - corners.back().y) > 1e-6) {
        corners.push_back(corner);
      }
    }
  }
  return corners;
}

/// Pictures on the spot between two headings, both ends excluded.
void append_turn(const glm::dvec2& p_m, double from_rad, double to_rad, double every_rad,
                 std::vector<core::Pose2>& poses) {
  const double turn = core::wrap_angle_rad(to_rad - from_rad);
  const int steps = static_cast<int>(std::ceil(std::abs(turn) / every_rad - 1e-9));
  for (int k = 1; k < steps; ++k) {
    poses.push_back(
        {p_m.x, p_m.y, core::wrap_angle_rad(from_rad + turn * k / std::max(1, steps))});
  }
}

}  // namespace

Drive read_drive(const std::filesystem::path& file) {
  const ConfigNode root = ConfigNode::load(file);
  reconstruction::expect_schema(root, "segsim.drive", 1);
  Drive drive;
  drive.origin = file.string();
  drive.scene = root.text_or("scene", "");
  drive.every_m = positive(root, "every_m", 0.5);
  drive.turn_every_rad = kDegree_rad * positive(root, "turn_every_deg", 45.0);
  for (const ConfigNode& node : root.list("way_points")) {
    const std::vector<ConfigNode> numbers = node.as_list();
    if (numbers.size() != 2) node.fail("[x, y]", std::to_string(numbers.size()) + " numbers");
    drive.way_points_m.emplace_back(numbers[0].as_number(), numbers[1].as_number());
  }
  if (drive.way_points_m.size() < 2) {
    throw InputError::expected(file.string() + ": way_points", "two places or more",
                               std::to_string(drive.way_points_m.size()));
  }
  root.finish();
  return drive;
}

std::vector<core::Pose2> drive_poses(const sim::World& world, const Drive& drive) {
  const std::vector<glm::dvec2> corners = corners_of(world, drive);
  std::vector<core::Pose2> poses;
  double along_m = 0.0;  // Driven since the last picture.
  for (std::size_t i = 1; i < corners.size(); ++i) {
    const glm::dvec2 from = corners[i - 1], to = corners[i];
    const double length_m = std::hypot(to.x - from.x, to.y - from.y);
    const double yaw_rad = std::atan2(to.y - from.y, to.x - from.x);
    if (poses.empty()) {
      poses.push_back({from.x, from.y, yaw_rad});
    } else {
      append_turn(from, poses.back().yaw_rad, yaw_rad, drive.turn_every_rad, poses);
    }
    double at_m = drive.every_m - along_m;
    for (; at_m <= length_m + 1e-9; at_m += drive.every_m) {
      const double t = at_m / length_m;
      poses.push_back({from.x + t * (to.x - from.x), from.y + t * (to.y - from.y), yaw_rad});
    }
    along_m = length_m - (at_m - drive.every_m);
  }
  return poses;
}

}  // namespace segsim::experiments::scenes
