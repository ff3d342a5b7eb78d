#include "nav/behaviours/object_verification.h"

#include <cmath>

#include "core/check.h"

namespace segsim::nav {

void ObjectVerification::begin(core::TimeNs time_ns) {
  since_ns_ = time_ns;
  facing_since_ns_.reset();
}

void ObjectVerification::end() {
  since_ns_.reset();
  facing_since_ns_.reset();
}

bool ObjectVerification::faces(double error_rad) const {
  return std::abs(error_rad) <= options_.facing_rad;
}

Verdict ObjectVerification::look(core::TimeNs time_ns, double error_rad, bool seen,
                                 double patience) {
  SEGSIM_CHECK(active(), "begin() comes first");
  const bool facing = faces(error_rad);
  if (facing && !facing_since_ns_) facing_since_ns_ = time_ns;
  if (facing && seen) return Verdict::kSeen;
  // Since the first facing the clock runs on while the robot turns away and back; since the
  // standing it is read only while the object is faced.
  const bool counts = options_.from_first_facing ? facing_since_ns_.has_value() : facing;
  const core::TimeNs from_ns =
      options_.from_first_facing && facing_since_ns_ ? *facing_since_ns_ : *since_ns_;
  const bool looked = counts && core::seconds(time_ns - from_ns) > patience * options_.look_s;
  const bool late = core::seconds(time_ns - *since_ns_) > options_.longest_s;
  return looked || late ? Verdict::kNotSeen : Verdict::kLooking;
}

}  // namespace segsim::nav
