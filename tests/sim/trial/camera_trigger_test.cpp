#include "sim/trial/internal/camera_trigger.h"

#include <gtest/gtest.h>

namespace segsim::sim::internal {
namespace {

constexpr core::TimeNs kMs = 1'000'000;

/// When the images that leave the camera were due, of the first `count` [ms].
std::vector<core::TimeNs> released_ms(CameraTrigger trigger, int count) {
  std::vector<core::TimeNs> times_ms;
  for (int k = 0; k < count; ++k) {
    const core::TimeNs due_ns = trigger.next_ns();
    if (trigger.release()) times_ms.push_back(due_ns / kMs);
  }
  return times_ms;
}

TEST(CameraTrigger, ImagesComeByTheRate) {
  EXPECT_EQ(released_ms(CameraTrigger({100 * kMs, 30 * kMs, 0}, 1, {}), 3),
            (std::vector<core::TimeNs>{30, 130, 230}));
}

TEST(CameraTrigger, AFaultTakesTheFirstImagesFromItsTimeOn) {
  CameraTrigger trigger({100 * kMs, 0, 0}, 1, {{150 * kMs, 2}});
  EXPECT_EQ(released_ms(trigger, 6), (std::vector<core::TimeNs>{0, 100, 400, 500}));
  for (int k = 0; k < 6; ++k) (void)trigger.release();
  EXPECT_EQ(trigger.dropped(), 2);
}

TEST(CameraTrigger, AnImageThatTwoFaultsTakeIsLostOnce) {
  CameraTrigger trigger({100 * kMs, 0, 0}, 1, {{100 * kMs, 1}, {100 * kMs, 2}});
  EXPECT_EQ(released_ms(trigger, 5), (std::vector<core::TimeNs>{0, 300, 400}));
  for (int k = 0; k < 5; ++k) (void)trigger.release();
  EXPECT_EQ(trigger.dropped(), 2);
}

TEST(CameraTrigger, ALostImageShiftsNoOther) {
  const SensorRate shaken{100 * kMs, 0, 20 * kMs};
  const std::vector<core::TimeNs> whole = released_ms(CameraTrigger(shaken, 9, {}), 8);
  std::vector<core::TimeNs> expected = whole;
  expected.erase(expected.begin() + 4);
  EXPECT_EQ(released_ms(CameraTrigger(shaken, 9, {{(whole[4] - 1) * kMs, 1}}), 8), expected);
}

}  // namespace
}  // namespace segsim::sim::internal
