#pragma once

/// @file
/// Before STOP: the robot stands beside an object, faces it and waits for a detection there.
/// Very near an object may fill the image, so one that was not seen can be given one more look
/// from farther away.

#include <optional>
#include <set>

#include "core/stages.h"

namespace segsim::nav {

struct VerificationOptions {
  double facing_rad = 0.35;  ///< The object counts as faced within this angle, 20 degrees.
  /// Looking without a detection until the object is given up ...
  double look_s = 2.0;
  bool from_first_facing =
      true;                 ///< ... since it was faced first; else since the robot stood.
  double longest_s = 10.0;  ///< ... or so long altogether, faced or not.
};

enum class Verdict : std::uint8_t { kLooking, kSeen, kNotSeen };

class ObjectVerification {
 public:
  explicit ObjectVerification(const VerificationOptions& options = {}) : options_(options) {}

  /// The robot stands at its place from now on.
  void begin(core::TimeNs time_ns);
  /// The robot goes on; what is known of far looks stays.
  void end();
  [[nodiscard]] bool active() const { return since_ns_.has_value(); }
  /// When it began. Only while active.
  [[nodiscard]] core::TimeNs since_ns() const { return *since_ns_; }

  [[nodiscard]] bool faces(double error_rad) const;
  /// One decision while active. @param error_rad  Bearing of the object off the heading.
  /// @param seen  Whether a detection shows the object now; counts only while it is faced.
  /// @param patience  Multiple of the time to look.
  [[nodiscard]] Verdict look(core::TimeNs time_ns, double error_rad, bool seen,
                             double patience = 1.0);

  /// Asks for one more look at this object from farther away. @return  False if it had one.
  bool look_from_afar(int object_id) { return far_looks_.insert(object_id).second; }
  [[nodiscard]] bool looks_from_afar(int object_id) const {
    return far_looks_.count(object_id) != 0;
  }
  void forget_far_looks() { far_looks_.clear(); }

 private:
  VerificationOptions options_;
  std::optional<core::TimeNs> since_ns_, facing_since_ns_;
  std::set<int> far_looks_;  ///< Objects that are or were looked at from farther.
};

}  // namespace segsim::nav
