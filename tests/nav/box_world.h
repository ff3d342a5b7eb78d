#pragma once

/// @file
/// A small world of boxes for tests of the policy: analytic depth camera on a mast, kinematic
/// robot with a round footprint, detections from the visible pixels of one box.

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include <glm/geometric.hpp>
#include <glm/mat3x3.hpp>

#include "core/random.h"
#include "core/stages.h"

namespace segsim::nav::test {

struct Box {
  glm::dvec3 low{0.0}, high{0.0};
};

struct BoxWorld {
  std::vector<Box> boxes;      ///< Walls and furniture.
  std::optional<Box> object;   ///< What is searched.
  std::vector<Box> invisible;  ///< Hit by the robot, not seen by the camera (glass).
  double ceiling_m = 2.5;
};

/// Walls with an outline and doors.
class WorldBuilder {
 public:
  static constexpr double kWall_m = 0.10, kHeight_m = 2.5;
  BoxWorld world;
  /// Wall along x at y, from x0 to x1, with a door gap if door1 > door0.
  void wall_x(double y, double x0, double x1, double door0 = 0, double door1 = 0) {
    if (door1 > door0) {
      wall_x(y, x0, door0);
      wall_x(y, door1, x1);
      return;
    }
    add(x0, y - 0.5 * kWall_m, 0, x1, y + 0.5 * kWall_m, kHeight_m);
  }
  void wall_y(double x, double y0, double y1, double door0 = 0, double door1 = 0) {
    if (door1 > door0) {
      wall_y(x, y0, door0);
      wall_y(x, door1, y1);
      return;
    }
    add(x - 0.5 * kWall_m, y0, 0, x + 0.5 * kWall_m, y1, kHeight_m);
  }
  void add(double x0, double y0, double z0, double x1, double y1, double z1) {
    world.boxes.push_back({{x0, y0, z0}, {x1, y1, z1}});
  }
  void table(double x0, double y0, double x1, double y1) {
    add(x0, y0, 0.70, x1, y1, 0.74);
    for (const double x : {x0, x1 - 0.05}) {
      for (const double y : {y0, y1 - 0.05}) add(x, y, 0.0, x + 0.05, y + 0.05, 0.70);
    }
  }
};

/// Four rooms along a corridor, 10 m x 8 m = 80 m2, doors of 0.9 m, some furniture.
inline BoxWorld four_rooms() {
  WorldBuilder b;
  b.wall_x(0, 0, 10);
  b.wall_x(8, 0, 10);
  b.wall_y(0, 0, 8);
  b.wall_y(10, 0, 8);
  b.wall_x(3.3, 0, 5, 3.2, 4.1);
  b.wall_x(3.3, 5, 10, 5.6, 6.5);
  b.wall_x(4.7, 0, 4, 1.0, 1.9);
  b.wall_x(4.7, 4, 10, 7.0, 7.9);
  b.wall_y(5, 0, 3.3);
  b.wall_y(4, 4.7, 8);
  b.add(0.2, 0.2, 0, 2.2, 1.8, 0.5);  // Bed.
  b.add(7.0, 0.1, 0, 9.0, 0.9, 0.8);  // Sofa.
  b.add(9.5, 1.5, 0, 9.9, 3.0, 2.0);  // Wardrobe.
  b.table(1.2, 6.2, 2.6, 7.0);
  b.add(4.1, 7.5, 0, 6.0, 7.9, 0.9);  // Sideboard.
  return b.world;
}

inline double ray_box(const glm::dvec3& origin, const glm::dvec3& inverse, const Box& box) {
  const glm::dvec3 a = (box.low - origin) * inverse, b = (box.high - origin) * inverse;
  const glm::dvec3 near = glm::min(a, b), far = glm::max(a, b);
  const double enter = std::max({near.x, near.y, near.z});
  const double leave = std::min({far.x, far.y, far.z});
  return enter <= leave && enter > 0.0 ? enter : std::numeric_limits<double>::infinity();
}

struct CameraImages {
  core::Image<float> depth_m;
  core::Image<std::uint8_t> is_object;
};

/// Depth along +z, NaN beyond `range_m`; floor z = 0 and a ceiling close the world.
inline CameraImages ray_cast(const BoxWorld& world, const core::CameraIntrinsics& camera,
                             const glm::dmat3& R_world_camera, const glm::dvec3& eye_m,
                             double range_m) {
  CameraImages images{core::Image<float>(camera.width_px, camera.height_px),
                      core::Image<std::uint8_t>(camera.width_px, camera.height_px)};
  for (int y = 0; y < camera.height_px; ++y) {
    for (int x = 0; x < camera.width_px; ++x) {
      const glm::dvec3 d = R_world_camera * camera.back_project({x + 0.5, y + 0.5}, 1.0);
      const glm::dvec3 inverse(1.0 / d.x, 1.0 / d.y, 1.0 / d.z);
      double t = d.z < 0.0 ? -eye_m.z / d.z : (world.ceiling_m - eye_m.z) / d.z;
      for (const Box& box : world.boxes) t = std::min(t, ray_box(eye_m, inverse, box));
      if (world.object) {
        const double hit = ray_box(eye_m, inverse, *world.object);
        if (hit < t) {
          t = hit;
          images.is_object(x, y) = 1;
        }
      }
      images.depth_m(x, y) =
          t <= range_m ? static_cast<float>(t) : std::numeric_limits<float>::quiet_NaN();
    }
  }
  return images;
}

struct SimulationOptions {
  core::CameraIntrinsics camera = core::CameraIntrinsics::from_fov(128, 96, 1.3788);
  double mast_m = 1.1, pitch_down_rad = 0.0, camera_forward_m = 0.0;
  double range_m = 6.0, period_s = 0.2, time_limit_s = 240.0;
  double body_radius_m = 0.25;
  double recall = 1.0;  ///< Chance per frame to detect the visible object.
  double score = 0.8;
  double box_jitter_px = 0.0;
  double depth_noise = 0.0;  ///< Standard deviation at 1 m, growing with the square.
  int min_object_px = 25;
  /// Extra boxes handed to the policy as class 0: (tick, box).
  std::vector<std::pair<int, core::BoxPx>> false_positives;
  std::uint64_t seed = 1;
};

struct SimulationResult {
  std::string stop_reason;  ///< Empty: time over.
  core::Pose2 pose;
  double to_object_m = 1e18;  ///< Planar, to the object's box.
  int object_pixels = 0;      ///< In the last image.
  int ticks = 0, contacts = 0;
  double path_m = 0.0, time_s = 0.0;
  bool spun = false, navigated = false, recovered = false;
  double max_forward_mps = 0.0, max_turn_radps = 0.0;
  std::vector<core::Pose2> track;
  core::PolicyView view;
  bool success() const {
    return stop_reason == "goal_reached" && to_object_m < 1.7 && object_pixels >= 25;
  }
};

inline double planar_distance_m(const Box& box, const glm::dvec2& p) {
  const double dx = std::max({box.low.x - p.x, 0.0, p.x - box.high.x});
  const double dy = std::max({box.low.y - p.y, 0.0, p.y - box.high.y});
  return std::hypot(dx, dy);
}

inline bool collides(const BoxWorld& world, const glm::dvec2& p, double radius_m) {
  const auto hits = [&](const Box& box) {
    return box.low.z < 0.6 && planar_distance_m(box, p) < radius_m;
  };
  return std::any_of(world.boxes.begin(), world.boxes.end(), hits) ||
         std::any_of(world.invisible.begin(), world.invisible.end(), hits) ||
         (world.object && hits(*world.object));
}

/// The robot with its camera; one call of step() is one control tick.
class Simulation {
 public:
  Simulation(BoxWorld world, core::Pose2 start, SimulationOptions options)
      : world_(std::move(world)), pose_(start), options_(std::move(options)) {}

  /// Renders what the robot sees now; valid until the next call.
  const core::Observation& observe() {
    const auto T_robot_camera =
        core::mast_camera(options_.mast_m, options_.pitch_down_rad, options_.camera_forward_m);
    observation_.T_odom_robot = core::transform_from_pose2<core::frame::Odom>(pose_);
    observation_.T_robot_camera = T_robot_camera;
    observation_.intrinsics = options_.camera;
    observation_.capture_index = static_cast<std::uint64_t>(tick_);
    observation_.capture_time_ns = static_cast<core::TimeNs>(tick_ * options_.period_s * 1e9);
    const auto T = observation_.T_odom_camera();
    images_ = ray_cast(world_, options_.camera, glm::mat3_cast(T.rotation()),
                       T.translation_m(), options_.range_m);
    if (options_.depth_noise > 0.0) {
      core::RandomStream random(options_.seed, "depth", static_cast<std::uint64_t>(tick_));
      for (float& depth : images_.depth_m.pixels()) {
        const double sigma = options_.depth_noise * static_cast<double>(depth * depth);
        depth += static_cast<float>(sigma * random.normal());
      }
    }
    observation_.depth_m = &images_.depth_m;
    return observation_;
  }

  [[nodiscard]] int object_pixels() const {
    return static_cast<int>(
        std::count(images_.is_object.pixels().begin(), images_.is_object.pixels().end(), 1));
  }

  /// Detections of the object in the images of the last observe().
  std::vector<core::Detection> detect() {
    std::vector<core::Detection> detections;
    core::RandomStream random(options_.seed, "detect", static_cast<std::uint64_t>(tick_));
    int x0 = 1 << 20, y0 = 1 << 20, x1 = -1, y1 = -1;
    for (int y = 0; y < options_.camera.height_px; ++y) {
      for (int x = 0; x < options_.camera.width_px; ++x) {
        if (images_.is_object(x, y) == 0) continue;
        x0 = std::min(x0, x);
        y0 = std::min(y0, y);
        x1 = std::max(x1, x + 1);
        y1 = std::max(y1, y + 1);
      }
    }
    if (object_pixels() >= options_.min_object_px && random.chance(options_.recall)) {
      const auto jitter = [&](int edge) {
        return static_cast<float>(edge + options_.box_jitter_px * random.normal());
      };
      core::Detection d{0,
                        static_cast<float>(options_.score),
                        {jitter(x0), jitter(y0), jitter(x1), jitter(y1)}};
      detections.push_back(d);
    }
    for (const auto& [tick, box] : options_.false_positives) {
      if (tick == tick_) detections.push_back({0, 0.9F, box});
    }
    return detections;
  }

  /// Moves the robot for one period; a blocked translation stays out, turning always works.
  void step(const core::VelocityCommand& command) {
    constexpr int kSubsteps = 10;
    const double dt = options_.period_s / kSubsteps;
    bool contact = false;
    for (int k = 0; k < kSubsteps; ++k) {
      core::Pose2 next = pose_;
      next.yaw_rad = core::wrap_angle_rad(next.yaw_rad + command.turn_radps * dt);
      next.x_m += command.forward_mps * dt * std::cos(next.yaw_rad);
      next.y_m += command.forward_mps * dt * std::sin(next.yaw_rad);
      if (collides(world_, {next.x_m, next.y_m}, options_.body_radius_m)) {
        contact = true;
        next.x_m = pose_.x_m;
        next.y_m = pose_.y_m;
      }
      path_m_ += std::hypot(next.x_m - pose_.x_m, next.y_m - pose_.y_m);
      pose_ = next;
    }
    if (contact) ++contacts_;
    ++tick_;
  }

  [[nodiscard]] const core::Pose2& pose() const { return pose_; }
  [[nodiscard]] const BoxWorld& world() const { return world_; }
  [[nodiscard]] const SimulationOptions& options() const { return options_; }
  [[nodiscard]] int tick() const { return tick_; }
  [[nodiscard]] int contacts() const { return contacts_; }
  [[nodiscard]] double path_m() const { return path_m_; }

 private:
  BoxWorld world_;
  core::Pose2 pose_;
  SimulationOptions options_;
  core::Observation observation_;
  CameraImages images_;
  int tick_ = 0, contacts_ = 0;
  double path_m_ = 0.0;
};

/// A whole episode.
inline SimulationResult run_episode(const BoxWorld& world, const core::Pose2& start,
                                    const SimulationOptions& options, core::Policy& policy) {
  Simulation simulation(world, start, options);
  SimulationResult result;
  policy.reset({"thing", 0}, options.seed);
  while (simulation.tick() * options.period_s < options.time_limit_s) {
    const core::Observation& observation = simulation.observe();
    const core::Decision decision = policy.decide(observation, simulation.detect());
    result.track.push_back(simulation.pose());
    result.spun |= decision.mode == core::PolicyMode::kInitialize;
    result.navigated |= decision.mode == core::PolicyMode::kNavigate;
    result.recovered |= decision.mode == core::PolicyMode::kRecover;
    result.max_forward_mps = std::max(result.max_forward_mps, decision.command.forward_mps);
    result.max_turn_radps =
        std::max(result.max_turn_radps, std::abs(decision.command.turn_radps));
    if (decision.stop) {
      result.stop_reason = core::to_string(decision.stop);
      break;
    }
    simulation.step(decision.command);
  }
  result.pose = simulation.pose();
  if (world.object) {
    result.to_object_m = planar_distance_m(*world.object, {result.pose.x_m, result.pose.y_m});
    simulation.observe();
    result.object_pixels = simulation.object_pixels();
  }
  result.ticks = simulation.tick();
  result.contacts = simulation.contacts();
  result.path_m = simulation.path_m();
  result.time_s = simulation.tick() * options.period_s;
  result.view = policy.view();
  return result;
}

}  // namespace segsim::nav::test
