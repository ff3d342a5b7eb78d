#include "nav/behaviours/object_verification.h"

#include <cmath>

#include <gmock/gmock.h>

#include "core/check.h"

namespace segsim::nav {
namespace {

core::TimeNs at_s(double time_s) { return std::llround(time_s * 1e9); }

TEST(ObjectVerification, ADetectionCountsOnlyWhileTheObjectIsFaced) {
  ObjectVerification verification({.facing_rad = 0.2});
  verification.begin(0);
  EXPECT_EQ(verification.look(at_s(0.1), 0.5, true), Verdict::kLooking);
  EXPECT_EQ(verification.look(at_s(0.2), 0.1, false), Verdict::kLooking);
  EXPECT_EQ(verification.look(at_s(0.3), -0.1, true), Verdict::kSeen);
}

TEST(ObjectVerification, TheTimeToLookBeginsWithTheFirstFacing) {
  ObjectVerification verification({.look_s = 2.0, .from_first_facing = true});
  verification.begin(0);
  EXPECT_EQ(verification.look(at_s(3.0), 1.0, false), Verdict::kLooking);
  EXPECT_EQ(verification.look(at_s(4.0), 0.0, false), Verdict::kLooking);
  EXPECT_EQ(verification.look(at_s(5.9), 0.0, false), Verdict::kLooking);
  EXPECT_EQ(verification.look(at_s(6.1), 1.0, false), Verdict::kNotSeen);  // Turned away.
}

TEST(ObjectVerification, OrWithTheStandingAndThenOnlyWhileItFaces) {
  ObjectVerification verification({.look_s = 2.0, .from_first_facing = false});
  verification.begin(0);
  EXPECT_EQ(verification.look(at_s(3.0), 1.0, false), Verdict::kLooking);
  EXPECT_EQ(verification.look(at_s(3.1), 0.0, false), Verdict::kNotSeen);
}

TEST(ObjectVerification, PatienceStretchesTheTimeToLookNotTheWhole) {
  ObjectVerification verification({.look_s = 2.0, .longest_s = 5.0});
  verification.begin(0);
  EXPECT_EQ(verification.look(at_s(0.0), 0.0, false), Verdict::kLooking);
  EXPECT_EQ(verification.look(at_s(3.0), 0.0, false, 2.0), Verdict::kLooking);
  EXPECT_EQ(verification.look(at_s(3.0), 0.0, false), Verdict::kNotSeen);
  EXPECT_EQ(verification.look(at_s(5.1), 0.0, false, 9.0), Verdict::kNotSeen);
}

TEST(ObjectVerification, ARobotThatCannotTurnGivesUpInTheEnd) {
  ObjectVerification verification({.longest_s = 10.0});
  verification.begin(0);
  EXPECT_EQ(verification.look(at_s(9.9), 1.0, false), Verdict::kLooking);
  EXPECT_EQ(verification.look(at_s(10.1), 1.0, false), Verdict::kNotSeen);
}

TEST(ObjectVerification, EachObjectGetsOneLookFromAfar) {
  ObjectVerification verification;
  EXPECT_FALSE(verification.looks_from_afar(3));
  EXPECT_TRUE(verification.look_from_afar(3));
  EXPECT_TRUE(verification.looks_from_afar(3));
  EXPECT_FALSE(verification.look_from_afar(3));
  EXPECT_TRUE(verification.look_from_afar(4));
  verification.end();
  EXPECT_TRUE(verification.looks_from_afar(3));
  verification.forget_far_looks();
  EXPECT_FALSE(verification.looks_from_afar(3));
}

TEST(ObjectVerification, LookingWithoutBeginningIsABug) {
  ObjectVerification verification;
  EXPECT_FALSE(verification.active());
  EXPECT_THROW((void)verification.look(0, 0.0, false), core::ContractViolation);
  verification.begin(7);
  EXPECT_EQ(verification.since_ns(), 7);
  verification.end();
  EXPECT_FALSE(verification.active());
}

}  // namespace
}  // namespace segsim::nav
