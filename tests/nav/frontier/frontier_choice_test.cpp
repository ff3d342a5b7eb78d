#include "nav/frontier/frontier_choice.h"

#include <algorithm>

#include <gmock/gmock.h>

namespace segsim::nav {
namespace {

using Frontiers = std::vector<ValuedFrontier>;

VlfmRules published(Quirk quirk) {
  VlfmRules rules;
  rules.set(quirk, Rule::kVlfm);
  return rules;
}

TEST(FrontierChoice, TheMostValuableWins) {
  FrontierChooser chooser;
  const Frontiers frontiers{{{1, 0}, 0.2}, {{9, 0}, 0.5}, {{0, 1}, -1.0}};
  EXPECT_EQ(chooser.choose({0, 0}, frontiers), 1U);
  EXPECT_FALSE(chooser.choose({0, 0}, Frontiers{}));
}

TEST(FrontierChoice, SticksWhileTheValueHoldsUpTo001) {
  const Frontiers first{{{1, 0}, 0.50}, {{5, 0}, 0.40}};
  for (const auto& [moved_to, now, stays] : {std::tuple{glm::dvec2(1, 0), 0.495, true},
                                             {glm::dvec2(1, 0), 0.485, false},
                                             {glm::dvec2(1.4, 0), 0.495, true},
                                             {glm::dvec2(1.6, 0), 0.495, false}}) {
    FrontierChooser chooser;
    ASSERT_EQ(chooser.choose({0, 0}, first), 0U);
    // Another one became better meanwhile.
    const Frontiers second{{moved_to, now}, {{5, 0}, 0.9}};
    EXPECT_EQ(chooser.choose({0.5, 0}, second), stays ? 0U : 1U) << moved_to.x << " " << now;
  }
}

TEST(FrontierChoice, RepeatedStatesAreVetoedOnlyWhenFixed) {  // Q1
  // The value falls so fast that stickiness never holds; state and best two values repeat.
  const Frontiers frontiers{{{1, 0}, 0.5}, {{5, 0}, 0.4}};
  const Frontiers other{{{1, 0}, 0.3}, {{5, 0}, 0.2}};
  FrontierChooser fixed, as_published({}, published(Quirk::kAcyclicMemory));
  for (FrontierChooser* chooser : {&fixed, &as_published}) {
    ASSERT_EQ(chooser->choose({0, 0}, frontiers), 0U);
    ASSERT_EQ(chooser->choose({0, 0}, other), 0U);  // Lost value; a new state: still the best.
  }
  // The first state again; its value rose, so stickiness would hold, unless the place is new.
  const Frontiers again{{{1, 0}, 0.5}, {{5, 0}, 0.4}};
  FrontierChooser moved, moved_published({}, published(Quirk::kAcyclicMemory));
  for (FrontierChooser* chooser : {&moved, &moved_published}) {
    ASSERT_EQ(chooser->choose({0, 0}, again), 0U);
    ASSERT_EQ(chooser->choose({0, 0}, Frontiers{{{9, 9}, 0.9}}), 0U);
  }
  EXPECT_EQ(moved.choose({0, 0}, again), 1U);
  EXPECT_EQ(moved_published.choose({0, 0}, again), 0U);
}

TEST(FrontierChoice, MemoryRoundsPlacesAndValuesAndForgetsWithTheEpisode) {
  AcyclicMemory memory{VlfmRules()};
  memory.add({1.0, 2.0}, {3.0, 4.0}, 0.5, 0.4);
  EXPECT_TRUE(memory.seen({1.02, 2.0}, {3.0, 3.98}, 0.5004, 0.4));
  EXPECT_FALSE(memory.seen({1.03, 2.0}, {3.0, 4.0}, 0.5, 0.4));
  EXPECT_FALSE(memory.seen({1.0, 2.0}, {3.0, 4.0}, 0.502, 0.4));
  memory.reset();
  EXPECT_EQ(memory.size(), 0U);
  AcyclicMemory never{published(Quirk::kAcyclicMemory)};
  never.add({1.0, 2.0}, {3.0, 4.0}, 0.5, 0.4);
  EXPECT_FALSE(never.seen({1.0, 2.0}, {3.0, 4.0}, 0.5, 0.4));
}

TEST(FrontierChoice, AllVetoedGoesToTheNearestOrTheFarthest) {  // Q2
  // One visit to each frontier with the same values vetoes all of them.
  const Frontiers frontiers{{{7, 0}, 0.1}, {{3, 0}, 0.2}, {{5, 0}, 0.3}};
  const auto choose_all_vetoed = [&](const VlfmRules& rules, const FloorWays& ways) {
    FrontierChooser chooser({}, rules);
    for (int k = 0; k < 3; ++k) {
      (void)chooser.choose({0, 0}, frontiers, ways);
      (void)chooser.choose({0, 0}, Frontiers{{{50.0 + k, 50}, 5.0 + k}});  // No stickiness.
    }
    return chooser.choose({0, 0}, frontiers, ways).value();
  };
  EXPECT_EQ(choose_all_vetoed(VlfmRules(), {}), 1U);  // Nearest: 3 m.
  // By the way along the floor another one is nearest.
  FloorWays ways;
  ways.length_m = [](std::size_t k) { return k == 0 ? 1.0 : 10.0; };
  EXPECT_EQ(choose_all_vetoed(VlfmRules(), ways), 0U);
  // Farthest is index 0 of the list; the sorted list has the frontier at 5 m there.
  EXPECT_EQ(choose_all_vetoed(published(Quirk::kVetoFallback), {}), 2U);
}

TEST(FrontierChoice, TiesGoToTheNearestIfAsked) {
  const Frontiers frontiers{{{7, 0}, 0.300}, {{3, 0}, 0.295}, {{1, 0}, 0.1}};
  FrontierChoiceOptions options;
  EXPECT_EQ(FrontierChooser(options).choose({0, 0}, frontiers), 0U);
  options.tie_margin = 0.02;
  EXPECT_EQ(FrontierChooser(options).choose({0, 0}, frontiers), 1U);
}

/// The way to the second nearest matters only where the state with the nearest comes back.
TEST(FrontierChoice, AsksForTheWaysOfTiesOneAfterTheOther) {
  const Frontiers frontiers{{{7, 0}, 0.300}, {{3, 0}, 0.295}, {{1, 0}, 0.298}};
  std::vector<std::size_t> asked_among;
  FloorWays ways;
  ways.nearest = [&](std::span<const std::size_t> list) {
    asked_among.push_back(list.size());
    const auto nearest =
        std::find(list.begin(), list.end(), asked_among.size() == 1 ? 1U : 2U);
    return static_cast<std::size_t>(nearest - list.begin());
  };
  FrontierChoiceOptions options;
  options.tie_margin = 0.02;
  FrontierChooser chooser(options);
  EXPECT_EQ(chooser.choose({0, 0}, frontiers, ways), 1U);
  EXPECT_THAT(asked_among, testing::ElementsAre(3U));

  // Its state is known now; stickiness does not hold.
  ASSERT_EQ(chooser.choose({0, 0}, Frontiers{{{50, 50}, 5.0}}), 0U);
  asked_among.clear();
  EXPECT_EQ(chooser.choose({0, 0}, frontiers, ways), 2U);
  EXPECT_THAT(asked_among, testing::ElementsAre(3U, 2U));
}

}  // namespace
}  // namespace segsim::nav
