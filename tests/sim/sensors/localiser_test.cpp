#include "sim/sensors/localiser.h"

#include <cmath>

#include <gtest/gtest.h>

namespace segsim::sim {
namespace {

TEST(Localiser, ErrorsHaveTheirSpreadAndDoNotGrow) {
  LocaliserModel model;
  model.position_m = {0.03, 0.04, 20.0};
  model.heading_rad = {0.01, 0.0, 20.0};
  double early2 = 0.0, late2 = 0.0, yaw2 = 0.0;
  constexpr int kEpisodes = 2000;
  for (std::uint64_t seed = 0; seed < kEpisodes; ++seed) {
    Localiser localiser(model, seed);
    localiser.move_to(0, {1.0, 2.0, 3.1});
    early2 += std::pow(localiser.estimate().x_m - 1.0, 2) / kEpisodes;
    localiser.move_to(100 * core::kNsPerSecond, {50.0, 2.0, 3.1});
    const core::Pose2 found = localiser.estimate();
    late2 += std::pow(found.x_m - 50.0, 2) / kEpisodes;
    yaw2 += std::pow(core::wrap_angle_rad(found.yaw_rad - 3.1), 2) / kEpisodes;
  }
  // sqrt(0.03^2 + 0.04^2) = 0.05. The standard error of a deviation of 2000 is 1.6 %.
  EXPECT_NEAR(std::sqrt(early2), 0.05, 0.004);
  EXPECT_NEAR(std::sqrt(late2), 0.05, 0.004);
  EXPECT_NEAR(std::sqrt(yaw2), 0.01, 0.0008);
}

TEST(Localiser, ErrorsStayBetweenCorrectionsWhateverTheSteps) {
  const LocaliserModel model;
  Localiser fine(model, 5), coarse(model, 5);
  for (core::TimeNs t = 0; t <= 250'000'000; t += 5'000'000) {
    fine.move_to(t, {core::seconds(t), 0.0, 0.0});
  }
  coarse.move_to(250'000'000, {0.25, 0.0, 0.0});
  EXPECT_EQ(fine.estimate().x_m, coarse.estimate().x_m);
  const double error_m = fine.estimate().x_m - 0.25;
  fine.move_to(299'000'000, {9.0, 0.0, 0.0});
  EXPECT_NEAR(fine.estimate().x_m - 9.0, error_m, 1e-12);
  fine.move_to(300'000'000, {9.0, 0.0, 0.0});
  EXPECT_GT(std::abs(fine.estimate().x_m - 9.0 - error_m), 1e-6);
}

TEST(Localiser, WithoutErrorItKnowsThePose) {
  Localiser localiser({{}, {}, 100'000'000}, 1);
  localiser.move_to(400'000'000, {1.0, 2.0, 3.0});
  EXPECT_EQ(localiser.estimate().x_m, 1.0);
  EXPECT_EQ(localiser.estimate().y_m, 2.0);
  EXPECT_NEAR(localiser.estimate().yaw_rad, 3.0, 1e-15);
}

}  // namespace
}  // namespace segsim::sim
