#include "sim/trial/internal/trial_recorder.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>
#include <utility>

#include "core/random.h"

namespace segsim::sim::internal {
namespace {

std::uint64_t chain_hash(std::uint64_t previous, const TickRecord& record) {
  const auto quantised = [](double value) { return std::llround(value * 1e6); };
  const std::array<std::int64_t, 9> state = {
      record.time_ns,
      quantised(record.pose.x_m),
      quantised(record.pose.y_m),
      quantised(record.pose.yaw_rad),
      quantised(record.command.forward_mps),
      quantised(record.command.turn_radps),
      static_cast<std::int64_t>(record.mode),
      record.capture_index,
      static_cast<std::int64_t>(record.detections_hash)};
  // Bytes in a fixed order, so that the hash is the same on every machine.
  std::array<char, 8 * state.size()> bytes{};
  for (std::size_t k = 0; k < bytes.size(); ++k) {
    const auto word = static_cast<std::uint64_t>(state[k / 8]);
    bytes[k] = static_cast<char>((word >> (8 * (k % 8))) & 0xffU);
  }
  return core::hash64(std::string_view(bytes.data(), bytes.size()), previous);
}

const std::vector<core::Detection>& detections_in(const Capture* capture) {
  static const std::vector<core::Detection> kNone;
  return capture != nullptr ? capture->detections : kNone;
}

}  // namespace

void TrialRecorder::add(TickRecord record, const Images& images) {
  const int tick = static_cast<int>(track_.size());
  if (!record.fresh) ++ticks_without_news_;
  if (images.in_use != nullptr) {
    record.capture_index = static_cast<std::int64_t>(images.in_use->index);
    record.age_ns = record.time_ns - images.in_use->time_ns;
    record.detections_hash = images.in_use->detections_hash;
    age_.add(record.age_ns);
  } else {
    ++ticks_without_image_;
  }
  if (images.newest != nullptr) record.goal_pixels = images.newest->goal.pixels;
  const std::vector<core::Detection>& detections = detections_in(images.in_use);
  record.detections_of_goal = static_cast<int>(
      std::count_if(detections.begin(), detections.end(), [this](const core::Detection& d) {
        return goal_class_ >= 0 && d.class_index == goal_class_;
      }));
  if (first_visible_tick_ < 0 && images.goal_in_view) first_visible_tick_ = tick;
  if (first_detected_tick_ < 0 && record.detections_of_goal > 0) first_detected_tick_ = tick;
  state_hash_ = record.state_hash = chain_hash(state_hash_, record);
  track_.push_back(record);
  if (observer_ && images.newest != nullptr) {
    observer_(record, images.newest->frame, detections, policy_);
  }
}

void TrialRecorder::report(TrialResult& result) {
  result.ticks = static_cast<int>(track_.size());
  result.track = std::move(track_);
  result.state_hash = state_hash_;
  result.first_visible_tick = first_visible_tick_;
  result.first_detected_tick = first_detected_tick_;
  result.timing.age = std::move(age_);
  result.timing.ticks_without_image = ticks_without_image_;
  result.timing.ticks_without_news = ticks_without_news_;
  result.timing.overruns = overruns_;
}

}  // namespace segsim::sim::internal
