#pragma once

/// @file
/// The camera of a trial, the images that are on their way through the robot's computer, and
/// what the simulator alone knows about them.

#include <cstdint>
#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "sim/trial/goal_objects.h"
#include "sim/trial/internal/robot_camera.h"
#include "sim/trial/trial.h"

namespace segsim::sim::internal {

/// One image, from the exposure until nothing refers to it any more.
struct Capture {
  std::uint64_t index = 0;
  core::TimeNs time_ns = 0;
  core::Pose2 pose, estimate;  ///< At the exposure: true (World), believed (Odom).
  core::Frame frame;
  core::Image<float> depth_m;  ///< As the depth camera delivers it.
  GoalView goal;
  core::TimeNs render_ns = 0;  ///< Wall time.
  bool in_flight = true;       ///< The schedule has it.
  bool detected = false;
  core::TimeNs detect_ns = 0;
  std::vector<core::Detection> detections;
  std::uint64_t detections_hash = 0;
};

class TrialEye {
 public:
  explicit TrialEye(const TrialParts& parts);

  /// Takes the next image at that pose. It becomes the newest one.
  /// @param velocity  Of the base: what blurs the exposure.
  Capture& take(core::TimeNs time_ns, const core::Pose2& pose, const core::Pose2& estimate,
                const core::VelocityCommand& velocity);
  /// The next image is lost before anybody sees it; it keeps its number.
  void skip() {
    ++taken_;
    ++skipped_;
  }
  /// What the detector says of the image. Detection starts here and nowhere else: when the
  /// answer is first asked for, by the budget's stage "detect" or, if there is none, for the
  /// policy.
  const std::vector<core::Detection>& detections_of(Capture& capture);
  /// What the policy is shown. @param pose_at_use  Places the image there, if given (Odom).
  [[nodiscard]] core::Observation observation(const Capture& capture,
                                              const core::Pose2* pose_at_use) const;

  /// An image that is in flight. Buffers of images that nothing refers to are used again.
  [[nodiscard]] Capture& at(std::uint64_t index) { return *captures_.at(index); }
  [[nodiscard]] const Capture* newest() const { return newest_; }
  /// The schedule gave the image up.
  void dropped(std::uint64_t index);
  /// The schedule is done with the image: the policy may have it, unless a newer one is there.
  void ready(std::uint64_t index);
  /// The newest image that is ready and was not used yet; nullptr if there is none.
  [[nodiscard]] const Capture* ready() const { return ready_; }
  /// From now on the policy acts on the ready image, which must be there.
  Capture& use_ready();
  /// The ready image is thrown away unseen.
  void discard_ready();
  [[nodiscard]] const Capture* in_use() const { return in_use_; }

  /// What an image from there would show; none is taken.
  [[nodiscard]] GoalView look(const core::Pose2& pose);
  [[nodiscard]] const core::ObjectGoal& goal() const { return goal_; }
  /// How valid each image was; empty without sensor settings.
  [[nodiscard]] std::vector<Reading<RenderValidity>> take_validity() {
    return std::exchange(validity_, {});
  }
  /// Mean times and shares.
  void report(TrialResult& result) const;

 private:
  void sense(Capture& capture, const core::VelocityCommand& velocity);
  void recycle();

  const TrialOptions& options_;
  core::Renderer& renderer_;
  core::Detector& detector_;
  GroundTruthSink* truth_;
  core::ObjectGoal goal_;
  GoalObjects goal_objects_;
  RobotCamera camera_;
  std::map<std::uint64_t, std::unique_ptr<Capture>> captures_;
  std::vector<std::unique_ptr<Capture>> spare_;
  Capture* newest_ = nullptr;
  Capture* ready_ = nullptr;
  Capture* in_use_ = nullptr;
  core::Frame look_frame_, exposure_frame_;
  std::uint64_t seed_;
  std::vector<Reading<RenderValidity>> validity_;
  std::uint64_t taken_ = 0, skipped_ = 0;
  int detected_ = 0;
  core::TimeNs detect_ns_ = 0;
  double render_ms_ = 0.0;
  double invalid_share_ = 0.0;
};

/// Wall time since the steady clock's beginning.
[[nodiscard]] core::TimeNs wall_ns();

}  // namespace segsim::sim::internal
