#pragma once

/// @file
/// A furnished room whose surfaces have a texture that never repeats, seen by a camera that
/// walks round it: pictures to find depth in, and the exact depth by ray casting.

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <limits>
#include <memory>
#include <numbers>
#include <string>
#include <vector>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "reconstruction/datasets/rgbd_sequence.h"
#include "tests/reconstruction/ray_room.h"

namespace segsim::reconstruction::testing {

/// A number in [0, 1] for each corner of a grid.
inline double corner_noise(std::int64_t u, std::int64_t v, std::uint64_t surface) {
  std::uint64_t h = surface * 0x9E3779B97F4A7C15ULL +
                    static_cast<std::uint64_t>(u) * 0xBF58476D1CE4E5B9ULL +
                    static_cast<std::uint64_t>(v) * 0x94D049BB133111EBULL;
  h ^= h >> 31, h *= 0xD6E8FEB86659FD93ULL, h ^= h >> 27;
  h *= 0x9E3779B97F4A7C15ULL, h ^= h >> 31;
  return static_cast<double>(h >> 11) / 9007199254740992.0;
}

/// Smooth noise with details of `size_m`.
inline double value_noise(double u_m, double v_m, double size_m, std::uint64_t surface) {
  const double u = u_m / size_m, v = v_m / size_m;
  const auto iu = static_cast<std::int64_t>(std::floor(u));
  const auto iv = static_cast<std::int64_t>(std::floor(v));
  const auto smooth = [](double t) { return t * t * (3.0 - 2.0 * t); };
  const double s = smooth(u - std::floor(u)), t = smooth(v - std::floor(v));
  const auto at = [&](int du, int dv) { return corner_noise(iu + du, iv + dv, surface); };
  return (1 - t) * ((1 - s) * at(0, 0) + s * at(1, 0)) +
         t * ((1 - s) * at(0, 1) + s * at(1, 1));
}

/// Grey of a place on a surface, details from 1 m to 6 cm.
inline double surface_grey(double u_m, double v_m, std::uint64_t surface) {
  double grey = 0.0;
  double weight = 0.5;
  for (const double size_m : {1.0, 0.5, 0.25, 0.12, 0.06}) {
    grey += weight * (value_noise(u_m, v_m, size_m, surface) - 0.5);
    weight *= 0.8;
    surface += 100;
  }
  return 128.0 + 110.0 * grey;
}

class StereoRoom final : public RgbdSequence {
 public:
  /// Once round, looking across the room.
  explicit StereoRoom(int frames = 24, int width_px = 160, int height_px = 120)
      : camera_(core::CameraIntrinsics::from_fov(width_px, height_px,
                                                 75.0 * std::numbers::pi / 180.0)) {
    room_.add_walls({0, 0, 0}, {4.4, 4, 2.5});
    room_.add_slab({0, 0, 0}, 4.4, 4);
    room_.add_slab({0, 0, 2.5}, 4.4, 4);
    room_.add_box({0.0, 0.0, 0.0}, {1.2, 0.6, 0.8});
    room_.add_box({3.8, 2.4, 0.0}, {4.4, 3.6, 1.6});
    room_.add_box({1.0, 3.5, 0.0}, {2.4, 4.0, 0.5});
    const glm::dvec3 middle(2.2, 2.0, 1.3);
    for (int i = 0; i < frames; ++i) {
      const double phi = 2.0 * std::numbers::pi * i / frames;
      const glm::dvec3 out(std::cos(phi), std::sin(phi), 0.0);
      const glm::dvec3 eye = middle + 1.2 * out + glm::dvec3(0, 0, 0.15 * std::sin(3 * phi));
      add(core::look_at(eye, middle - 0.6 * out - glm::dvec3(0, 0, 0.35)));
    }
  }

  /// The same room from one place: nothing but turning.
  static std::unique_ptr<StereoRoom> turning(int frames = 24) {
    auto room = std::make_unique<StereoRoom>(0);
    for (int i = 0; i < frames; ++i) {
      const double phi = 2.0 * std::numbers::pi * i / frames;
      const glm::dvec3 eye(2.2 + 0.001 * i, 2.0, 1.3);
      room->add(core::look_at(eye, eye + glm::dvec3(std::cos(phi), std::sin(phi), -0.2)));
    }
    return room;
  }

  /// Frame i gets the pose of another.
  void swap_poses(std::size_t distance) {
    std::vector<core::CameraPose> poses;
    for (std::size_t i = 0; i < poses_.size(); ++i) {
      poses.push_back(poses_[(i * distance) % poses_.size()]);
    }
    told_ = poses;
  }
  [[nodiscard]] const std::vector<Rectangle>& rectangles() const { return room_.rectangles; }
  /// So many points of every frame's surfaces are known beforehand.
  void know_points(int per_frame) { points_per_frame_ = per_frame; }

  const std::string& name() const override { return name_; }
  const core::CameraIntrinsics& intrinsics() const override { return camera_; }
  std::size_t frame_count() const override { return poses_.size(); }
  const std::string& frame_name(std::size_t i) const override { return names_[i]; }
  const core::CameraPose& pose(std::size_t i) const override {
    return told_.empty() ? poses_[i] : told_[i];
  }
  bool has_masks() const override { return false; }
  const std::vector<core::SceneClass>& classes() const override { return classes_; }
  const std::vector<core::SceneInstance>& instances() const override { return instances_; }
  const std::vector<std::string>& warnings() const override { return lines_; }
  const std::vector<std::string>& notes() const override { return lines_; }
  std::vector<glm::dvec3> seen_points_m(std::size_t i) const override {
    std::vector<glm::dvec3> points_m;
    core::RandomStream random(1, "points", i);
    for (int k = 0; k < points_per_frame_; ++k) {
      const glm::dvec2 px(random.uniform(0, camera_.width_px),
                          random.uniform(0, camera_.height_px));
      const core::Point<core::frame::Camera> p{camera_.back_project(px, cast(i, px).depth_m)};
      points_m.push_back((poses_[i] * p).xyz_m);
    }
    return points_m;
  }

  RgbdFrame load(std::size_t i) const override {
    RgbdFrame frame;
    frame.name = names_[i];
    frame.T_world_camera = pose(i);
    frame.rgb = core::Image<core::Rgb8>(camera_.width_px, camera_.height_px);
    frame.depth_m = core::Image<float>(camera_.width_px, camera_.height_px);
    for (int y = 0; y < camera_.height_px; ++y) {
      for (int x = 0; x < camera_.width_px; ++x) {
        const Seen middle = cast(i, {x + 0.5, y + 0.5});
        frame.depth_m(x, y) = static_cast<float>(middle.depth_m);
        // A pixel is a mean, not a point.
        double grey = 0.0;
        for (const double dy : {0.25, 0.75}) {
          for (const double dx : {0.25, 0.75}) grey += 0.25 * cast(i, {x + dx, y + dy}).grey;
        }
        const auto value = static_cast<std::uint8_t>(std::lround(grey));
        frame.rgb(x, y) = {value, value, value};
      }
    }
    return frame;
  }

  /// Pictures and poses in the layout `nerfstudio`, without depth.
  void write_nerfstudio(const std::filesystem::path& folder) const {
    std::filesystem::create_directories(folder / "images");
    std::ofstream json(folder / "transforms.json");
    json.precision(12);
    json << "{\"w\": " << camera_.width_px << ", \"h\": " << camera_.height_px
         << ", \"fl_x\": " << camera_.fx_px << ", \"fl_y\": " << camera_.fy_px
         << ", \"cx\": " << camera_.cx_px << ", \"cy\": " << camera_.cy_px
         << ", \"camera_model\": \"OPENCV\", \"frames\": [";
    for (std::size_t i = 0; i < poses_.size(); ++i) {
      const glm::dmat3 R = glm::mat3_cast(pose(i).rotation());
      const glm::dvec3 t = pose(i).translation_m();
      json << (i == 0 ? "" : ",") << "\n {\"file_path\": \"images/" << names_[i]
           << ".png\", \"transform_matrix\": [";
      for (int row = 0; row < 3; ++row) {  // Camera axes of OpenGL.
        json << "[" << R[0][row] << ", " << -R[1][row] << ", " << -R[2][row] << ", " << t[row]
             << "], ";
      }
      json << "[0, 0, 0, 1]]}";
      const RgbdFrame frame = load(i);
      cv::Mat bgr(camera_.height_px, camera_.width_px, CV_8UC3);
      for (int y = 0; y < bgr.rows; ++y) {
        for (int x = 0; x < bgr.cols; ++x) {
          const core::Rgb8 c = frame.rgb(x, y);
          bgr.at<cv::Vec3b>(y, x) = cv::Vec3b(c.b, c.g, c.r);
        }
      }
      cv::imwrite((folder / "images" / (names_[i] + ".png")).string(), bgr);
    }
    json << "]}\n";
  }

 private:
  struct Seen {
    double depth_m = 0.0, grey = 0.0;
  };

  void add(const core::CameraPose& pose) {
    poses_.push_back(pose);
    names_.push_back("view" + std::to_string(100 + names_.size()));
  }

  Seen cast(std::size_t i, const glm::dvec2& px) const {
    const core::CameraPose& T = poses_[i];
    const glm::dvec3 ray = T.rotation() * camera_.back_project(px, 1.0);
    Seen seen{std::numeric_limits<double>::infinity(), 0.0};
    std::size_t nearest = 0;
    for (std::size_t k = 0; k < room_.rectangles.size(); ++k) {
      const double t = hit(room_.rectangles[k], T.translation_m(), ray);
      if (t < seen.depth_m) seen.depth_m = t, nearest = k;
    }
    const Rectangle& r = room_.rectangles[nearest];
    const glm::dvec3 at = T.translation_m() + seen.depth_m * ray - r.corner_m;
    seen.grey = surface_grey(glm::dot(at, glm::normalize(r.side_m)),
                             glm::dot(at, glm::normalize(r.other_m)), nearest + 1);
    return seen;
  }

  std::string name_ = "stereo room";
  core::CameraIntrinsics camera_;
  RayRoom room_;
  std::vector<core::CameraPose> poses_, told_;
  std::vector<std::string> names_, lines_;
  std::vector<core::SceneClass> classes_;
  std::vector<core::SceneInstance> instances_;
  int points_per_frame_ = 0;
};

}  // namespace segsim::reconstruction::testing
