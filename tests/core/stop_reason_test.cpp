#include "core/stop_reason.h"

#include <set>
#include <string>

#include <gtest/gtest.h>

#include "core/error.h"

namespace segsim::core {
namespace {

constexpr int kReasons = static_cast<int>(StopReason::kStepFailed) + 1;

TEST(StopReason, NamesAreUniqueAndReadBack) {
  std::set<std::string> names;
  for (int k = 0; k < kReasons; ++k) {
    const auto reason = static_cast<StopReason>(k);
    EXPECT_TRUE(names.insert(to_string(reason)).second) << to_string(reason);
    EXPECT_EQ(stop_reason_from(to_string(reason), "here"), reason);
  }
}

/// Files of earlier versions have these words.
TEST(StopReason, NamesInFilesStay) {
  EXPECT_STREQ(to_string(StopReason::kGoalReached), "goal_reached");
  EXPECT_STREQ(to_string(StopReason::kNoFrontierLeft), "no_frontier_left");
  EXPECT_STREQ(to_string(StopReason::kNothingNew), "nothing_new");
  EXPECT_STREQ(to_string(StopReason::kStuck), "stuck");
  EXPECT_STREQ(to_string(StopReason::kMapExhausted), "map_exhausted");
  EXPECT_STREQ(to_string(StopReason::kPointnavStop), "pointnav_stop");
  EXPECT_STREQ(to_string(StopReason::kNoPath), "no_path");
  EXPECT_STREQ(to_string(StopReason::kRandomStop), "random_stop");
  EXPECT_STREQ(to_string(StopReason::kScriptEnd), "script_end");
  EXPECT_STREQ(to_string(StopReason::kStepFailed), "step_failed");
}

TEST(StopReason, NoneIsTheEmptyName) {
  EXPECT_STREQ(to_string(std::optional<StopReason>()), "");
  EXPECT_EQ(stop_reason_from("", "here"), std::nullopt);
}

TEST(StopReason, ATypoIsRefused) {
  EXPECT_THROW((void)stop_reason_from("goal_raeched", "here"), InputError);
}

}  // namespace
}  // namespace segsim::core
