#include "experiments/support/stage_times.h"

#include <atomic>
#include <chrono>
#include <mutex>
#include <set>
#include <stdexcept>
#include <thread>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "experiments/support/side_by_side.h"

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

}  // namespace
}  // namespace segsim::experiments
