#pragma once

/// @file
/// A walk through the largest room of a procedural flat, recorded by cameras with faults to
/// order, in TUM's layout: truth for what is found out about offsets, clocks and noise.

#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "core/render.h"
#include "reconstruction/datasets/color_depth.h"
#include "worlds/capture/mesh_renderer.h"
#include "worlds/procedural/procedural_flat.h"

namespace segsim::reconstruction::testing {

class RoughWalk {
 public:
  // How it is recorded. -------------------------------------------------------------------
  CameraToCamera T_color_depth;
  std::optional<core::CameraIntrinsics> depth_camera;
  double depth_late_s = 0.0;  ///< Depth was taken so long after its stamp.
  double poses_late_s = 0.0;  ///< The same of poses.
  double read_out_s = 0.0;    ///< Of the colour camera, from first row to last.
  int frames = 60;
  double frame_s = 1.0 / 10.0;
  /// Changes a true depth image.
  std::function<void(int, core::Image<float>&)> change_depth;

  /// Without faults.
  void record_well() {
    T_color_depth = {};
    depth_camera.reset();
    depth_late_s = poses_late_s = read_out_s = 0.0;
    change_depth = nullptr;
  }

  explicit RoughWalk(std::uint64_t seed = 3) {
    worlds::FlatOptions options;
    options.seed = seed;
    const worlds::Flat flat = worlds::make_flat_with_rooms(options);
    for (const worlds::FlatRoom& room : flat.rooms) {
      const glm::vec2 size_m = room.max_m - room.min_m;
      const double area_m2 = std::min(size_m.x, size_m.y) * size_m.y * size_m.x;
      if (area_m2 < largest_) continue;
      largest_ = area_m2;
      center_m_ = 0.5 * glm::dvec2(room.min_m + room.max_m);
      half_m_ = 0.5 * glm::dvec2(size_m);
    }
    worlds::MeshRenderOptions fast;
    fast.threads = 1, fast.cell_m = 0.1F, fast.shadow_samples = 6, fast.bounce_samples = 36;
    renderer_ = worlds::make_mesh_renderer(flat.scene, fast);
  }

  /// Held by hand: round the room, looking across it, turning faster and slower, with a sway.
  [[nodiscard]] core::CameraPose pose(double t_s) const {
    const double phi = 0.35 * t_s;
    const glm::dvec3 eye_m(center_m_.x + 0.5 * half_m_.x * std::cos(phi),
                           center_m_.y + 0.5 * half_m_.y * std::sin(phi),
                           1.35 + 0.12 * std::sin(1.3 * t_s));
    const double yaw = phi + std::numbers::pi + 0.35 * std::sin(1.9 * t_s),
                 pitch = 0.3 + 0.18 * std::sin(1.5 * t_s + 1.0);
    const glm::dvec3 ahead(std::cos(yaw) * std::cos(pitch), std::sin(yaw) * std::cos(pitch),
                           -std::sin(pitch));
    const core::CameraPose level = core::look_at(eye_m, eye_m + ahead);
    return {level.rotation() *
                glm::angleAxis(0.06 * std::sin(2.3 * t_s), glm::dvec3(0.0, 0.0, 1.0)),
            eye_m};
  }
  [[nodiscard]] double time_s(int frame) const { return 100.0 + frame_s * frame; }
  [[nodiscard]] int number_at(double time) const {
    return static_cast<int>(std::lround((time - time_s(0)) / frame_s));
  }
  [[nodiscard]] static core::CameraIntrinsics camera() {
    return core::CameraIntrinsics::from_fov(320, 240, 70.0 * std::numbers::pi / 180.0);
  }
  [[nodiscard]] core::Frame draw(const core::CameraPose& T,
                                 const core::CameraIntrinsics& intrinsics) const {
    return renderer_->render(T, intrinsics, core::Channels::kRgbd);
  }
  /// What a colour camera without rolling shutter sees in a frame, with its depth.
  [[nodiscard]] core::Frame truth(int frame) const {
    return draw(pose(time_s(frame)), camera());
  }

  void write(const std::filesystem::path& folder) const {
    namespace fs = std::filesystem;
    fs::create_directories(folder / "rgb");
    fs::create_directories(folder / "depth");
    std::ofstream rgb(folder / "rgb.txt"), depth(folder / "depth.txt"),
        poses(folder / "groundtruth.txt"), intrinsics(folder / "intrinsics.txt");
    const core::CameraIntrinsics c = camera();
    intrinsics.precision(12);
    intrinsics << c.fx_px << ' ' << c.fy_px << ' ' << c.cx_px - 0.5 << ' ' << c.cy_px - 0.5
               << '\n';
    for (int i = 0; i < frames; ++i) {
      const std::string stamp = std::to_string(time_s(i));
      write_color(folder / "rgb" / (stamp + ".png"), i);
      rgb << stamp << " rgb/" << stamp << ".png\n";
      write_depth(folder / "depth" / (stamp + ".png"), i);
      depth << stamp << " depth/" << stamp << ".png\n";
    }
    poses.precision(12);
    for (double t = time_s(0) - 0.3; t < time_s(frames) + 0.3; t += 0.01) {
      const core::CameraPose T = pose(t + poses_late_s);
      const glm::dvec3& p = T.translation_m();
      const glm::dquat& q = T.rotation();
      poses << t << ' ' << p.x << ' ' << p.y << ' ' << p.z << ' ' << q.x << ' ' << q.y << ' '
            << q.z << ' ' << q.w << '\n';
    }
  }

 private:
  void write_color(const std::filesystem::path& file, int frame) const {
    const core::CameraIntrinsics c = camera();
    cv::Mat bgr(c.height_px, c.width_px, CV_8UC3);
    core::Frame drawn;
    // In bands of a few rows: nothing moves by a pixel meanwhile.
    const int rows = read_out_s > 0.0 ? 4 : c.height_px;
    for (int y0 = 0; y0 < c.height_px; y0 += rows) {
      const double share = (y0 + 0.5 * rows) / c.height_px - 0.5;
      core::CameraIntrinsics band = c;
      band.height_px = std::min(rows, c.height_px - y0), band.cy_px -= y0;
      renderer_->render(pose(time_s(frame) + share * read_out_s), band, core::Channels::kRgb,
                        drawn);
      for (int y = y0; y < std::min(y0 + rows, c.height_px); ++y) {
        for (int x = 0; x < c.width_px; ++x) {
          const core::Rgb8 p = drawn.rgb(x, y - y0);
          bgr.at<cv::Vec3b>(y, x) = {p.b, p.g, p.r};
        }
      }
    }
    cv::imwrite(file.string(), bgr);
  }
  void write_depth(const std::filesystem::path& file, int frame) const {
    const core::CameraPose T_world_color = pose(time_s(frame) + depth_late_s);
    const core::CameraPose T_world_depth = T_world_color * T_color_depth;
    core::Frame drawn;
    renderer_->render(T_world_depth, depth_camera.value_or(camera()), core::Channels::kDepth,
                      drawn);
    if (change_depth) change_depth(frame, drawn.depth_m);
    cv::Mat counts(drawn.depth_m.height_px(), drawn.depth_m.width_px(), CV_16U);
    for (int y = 0; y < counts.rows; ++y) {
      for (int x = 0; x < counts.cols; ++x) {
        const float z = drawn.depth_m(x, y);
        counts.at<std::uint16_t>(y, x) =
            z > 0.0F && z < 13.0F ? static_cast<std::uint16_t>(std::lround(5000.0F * z)) : 0;
      }
    }
    cv::imwrite(file.string(), counts);
  }

  double largest_ = 0.0;
  glm::dvec2 center_m_{0.0}, half_m_{0.0};
  std::unique_ptr<core::Renderer> renderer_;
};

}  // namespace segsim::reconstruction::testing
