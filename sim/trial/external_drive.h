#pragma once

/// @file
/// Another simulator that moves the robot in place of this one: Gazebo with its physics
/// (sim/gazebo/gazebo_drive.h). Perception, policy, judging and records stay as they are.

#include "core/frames.h"
#include "core/stages.h"

namespace segsim::sim {

class ExternalDrive {
 public:
  /// Where the robot was, in this trial's time.
  struct Moment {
    core::TimeNs time_ns = 0;
    core::Pose2 pose;  ///< World frame.
  };

  virtual ~ExternalDrive() = default;

  /// Puts the robot, at rest, where an episode starts.
  /// @return  Where it stands. @throws core::InputError if the other simulator does not do it.
  virtual core::Pose2 begin(const core::Pose2& start) = 0;
  /// To the wheels, at once.
  /// @throws core::InputError if the other simulator's time has run ahead of the trial's.
  virtual void command(const core::VelocityCommand& command) = 0;
  /// The next moment after the last one, at `until_ns` at the latest. Waits for it. Time is 0
  /// at the first call after begin(). @throws core::InputError if nothing comes,
  /// core::Interrupted on a signal.
  virtual Moment next(core::TimeNs until_ns) = 0;
  /// The trial is over, however it ended: the robot is to stand.
  virtual void end() noexcept = 0;
};

}  // namespace segsim::sim
