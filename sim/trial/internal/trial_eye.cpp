#include "sim/trial/internal/trial_eye.h"

#include <algorithm>
#include <bit>
#include <chrono>
#include <string_view>
#include <utility>

#include "core/check.h"
#include "core/random.h"

namespace segsim::sim::internal {
namespace {

double invalid_share(const core::Image<float>& alpha) {
  if (alpha.empty()) return 0.0;
  const auto invalid = std::count_if(alpha.pixels().begin(), alpha.pixels().end(),
                                     [](float a) { return !(a >= 0.5F); });
  return static_cast<double>(invalid) / static_cast<double>(alpha.size());
}

int index_of_class(const core::Detector& detector, const std::string& name) {
  const std::vector<std::string>& names = detector.class_names();
  const auto found = std::find(names.begin(), names.end(), name);
  return found == names.end() ? -1 : static_cast<int>(found - names.begin());
}

/// All bits count: a replay must notice a score that differs in the last one.
std::uint64_t hash_of(const std::vector<core::Detection>& detections) {
  std::string bytes;
  const auto add = [&bytes](std::uint32_t word) {
    for (int k = 0; k < 4; ++k) bytes += static_cast<char>((word >> (8 * k)) & 0xffU);
  };
  for (const core::Detection& d : detections) {
    add(static_cast<std::uint32_t>(d.class_index));
    for (const float value : {d.score, d.box.x0, d.box.y0, d.box.x1, d.box.y1}) {
      add(std::bit_cast<std::uint32_t>(value));
    }
  }
  return core::hash64(bytes);
}

}  // namespace

core::TimeNs wall_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::steady_clock::now().time_since_epoch())
      .count();
}

TrialEye::TrialEye(const TrialParts& parts)
    : options_(parts.options),
      renderer_(parts.renderer),
      detector_(parts.detector),
      truth_(parts.truth),
      goal_{parts.episode.class_name, index_of_class(parts.detector, parts.episode.class_name),
            parts.episode.phrase},
      goal_objects_(parts.world.manifest(), parts.episode),
      camera_(parts.options, parts.episode.seed),
      seed_(parts.episode.seed) {
  if (truth_ != nullptr) truth_->begin_episode(parts.episode);
}

Capture& TrialEye::take(core::TimeNs time_ns, const core::Pose2& pose,
                        const core::Pose2& estimate, const core::VelocityCommand& velocity) {
  std::unique_ptr<Capture> made;
  if (spare_.empty()) {
    made = std::make_unique<Capture>();
  } else {
    made = std::move(spare_.back());
    spare_.pop_back();
  }
  Capture& capture = *made;
  capture.index = taken_++;
  capture.time_ns = time_ns;
  capture.pose = pose;
  capture.estimate = estimate;
  capture.in_flight = true;
  capture.detected = false;
  capture.detections.clear();
  capture.detections_hash = 0;
  capture.detect_ns = 0;
  const core::TimeNs start_ns = wall_ns();
  camera_.render(renderer_, pose, kJudgedChannels, capture.frame);
  capture.render_ns = wall_ns() - start_ns;
  // What it took when it was drawn: a renderer may know the view from an earlier trial.
  render_ms_ += capture.frame.stats.render_ms;
  sense(capture, velocity);
  capture.goal = look_for_goal(capture.frame, goal_objects_);
  invalid_share_ += invalid_share(capture.frame.alpha);
  newest_ = &capture;
  captures_[capture.index] = std::move(made);
  recycle();
  return capture;
}

/// From the exact images to what the camera delivers. Depth and labels of the frame stay as
/// they are: they belong to the judge.
void TrialEye::sense(Capture& capture, const core::VelocityCommand& velocity) {
  camera_.measure(capture.index, capture.frame.depth_m, capture.depth_m);
  if (!options_.sensors) return;
  const SensorSettings& sensors = *options_.sensors;
  const RgbModel& model = sensors.camera.rgb;
  const bool moves = velocity.forward_mps != 0.0 || velocity.turn_radps != 0.0;
  if (model.blurs() && moves) {
    ExposureMean mean;
    for (const double offset_s : model.exposure_offsets_s()) {
      if (offset_s == 0.0) {
        mean.add(capture.frame.rgb);
        continue;
      }
      camera_.render(renderer_, drive_arc(capture.pose, velocity, offset_s),
                     core::Channels::kRgb, exposure_frame_);
      mean.add(exposure_frame_.rgb);
    }
    mean.finish(capture.frame.rgb);
  }
  add_rgb_noise(model, PixelNoise(seed_, "camera/rgb", capture.index), capture.frame.rgb);
  compress_jpeg(model, capture.frame.rgb);
  static const std::vector<core::CameraPose> kUnknown;
  const auto& views = sensors.training_views ? *sensors.training_views : kUnknown;
  validity_.push_back({capture.time_ns, capture.time_ns,
                       render_validity(capture.frame.alpha, capture.frame.T_world_camera,
                                       views, sensors.camera.hole_limit)});
}

const std::vector<core::Detection>& TrialEye::detections_of(Capture& capture) {
  if (capture.detected) return capture.detections;
  capture.detected = true;
  ++detected_;
  if (truth_ != nullptr) truth_->set_truth(capture.frame);
  const core::TimeNs start_ns = wall_ns();
  capture.detections = detector_.detect(observation(capture, nullptr));
  capture.detect_ns = wall_ns() - start_ns;
  detect_ns_ += capture.detect_ns;
  capture.detections_hash = hash_of(capture.detections);
  return capture.detections;
}

core::Observation TrialEye::observation(const Capture& capture,
                                        const core::Pose2* pose_at_use) const {
  core::Observation seen;
  seen.capture_time_ns = capture.time_ns;
  seen.capture_index = capture.index;
  seen.intrinsics = options_.camera;
  seen.T_odom_robot = core::transform_from_pose2<core::frame::Odom>(
      pose_at_use != nullptr ? *pose_at_use : capture.estimate);
  seen.T_robot_camera = camera_.T_robot_camera();
  seen.rgb = &capture.frame.rgb;
  seen.depth_m = &capture.depth_m;
  return seen;
}

void TrialEye::dropped(std::uint64_t index) {
  captures_.at(index)->in_flight = false;
  recycle();
}

void TrialEye::ready(std::uint64_t index) {
  Capture* capture = captures_.at(index).get();
  capture->in_flight = false;
  const bool outdated = (ready_ != nullptr && ready_->index > index) ||
                        (in_use_ != nullptr && in_use_->index > index);
  if (!outdated) ready_ = capture;
  recycle();
}

Capture& TrialEye::use_ready() {
  SEGSIM_CHECK(ready_ != nullptr, "no image is ready");
  in_use_ = std::exchange(ready_, nullptr);
  recycle();
  return *in_use_;
}

void TrialEye::discard_ready() {
  ready_ = nullptr;
  recycle();
}

void TrialEye::recycle() {
  for (auto it = captures_.begin(); it != captures_.end();) {
    const Capture* capture = it->second.get();
    if (capture->in_flight || capture == newest_ || capture == ready_ || capture == in_use_) {
      ++it;
    } else {
      spare_.push_back(std::move(it->second));
      it = captures_.erase(it);
    }
  }
}

GoalView TrialEye::look(const core::Pose2& pose) {
  camera_.render(renderer_, pose, kJudgedChannels, look_frame_);
  return look_for_goal(look_frame_, goal_objects_);
}

void TrialEye::report(TrialResult& result) const {
  const auto mean_ms = [](core::TimeNs sum_ns, std::uint64_t count) {
    return count == 0 ? 0.0 : ms_from_ns(sum_ns) / static_cast<double>(count);
  };
  const std::uint64_t images = taken_ - skipped_;
  result.render_ms = images == 0 ? 0.0 : render_ms_ / static_cast<double>(images);
  result.detect_ms = mean_ms(detect_ns_, static_cast<std::uint64_t>(detected_));
  result.invalid_pixel_fraction =
      images == 0 ? 0.0 : invalid_share_ / static_cast<double>(images);
}

}  // namespace segsim::sim::internal
