#pragma once

/// @file
/// A running Gazebo moves the robot of a trial: its poses come in, velocity commands go out.
///
///     Gazebo --/world/W/dynamic_pose/info--> poses of the model --> trial
///        ^                                                            |
///        +----------- /model/M/cmd_vel, /world/W/set_pose ------------+
///
/// Gazebo is not changed and does not wait: its clock is the trial's. The trial knows the
/// robot in the plane; how it sways is not in the images.

#include <chrono>
#include <functional>
#include <memory>
#include <string>

#include "sim/gazebo/gazebo_bridge.h"
#include "sim/trial/external_drive.h"

namespace segsim::sim {

struct GazeboDriveOptions {
  std::string world;
  std::string model = "jackal";
  std::string pose_topic;     ///< Empty: /world/W/dynamic_pose/info, W the world
  std::string command_topic;  ///< Empty: /model/M/cmd_vel, M the model
  GazeboFlavour flavour = GazeboFlavour::kBoth;
  double patience_s = 30.0;  ///< Wall time until a pose comes, or the service answers.
  double most_lag_s = 1.0;   ///< By which Gazebo's clock may have passed the trial's.
  std::function<bool()> interrupted{};  ///< Asked while it waits; may be empty.
};

/// What a series of trials has in common. Trials come one after another.
class GazeboDrive final : public ExternalDrive {
 public:
  /// Subscribes and advertises at once; IGN_PARTITION and the like as in GazeboBridge.
  /// @throws core::InputError: a name that is no topic, or a program without the transport.
  explicit GazeboDrive(GazeboDriveOptions options);
  ~GazeboDrive() override;
  GazeboDrive(const GazeboDrive&) = delete;
  GazeboDrive& operator=(const GazeboDrive&) = delete;

  /// Waits for the first pose of the model.
  /// @throws core::InputError if none comes, core::Interrupted.
  void await_poses();

  core::Pose2 begin(const core::Pose2& start) override;
  void command(const core::VelocityCommand& command) override;
  Moment next(core::TimeNs until_ns) override;
  void end() noexcept override;

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace segsim::sim
