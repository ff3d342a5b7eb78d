// Instead of gazebo_drive.cpp in a program without the transport.

#include "core/error.h"
#include "sim/gazebo/gazebo_drive.h"

namespace segsim::sim {

struct GazeboDrive::Parts {};

GazeboDrive::GazeboDrive(GazeboDriveOptions /*options*/) {
  throw core::InputError::expected("motion by Gazebo", "a build with SEGSIM_GAZEBO=ON",
                                   "one without");
}

GazeboDrive::~GazeboDrive() = default;

void GazeboDrive::await_poses() {}

core::Pose2 GazeboDrive::begin(const core::Pose2& /*start*/) { return {}; }

void GazeboDrive::command(const core::VelocityCommand& /*command*/) {}

ExternalDrive::Moment GazeboDrive::next(core::TimeNs /*until_ns*/) { return {}; }

void GazeboDrive::end() noexcept {}

}  // namespace segsim::sim
