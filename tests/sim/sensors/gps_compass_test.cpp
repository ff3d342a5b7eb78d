#include "sim/sensors/gps_compass.h"

#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

namespace segsim::sim {
namespace {

constexpr double kRad = std::numbers::pi / 180.0;

GpsModel exact_gps() {
  GpsModel model;
  model.horizontal_m = {};
  model.antenna_m = 0.0;
  return model;
}

TEST(Gps, KnownPlaces) {
  // GeographicLib's own values for points east and north of two origins.
  struct Known {
    core::GeodeticOrigin origin;
    core::Pose2 pose;
    GeodeticPoint point;
  };
  const Known known[] = {
      {{49.9, 8.9, 0.0, 0.0}, {10, 20, 0}, {49.9001798121, 8.9001391903, 0.000039}},
      {{49.9, 8.9, 0.0, 0.0}, {100, 0, 0}, {49.8999999916, 8.9013918978, 0.000782}},
      {{30.263, 120.123, 10.0, 0.0}, {10, 20, 0}, {30.2631804125, 120.1231039168, 10.000039}},
      // The world's x axis points north: what is 20 m along it and -10 m along y is the same
      // place.
      {{49.9, 8.9, 0.0, 90.0 * kRad}, {20, -10, 0}, {49.9001798121, 8.9001391903, 0.000039}},
  };
  for (const Known& k : known) {
    Gps gps(exact_gps(), LocalFrame(k.origin), 1);
    const GeodeticPoint found = gps.read(0, k.pose);
    EXPECT_NEAR(found.latitude_deg, k.point.latitude_deg, 1e-10);
    EXPECT_NEAR(found.longitude_deg, k.point.longitude_deg, 1e-10);
    EXPECT_NEAR(found.height_m, k.point.height_m, 3e-6);
  }
}

TEST(Gps, ErrorsAreInMetresEastNorthAndUp) {
  GpsModel model = exact_gps();
  model.horizontal_m = {0.3, 0.0, 100.0};
  model.antenna_m = 1.2;
  const core::GeodeticOrigin origin{49.9, 8.9, 100.0, 0.5};
  const LocalFrame frame(origin);
  const LocalFrame east_north({49.9, 8.9, 100.0, 0.0});
  Gps gps(model, frame, 3);
  const core::Pose2 pose{4.0, -3.0, 1.0};
  const glm::dvec3 truth = east_north.from_geodetic(frame.to_geodetic({4.0, -3.0, 1.2}));
  glm::dvec3 squares(0.0);
  constexpr int kFixes = 8000;
  for (int k = 0; k < kFixes; ++k) {
    const glm::dvec3 e =
        east_north.from_geodetic(gps.read(k * core::TimeNs{25'000'000}, pose)) - truth;
    squares += e * e / static_cast<double>(kFixes);
  }
  EXPECT_NEAR(std::sqrt(squares.x), 0.3, 0.012);
  EXPECT_NEAR(std::sqrt(squares.y), 0.3, 0.012);
  EXPECT_NEAR(std::sqrt(squares.z), 0.6, 0.024) << "heights are twice as bad";
}

TEST(Compass, PointsOfTheCompass) {
  CompassModel model;
  model.heading_rad = {};
  const auto heading_deg = [&](double yaw_deg, double origin_yaw_deg = 0.0) {
    Compass compass(model, LocalFrame({49.9, 8.9, 0.0, origin_yaw_deg * kRad}), 1);
    return compass.read_rad(0, {0.0, 0.0, yaw_deg * kRad}) / kRad;
  };
  EXPECT_NEAR(heading_deg(0.0), 90.0, 1e-9) << "x is east";
  EXPECT_NEAR(heading_deg(89.0), 1.0, 1e-9);
  EXPECT_NEAR(heading_deg(91.0), 359.0, 1e-9);
  EXPECT_NEAR(heading_deg(180.0), 270.0, 1e-9);
  EXPECT_NEAR(heading_deg(-90.0), 180.0, 1e-9);
  EXPECT_NEAR(heading_deg(0.0, 60.0), 30.0, 1e-9);
  // The needle points 4 degrees east of true north: it counts 4 degrees less.
  model.declination_rad = 4.0 * kRad;
  EXPECT_NEAR(heading_deg(0.0), 86.0, 1e-9);
  EXPECT_NEAR(heading_deg(88.0), 358.0, 1e-9);
}

TEST(Compass, StaysWithinOneTurnWithNoise) {
  CompassModel model;
  model.heading_rad = {0.1, 0.0, 10.0};
  Compass compass(model, LocalFrame({}), 1);
  double sines = 0.0, squares = 0.0;
  constexpr int kReadings = 4000;
  for (int k = 0; k < kReadings; ++k) {
    const double heading =
        compass.read_rad(k * core::TimeNs{20'000'000}, {0.0, 0.0, 0.5 * std::numbers::pi});
    ASSERT_GE(heading, 0.0);
    ASSERT_LT(heading, 2.0 * std::numbers::pi);
    sines += std::sin(heading) / kReadings;
    squares += std::pow(core::wrap_angle_rad(heading), 2) / kReadings;
  }
  EXPECT_NEAR(sines, 0.0, 0.008);
  EXPECT_NEAR(std::sqrt(squares), 0.1, 0.006);
}

}  // namespace
}  // namespace segsim::sim
