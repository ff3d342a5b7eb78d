#include "sim/trial/success_profile.h"

#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace segsim::sim {
namespace {

using testing::HasSubstr;

const SuccessProfile& profile(const std::string& name) {
  const SuccessProfile* found = find_success_profile(name);
  EXPECT_NE(found, nullptr) << name;
  return *found;
}

/// A stop beside the goal that every profile accepts.
TrialEnd good_end() {
  TrialEnd end;
  end.stopped = end.declared = true;
  end.view_point_m = 0.05;
  end.object_m = 0.0;
  end.planar_m = 0.05;
  end.visible_px = 400;
  end.time_s = 20.0;
  end.path_m = 12.0;
  end.shortest_path_m = 10.0;
  end.shortest_object_m = 9.5;
  return end;
}

TEST(SuccessProfile, NamesAreUniqueAndTheDefaultComesFirst) {
  std::set<std::string> names;
  for (const SuccessProfile& p : success_profiles()) {
    EXPECT_TRUE(names.insert(p.name).second);
    EXPECT_TRUE(succeeded(p, good_end())) << p.name;
  }
  EXPECT_EQ(success_profiles().front(), SuccessProfile{});
  EXPECT_EQ(names, (std::set<std::string>{"segsim-object", "habitat-hm3d", "apexnav",
                                          "semexp-gibson", "allenact-robothor", "barn"}));
  EXPECT_EQ(find_success_profile("spl"), nullptr);
}

TEST(SuccessProfile, TheDistanceIsStrict) {
  TrialEnd end = good_end();
  end.view_point_m = 0.1;
  EXPECT_FALSE(succeeded(profile("habitat-hm3d"), end));
  EXPECT_TRUE(succeeded(profile("apexnav"), end));
  end.view_point_m = 0.0999999;
  EXPECT_TRUE(succeeded(profile("habitat-hm3d"), end));
  end.view_point_m = 0.2;
  EXPECT_FALSE(succeeded(profile("apexnav"), end));
  EXPECT_TRUE(succeeded(profile("segsim-object"), end));
  end.view_point_m = 1.0;
  EXPECT_FALSE(succeeded(profile("segsim-object"), end));
}

TEST(SuccessProfile, OnlyOursAsksForTheReasonOfAStop) {
  TrialEnd end = good_end();
  end.declared = false;
  for (const SuccessProfile& p : success_profiles()) {
    EXPECT_EQ(succeeded(p, end), p.name != "segsim-object") << p.name;
  }
}

TEST(SuccessProfile, WithoutStopOnlyBarnSucceeds) {
  TrialEnd end = good_end();
  end.stopped = end.declared = false;
  for (const SuccessProfile& p : success_profiles()) {
    EXPECT_EQ(succeeded(p, end), p.name == "barn") << p.name;
  }
}

TEST(SuccessProfile, WhoAsksForAView) {
  TrialEnd end = good_end();
  end.visible_px = 39;
  for (const SuccessProfile& p : success_profiles()) {
    const bool asks = p.name == "segsim-object" || p.name == "allenact-robothor";
    EXPECT_EQ(succeeded(p, end), !asks) << p.name;
  }
  end.visible_px = 40;
  EXPECT_TRUE(succeeded(profile("segsim-object"), end));
}

TEST(SuccessProfile, OffTheFloorNothingByDistanceSucceeds) {
  TrialEnd end;
  end.stopped = end.declared = true;
  end.visible_px = 1000;
  for (const SuccessProfile& p : success_profiles()) {
    EXPECT_EQ(succeeded(p, end), p.name == "allenact-robothor") << p.name;
    EXPECT_EQ(profile_spl(p, TrialEnd{}), 0.0) << p.name;
  }
}

TEST(SuccessProfile, SemExpMeasuresToTheGrownObject) {
  TrialEnd end = good_end();
  end.path_m = 21.0;
  // min(S (9.5 + 1) / (21 + 1e-5), 1)
  EXPECT_NEAR(profile_spl(profile("semexp-gibson"), end), 10.5 / 21.00001, 1e-12);
  end.path_m = 5.0;
  EXPECT_DOUBLE_EQ(profile_spl(profile("semexp-gibson"), end), 1.0);
  end.object_m = 0.01;
  EXPECT_DOUBLE_EQ(profile_spl(profile("semexp-gibson"), end), 0.0);
}

TEST(SuccessProfile, AllenActAtTheGoalFromTheStart) {
  TrialEnd end = good_end();
  end.shortest_path_m = 0.0;
  EXPECT_DOUBLE_EQ(profile_spl(profile("allenact-robothor"), end), 0.0);
  end.path_m = 0.0;
  EXPECT_DOUBLE_EQ(profile_spl(profile("allenact-robothor"), end), 1.0);
}

TEST(BarnScore, WorkedExamples) {
  EXPECT_DOUBLE_EQ(barn_score(true, 10.0, 10.0), 0.5);
  EXPECT_DOUBLE_EQ(barn_score(true, 10.0, 20.0), 0.25);
  EXPECT_DOUBLE_EQ(barn_score(true, 10.0, 60.0), 0.125);
  EXPECT_DOUBLE_EQ(barn_score(true, 10.0, 5.0), 0.5);
  EXPECT_DOUBLE_EQ(barn_score(false, 10.0, 10.0), 0.0);
  TrialEnd end = good_end();
  EXPECT_DOUBLE_EQ(profile_spl(profile("barn"), end), 0.25);
  end.contacts = 1;
  EXPECT_DOUBLE_EQ(profile_spl(profile("barn"), end), 0.0);
  end.contacts = 0;
  end.time_s = 100.0;
  EXPECT_DOUBLE_EQ(profile_spl(profile("barn"), end), 0.0);
  end.time_s = 20.0;
  end.planar_m = 1.0;  // "At most", not "below".
  EXPECT_DOUBLE_EQ(profile_spl(profile("barn"), end), 0.25);
}

TEST(SuccessProfile, WordsNameTheNumbers) {
  EXPECT_THAT(in_words(profile("habitat-hm3d")), HasSubstr("0.1 m"));
  EXPECT_THAT(in_words(profile("segsim-object")), HasSubstr("40 px"));
  EXPECT_THAT(in_words(profile("barn")), HasSubstr("100 s"));
}

}  // namespace
}  // namespace segsim::sim
