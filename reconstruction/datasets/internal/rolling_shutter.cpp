#include "reconstruction/datasets/internal/rolling_shutter.h"

#include <algorithm>
#include <cmath>

#include "core/check.h"

namespace segsim::reconstruction::internal {
namespace {

constexpr int kIterations = 3;           ///< Each leaves a few percent of the shift.
constexpr double kWithoutDepth_m = 3.0;  ///< Where not even a neighbour has depth.

/// Between four pixels.
core::Rgb8 color_at(const core::Image<core::Rgb8>& rgb, const glm::dvec2& px) {
  const double u = std::clamp(px.x - 0.5, 0.0, rgb.width_px() - 1.0);
  const double v = std::clamp(px.y - 0.5, 0.0, rgb.height_px() - 1.0);
  const int x = std::min(static_cast<int>(u), std::max(0, rgb.width_px() - 2));
  const int y = std::min(static_cast<int>(v), std::max(0, rgb.height_px() - 2));
  const int x1 = std::min(x + 1, rgb.width_px() - 1),
            y1 = std::min(y + 1, rgb.height_px() - 1);
  const double s = u - x, t = v - y;
  const auto mix = [&](auto channel) {
    return static_cast<std::uint8_t>(
        std::lround((1 - t) * ((1 - s) * channel(rgb(x, y)) + s * channel(rgb(x1, y))) +
                    t * ((1 - s) * channel(rgb(x, y1)) + s * channel(rgb(x1, y1)))));
  };
  return {mix([](const core::Rgb8& p) { return p.r; }),
          mix([](const core::Rgb8& p) { return p.g; }),
          mix([](const core::Rgb8& p) { return p.b; })};
}

}  // namespace

std::vector<CameraToCamera> row_motion(const PoseTrack& track, double time_s,
                                       double read_out_s, int rows) {
  const auto T_world_middle = track.at(time_s);
  if (!T_world_middle) return {};
  std::vector<CameraToCamera> motion;
  motion.reserve(static_cast<std::size_t>(rows));
  for (int row = 0; row < rows; ++row) {
    const auto T_world_row = track.at(time_s + read_out_s * ((row + 0.5) / rows - 0.5));
    if (!T_world_row) return {};
    motion.push_back(T_world_row->inverse() * *T_world_middle);
  }
  return motion;
}

void straighten_rows(const std::vector<CameraToCamera>& motion,
                     const core::CameraIntrinsics& camera, RgbdFrame& frame) {
  const int width = camera.width_px, height = camera.height_px;
  SEGSIM_CHECK(static_cast<int>(motion.size()) == height, std::to_string(motion.size()));
  const RgbdFrame taken = frame;
  const core::Image<float> depth_m = depth_of_size(taken.depth_m, width, height);
  core::Image<std::uint8_t> valid(width, height, 255);
  bool all_valid = taken.valid.empty();
  for (int y = 0; y < height; ++y) {
    double z_m = kWithoutDepth_m;
    for (int x = 0; x < width; ++x) {
      if (!depth_m.empty() && depth_m(x, y) > 0.0F) z_m = depth_m(x, y);
      const core::Point<core::frame::Camera> p{camera.back_project({x + 0.5, y + 0.5}, z_m)};
      glm::dvec2 px(x + 0.5, y + 0.5);
      for (int i = 0; i < kIterations; ++i) {
        const int row = std::clamp(static_cast<int>(std::floor(px.y)), 0, height - 1);
        px = camera.project((motion[static_cast<std::size_t>(row)] * p).xyz_m);
      }
      const int from_x = static_cast<int>(std::floor(px.x));
      const int from_y = static_cast<int>(std::floor(px.y));
      const bool shown = taken.rgb.contains(from_x, from_y);
      const bool good = shown && (taken.valid.empty() || taken.valid(from_x, from_y) != 0);
      if (!good) valid(x, y) = 0, all_valid = false;
      frame.rgb(x, y) = shown ? color_at(taken.rgb, px) : core::Rgb8{};
      if (frame.semantic.empty()) continue;
      frame.semantic(x, y) = shown ? taken.semantic(from_x, from_y) : std::uint16_t{0};
      frame.instance(x, y) = shown ? taken.instance(from_x, from_y) : std::uint16_t{0};
    }
  }
  if (!all_valid) frame.valid = std::move(valid);
}

}  // namespace segsim::reconstruction::internal
