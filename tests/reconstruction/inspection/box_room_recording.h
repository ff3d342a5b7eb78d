#pragma once

/// @file
/// A recording in memory with faults to order: a room of 6 x 5 x 2.6 m with furniture, and a
/// camera that turns while it walks round twice. Exact depth; every surface has a texture that
/// its neighbours have not.

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <functional>
#include <limits>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include <glm/geometric.hpp>
#include <opencv2/core.hpp>

#include "reconstruction/datasets/rgbd_sequence.h"

namespace segsim::reconstruction::testing {

class BoxRoomRecording final : public RgbdSequence {
 public:
  /// Twice round in 240 frames. Longer recordings walk on.
  explicit BoxRoomRecording(std::size_t frames = 240) {
    for (std::size_t i = 0; i < frames; ++i) {
      poses_.push_back(true_pose(i));
      char name[32];
      std::snprintf(name, sizeof name, "frame-%06zu", i);
      names_.emplace_back(name);
      truth_.push_back(i);
    }
  }

  // Faults, before the recording is used. -------------------------------------------------
  std::function<void(std::size_t, cv::Mat&)> change_color;  ///< RGB.
  std::function<void(std::size_t, core::Image<float>&)> change_depth;
  std::optional<double> frame_time_s;        ///< Frames have times, so far apart.
  std::optional<std::size_t> repeated_time;  ///< This frame has the time of the one before.

  /// Grows along x over the whole recording.
  void drift(double distance_m) {
    for (std::size_t i = 0; i < poses_.size(); ++i) {
      const double share = static_cast<double>(i) / static_cast<double>(poses_.size());
      poses_[i] = {poses_[i].rotation(),
                   poses_[i].translation_m() + glm::dvec3(distance_m * share, 0.0, 0.0)};
    }
  }
  void scale_poses(double factor) {
    for (core::CameraPose& T : poses_) T = {T.rotation(), factor * T.translation_m()};
  }
  void scale_depth(double factor) { depth_factor_ = factor; }
  void invert_poses() {
    for (core::CameraPose& T : poses_) {
      const auto inverse = T.inverse();
      T = {inverse.rotation(), inverse.translation_m()};
    }
  }
  void erase(std::size_t begin, std::size_t end) {
    const auto cut = [&](auto& values) {
      values.erase(values.begin() + static_cast<std::ptrdiff_t>(begin),
                   values.begin() + static_cast<std::ptrdiff_t>(end));
    };
    cut(poses_), cut(names_), cut(truth_);
  }
  void keep_only(const std::function<bool(double yaw_deg)>& wanted) {
    for (std::size_t i = poses_.size(); i-- > 0;) {
      const glm::dvec3 forward = poses_[i].rotation() * glm::dvec3(0.0, 0.0, 1.0);
      const double yaw_deg = std::atan2(forward.y, forward.x) * 180.0 / std::numbers::pi;
      if (!wanted(yaw_deg < 0.0 ? yaw_deg + 360.0 : yaw_deg)) erase(i, i + 1);
    }
  }
  /// Depth of what lies lower than `height_m`, in frame i.
  void erase_below(std::size_t i, double height_m, core::Image<float>& depth_m) const {
    for (int y = 0; y < depth_m.height_px(); ++y) {
      for (int x = 0; x < depth_m.width_px(); ++x) {
        const core::Point<core::frame::Camera> p{
            camera_.back_project({x + 0.5, y + 0.5}, depth_m(x, y))};
        if ((poses_[i] * p).xyz_m.z < height_m) depth_m(x, y) = std::nanf("");
      }
    }
  }

  [[nodiscard]] std::size_t loads() const { return loads_; }
  [[nodiscard]] std::size_t most_at_once() const { return most_at_once_; }

  // RgbdSequence --------------------------------------------------------------------------
  const std::string& name() const override { return name_; }
  const core::CameraIntrinsics& intrinsics() const override { return camera_; }
  std::size_t frame_count() const override { return poses_.size(); }
  const std::string& frame_name(std::size_t i) const override { return names_[i]; }
  const core::CameraPose& pose(std::size_t i) const override { return poses_[i]; }
  std::optional<double> time_s(std::size_t i) const override {
    if (!frame_time_s) return std::nullopt;
    const std::size_t k = repeated_time == i ? i - 1 : i;
    return *frame_time_s * static_cast<double>(k);
  }
  bool has_masks() const override { return false; }
  const std::vector<core::SceneClass>& classes() const override { return classes_; }
  const std::vector<core::SceneInstance>& instances() const override { return instances_; }
  const std::vector<std::string>& warnings() const override { return lines_; }
  const std::vector<std::string>& notes() const override { return lines_; }

  RgbdFrame load(std::size_t i) const override {
    ++loads_;
    const std::size_t now = ++at_once_;
    for (std::size_t most = most_at_once_;
         now > most && !most_at_once_.compare_exchange_weak(most, now);) {
    }
    RgbdFrame frame = render(true_pose(truth_[i]));
    frame.name = names_[i];
    frame.T_world_camera = pose(i);
    for (float& d : frame.depth_m.pixels()) d *= static_cast<float>(depth_factor_);
    if (change_depth) change_depth(i, frame.depth_m);
    if (change_color) {
      cv::Mat view(frame.rgb.height_px(), frame.rgb.width_px(), CV_8UC3, frame.rgb.data());
      change_color(i, view);
    }
    --at_once_;
    return frame;
  }

 private:
  struct Box {
    glm::dvec3 min_m, max_m;
  };
  struct Hit {
    double distance = std::numeric_limits<double>::infinity();
    int surface = 0;  ///< Of all surfaces; decides the colour.
    int axis = 0;     ///< That the surface is perpendicular to.
  };
  static constexpr Box kRoom{{-3.0, -2.5, 0.0}, {3.0, 2.5, 2.6}};
  static constexpr std::array<Box, 6> kFurniture{{{{-0.5, -0.4, 0.0}, {0.5, 0.4, 0.75}},
                                                  {{2.4, -1.0, 0.0}, {3.0, 0.2, 1.9}},
                                                  {{-3.0, 1.2, 0.0}, {-2.3, 2.5, 0.9}},
                                                  {{-2.8, -2.5, 0.0}, {-1.9, -2.0, 1.5}},
                                                  {{0.7, 2.0, 0.0}, {1.9, 2.5, 2.1}},
                                                  {{1.0, -2.5, 0.0}, {1.5, -2.1, 0.5}}}};

  /// Outwards, 3 degrees a frame, at half the way to the walls; the pitch goes up and down.
  static core::CameraPose true_pose(std::size_t i) {
    const double phi = static_cast<double>(i) * 3.0 * std::numbers::pi / 180.0;
    const glm::dvec3 eye_m(1.4 * std::cos(phi), 1.1 * std::sin(phi),
                           1.3 + 0.1 * std::sin(0.37 * phi));
    const double pitch_rad = -0.15 + 0.35 * std::sin(1.5 * phi);
    return core::look_at(
        eye_m, eye_m + glm::dvec3(std::cos(pitch_rad) * std::cos(phi),
                                  std::cos(pitch_rad) * std::sin(phi), std::sin(pitch_rad)));
  }

  static Hit cast(const glm::dvec3& eye_m, const glm::dvec3& d) {
    Hit hit;
    for (int axis = 0; axis < 3; ++axis) {
      const double wall_m = d[axis] > 0.0 ? kRoom.max_m[axis] : kRoom.min_m[axis];
      const double distance = (wall_m - eye_m[axis]) / d[axis];
      if (distance < hit.distance) hit = {distance, 2 * axis + (d[axis] > 0.0 ? 1 : 0), axis};
    }
    int surface = 6;
    for (const Box& box : kFurniture) {
      double enter = 0.0, leave = std::numeric_limits<double>::infinity();
      int enter_axis = 0;
      for (int axis = 0; axis < 3; ++axis) {
        double a = (box.min_m[axis] - eye_m[axis]) / d[axis];
        double b = (box.max_m[axis] - eye_m[axis]) / d[axis];
        if (a > b) std::swap(a, b);
        if (a > enter) enter = a, enter_axis = axis;
        leave = std::min(leave, b);
      }
      if (enter > 0.0 && enter < leave && enter < hit.distance) {
        hit = {enter, surface + enter_axis, enter_axis};
      }
      surface += 3;
    }
    return hit;
  }

  /// Fine stripes of low contrast on a colour of the surface's own.
  static core::Rgb8 color(const Hit& hit, const glm::dvec3& p_m) {
    const double u = p_m[(hit.axis + 1) % 3], v = p_m[(hit.axis + 2) % 3];
    const int shade =
        (static_cast<int>(std::floor(u / 0.08)) + static_cast<int>(std::floor(v / 0.08))) %
                    2 ==
                0
            ? 0
            : 8;
    const auto channel = [&](int factor) {
      return static_cast<std::uint8_t>(40 + (hit.surface * factor) % 170 + shade);
    };
    return {channel(71), channel(113), channel(37)};
  }

  RgbdFrame render(const core::CameraPose& T_world_camera) const {
    RgbdFrame frame;
    frame.rgb = core::Image<core::Rgb8>(camera_.width_px, camera_.height_px);
    frame.depth_m = core::Image<float>(camera_.width_px, camera_.height_px);
    for (int y = 0; y < camera_.height_px; ++y) {
      for (int x = 0; x < camera_.width_px; ++x) {
        // Depth 1 along +z, so the distance along this ray is the depth.
        const glm::dvec3 d =
            T_world_camera.rotation() * camera_.back_project({x + 0.5, y + 0.5}, 1.0);
        const Hit hit = cast(T_world_camera.translation_m(), d);
        frame.depth_m(x, y) = static_cast<float>(hit.distance);
        frame.rgb(x, y) = color(hit, T_world_camera.translation_m() + hit.distance * d);
      }
    }
    return frame;
  }

  std::string name_ = "box room";
  core::CameraIntrinsics camera_ =
      core::CameraIntrinsics::from_fov(192, 144, 75.0 * std::numbers::pi / 180.0);
  std::vector<core::CameraPose> poses_;
  std::vector<std::string> names_;
  std::vector<std::size_t> truth_;  ///< Which frame of the walk it is.
  mutable std::atomic<std::size_t> loads_{0}, at_once_{0}, most_at_once_{0};
  double depth_factor_ = 1.0;
  std::vector<core::SceneClass> classes_;
  std::vector<core::SceneInstance> instances_;
  std::vector<std::string> lines_;
};

}  // namespace segsim::reconstruction::testing
