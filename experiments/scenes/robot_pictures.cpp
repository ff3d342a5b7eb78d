#include "experiments/scenes/robot_pictures.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <string>
#include <vector>

#include <glm/geometric.hpp>
#include <glm/vec2.hpp>

#include "core/formatted.h"
#include "core/random.h"
#include "experiments/drawing/frame_picture.h"
#include "experiments/drawing/map_canvas.h"
#include "experiments/scenes/coverage.h"
#include "experiments/support/text_grid.h"

namespace segsim::experiments::scenes {
namespace {

constexpr int kMargin_px = 12, kCaption_px = 22;
constexpr double kLetter_px = 7.0;

/// The first cell, then always the one farthest from those chosen; ties go to the earlier one.
std::vector<glm::dvec2> spread_places(const std::vector<glm::dvec2>& cells_m, int count) {
  std::vector<glm::dvec2> places_m{cells_m.front()};
  std::vector<double> nearest_m(cells_m.size(), std::numeric_limits<double>::infinity());
  while (static_cast<int>(places_m.size()) < count) {
    for (std::size_t i = 0; i < cells_m.size(); ++i) {
      nearest_m[i] = std::min(nearest_m[i], glm::distance(cells_m[i], places_m.back()));
    }
    const auto farthest = std::max_element(nearest_m.begin(), nearest_m.end());
    places_m.push_back(cells_m[static_cast<std::size_t>(farthest - nearest_m.begin())]);
  }
  return places_m;
}

double nearest_camera_m(const glm::dvec3& eye_m, std::span<const glm::dvec3> cameras_m) {
  double nearest = std::numeric_limits<double>::infinity();
  for (const glm::dvec3& camera_m : cameras_m) {
    nearest = std::min(nearest, glm::distance(eye_m, camera_m));
  }
  return nearest;
}

std::string caption(const core::Frame& frame, const core::Pose2& pose, double height_m,
                    std::span<const glm::dvec3> cameras_m) {
  const auto& alpha = frame.alpha.pixels();
  const double covered =
      std::accumulate(alpha.begin(), alpha.end(), 0.0) / static_cast<double>(alpha.size());
  const double distance_m = nearest_camera_m({pose.x_m, pose.y_m, height_m}, cameras_m);
  return core::print("camera %.2f m high at (", height_m) + core::print("%.1f, ", pose.x_m) +
         core::print("%.1f), ", pose.y_m) +
         core::print("%.0f deg: ", pose.yaw_rad * 180.0 / std::numbers::pi) +
         core::print("%.0f %% covered, ", 100.0 * covered) +
         core::print("nearest training camera %.1f m away", distance_m);
}

}  // namespace

core::Image<core::Rgb8> robot_pictures(core::Renderer& renderer, const sim::World& world,
                                       std::span<const glm::dvec3> camera_positions_m,
                                       const RobotPictureOptions& options) {
  const std::vector<glm::dvec2> places_m =
      spread_places(reachable_cells_m(world), options.places);
  const auto camera = core::CameraIntrinsics::from_fov(
      options.width_px, options.height_px, options.hfov_deg * std::numbers::pi / 180.0);
  core::RandomStream random(options.seed, "robot_pictures");
  cv::Mat sheet;
  core::Frame frame;
  for (std::size_t row = 0; row < places_m.size(); ++row) {
    const core::Pose2 pose{places_m[row].x, places_m[row].y,
                           random.uniform(-std::numbers::pi, std::numbers::pi)};
    const auto T_world_robot = core::transform_from_pose2<core::frame::World>(pose);
    int column = 0;
    for (const double height_m : {options.mast_height_m, options.deck_height_m}) {
      renderer.render(T_world_robot * core::mast_camera(height_m, 0.0), camera,
                      core::Channels::kAll, frame);
      const cv::Mat view = drawing::to_bgr(drawing::frame_picture(frame));
      const int cell_width = view.cols + kMargin_px;
      const int cell_height = view.rows + kCaption_px + kMargin_px;
      if (sheet.empty()) {
        sheet = cv::Mat(kMargin_px + options.places * cell_height, kMargin_px + 2 * cell_width,
                        CV_8UC3, drawing::ink::kPaper);
      }
      const int left = kMargin_px + column * cell_width;
      const int top = kMargin_px + static_cast<int>(row) * cell_height;
      view.copyTo(sheet(cv::Rect(left, top + kCaption_px, view.cols, view.rows)));
      drawing::draw_text(sheet, caption(frame, pose, height_m, camera_positions_m),
                         {static_cast<double>(left), top + kCaption_px - 7.0}, kLetter_px,
                         drawing::ink::kText);
      ++column;
    }
  }
  return drawing::from_bgr(sheet);
}

}  // namespace segsim::experiments::scenes
