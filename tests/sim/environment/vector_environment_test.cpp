#include "sim/trial/environment/vector_environment.h"

#include <algorithm>
#include <set>

#include <gtest/gtest.h>

#include "core/random.h"
#include "tests/sim/environment/two_rooms.h"

namespace segsim::sim {
namespace {

constexpr std::size_t kCount = 5;

std::vector<Episode> episodes_of(const TwoRooms& rooms) {
  std::vector<Episode> episodes;
  for (int k = 0; k < 7; ++k) {
    episodes.push_back(rooms.episode({0.8 + 0.2 * k, 3.3, 0.3 * k}));
    episodes.back().seed = static_cast<std::uint64_t>(k);
  }
  episodes[6].view_points_m = {{1.0, 1.0}};  // Another goal.
  return episodes;
}

class VectorEnvironmentTest : public testing::Test {
 protected:
  VectorEnvironmentTest() { rooms_.options.trial.time_limit_s = 1.0; }

  VectorEnvironment make(std::size_t count, int threads) {
    return VectorEnvironment(pool_, rooms_.options, {count, threads},
                             EpisodeOrder::Kind::kShuffled,
                             [](int) { return TwoRooms::make_renderer(); });
  }
  static std::vector<VectorEnvironment::Reset> seeds(std::uint64_t first, std::size_t count) {
    std::vector<VectorEnvironment::Reset> resets(count);
    for (std::size_t i = 0; i < count; ++i) resets[i] = {true, first + i};
    return resets;
  }

  /// Bits of all that environments show in 40 random steps, one chain for each.
  std::vector<std::uint64_t> run(std::size_t count, int threads, std::uint64_t seed) {
    VectorEnvironment environments = make(count, threads);
    std::vector<std::uint64_t> hashes(count, 0);
    const auto add = [&](std::size_t i, const void* data, std::size_t bytes) {
      hashes[i] = core::hash64({static_cast<const char*>(data), bytes}, hashes[i]);
    };
    const auto observe = [&](std::size_t i, const ObjectNavEnvironment& environment) {
      const auto& depth = environment.depth_m().pixels();
      add(i, depth.data(), depth.size() * sizeof depth[0]);
      const core::Pose2 pose = environment.pose();
      add(i, &pose, sizeof pose);
    };
    environments.reset(seeds(seed, count), observe);
    for (std::uint64_t k = 0; k < 40; ++k) {
      std::vector<core::VelocityCommand> commands(count);
      std::vector<EnvironmentAction> actions(count);
      for (std::size_t i = 0; i < count; ++i) {
        core::RandomStream random(seed + i, "actions", k);
        commands[i] = {random.uniform(0.0, 0.8), random.uniform(-1.0, 1.0)};
        actions[i] = {random.chance(0.05), {&commands[i], 1}};
      }
      const auto steps = environments.step(actions, observe);
      for (std::size_t i = 0; i < count; ++i) {
        add(i, &steps[i].step.reward, sizeof(double));
        resets_ += steps[i].reset ? 1 : 0;
        stops_ += steps[i].step.terminated ? 1 : 0;
      }
    }
    return hashes;
  }

  TwoRooms rooms_;
  EpisodePool pool_{rooms_.world, episodes_of(rooms_)};
  int resets_ = 0, stops_ = 0;
};

TEST_F(VectorEnvironmentTest, ThreadsChangeNothing) {
  const std::vector<std::uint64_t> one = run(kCount, 1, 3);
  EXPECT_GT(resets_, 5);
  EXPECT_GT(stops_, 1);
  EXPECT_EQ(run(kCount, 2, 3), one);
  EXPECT_EQ(run(kCount, 4, 3), one);
  EXPECT_EQ(run(kCount, 16, 3), one);
  EXPECT_NE(run(kCount, 1, 4), one);
}

TEST_F(VectorEnvironmentTest, EachIsAsItWouldBeAlone) {
  const std::vector<std::uint64_t> together = run(kCount, 2, 11);
  for (std::size_t i = 0; i < kCount; ++i) {
    EXPECT_EQ(run(1, 1, 11 + i), std::vector<std::uint64_t>{together[i]}) << i;
  }
}

TEST_F(VectorEnvironmentTest, TheStepAfterTheEndBeginsTheNextEpisode) {
  VectorEnvironment environments = make(1, 1);
  const auto look = [](std::size_t, const ObjectNavEnvironment&) {};
  environments.reset(seeds(0, 1), look);
  const core::VelocityCommand ahead{0.5, 0.0};
  const std::vector<EnvironmentAction> stop{{true, {}}}, drive{{false, {&ahead, 1}}};
  EXPECT_FALSE(environments.step(drive, look)[0].reset);
  VectorEnvironment::Step step = environments.step(stop, look)[0];
  EXPECT_TRUE(step.step.terminated && !step.reset);
  const std::size_t before = environments.episode(0);
  step = environments.step(drive, look)[0];
  EXPECT_TRUE(step.reset);
  EXPECT_FALSE(step.step.terminated || step.step.truncated);
  EXPECT_EQ(step.step.reward, 0.0);
  EXPECT_NE(environments.episode(0), before);
  EXPECT_EQ(environments.environment(0).time_ns(), 0) << "the action did not count";
  EXPECT_FALSE(environments.step(drive, look)[0].reset);
}

TEST_F(VectorEnvironmentTest, AnEpisodeCanBeAskedFor) {
  VectorEnvironment environments = make(2, 1);
  environments.reset(std::vector<VectorEnvironment::Reset>{{false, 0, 3}, {false, 0, 6}},
                     [](std::size_t, const ObjectNavEnvironment&) {});
  EXPECT_EQ(environments.episode(0), 3U);
  EXPECT_EQ(environments.environment(1).episode().seed, 6U);
}

TEST(EpisodeOrder, EveryRoundHasEveryEpisodeOnce) {
  EpisodeOrder order(EpisodeOrder::Kind::kShuffled, 9, 0, 1);
  order.restart(5);
  std::vector<std::vector<std::size_t>> rounds;
  for (int round = 0; round < 3; ++round) {
    std::vector<std::size_t> drawn;
    for (int k = 0; k < 9; ++k) drawn.push_back(order.next());
    EXPECT_EQ(std::set<std::size_t>(drawn.begin(), drawn.end()).size(), 9U);
    EXPECT_LT(*std::max_element(drawn.begin(), drawn.end()), 9U);
    rounds.push_back(drawn);
  }
  EXPECT_NE(rounds[0], rounds[1]);
  order.restart(5);
  for (const std::size_t episode : rounds[0]) EXPECT_EQ(order.next(), episode);
  order.restart(6);
  std::vector<std::size_t> other;
  for (int k = 0; k < 9; ++k) other.push_back(order.next());
  EXPECT_NE(other, rounds[0]);
}

TEST(EpisodeOrder, InTurnEnvironmentsShareTheEpisodes) {
  std::multiset<std::size_t> seen;
  for (std::size_t i = 0; i < 3; ++i) {
    EpisodeOrder order(EpisodeOrder::Kind::kInTurn, 6, i, 3);
    seen.insert(order.next());
    seen.insert(order.next());
  }
  EXPECT_EQ(seen, (std::multiset<std::size_t>{0, 1, 2, 3, 4, 5}));
}

TEST(EpisodePool, EpisodesWithOneGoalShareItsDistances) {
  const TwoRooms rooms;
  const EpisodePool pool(rooms.world, episodes_of(rooms));
  EXPECT_EQ(pool.to_goal(0), pool.to_goal(5));
  EXPECT_NE(pool.to_goal(0), pool.to_goal(6));
  EXPECT_NEAR(pool.to_goal(0)->at({1.0, 3.3}), pool.episode(1).shortest_path_m, 0.5);
}

}  // namespace
}  // namespace segsim::sim
