#include "reconstruction/inspection/rig_checks.h"

#include <algorithm>
#include <utility>

#include "reconstruction/inspection/pose_time_fit.h"

namespace segsim::reconstruction {
namespace {

constexpr double kSmallest_px = 1.5;  ///< Of a picture 320 wide: less is not worth a line.
constexpr double kAsGood = 0.9;       ///< Of the gain of all parameters, for some to suffice.

/// The fewest parameters that explain what all explain.
std::pair<RigFitOptions, RigFit> fit_simply(const std::vector<const RigView*>& views,
                                            const RgbdSequence& sequence, bool timed) {
  const auto fit = [&](bool place, bool time) {
    RigFitOptions options;
    options.fit_place = place, options.fit_time = time, options.use_times = timed;
    return std::pair(options,
                     fit_rig(views, sequence.intrinsics(), sequence.pose_track(), options));
  };
  auto all = fit(true, timed);
  if (!timed || !all.second.is_off()) return all;
  const double enough = kAsGood * (all.second.best - all.second.given);
  for (const bool time : {true, false}) {
    auto some = fit(!time, time);
    if (some.second.is_off() && some.second.best - some.second.given > enough) return some;
  }
  return all;
}

}  // namespace

std::vector<Finding> find_depth_offset(const RgbdSequence& sequence,
                                       const RecordingSample& sample,
                                       std::vector<Finding> calibration) {
  std::vector<const RigView*> views;
  for (const FrameSample& frame : sample.frames) {
    if (frame.rig) views.push_back(&*frame.rig);
  }
  const bool timed = !sequence.pose_track().empty() && sequence.frame_count() > 0 &&
                     sequence.depth_time_s(0).has_value();
  if (views.empty()) return calibration;
  const auto [options, fit] = fit_simply(views, sequence, timed);
  const double reduction = std::min(1.0, 320.0 / sequence.intrinsics().width_px);
  if (!fit.is_off() || reduction * fit.displacement_px < kSmallest_px) return calibration;
  std::string flags;
  if (options.fit_place) flags = "--color-depth estimate";
  if (options.fit_time)
    flags += std::string(flags.empty() ? "" : " ") + "--depth-time-offset estimate";
  if (!calibration.empty()) {
    calibration.front().help +=
        "; or let " + flags + " bring depth there (" + fit.text(options) + ")";
    return calibration;
  }
  return {{options.fit_place ? FindingKind::kCalibration : FindingKind::kClocks,
           {},
           fit.text(options),
           flags,
           false}};
}

std::vector<Finding> find_late_poses(const RgbdSequence& sequence) {
  if (sequence.pose_track().empty()) return {};
  const PoseTimeFit fit = fit_pose_time(sequence);
  if (!fit.is_off()) return {};
  return {{FindingKind::kClocks, {}, fit.text(), "--pose-time-offset estimate", false}};
}

}  // namespace segsim::reconstruction
