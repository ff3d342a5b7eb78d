#include "reconstruction/inspection/camera_path.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>

#include "core/formatted.h"
#include "reconstruction/inspection/internal/median.h"
#include "reconstruction/inspection/internal/pose_steps.h"

namespace segsim::reconstruction {
namespace {

using internal::degrees;
using internal::turn_rad;
using internal::way_m;

constexpr double kGapTimesMedian = 5.0;
constexpr double kBlurSpeed_deg_s = 90.0, kBlurSpeed_m_s = 1.5;
constexpr double kSingleViewShare = 0.25;

std::optional<double> number_of(const std::string& name) {
  const auto number = frame_number(name);
  if (!number) return std::nullopt;
  return static_cast<double>(*number);
}

/// Ascending stamps of all frames and their unit; empty if some frame has none.
struct Stamps {
  std::vector<double> values;
  std::string unit;
};

Stamps stamps_of(const RgbdSequence& sequence) {
  Stamps stamps;
  const bool timed = sequence.frame_count() > 0 && sequence.time_s(0).has_value();
  stamps.unit = timed ? "s" : "frame numbers";
  for (std::size_t i = 0; i < sequence.frame_count(); ++i) {
    const auto stamp = timed ? sequence.time_s(i) : number_of(sequence.frame_name(i));
    if (!stamp || (i > 0 && *stamp < stamps.values.back())) return {};
    stamps.values.push_back(*stamp);
  }
  return stamps;
}

double median_difference(const std::vector<double>& values) {
  std::vector<double> differences;
  for (std::size_t i = 0; i + 1 < values.size(); ++i) {
    differences.push_back(values[i + 1] - values[i]);
  }
  return differences.empty() ? 0.0 : internal::median(std::move(differences));
}

/// After which way or turn about half of a view is new.
struct LongStep {
  double way_m = 0.0, turn_rad = 0.0;
};

LongStep long_step(const RgbdSequence& sequence, const RecordingSample& sample) {
  constexpr double kWithoutDepth_m = 1.0;
  return {sample.median_depth_m > 0.0 ? 0.5 * sample.median_depth_m : kWithoutDepth_m,
          0.5 * sequence.intrinsics().horizontal_fov_rad()};
}

bool leaves(const core::CameraPose& a, const core::CameraPose& b, const LongStep& limit) {
  return way_m(a, b) > limit.way_m || turn_rad(a, b) > limit.turn_rad;
}

std::vector<std::size_t> long_steps(const RgbdSequence& sequence,
                                    const RecordingSample& sample) {
  const LongStep limit = long_step(sequence, sample);
  std::vector<std::size_t> steps;
  for (std::size_t i = 0; i + 1 < sample.path.size(); ++i) {
    if (leaves(sample.path[i], sample.path[i + 1], limit)) steps.push_back(i);
  }
  return steps;
}

std::string step_text(const RecordingSample& sample, std::size_t i) {
  const core::CameraPose &a = sample.path[i], &b = sample.path[i + 1];
  return core::print("%.2f m", way_m(a, b)) + " and " +
         core::print("%.0f deg", degrees(turn_rad(a, b)));
}

double speed_excess(const core::CameraPose& a, const core::CameraPose& b, double time_s) {
  return std::max(degrees(turn_rad(a, b)) / time_s / kBlurSpeed_deg_s,
                  way_m(a, b) / time_s / kBlurSpeed_m_s);
}

std::optional<Finding> find_high_speed(const RgbdSequence& sequence,
                                       const RecordingSample& sample) {
  std::vector<std::size_t> fast;
  std::size_t worst = 0;
  double most = 1.0, worst_s = 1.0;
  for (std::size_t i = 0; i + 1 < sample.path.size(); ++i) {
    const auto from_s = sequence.time_s(i), to_s = sequence.time_s(i + 1);
    if (!from_s || !to_s || !(*to_s > *from_s)) continue;
    const double excess = speed_excess(sample.path[i], sample.path[i + 1], *to_s - *from_s);
    if (excess > 1.0) fast.push_back(i);
    if (excess > most) most = excess, worst = i, worst_s = *to_s - *from_s;
  }
  if (fast.empty()) return std::nullopt;
  const core::CameraPose &a = sample.path[worst], &b = sample.path[worst + 1];
  return Finding{FindingKind::kFastCamera, frames_text(sequence, fast),
                 core::print("up to %.1f m/s", way_m(a, b) / worst_s) + " and " +
                     core::print("%.0f deg/s", degrees(turn_rad(a, b)) / worst_s) +
                     " at frame " + sequence.frame_name(worst),
                 "move and turn more slowly: images blur and lines bend", false};
}

}  // namespace

std::vector<Finding> find_repeated_frames(const RgbdSequence& sequence) {
  std::vector<std::size_t> same_time;
  std::map<std::string, std::size_t> first_of_name;
  std::vector<std::size_t> same_name;
  for (std::size_t i = 0; i < sequence.frame_count(); ++i) {
    if (!first_of_name.try_emplace(sequence.frame_name(i), i).second) same_name.push_back(i);
    if (i > 0 && sequence.time_s(i) && sequence.time_s(i) == sequence.time_s(i - 1)) {
      same_time.push_back(i);
    }
  }
  std::vector<Finding> findings;
  if (!same_time.empty()) {
    findings.push_back(
        {FindingKind::kRepeatedFrames, frames_text(sequence, same_time),
         core::print("the time stamp %.6f s", *sequence.time_s(same_time.front())) +
             " is that of the frame before" + (same_time.size() > 1 ? ", and so on" : ""),
         "one of two such frames has the other's pose: remove it from the list", false});
  }
  if (!same_name.empty()) {
    findings.push_back({FindingKind::kRepeatedFrames, frames_text(sequence, same_name),
                        std::to_string(same_name.size()) + " listed more than once",
                        "remove the second entries", false});
  }
  return findings;
}

std::vector<Finding> find_frame_gaps(const RgbdSequence& sequence,
                                     const RecordingSample& sample) {
  const Stamps stamps = stamps_of(sequence);
  const double usual = median_difference(stamps.values);
  if (!(usual > 0.0) || are_single_views(sequence, sample)) return {};
  std::vector<double> ways_m, turns_rad;
  for (std::size_t i = 0; i + 1 < sample.path.size(); ++i) {
    ways_m.push_back(way_m(sample.path[i], sample.path[i + 1]));
    turns_rad.push_back(turn_rad(sample.path[i], sample.path[i + 1]));
  }
  const double usual_m = internal::median(ways_m), usual_rad = internal::median(turns_rad);
  std::vector<std::size_t> gaps;
  std::size_t widest = 0;
  double widest_gap = 0.0;
  for (std::size_t i = 0; i + 1 < stamps.values.size(); ++i) {
    const double gap = stamps.values[i + 1] - stamps.values[i];
    const bool moved = ways_m[i] > 3.0 * usual_m || turns_rad[i] > 3.0 * usual_rad;
    if (gap < kGapTimesMedian * usual || !moved) continue;
    gaps.push_back(i);
    if (gap > widest_gap) widest_gap = gap, widest = i;
  }
  if (gaps.empty()) return {};
  return {{FindingKind::kFrameGap, "after " + frames_text(sequence, gaps),
           core::print("up to %.3g ", widest_gap) + stamps.unit +
               core::print(" instead of %.3g", usual) + ", while the camera went " +
               step_text(sample, widest) + " (frame " + sequence.frame_name(widest) + ")",
           "record this part again, or give all frames", false}};
}

bool are_single_views(const RgbdSequence& sequence, const RecordingSample& sample) {
  return static_cast<double>(long_steps(sequence, sample).size()) >
         kSingleViewShare * static_cast<double>(sample.path.size());
}

std::vector<Finding> find_fast_camera(const RgbdSequence& sequence,
                                      const RecordingSample& sample) {
  std::vector<Finding> findings;
  if (auto fast = find_high_speed(sequence, sample)) findings.push_back(std::move(*fast));
  const std::vector<std::size_t> steps = long_steps(sequence, sample);
  if (steps.empty() || are_single_views(sequence, sample)) return findings;
  const LongStep limit = long_step(sequence, sample);
  const auto size = [&](std::size_t i) {
    const core::CameraPose &a = sample.path[i], &b = sample.path[i + 1];
    return std::max(way_m(a, b) / limit.way_m, turn_rad(a, b) / limit.turn_rad);
  };
  const std::size_t worst =
      *std::max_element(steps.begin(), steps.end(),
                        [&](std::size_t i, std::size_t j) { return size(i) < size(j); });
  findings.push_back({FindingKind::kFastCamera, "after " + frames_text(sequence, steps),
                      "the next frame is up to " + step_text(sample, worst) + " away (frame " +
                          sequence.frame_name(worst) + "), so that most of its view is new",
                      "move more slowly, or give more frames", false});
  return findings;
}

}  // namespace segsim::reconstruction
