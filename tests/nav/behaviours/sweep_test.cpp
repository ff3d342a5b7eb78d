#include "nav/behaviours/sweep.h"

#include <gmock/gmock.h>

namespace segsim::nav {
namespace {

constexpr core::TimeNs kSecond = core::kNsPerSecond;

TEST(Sweep, VisitsOnePlaceAfterTheOther) {
  Sweep sweep;
  EXPECT_FALSE(sweep.place_m());
  sweep.begin({{1.0, 0.0}, {5.0, 0.0}}, 0);
  EXPECT_EQ(sweep.place_m(), glm::dvec2(1.0, 0.0));
  sweep.leave(kSecond);
  EXPECT_EQ(sweep.place_m(), glm::dvec2(5.0, 0.0));
  sweep.leave(2 * kSecond);
  EXPECT_FALSE(sweep.place_m());
  sweep.leave(3 * kSecond);  // Nothing to leave.
  EXPECT_EQ(sweep.places_left(), SweepOptions{}.most_places - 2);
}

TEST(Sweep, PatienceBeginsWithEachPlace) {
  Sweep sweep({.patience_s = 10.0});
  EXPECT_FALSE(sweep.late(100 * kSecond));
  sweep.begin({{1.0, 0.0}, {5.0, 0.0}}, 0);
  EXPECT_FALSE(sweep.late(10 * kSecond));
  EXPECT_TRUE(sweep.late(11 * kSecond));
  sweep.leave(11 * kSecond);
  EXPECT_FALSE(sweep.late(20 * kSecond));
  EXPECT_TRUE(sweep.late(22 * kSecond));
}

TEST(Sweep, RemembersWhereItWas) {
  Sweep sweep({.most_places = 2, .apart_m = 1.0});
  sweep.begin({{1.0, 0.0}}, 0);
  sweep.leave(kSecond);
  EXPECT_TRUE(sweep.visited({1.9, 0.0}));
  EXPECT_FALSE(sweep.visited({2.1, 0.0}));
  sweep.forget_visited();
  EXPECT_FALSE(sweep.visited({1.0, 0.0}));
  EXPECT_EQ(sweep.places_left(), 1);  // What was visited still counts.
}

TEST(Sweep, PlacesThatWereNeverSetOutForDoNotCount) {
  Sweep sweep({.most_places = 4});
  sweep.begin({{1.0, 0.0}, {5.0, 0.0}}, 0);
  EXPECT_FALSE(sweep.visited({5.0, 0.0}));
  sweep.begin({{9.0, 0.0}}, kSecond);
  EXPECT_EQ(sweep.place_m(), glm::dvec2(9.0, 0.0));
  EXPECT_EQ(sweep.places_left(), 2);
}

}  // namespace
}  // namespace segsim::nav
