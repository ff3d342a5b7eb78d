#include "reconstruction/datasets/internal/pose_jumps.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <string>
#include <utility>

#include <glm/geometric.hpp>

#include "core/error.h"

namespace segsim::reconstruction::internal {
namespace {

constexpr std::size_t kFewestPoses = 8;
constexpr double kShortestJump_m = 0.5;
constexpr double kSmallestTurn_rad = std::numbers::pi / 3.0;
constexpr double kTimesMedian = 20.0, kLargestShare = 0.25, kLargestBreakShare = 0.1;

double way_m(const core::CameraPose& a, const core::CameraPose& b) {
  return glm::distance(a.translation_m(), b.translation_m());
}
double turn_rad(const core::CameraPose& a, const core::CameraPose& b) {
  const glm::dquat q = glm::conjugate(a.rotation()) * b.rotation();
  return 2.0 * std::atan2(glm::length(glm::dvec3(q.x, q.y, q.z)), std::abs(q.w));
}

double median(std::vector<double> values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// "1.32 m, 5 deg"
std::string step_text(const core::CameraPose& a, const core::CameraPose& b) {
  char text[64];
  std::snprintf(text, sizeof text, "%.2f m, %.0f deg", way_m(a, b),
                turn_rad(a, b) * 180.0 / std::numbers::pi);
  return text;
}

}  // namespace

PoseJumps find_pose_jumps(std::span<const core::CameraPose> path) {
  if (path.size() < kFewestPoses) return {};
  std::vector<double> ways_m, turns_rad;
  for (std::size_t i = 0; i + 1 < path.size(); ++i) {
    ways_m.push_back(way_m(path[i], path[i + 1]));
    turns_rad.push_back(turn_rad(path[i], path[i + 1]));
  }
  const double longest_m = std::max(kShortestJump_m, kTimesMedian * median(ways_m));
  const double largest_rad = std::max(kSmallestTurn_rad, kTimesMedian * median(turns_rad));
  const auto jumps = [&](const core::CameraPose& a, const core::CameraPose& b) {
    return way_m(a, b) > longest_m || turn_rad(a, b) > largest_rad;
  };
  std::vector<std::size_t> steps;
  for (std::size_t i = 0; i + 1 < path.size(); ++i) {
    if (jumps(path[i], path[i + 1])) steps.push_back(i);
  }
  if (static_cast<double>(steps.size()) > kLargestShare * static_cast<double>(ways_m.size())) {
    return {};
  }
  PoseJumps found;
  for (std::size_t k = 0; k < steps.size(); ++k) {
    const std::size_t i = steps[k];
    const bool returns =
        k + 1 < steps.size() && steps[k + 1] == i + 1 && !jumps(path[i], path[i + 2]);
    if (returns) {
      found.lone.push_back(i + 1);
      ++k;  // The way back is part of it.
    } else {
      found.breaks.push_back(i);
    }
  }
  const auto all_steps = static_cast<double>(ways_m.size());
  if (static_cast<double>(found.breaks.size()) > kLargestBreakShare * all_steps) return {};
  return found;
}

void check_pose_jumps(SequenceParts& parts, OnBadFrame on_bad_frame) {
  std::vector<core::CameraPose> path;
  for (const FrameFiles& frame : parts.frames) path.push_back(frame.T_world_camera);
  const PoseJumps jumps = find_pose_jumps(path);
  for (const std::size_t i : jumps.breaks) {
    parts.warnings.push_back("poses jump between frames " + parts.frames[i].name + " and " +
                             parts.frames[i + 1].name + ": " +
                             step_text(path[i], path[i + 1]) +
                             "; was tracking lost, or are these two recordings?");
  }
  std::vector<FrameFiles> good;
  auto next = jumps.lone.begin();
  for (std::size_t i = 0; i < parts.frames.size(); ++i) {
    const bool lone = next != jumps.lone.end() && *next == i;
    if (lone) ++next;
    if (accept_frame(on_bad_frame, parts.frames[i].name, parts.warnings, [&] {
          if (!lone) return;
          throw core::InputError::expected(
              parts.name + ", pose of frame " + parts.frames[i].name,
              "one near those before and after, " + step_text(path[i - 1], path[i + 1]) +
                  " apart",
              "a jump of " + step_text(path[i - 1], path[i]) + " and back");
        })) {
      good.push_back(std::move(parts.frames[i]));
    }
  }
  parts.frames = std::move(good);
}

}  // namespace segsim::reconstruction::internal
