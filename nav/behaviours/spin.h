#pragma once

/// @file
/// Looking around on the spot, before a search and at the places of a sweep.

#include <optional>

#include "core/frames.h"
#include "core/stages.h"

namespace segsim::nav {

struct SpinOptions {
  double rate_radps = 1.2;
  double angle_rad = 6.2832;    ///< 0 skips it.
  double tolerance_rad = 0.05;  ///< This much less is enough.
};

class Spin {
 public:
  explicit Spin(const SpinOptions& options = {}) : options_(options) {}
  /// Starts anew.
  void begin() { turned_rad_ = 0.0; }
  /// The command of this decision, to the left; nullopt when the robot has been once around.
  [[nodiscard]] std::optional<core::VelocityCommand> command(double yaw_rad) {
    if (last_yaw_rad_) turned_rad_ += core::wrap_angle_rad(yaw_rad - *last_yaw_rad_);
    if (turned_rad_ >= options_.angle_rad - options_.tolerance_rad) return std::nullopt;
    return core::VelocityCommand{0.0, options_.rate_radps};
  }
  /// To be called at the end of every decision, also of those that do not spin: only turns
  /// between two decisions count of which the second one spins.
  void end_decision(double yaw_rad) { last_yaw_rad_ = yaw_rad; }

 private:
  SpinOptions options_;
  double turned_rad_ = 0.0;
  std::optional<double> last_yaw_rad_;
};

}  // namespace segsim::nav
