#include "nav/behaviours/recovery.h"

#include <cmath>

#include <gmock/gmock.h>

#include "tests/nav/text_map.h"

namespace segsim::nav {
namespace {

constexpr double kRadius_m = 0.3;
constexpr core::VelocityCommand kForward{0.3, 0.0};

Moment at(const core::Pose2& pose, double time_s) {
  return {nullptr, pose, {pose.x_m, pose.y_m}, std::llround(time_s * 1e9)};
}

/// Drives in vain until the recovery is due. @return  Decisions that it took.
int drive_in_vain(Recovery& recovery, const core::Pose2& pose) {
  int decisions = 0;
  while (!recovery.due() && decisions < 100) {
    recovery.watch(pose, kForward, false);
    ++decisions;
  }
  return decisions;
}

/// The commands of a recovery on a robot that moves as told, every 0.1 s.
std::vector<core::VelocityCommand> carry_out(Recovery& recovery, core::Pose2 pose,
                                             const CostMap& map = {}) {
  std::vector<core::VelocityCommand> commands;
  const PathFollower follower;
  for (int k = 0; k < 200; ++k) {
    const auto command = recovery.command(at(pose, 0.1 * k), follower, map);
    if (!command) return commands;
    commands.push_back(*command);
    pose = advance(pose, *command, 0.1);
  }
  ADD_FAILURE() << "the recovery does not end";
  return commands;
}

TEST(Recovery, IsDueAfterDrivingInVain) {
  Recovery recovery({}, kRadius_m);
  recovery.reset(1);
  EXPECT_FALSE(recovery.due());
  EXPECT_EQ(drive_in_vain(recovery, {}), StuckOptions{}.decisions);
  recovery.forget_motion();
  EXPECT_FALSE(recovery.due());
}

TEST(Recovery, IsDueWhenNoWayForwardIsSafeIfSoAsked) {
  for (const int limit : {0, 3}) {
    Recovery recovery({.blocked_decisions = limit}, kRadius_m);
    recovery.reset(1);
    for (int k = 0; k < 4; ++k) {
      EXPECT_FALSE(recovery.due());
      recovery.watch({}, {}, true);  // It stands, so it is not stuck.
    }
    EXPECT_EQ(recovery.due(), limit == 3);
    if (limit == 3) {
      EXPECT_FALSE(recovery.begin(at({}, 0.0))) << "nothing was felt";
    }
  }
}

TEST(Recovery, BacksUpThenTurnsAndEnds) {
  Recovery recovery({.back_where_safe = false}, kRadius_m);
  recovery.reset(1);
  drive_in_vain(recovery, {});
  (void)recovery.begin(at({}, 0.0));
  EXPECT_TRUE(recovery.active());
  EXPECT_FALSE(recovery.due());
  const auto commands = carry_out(recovery, {});
  EXPECT_FALSE(recovery.active());
  double back_m = 0.0, turn_rad = 0.0;
  bool turned = false;
  for (const core::VelocityCommand& command : commands) {
    EXPECT_FALSE(turned && command.forward_mps != 0.0) << "backs up after the turn";
    turned |= command.turn_radps != 0.0;
    back_m -= 0.1 * command.forward_mps;
    turn_rad += 0.1 * command.turn_radps;
  }
  const RecoveryOptions usual;
  EXPECT_NEAR(back_m, usual.back_m, 0.021);
  EXPECT_GE(std::abs(turn_rad), usual.turn_min_rad - usual.turn_tolerance_rad - 0.1);
  EXPECT_LE(std::abs(turn_rad), usual.turn_max_rad + 0.1);
}

TEST(Recovery, BacksUpOnlyWhereThereIsRoomIfSoAsked) {
  // A wall behind the robot, which looks along +x.
  const CostMap map = test::text_map({"#........", "#........", "#........", "#........",
                                      "#........", "#........", "#........"},
                                     test::thin_options(), 0.1);
  const core::Pose2 pose{map.frame().center_m({3, 3}).x, map.frame().center_m({3, 3}).y, 0.0};
  for (const bool careful : {true, false}) {
    Recovery recovery({.back_where_safe = careful}, kRadius_m);
    recovery.reset(1);
    drive_in_vain(recovery, pose);
    (void)recovery.begin(at(pose, 0.0));
    EXPECT_EQ(carry_out(recovery, pose, map).front().forward_mps < 0.0, !careful);
  }
}

TEST(Recovery, EachPhaseEndsAlthoughTheRobotCannotMove) {
  Recovery recovery({.back_where_safe = false}, kRadius_m);
  recovery.reset(1);
  drive_in_vain(recovery, {});
  (void)recovery.begin(at({}, 0.0));
  const PathFollower follower;
  double time_s = 0.0;
  while (recovery.command(at({}, time_s), follower, {}) && time_s < 20.0) time_s += 0.25;
  EXPECT_NEAR(time_s, 2.0 * RecoveryOptions{}.phase_s, 0.3);
}

TEST(Recovery, WhatIsFeltLiesAheadAndGrowsAtTheSamePlace) {
  const RecoveryOptions options;
  Recovery recovery(options, kRadius_m);
  recovery.reset(1);
  const core::Pose2 north{1.0, 2.0, 0.5 * 3.14159265358979};
  const std::vector<double> radii_m{0.05, 0.10, 0.15, 0.20, 0.20};
  for (const double radius_m : radii_m) {
    drive_in_vain(recovery, north);
    const auto felt = recovery.begin(at(north, 0.0));
    ASSERT_TRUE(felt);
    EXPECT_NEAR(felt->radius_m, radius_m, 1e-12);
    EXPECT_NEAR(felt->center_m.x, 1.0, 1e-9);
    EXPECT_NEAR(felt->center_m.y, 2.0 + kRadius_m + options.felt_beyond_m, 1e-9);
    carry_out(recovery, north);
  }
  recovery.forget_places();
  drive_in_vain(recovery, north);
  EXPECT_NEAR(recovery.begin(at(north, 0.0))->radius_m, radii_m.front(), 1e-12);
}

TEST(Recovery, TheTurnComesFromTheSeedAndTheStream) {
  const auto turn_of = [](std::uint64_t seed, const std::string& stream) {
    Recovery recovery({.back_m = 0.0, .random_stream = stream}, kRadius_m);
    recovery.reset(seed);
    (void)recovery.begin(at({}, 0.0));
    double turn_rad = 0.0;
    for (const auto& command : carry_out(recovery, {})) turn_rad += 0.1 * command.turn_radps;
    return turn_rad;
  };
  EXPECT_EQ(turn_of(1, "recovery"), turn_of(1, "recovery"));
  EXPECT_NE(turn_of(1, "recovery"), turn_of(2, "recovery"));
  EXPECT_NE(turn_of(1, "recovery"), turn_of(1, "another"));
}

TEST(Recovery, TheirNumberIsLimited) {
  Recovery recovery({.most = 2}, kRadius_m);
  recovery.reset(1);
  for (int k = 0; k < 2; ++k) {
    EXPECT_FALSE(recovery.exhausted());
    (void)recovery.begin(at({}, 0.0));
    carry_out(recovery, {});
  }
  EXPECT_TRUE(recovery.exhausted());
  recovery.reset(1);
  EXPECT_FALSE(recovery.exhausted());
}

}  // namespace
}  // namespace segsim::nav
