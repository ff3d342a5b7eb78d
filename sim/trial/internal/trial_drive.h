#pragma once

/// @file
/// The robot in the world, with its odometer and its bumper.

#include <cstdint>
#include <optional>
#include <vector>

#include "sim/ground/navmesh_walker.h"
#include "sim/trial/trial.h"

namespace segsim::sim::internal {

class TrialDrive {
 public:
  /// @param external  Moves the robot in place of this class; may be null. All outlive it.
  /// @throws core::InputError if the robot does not fit where the episode starts.
  TrialDrive(const Episode& episode, const TrialOptions& options, const World& world,
             const RobotModel& robot, ExternalDrive* external = nullptr);
  ~TrialDrive() {
    if (external_ != nullptr) external_->end();
  }
  TrialDrive(const TrialDrive&) = delete;
  TrialDrive& operator=(const TrialDrive&) = delete;

  /// Drives up to that time with the command that is in effect.
  /// @return  False if a contact that ends the trial cut it short.
  [[nodiscard]] bool drive_to(core::TimeNs time_ns);
  void set_command(const core::VelocityCommand& command);
  /// The command in effect is sent again, so that the base does not run into its timeout.
  void send_again() { set_command(command_); }
  /// Forgets the contacts before now.
  void begin_tick() { in_contact_ = false; }

  [[nodiscard]] const core::Pose2& pose() const { return robot_.state().pose; }
  /// True, in the robot's frame.
  [[nodiscard]] core::VelocityCommand velocity() const {
    return {robot_.state().forward_mps, robot_.state().turn_radps};
  }
  /// What the robot believes, in Odom.
  [[nodiscard]] core::Pose2 estimate() const {
    if (odometer_) return odometer_->estimate();
    return localiser_ ? localiser_->estimate() : pose();
  }
  /// Of the sensors other than the camera; null: there are none.
  [[nodiscard]] const SensorLog* sensor_log() const {
    return sensors_ ? &sensors_->log() : nullptr;
  }
  [[nodiscard]] core::TimeNs time_ns() const { return now_ns_; }
  [[nodiscard]] bool in_contact() const { return in_contact_; }
  /// Driven so far.
  [[nodiscard]] double path_m() const { return path_m_; }
  /// Separate contacts so far.
  [[nodiscard]] int contacts() const { return static_cast<int>(contacts_.size()); }
  /// Moves into the result what the drive amounts to: where it ended, contacts, and what the
  /// sensors other than the camera recorded.
  void report(TrialResult& result);

 private:
  /// Places the robot at the start of the episode.
  void place(const Episode& episode);
  /// drive_to() where another simulator moves the robot.
  [[nodiscard]] bool follow_to(core::TimeNs time_ns);
  /// The robot is there at that time.
  void arrive(core::TimeNs time_ns, const core::Pose2& pose);
  /// One substep, in the world of the options' collision mode.
  [[nodiscard]] MoveResult move(const core::VelocityCommand& velocity, double step_s);
  void note_contact(const Contact& contact, core::TimeNs step_ns);

  const TrialOptions& options_;
  const World& world_;
  ExternalDrive* external_;  ///< May be null.
  Robot robot_;
  /// The last motion: a base that pushes on a wall repeats it exactly, substep after substep.
  struct Moved {
    core::Pose2 from;
    core::VelocityCommand velocity;
    double step_s = 0.0;
    MoveResult result;
  };
  std::optional<Moved> moved_;
  std::optional<NavmeshWalker> walker_;  ///< Of CollisionMode::kNavmesh.
  std::optional<Odometer> odometer_;
  std::optional<Localiser> localiser_;
  std::optional<SensorSuite> sensors_;
  core::VelocityCommand command_;
  core::TimeNs substep_ns_ = 0, now_ns_ = 0;
  core::TimeNs last_contact_ns_ = -1, contact_ns_ = 0;
  bool in_contact_ = false;
  bool following_ = false;  ///< The other simulator's time has begun.
  double path_m_ = 0.0;
  std::vector<ContactRecord> contacts_;
};

}  // namespace segsim::sim::internal
