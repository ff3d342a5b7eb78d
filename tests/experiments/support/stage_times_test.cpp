#include "experiments/support/stage_times.h"

#include <atomic>
#include <chrono>
#include <mutex>
#include <set>
#include <stdexcept>
#include <thread>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "experiments/support/side_by_side.h"
#include "experiments/support/task_graph.h"

namespace segsim::experiments {
namespace {

using testing::HasSubstr;

TEST(StageTimes, WhatWasThereTakesNoTime) {
  support::StageTimes times;
  { const support::StageTimes::Timer found(times, "capture"); }
  {
    support::StageTimes::Timer made(times, "trials");
    made.working();
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  { support::StageTimes::Timer again(times, "trials"); }
  const std::vector<support::StageTime> all = times.all();
  ASSERT_EQ(all.size(), 2U);
  EXPECT_EQ(all[0].stage, "capture");
  EXPECT_FALSE(all[0].made);
  EXPECT_EQ(all[0].wall_s, 0.0);
  EXPECT_EQ(support::in_words(all[0]), "0 s (was there)");
  EXPECT_TRUE(all[1].made);
  EXPECT_GE(all[1].wall_s, 0.002);
  EXPECT_THAT(support::stage_times_text({{"trials", 61.25, true}}, 70.0),
              testing::AllOf(HasSubstr("trials  61.2 s"), HasSubstr("all     70.0 s")));
}

/// Pieces of a stage that overlap count once: from the first one's beginning to the last one's
/// end.
TEST(StageTimes, OverlappingTimersCountOnce) {
  support::StageTimes times;
  const auto start = support::StageTimes::Clock::now();
  {
    support::StageTimes::Timer first(times, "views");
    first.working();
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
    support::StageTimes::Timer second(times, "views");
    second.working();
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  }
  const std::chrono::duration<double> both = support::StageTimes::Clock::now() - start;
  ASSERT_EQ(times.all().size(), 1U);
  EXPECT_GE(times.all()[0].wall_s, 0.010);
  EXPECT_LE(times.all()[0].wall_s, both.count());
}

/// A run that is gone on with keeps what earlier calls took.
TEST(StageTimes, RowsOfARunAddUp) {
  const std::map<std::string, std::string> known{{"time/trials", "10.5 s"},
                                                 {"time/capture", "3.0 s"},
                                                 {"time/episodes", "0 s (was there)"}};
  const auto rows = support::stage_time_rows({{"trials", 2.0, true},
                                              {"capture", 0.0, false},
                                              {"episodes", 1.0, true},
                                              {"tables", 0.0, false}},
                                             known);
  EXPECT_EQ(rows, (std::map<std::string, std::string>{{"time/trials", "12.5 s"},
                                                      {"time/episodes", "1.0 s"},
                                                      {"time/tables", "0 s (was there)"}}));
}

TEST(SideBySide, EveryPieceOnceAndNoMoreThanAskedForAtOnce) {
  for (const int at_once : {1, 2, 3, 50}) {
    std::mutex mutex;
    std::multiset<std::size_t> done;
    std::atomic<int> now{0}, most{0};
    support::side_by_side(20, at_once, [&](std::size_t k) {
      const int beside = ++now;
      for (int seen = most; seen < beside && !most.compare_exchange_weak(seen, beside);) {
      }
      std::this_thread::yield();
      {
        const std::lock_guard<std::mutex> lock(mutex);
        done.insert(k);
      }
      --now;
    });
    EXPECT_EQ(done.size(), 20U);
    EXPECT_EQ(std::set<std::size_t>(done.begin(), done.end()).size(), 20U);
    EXPECT_LE(most, at_once);
  }
  support::side_by_side(0, 4, [](std::size_t) { FAIL(); });
}

/// Both are under way when both fail: the smaller index is told, and nothing new begins.
TEST(SideBySide, TheFirstErrorIsThrown) {
  for (const int at_once : {1, 2}) {
    std::atomic<int> begun{0};
    try {
      support::side_by_side(100, at_once, [&](std::size_t k) {
        ++begun;
        while (at_once == 2 && begun < 2) std::this_thread::yield();
        throw std::runtime_error("piece " + std::to_string(k));
      });
      FAIL() << "no error";
    } catch (const std::runtime_error& error) {
      EXPECT_STREQ(error.what(), "piece 0");
    }
    EXPECT_EQ(begun, at_once);
  }
}

/// 0 -> 1 -> 4, 2 -> 4, 3 alone: whatever a task needs has ended when it begins.
TEST(TaskGraph, TasksBeginWhenWhatTheyNeedHasEnded) {
  for (const int at_once : {1, 2, 3, 8}) {
    for (int round = 0; round < 20; ++round) {
      std::mutex mutex;
      std::vector<int> ended;
      support::TaskGraph graph;
      const auto task = [&](int name, const std::vector<support::TaskGraph::Id>& needs) {
        return graph.add(
            [&, name, needs] {
              std::this_thread::yield();
              const std::lock_guard<std::mutex> lock(mutex);
              for (const support::TaskGraph::Id need : needs) {
                EXPECT_THAT(ended, testing::Contains(static_cast<int>(need)));
              }
              ended.push_back(name);
            },
            needs);
      };
      const auto zero = task(0, {});
      const auto one = task(1, {zero});
      const auto two = task(2, {});
      task(3, {});
      task(4, {one, two});
      graph.run(at_once);
      EXPECT_THAT(ended, testing::UnorderedElementsAre(0, 1, 2, 3, 4));
      if (at_once == 1) {
        EXPECT_THAT(ended, testing::ElementsAre(0, 1, 2, 3, 4));
      }
    }
  }
}

/// Of those that can begin, the first one: a chain that was added early is not held up by many
/// small tasks that were added after it.
TEST(TaskGraph, WhatWasAddedFirstBeginsFirst) {
  std::vector<int> order;
  support::TaskGraph graph;
  const auto first = graph.add([&] { order.push_back(0); });
  graph.add([&] { order.push_back(1); }, {first});
  for (int k = 2; k < 6; ++k) graph.add([&, k] { order.push_back(k); });
  graph.run(1);
  EXPECT_THAT(order, testing::ElementsAre(0, 1, 2, 3, 4, 5));
}

TEST(TaskGraph, WhatNeedsAFailedTaskDoesNotBegin) {
  for (const int at_once : {1, 2}) {
    bool begun = false;
    support::TaskGraph graph;
    const auto fails = graph.add([] { throw std::runtime_error("no scene"); });
    graph.add([&] { begun = true; }, {fails});
    EXPECT_THROW(graph.run(at_once), std::runtime_error);
    EXPECT_FALSE(begun);
  }
}

}  // namespace
}  // namespace segsim::experiments
