#include "reconstruction/inspection/recording_sample.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

#include "reconstruction/inspection/internal/median.h"
#include "reconstruction/inspection/internal/pose_steps.h"
#include "reconstruction/lifting/parallel_loading.h"

namespace segsim::reconstruction {
namespace {

using FramePairs = std::vector<std::pair<std::size_t, std::size_t>>;

std::set<std::size_t> spread(std::size_t all, std::size_t most) {
  std::set<std::size_t> chosen;
  const std::size_t count = std::min(all, most);
  for (std::size_t k = 0; k < count; ++k) chosen.insert(k * all / count);
  return chosen;
}

/// Later frames that look the same way, each about twice as far along the path as the one
/// before. Inverting all poses leaves the angle between two of them as it is, so these are
/// partners even if the poses are wrong in this way.
FramePairs partners_of(const std::vector<core::CameraPose>& path, std::size_t anchor) {
  constexpr double kLargestTurn_rad = 25.0 * std::numbers::pi / 180.0;
  constexpr std::size_t kFarthest = 256, kMost = 6;
  FramePairs pairs;
  std::size_t next_gap = 1;
  const std::size_t end = std::min(path.size(), anchor + kFarthest);
  for (std::size_t j = anchor + 1; j < end && pairs.size() < kMost; ++j) {
    if (j - anchor < next_gap) continue;
    if (internal::turn_rad(path[anchor], path[j]) > kLargestTurn_rad) continue;
    pairs.emplace_back(anchor, j);
    next_gap = 2 * (j - anchor);
  }
  return pairs;
}

FrameSample measure(const RgbdSequence& sequence, std::size_t i, bool edges) {
  const RgbdFrame frame = sequence.load(i);
  FrameSample sample;
  sample.frame = i;
  sample.detail = measure_detail(frame.rgb);
  if (frame.depth_m.empty()) return sample;
  sample.depth = make_depth_thumbnail(frame.depth_m, sequence.intrinsics());
  std::vector<float> measured_m;
  for (const float d : frame.depth_m.pixels()) {
    if (d > 0.0F) measured_m.push_back(d);
  }
  sample.hole_share =
      1.0 - static_cast<double>(measured_m.size()) / static_cast<double>(frame.depth_m.size());
  if (!measured_m.empty()) sample.median_depth_m = internal::median(std::move(measured_m));
  if (edges) {
    sample.edges = make_edge_view(frame.rgb, frame.depth_m);
    sample.rig.emplace(sequence, i, frame);
  }
  return sample;
}

/// Places of frames among the samples instead of frames.
FramePairs places(const FramePairs& pairs, const std::vector<std::size_t>& chosen) {
  const auto place = [&](std::size_t frame) {
    return static_cast<std::size_t>(std::lower_bound(chosen.begin(), chosen.end(), frame) -
                                    chosen.begin());
  };
  FramePairs result;
  for (const auto& [a, b] : pairs) result.emplace_back(place(a), place(b));
  return result;
}

}  // namespace

RecordingSample sample_recording(const RgbdSequence& sequence, const SampleOptions& options) {
  RecordingSample sample;
  for (std::size_t i = 0; i < sequence.frame_count(); ++i) {
    sample.path.push_back(sequence.pose(i));
  }
  std::set<std::size_t> wanted = spread(sample.path.size(), options.most_frames);
  FramePairs pairs;
  for (const std::size_t anchor : spread(sample.path.size(), options.anchors)) {
    wanted.insert(anchor);
    for (const auto& pair : partners_of(sample.path, anchor)) {
      pairs.push_back(pair);
      wanted.insert(pair.second);
    }
  }
  const std::vector<std::size_t> chosen(wanted.begin(), wanted.end());
  const std::set<std::size_t> with_edges = spread(chosen.size(), options.edge_views);
  sample.frames.resize(chosen.size());
  internal::load_each(chosen.size(), [&](std::size_t k) {
    sample.frames[k] = measure(sequence, chosen[k], with_edges.contains(k));
  });
  sample.pairs = places(pairs, chosen);
  std::vector<double> depths_m;
  for (const FrameSample& frame : sample.frames) {
    if (frame.median_depth_m > 0.0) depths_m.push_back(frame.median_depth_m);
  }
  if (!depths_m.empty()) sample.median_depth_m = internal::median(std::move(depths_m));
  return sample;
}

}  // namespace segsim::reconstruction
