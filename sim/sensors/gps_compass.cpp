#include "sim/sensors/gps_compass.h"

#include <cmath>
#include <numbers>

namespace segsim::sim {
namespace {

ErrorModel scaled(ErrorModel model, double factor) {
  model.sigma *= factor;
  model.drift *= factor;
  return model;
}

}  // namespace

Gps::Gps(const GpsModel& model, const LocalFrame& frame, std::uint64_t seed)
    : model_(model),
      frame_(frame),
      error_m_{SlowError(model.horizontal_m, seed, "gps/east"),
               SlowError(model.horizontal_m, seed, "gps/north"),
               SlowError(scaled(model.horizontal_m, model.up_factor), seed, "gps/up")} {}

GeodeticPoint Gps::read(core::TimeNs time_ns, const core::Pose2& pose) {
  const double east_m = error_m_[0].next(time_ns), north_m = error_m_[1].next(time_ns);
  const double up_m = error_m_[2].next(time_ns);
  // From east and north to the world's axes, which are turned by the origin's yaw.
  const double c = std::cos(frame_.origin().yaw_rad), s = std::sin(frame_.origin().yaw_rad);
  return frame_.to_geodetic({pose.x_m + c * east_m + s * north_m,
                             pose.y_m - s * east_m + c * north_m, model_.antenna_m + up_m});
}

Compass::Compass(const CompassModel& model, const LocalFrame& frame, std::uint64_t seed)
    : world_yaw_rad_(frame.origin().yaw_rad),
      declination_rad_(model.declination_rad),
      error_rad_(model.heading_rad, seed, "compass") {}

double Compass::read_rad(core::TimeNs time_ns, const core::Pose2& pose) {
  constexpr double kTurn = 2.0 * std::numbers::pi;
  // Counter-clockwise from east becomes clockwise from north.
  const double north_rad = 0.5 * std::numbers::pi - (pose.yaw_rad + world_yaw_rad_);
  const double heading =
      std::fmod(north_rad - declination_rad_ + error_rad_.next(time_ns), kTurn);
  const double positive = heading < 0.0 ? heading + kTurn : heading;
  return positive < kTurn ? positive : 0.0;  // A tiny negative number rounds up to a turn.
}

}  // namespace segsim::sim
