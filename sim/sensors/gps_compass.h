#pragma once

/// @file
/// Where on earth, and which way: GPS through the geodetic origin of the scene
/// (sim/ground/geodesy.h), and a compass.
///
/// GPS errors are made in the local frame (east, north, up) and then carried to the ellipsoid.
/// Defaults: Jackal's URDF gives its GPS 40 Hz and a drift of 0.1 mm, which is none; ours are
/// a receiver under open sky without corrections: 0.3 m from fix to fix, 1.5 m wandering over
/// minutes, heights twice as bad. An assumption: indoors there is no GPS at all.

#include <array>

#include <glm/vec3.hpp>

#include "core/frames.h"
#include "core/stages.h"
#include "sim/ground/geodesy.h"
#include "sim/sensors/slow_error.h"

namespace segsim::sim {

struct GpsModel {
  ErrorModel horizontal_m{0.3, 1.5, 120.0};  ///< East and north, each.
  double up_factor = 2.0;                    ///< Times the horizontal errors.
  double antenna_m = 1.2;                    ///< Above the floor, over the robot's origin.
};

class Gps {
 public:
  Gps(const GpsModel& model, const LocalFrame& frame, std::uint64_t seed);
  /// The fix of a robot that stands there. Times ascend.
  [[nodiscard]] GeodeticPoint read(core::TimeNs time_ns, const core::Pose2& pose);

 private:
  GpsModel model_;
  LocalFrame frame_;
  std::array<SlowError, 3> error_m_;  ///< East, north, up.
};

/// Defaults: noise and drift of the heading in Jackal's URDF (jackal.gazebo), 0.005 rad.
struct CompassModel {
  ErrorModel heading_rad{0.005, 0.005, 3600.0};
  /// Magnetic minus true north, positive east: a constant, since maps of the earth's field are
  /// data that this program does not ship.
  double declination_rad = 0.0;
};

class Compass {
 public:
  Compass(const CompassModel& model, const LocalFrame& frame, std::uint64_t seed);
  /// Clockwise from magnetic north to the robot's +x, in [0, 2 pi).
  [[nodiscard]] double read_rad(core::TimeNs time_ns, const core::Pose2& pose);

 private:
  double world_yaw_rad_, declination_rad_;
  SlowError error_rad_;
};

}  // namespace segsim::sim
