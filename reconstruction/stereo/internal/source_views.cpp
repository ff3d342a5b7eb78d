#include "reconstruction/stereo/internal/source_views.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include <glm/geometric.hpp>

namespace segsim::reconstruction::internal {
namespace {

constexpr double kParallax_px = 25.0;
constexpr double kDegree = std::numbers::pi / 180.0;
constexpr double kSmallestScore = 0.05;
constexpr int kColumns = 5, kRows = 4;

/// World points that the reference may see.
std::vector<glm::dvec3> sample_points(const core::CameraPose& pose, const DepthRange& range,
                                      const core::CameraIntrinsics& camera) {
  const std::array<double, 3> depths_m{std::sqrt(range.near_m * range.middle_m),
                                       range.middle_m,
                                       std::sqrt(range.middle_m * range.far_m)};
  std::vector<glm::dvec3> points_m;
  for (const double depth_m : depths_m) {
    for (int row = 0; row < kRows; ++row) {
      for (int column = 0; column < kColumns; ++column) {
        const glm::dvec2 px((column + 0.5) * camera.width_px / kColumns,
                            (row + 0.5) * camera.height_px / kRows);
        points_m.push_back(
            (pose * core::Point<core::frame::Camera>{camera.back_project(px, depth_m)}).xyz_m);
      }
    }
  }
  return points_m;
}

bool inside(const core::CameraIntrinsics& camera, const glm::dvec3& p_camera_m) {
  if (p_camera_m.z <= 0.0) return false;
  const glm::dvec2 px = camera.project(p_camera_m);
  return px.x >= 0.0 && px.y >= 0.0 && px.x < camera.width_px && px.y < camera.height_px;
}

double angle_score(double angle_rad, double wanted_rad) {
  const double width_rad = (angle_rad < wanted_rad ? 0.4 : 1.2) * wanted_rad;
  const double off = (angle_rad - wanted_rad) / width_rad;
  return std::exp(-0.5 * off * off);
}

struct Candidate {
  double score;
  std::uint32_t view;
};

bool better(const Candidate& a, const Candidate& b) {
  return a.score != b.score ? a.score > b.score : a.view < b.view;
}

}  // namespace

double wanted_angle_rad(const core::CameraIntrinsics& camera) {
  return std::clamp(std::atan(kParallax_px / camera.fx_px), 4.0 * kDegree, 12.0 * kDegree);
}

SourceViews choose_sources(std::size_t reference, std::span<const core::CameraPose> poses,
                           std::span<const DepthRange> ranges,
                           const core::CameraIntrinsics& camera, int matched, int compared) {
  const core::CameraPose& pose = poses[reference];
  const glm::dvec3 eye_m = pose.translation_m();
  const double wanted_rad = wanted_angle_rad(camera);
  const std::vector<glm::dvec3> points_m = sample_points(pose, ranges[reference], camera);
  std::vector<Candidate> candidates;
  for (std::size_t view = 0; view < poses.size(); ++view) {
    const glm::dvec3 other_m = poses[view].translation_m();
    const double distance_m = glm::distance(eye_m, other_m);
    if (view == reference || distance_m > 2.0 * ranges[reference].far_m) continue;
    const auto T_camera_world = poses[view].inverse();
    double score = 0.0;
    for (const glm::dvec3& p_m : points_m) {
      if (!inside(camera, (T_camera_world * core::Point<core::frame::World>{p_m}).xyz_m)) {
        continue;
      }
      const glm::dvec3 a = glm::normalize(p_m - eye_m), b = glm::normalize(p_m - other_m);
      score += angle_score(std::acos(std::clamp(glm::dot(a, b), -1.0, 1.0)), wanted_rad);
    }
    score /= static_cast<double>(points_m.size());
    if (score >= kSmallestScore) {
      candidates.push_back({score, static_cast<std::uint32_t>(view)});
    }
  }
  std::sort(candidates.begin(), candidates.end(), better);

  SourceViews result;
  for (const Candidate& candidate : candidates) {
    if (result.compared.size() == static_cast<std::size_t>(compared)) break;
    result.compared.push_back(candidate.view);
  }
  // Places nearer to one another than half of the wanted baseline tell the same.
  const double apart_m = 0.5 * ranges[reference].middle_m * std::tan(wanted_rad);
  while (!candidates.empty() && result.matched.size() < static_cast<std::size_t>(matched)) {
    const Candidate best = *std::min_element(candidates.begin(), candidates.end(), better);
    result.matched.push_back(best.view);
    std::erase_if(candidates, [&](const Candidate& c) { return c.view == best.view; });
    for (Candidate& c : candidates) {
      const double m =
          glm::distance(poses[c.view].translation_m(), poses[best.view].translation_m());
      c.score *= std::min(1.0, 0.2 + m / apart_m);
    }
  }
  for (const std::uint32_t view : result.matched) {
    if (std::find(result.compared.begin(), result.compared.end(), view) ==
        result.compared.end()) {
      result.compared.push_back(view);
    }
  }
  return result;
}

}  // namespace segsim::reconstruction::internal
