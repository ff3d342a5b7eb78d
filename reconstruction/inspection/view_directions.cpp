#include "reconstruction/inspection/view_directions.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <glm/geometric.hpp>

#include "core/formatted.h"
#include "reconstruction/inspection/internal/pose_steps.h"

namespace segsim::reconstruction {
namespace {

using internal::degrees;

constexpr double kSector_rad = 2.0 * std::numbers::pi / ViewDirections::kSectors;
constexpr int kSmallestGap = 3;  ///< Sectors.
constexpr double kLowEnough_rad = 20.0 * std::numbers::pi / 180.0;

int wrapped(int sector) {
  return (sector % ViewDirections::kSectors + ViewDirections::kSectors) %
         ViewDirections::kSectors;
}

/// Marks the sectors whose middle, at the horizon, lies in the image.
void mark_horizon(const core::CameraPose& T_world_camera,
                  const core::CameraIntrinsics& intrinsics, ViewDirections& directions) {
  const glm::dquat R_camera_world = glm::conjugate(T_world_camera.rotation());
  for (int i = 0; i < ViewDirections::kSectors; ++i) {
    // What a level robot sees lies near the horizon: a camera that is tilted by less than half
    // of its view counts, so the nearest of three elevations does.
    for (const double elevation_rad : {0.0, -kLowEnough_rad, kLowEnough_rad}) {
      const double yaw_rad = (i + 0.5) * kSector_rad;
      const glm::dvec3 d =
          R_camera_world * glm::dvec3(std::cos(elevation_rad) * std::cos(yaw_rad),
                                      std::cos(elevation_rad) * std::sin(yaw_rad),
                                      std::sin(elevation_rad));
      if (!(d.z > 0.0)) continue;
      const glm::dvec2 px = intrinsics.project(d);
      if (px.x >= 0.0 && px.y >= 0.0 && px.x < intrinsics.width_px &&
          px.y < intrinsics.height_px) {
        ++directions.frames_of_sector[static_cast<std::size_t>(i)];
        break;
      }
    }
  }
}

void widen_elevations(const core::CameraPose& T_world_camera,
                      const core::CameraIntrinsics& intrinsics, ViewDirections& directions) {
  const double w = intrinsics.width_px, h = intrinsics.height_px;
  for (const glm::dvec2& px : {glm::dvec2(0.5 * w, 0.0), glm::dvec2(0.5 * w, h),
                               glm::dvec2(0.0, 0.5 * h), glm::dvec2(w, 0.5 * h)}) {
    const glm::dvec3 d =
        T_world_camera.rotation() * glm::normalize(intrinsics.back_project(px, 1.0));
    const double elevation_rad = std::asin(std::clamp(d.z, -1.0, 1.0));
    directions.lowest_rad = std::min(directions.lowest_rad, elevation_rad);
    directions.highest_rad = std::max(directions.highest_rad, elevation_rad);
  }
}

/// "90 to 150 deg, 200 to 230 deg": runs of at least kSmallestGap sectors that no frame sees.
std::string gaps_text(const ViewDirections& directions) {
  const auto unseen = [&](int i) {
    return directions.frames_of_sector[static_cast<std::size_t>(wrapped(i))] == 0;
  };
  std::string text;
  for (int begin = 0; begin < ViewDirections::kSectors; ++begin) {
    if (!unseen(begin) || unseen(begin - 1)) continue;
    int end = begin;
    while (unseen(end)) ++end;
    if (end - begin < kSmallestGap) continue;
    text += (text.empty() ? "" : ", ") + std::to_string(10 * begin) + " to " +
            std::to_string(10 * wrapped(end)) + " deg";
  }
  return text;
}

}  // namespace

ViewDirections count_directions(const std::vector<core::CameraPose>& path,
                                const core::CameraIntrinsics& intrinsics) {
  ViewDirections directions;
  directions.lowest_rad = 0.5 * std::numbers::pi;
  directions.highest_rad = -0.5 * std::numbers::pi;
  for (const core::CameraPose& pose : path) {
    mark_horizon(pose, intrinsics, directions);
    widen_elevations(pose, intrinsics, directions);
  }
  return directions;
}

std::vector<Finding> find_unseen_directions(const RgbdSequence& sequence,
                                            const RecordingSample& sample) {
  const ViewDirections directions = count_directions(sample.path, sequence.intrinsics());
  std::vector<Finding> findings;
  const auto add = [&](const std::string& how_bad, const std::string& help) {
    findings.push_back({FindingKind::kUnseenDirections, {}, how_bad, help, false});
  };
  const bool none =
      std::all_of(directions.frames_of_sector.begin(), directions.frames_of_sector.end(),
                  [](int frames) { return frames == 0; });
  const std::string gaps = gaps_text(directions);
  if (none) {
    add("no frame looks anywhere near the horizon",
        "record what a robot sees, or say which way is up (--up)");
  } else if (!gaps.empty()) {
    add("no frame looks towards yaw " + gaps +
            " (0 is +x, counter-clockwise; see the picture)",
        "record these directions, too");
  }
  if (directions.lowest_rad > -kLowEnough_rad) {
    add(core::print("nothing lower than %.0f deg was looked at",
                    degrees(directions.lowest_rad)),
        "look down at the floor now and then");
  }
  if (directions.highest_rad < kLowEnough_rad) {
    add(core::print("nothing higher than %.0f deg was looked at",
                    degrees(directions.highest_rad)),
        "look up at walls and ceiling now and then");
  }
  return findings;
}

}  // namespace segsim::reconstruction
