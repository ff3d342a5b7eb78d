#pragma once

/// @file
/// Plans are made anew every so often, and at once when something changed.

#include <optional>

#include "core/stages.h"

namespace segsim::nav {

class ReplanTimer {
 public:
  explicit ReplanTimer(double period_s) : period_s_(period_s) {}
  /// A plan was made.
  void planned(core::TimeNs time_ns) { planned_ns_ = time_ns; }
  /// The next plan is due at once.
  void demand() { planned_ns_.reset(); }
  [[nodiscard]] bool demanded() const { return !planned_ns_; }
  [[nodiscard]] bool due(core::TimeNs time_ns) const {
    constexpr double kRounding_s = 1e-6;
    return !planned_ns_ || core::seconds(time_ns - *planned_ns_) >= period_s_ - kRounding_s;
  }

 private:
  double period_s_;
  std::optional<core::TimeNs> planned_ns_;
};

}  // namespace segsim::nav
