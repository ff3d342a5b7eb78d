#include "sim/trial/oracle_detector.h"

#include <algorithm>

#include "core/check.h"
#include "core/random.h"

namespace segsim::sim {

OracleDetector::OracleDetector(const std::vector<core::SceneClass>& classes,
                               std::vector<std::string> class_names,
                               const OracleDetectorOptions& options)
    : class_names_(std::move(class_names)), options_(options) {
  for (const core::SceneClass& scene_class : classes) {
    if (class_index_.size() <= scene_class.id) {
      class_index_.resize(static_cast<std::size_t>(scene_class.id) + 1, -1);
    }
    const auto found = std::find(class_names_.begin(), class_names_.end(), scene_class.name);
    if (found != class_names_.end()) {
      class_index_[scene_class.id] = static_cast<int>(found - class_names_.begin());
    }
  }
}

void OracleDetector::begin_episode(const Episode& episode) {
  episode_seed_ = episode.seed;
  phrase_instances_ = episode.goal_instances;
  const auto found = std::find(class_names_.begin(), class_names_.end(), episode.class_name);
  const bool named = !phrase_instances_.empty() && found != class_names_.end();
  phrase_class_ = named ? static_cast<int>(found - class_names_.begin()) : -1;
}

void OracleDetector::set_truth(const core::Frame& frame) {
  SEGSIM_CHECK(frame.semantic.size() == frame.instance.size() && !frame.instance.empty(),
               "frame without labels");
  width_px_ = frame.instance.width_px();
  height_px_ = frame.instance.height_px();
  seen_.clear();
  // Slot of an instance id, then pixels in row order: no sort, no hashing.
  std::vector<std::int32_t> slot(65536, -1);
  for (int y = 0; y < height_px_; ++y) {
    for (int x = 0; x < width_px_; ++x) {
      const std::uint16_t id = frame.instance(x, y);
      const std::uint16_t semantic = frame.semantic(x, y);
      if (id == 0 || semantic >= class_index_.size() || class_index_[semantic] < 0) continue;
      if (slot[id] < 0) {
        slot[id] = static_cast<std::int32_t>(seen_.size());
        seen_.push_back({id, semantic, x, y, x + 1, y + 1, 0});
      }
      Seen& seen = seen_[static_cast<std::size_t>(slot[id])];
      seen.x0 = std::min(seen.x0, x);
      seen.x1 = std::max(seen.x1, x + 1);
      seen.y1 = y + 1;
      ++seen.pixels;
    }
  }
  std::sort(seen_.begin(), seen_.end(),
            [](const Seen& a, const Seen& b) { return a.instance < b.instance; });
}

std::vector<core::Detection> OracleDetector::detect(const core::Observation& observation) {
  std::vector<core::Detection> detections;
  for (const Seen& seen : seen_) {
    if (seen.pixels < options_.min_pixels) continue;
    if (class_index_[seen.semantic] == phrase_class_ &&
        std::find(phrase_instances_.begin(), phrase_instances_.end(), seen.instance) ==
            phrase_instances_.end()) {
      continue;
    }
    // One stream per capture and instance: what else is in view does not shift the draws.
    core::RandomStream random(options_.seed ^ episode_seed_, "oracle_detector",
                              observation.capture_index * 65536U + seen.instance);
    if (!random.chance(options_.recall)) continue;
    core::BoxPx box{static_cast<float>(seen.x0), static_cast<float>(seen.y0),
                    static_cast<float>(seen.x1), static_cast<float>(seen.y1)};
    if (options_.jitter_share > 0.0) {
      const double dx = options_.jitter_share * box.width_px();
      const double dy = options_.jitter_share * box.height_px();
      const auto shift = [&random](float value, double sigma, int limit) {
        return static_cast<float>(std::clamp(
            static_cast<double>(value) + sigma * random.normal(), 0.0, double(limit)));
      };
      box = {shift(box.x0, dx, width_px_), shift(box.y0, dy, height_px_),
             shift(box.x1, dx, width_px_), shift(box.y1, dy, height_px_)};
      if (box.area_px2() <= 0.0F) continue;
    }
    detections.push_back({class_index_[seen.semantic], 1.0F, box});
  }
  return detections;
}

}  // namespace segsim::sim
