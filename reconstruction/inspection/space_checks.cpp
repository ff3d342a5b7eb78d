#include "reconstruction/inspection/space_checks.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

#include "core/formatted.h"
#include "reconstruction/datasets/floor_fit.h"
#include "reconstruction/inspection/internal/median.h"
#include "reconstruction/inspection/internal/pose_steps.h"
#include "reconstruction/lifting/parallel_loading.h"

namespace segsim::reconstruction {
namespace {

using core::print;

constexpr double kFarthest_m = 6.0;
constexpr std::size_t kFloorPoints = 40'000;

constexpr double kSamePlace = 0.25;  ///< Of the median depth.
constexpr double kSameView_rad = 20.0 * std::numbers::pi / 180.0;
constexpr double kLongWay = 2.0;       ///< Of the median depth, along the path.
constexpr double kSeesTheSame = 0.25;  ///< Share of points that land in the other view.
constexpr double kOpen = 0.5;          ///< Of the agreement that neighbours have.
constexpr std::size_t kMostLoops = 400;

/// Two samples and how they agree.
struct Loop {
  std::size_t first = 0, second = 0;  ///< Places in RecordingSample::frames.
  DepthAgreement agreement;
};

DepthAgreement compare(const RecordingSample& sample, std::size_t first, std::size_t second) {
  const FrameSample &a = sample.frames[first], &b = sample.frames[second];
  return compare_depth(a.depth, b.depth,
                       sample.path[b.frame].inverse() * sample.path[a.frame]);
}

/// Length of the path up to each frame.
std::vector<double> walked_m(const std::vector<core::CameraPose>& path) {
  std::vector<double> walked{0.0};
  for (std::size_t i = 1; i < path.size(); ++i) {
    walked.push_back(walked.back() + internal::way_m(path[i - 1], path[i]));
  }
  return walked;
}

/// For each sample the earlier one that is nearest, if the camera was elsewhere in between.
std::vector<Loop> returns(const RecordingSample& sample) {
  const std::vector<double> walked = walked_m(sample.path);
  const double near_m = kSamePlace * sample.median_depth_m;
  std::vector<Loop> loops;
  for (std::size_t j = 0; j < sample.frames.size(); ++j) {
    const std::size_t frame_j = sample.frames[j].frame;
    double nearest_m = near_m;
    std::optional<std::size_t> nearest;
    for (std::size_t i = 0; i < j; ++i) {
      const std::size_t frame_i = sample.frames[i].frame;
      if (walked[frame_j] - walked[frame_i] < kLongWay * sample.median_depth_m) break;
      const double distance_m = internal::way_m(sample.path[frame_i], sample.path[frame_j]);
      if (distance_m < nearest_m &&
          internal::turn_rad(sample.path[frame_i], sample.path[frame_j]) < kSameView_rad) {
        nearest_m = distance_m, nearest = i;
      }
    }
    if (nearest) loops.push_back({*nearest, j, {}});
  }
  if (loops.size() <= kMostLoops) return loops;
  std::vector<Loop> fewer;
  for (std::size_t k = 0; k < kMostLoops; ++k) {
    fewer.push_back(loops[k * loops.size() / kMostLoops]);
  }
  return fewer;
}

/// How well neighbours along the path agree where they see the same; nothing if none do.
std::optional<double> usual_agreement(const RecordingSample& sample) {
  std::vector<double> shares(sample.pairs.size(), -1.0);
  internal::load_each(shares.size(), [&](std::size_t p) {
    const auto& [first, second] = sample.pairs[p];
    const core::CameraPose &a = sample.path[sample.frames[first].frame],
                           &b = sample.path[sample.frames[second].frame];
    if (internal::way_m(a, b) > kSamePlace * sample.median_depth_m ||
        internal::turn_rad(a, b) > kSameView_rad) {
      return;
    }
    const DepthAgreement agreement = compare(sample, first, second);
    if (agreement.landed > kSeesTheSame * agreement.points) {
      shares[p] = agreement.matched_of_landed();
    }
  });
  std::erase_if(shares, [](double share) { return share < 0.0; });
  if (shares.empty()) return std::nullopt;
  return internal::median(std::move(shares));
}

}  // namespace

std::vector<glm::vec3> sample_points_m(const RecordingSample& sample, std::size_t most) {
  std::size_t all = 0;
  for (const FrameSample& frame : sample.frames) all += frame.depth.depth_m.size();
  const std::size_t step = all / std::max<std::size_t>(most, 1) + 1;
  std::vector<glm::vec3> points_m;
  std::size_t n = 0;
  for (const FrameSample& frame : sample.frames) {
    const core::Image<float>& depth_m = frame.depth.depth_m;
    for (int y = 0; y < depth_m.height_px(); ++y) {
      for (int x = 0; x < depth_m.width_px(); ++x) {
        if (n++ % step != 0) continue;
        const double z = depth_m(x, y);
        if (!(z > 0.0 && z < kFarthest_m)) continue;
        const core::Point<core::frame::Camera> p{
            frame.depth.camera.back_project({x + 0.5, y + 0.5}, z)};
        points_m.emplace_back((sample.path[frame.frame] * p).xyz_m);
      }
    }
  }
  return points_m;
}

std::vector<Finding> find_unseen_floor(const RecordingSample& sample) {
  if (sample.median_depth_m <= 0.0) return {};
  const std::vector<glm::vec3> points_m = sample_points_m(sample, kFloorPoints);
  const std::optional<double> floor_m = fit_floor_height_m(points_m);
  double lowest_camera_m = std::numeric_limits<double>::infinity();
  for (const core::CameraPose& pose : sample.path) {
    lowest_camera_m = std::min(lowest_camera_m, pose.translation_m().z);
  }
  if (floor_m && *floor_m < lowest_camera_m) return {};
  return {{FindingKind::kFloorUnseen,
           {},
           floor_m ? core::print(
                         "the lowest large horizontal surface, at %.2f m, lies above a camera",
                         *floor_m)
                   : std::string("no large horizontal surface with nothing below it in the "
                                 "depth of all frames looked at"),
           "say which way is up (--up), give --floor-height, or record the floor",
           false}};
}

std::vector<Finding> find_open_loops(const RgbdSequence& sequence,
                                     const RecordingSample& sample) {
  if (sample.median_depth_m <= 0.0) return {};
  const std::optional<double> usual = usual_agreement(sample);
  if (!usual) return {};
  std::vector<Loop> loops = returns(sample);
  internal::load_each(loops.size(), [&](std::size_t k) {
    loops[k].agreement = compare(sample, loops[k].first, loops[k].second);
  });
  std::erase_if(loops, [](const Loop& loop) {
    return loop.agreement.landed < kSeesTheSame * loop.agreement.points;
  });
  const std::size_t closed_and_open = loops.size();
  std::erase_if(loops, [&](const Loop& loop) {
    return loop.agreement.matched_of_landed() >= kOpen * *usual;
  });
  if (loops.empty()) return {};
  const Loop& worst =
      *std::max_element(loops.begin(), loops.end(), [](const Loop& a, const Loop& b) {
        return a.agreement.median_error_m < b.agreement.median_error_m;
      });
  std::vector<std::size_t> frames;
  for (const Loop& loop : loops) frames.push_back(sample.frames[loop.second].frame);
  return {{FindingKind::kOpenLoop, frames_text(sequence, frames),
           std::to_string(loops.size()) + " of " + std::to_string(closed_and_open) +
               " returns to an earlier place disagree with it; frame " +
               sequence.frame_name(sample.frames[worst.second].frame) +
               " sees the surfaces of frame " +
               sequence.frame_name(sample.frames[worst.first].frame) +
               core::print(" %.2f m elsewhere", worst.agreement.median_error_m),
           "poses drift: take them from a system that closes loops, or reconstruct the parts "
           "apart",
           false}};
}

}  // namespace segsim::reconstruction
