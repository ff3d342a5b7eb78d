#include "experiments/runs/shard.h"

#include <map>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/error_message.h"

namespace segsim::experiments {
namespace {

using testing::HasSubstr;

using Variables = std::map<std::string, std::string>;

std::string shard(const std::string& word, const Variables& variables = {}) {
  return runs::shard_from(word,
                          [&](const char* name) -> const char* {
                            const auto found = variables.find(name);
                            return found == variables.end() ? nullptr : found->second.c_str();
                          })
      .text();
}

TEST(Shard, ByHand) {
  EXPECT_EQ(shard("0/1"), "0/1");
  EXPECT_EQ(shard("7/8"), "7/8");
  for (const char* word :
       {"", "8", "8/8", "-1/8", "0/0", "1/", "/3", "1/2/3", "a/b", "1 /2"}) {
    EXPECT_THAT(tests::input_error_of([&] { (void)shard(word); }), HasSubstr("--shard"))
        << word;
  }
}

/// Every unit is in exactly one part, and parts differ by at most one unit.
TEST(Shard, PartsAreAPartition) {
  for (const int count : {1, 2, 3, 7}) {
    std::map<int, int> sizes;
    for (std::size_t unit = 0; unit < 100; ++unit) {
      int owners = 0;
      for (int index = 0; index < count; ++index) {
        if (!runs::Shard{index, count}.has(unit)) continue;
        ++owners;
        ++sizes[index];
      }
      EXPECT_EQ(owners, 1) << unit << " of " << count;
    }
    for (const auto& [index, size] : sizes) {
      EXPECT_GE(size, 100 / count);
      EXPECT_LE(size, 100 / count + 1);
    }
  }
}

TEST(Shard, EachEngine) {
  EXPECT_EQ(shard("auto", {{"SLURM_ARRAY_TASK_ID", "5"},
                           {"SLURM_ARRAY_TASK_COUNT", "8"},
                           {"SLURM_ARRAY_TASK_MIN", "1"},
                           {"SLURM_ARRAY_TASK_MAX", "8"}}),
            "4/8");
  EXPECT_EQ(shard("auto", {{"JOB_COMPLETION_INDEX", "2"}, {"SHARD_COUNT", "4"}}), "2/4");
  EXPECT_EQ(shard("auto", {{"OMPI_COMM_WORLD_RANK", "1"}, {"OMPI_COMM_WORLD_SIZE", "2"}}),
            "1/2");
  EXPECT_EQ(shard("auto", {{"PMI_RANK", "1"}, {"PMI_SIZE", "3"}}), "1/3");
  EXPECT_EQ(shard("auto", {{"SLURM_PROCID", "3"}, {"SLURM_NTASKS", "4"}}), "3/4");
  EXPECT_EQ(
      shard("auto", {{"AWS_BATCH_JOB_ARRAY_INDEX", "9"}, {"AWS_BATCH_JOB_ARRAY_SIZE", "10"}}),
      "9/10");
  EXPECT_EQ(shard("auto", {{"PBS_ARRAY_INDEX", "3"}, {"SHARD_COUNT", "4"}}), "3/4");
  EXPECT_EQ(shard("auto", {{"PARALLEL_SEQ", "1"}, {"SHARD_COUNT", "4"}}), "0/4");
}

TEST(Shard, TheFirstEngineWithSeveralPartsCounts) {
  const Variables array{{"SLURM_ARRAY_TASK_ID", "1"},  {"SLURM_ARRAY_TASK_COUNT", "2"},
                        {"SLURM_ARRAY_TASK_MIN", "0"}, {"SLURM_ARRAY_TASK_MAX", "1"},
                        {"SLURM_PROCID", "0"},         {"SLURM_NTASKS", "1"}};
  EXPECT_EQ(shard("auto", array), "1/2");
  // A batch script of Slurm is task 0 of 1; what runs in it has its own number.
  Variables inside{{"SLURM_PROCID", "0"}, {"SLURM_NTASKS", "1"}};
  EXPECT_EQ(shard("auto", inside), "0/1");
  inside["AWS_BATCH_JOB_ARRAY_INDEX"] = "2";
  inside["AWS_BATCH_JOB_ARRAY_SIZE"] = "3";
  EXPECT_EQ(shard("auto", inside), "2/3");
}

/// One task of an array again: its part stays the same.
TEST(Shard, ThePartsCanBeSaidByHand) {
  Variables again{{"SLURM_ARRAY_TASK_ID", "6"},
                  {"SLURM_ARRAY_TASK_COUNT", "1"},
                  {"SLURM_ARRAY_TASK_MIN", "6"},
                  {"SLURM_ARRAY_TASK_MAX", "6"}};
  EXPECT_EQ(shard("auto", again), "0/1");
  again["SHARD_COUNT"] = "8";
  EXPECT_EQ(shard("auto", again), "6/8");
  again["SHARD_FIRST"] = "1";
  EXPECT_EQ(shard("auto", again), "5/8");
}

TEST(Shard, ArraysWithAStepAndWithHoles) {
  Variables array{{"SLURM_ARRAY_TASK_ID", "14"},
                  {"SLURM_ARRAY_TASK_COUNT", "3"},
                  {"SLURM_ARRAY_TASK_MIN", "10"},
                  {"SLURM_ARRAY_TASK_MAX", "14"},
                  {"SLURM_ARRAY_TASK_STEP", "2"}};
  EXPECT_EQ(shard("auto", array), "2/3");
  array["SLURM_ARRAY_TASK_MAX"] = "17";
  EXPECT_THAT(tests::input_error_of([&] { (void)shard("auto", array); }),
              HasSubstr("SHARD_COUNT"));
}

TEST(Shard, WhatIsMissingIsNamed) {
  EXPECT_THAT(tests::input_error_of([] { (void)shard("auto"); }),
              HasSubstr("JOB_COMPLETION_INDEX"));
  EXPECT_THAT(tests::input_error_of([] {
                (void)shard("auto", {{"JOB_COMPLETION_INDEX", "3"}});
              }),
              HasSubstr("SHARD_COUNT"));
  EXPECT_THAT(tests::input_error_of([] {
                (void)shard("auto", {{"PMI_RANK", "x"}, {"PMI_SIZE", "2"}});
              }),
              HasSubstr("PMI_RANK"));
  EXPECT_THAT(tests::input_error_of([] {
                (void)shard("auto", {{"PMI_RANK", "2"}, {"PMI_SIZE", "2"}});
              }),
              HasSubstr("2 of 2"));
}

}  // namespace
}  // namespace segsim::experiments
