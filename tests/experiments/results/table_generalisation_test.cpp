/// Tables of many scenes: pools, arms with weights of their own in every scene.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "experiments/results/generalisation_grids.h"
#include "tests/experiments/results/table_fixture.h"
#include "tests/experiments/results/trained_run.h"

namespace segsim::experiments {
namespace {

using testing::Contains;
using testing::HasSubstr;
using testing::Not;

/// Six scenes of a pool and two of another, four episodes each. "before" has one success in
/// every scene, "after-here" has three, "after-elsewhere" two but in the first scene.
struct ManyScenes {
  records::RunRow run = a_run(8 * 4 * 3);
  std::vector<records::SceneRow> scenes;
  std::vector<records::ArmRow> arms;
  std::vector<records::TrialRow> trials;

  explicit ManyScenes(int trainings) {
    arms.push_back({"before", "before.weights", std::string(64, 'b'), "", -1, {}});
    arms.back().exposure = records::SceneExposure{};
    for (const std::string name : {"after-here", "after-elsewhere"}) {
      for (int k = 0; k < trainings; ++k) add_arm(name, k);
    }
    for (int s = 0; s < 8; ++s) add_scene(s);
  }

 private:
  void add_arm(const std::string& family, int training) {
    const std::string name =
        family + (training == 0 ? "" : ".s" + std::to_string(training + 2));
    records::ArmRow row{name, "8 files for 8 scenes", std::string(64, 'a'), "", -1, {}};
    row.family = family;
    row.finetune_seed = static_cast<std::uint64_t>(2 + training);
    row.exposure = records::SceneExposure{};
    arms.push_back(row);
  }
  void add_scene(int s) {
    const std::string name = "home-" + std::to_string(s);
    scenes.push_back({name, "Home " + std::to_string(s), "s", "e", 4});
    run.provenance["pool/" + name] = s < 6 ? "train" : "unseen";
    for (records::ArmRow& arm : arms) {
      const bool here = arm.family == "after-here", before = arm.family.empty();
      if (!before) run.provenance["weights/" + arm.name + "/" + name] = "hash";
      if (here) arm.exposure->trained_on.push_back(name);
      const int successes = before ? 1 : here ? 3 : s == 0 ? 1 : 2;
      for (std::size_t k = 0; k < 4; ++k) {
        trials.push_back(a_trial(name, arm.name, k, static_cast<int>(k) < successes));
        trials.back().episode = name + "/" + std::to_string(k);
      }
    }
  }
};

results::ResultTable table_of(const ManyScenes& many) {
  return results::summarise(many.run, many.scenes, many.arms, many.trials);
}

const results::Generalisation& row_of(const results::ResultTable& table,
                                      const std::string& group, const std::string& arm) {
  for (const results::Generalisation& row : table.generalisation) {
    if (row.arm == arm && row.group.find(group) != std::string::npos) return row;
  }
  ADD_FAILURE() << group << ", " << arm;
  return table.generalisation.front();
}

TEST(TableGeneralisation, EveryArmIsComparedOverPoolsAndAllScenes) {
  const results::ResultTable table = table_of(ManyScenes(1));
  EXPECT_EQ(table.after, "after-here");
  ASSERT_EQ(table.pools.size(), 2U);
  EXPECT_EQ(table.pools[0].title, "Pool train (6 scenes)");
  EXPECT_EQ(table.pools[1].find("before")->success.trials, 8);
  ASSERT_EQ(table.generalisation.size(), 3U * 3U);

  const results::Generalisation& here = row_of(table, "All", "after-here");
  EXPECT_DOUBLE_EQ(here.difference->mean, 0.5);
  EXPECT_EQ(here.leakage, "scene");
  const results::Generalisation& elsewhere = row_of(table, "train", "after-elsewhere");
  EXPECT_NEAR(elsewhere.difference->mean, 0.25 * 5.0 / 6.0, 1e-12);
  EXPECT_EQ(elsewhere.leakage, "none");
  EXPECT_EQ(elsewhere.scenes, 6U);
  EXPECT_FALSE(row_of(table, "All", "before").difference);
}

TEST(TableGeneralisation, OneTrainingHasTheClusterBootstrapOverScenes) {
  const results::ResultTable table = table_of(ManyScenes(1));
  std::vector<results::ClusterSum> scenes(6, results::ClusterSum{1.0, 4});
  scenes[0].sum = 0.0;
  const results::MeanInterval expected = results::cluster_bootstrap_mean(scenes);
  const results::Generalisation& row = row_of(table, "train", "after-elsewhere");
  EXPECT_DOUBLE_EQ(row.difference->mean, expected.mean);
  EXPECT_DOUBLE_EQ(row.difference->interval.low, expected.interval.low);
  EXPECT_DOUBLE_EQ(row.difference->interval.high, expected.interval.high);
}

TEST(TableGeneralisation, SeveralTrainingsHaveTheHierarchicalInterval) {
  const results::ResultTable table = table_of(ManyScenes(2));
  std::vector<results::SeededValue> values;
  for (int training = 0; training < 2; ++training) {
    for (int scene = 0; scene < 8; ++scene) {
      for (int episode = 0; episode < 4; ++episode) {
        const bool gained = scene > 0 && episode == 1;
        values.push_back({1, training, scene, 4 * scene + episode, gained ? 1.0 : 0.0});
      }
    }
  }
  const results::MeanInterval expected = results::hierarchical_interval(values);
  const results::Generalisation& row = row_of(table, "All", "after-elsewhere");
  EXPECT_EQ(row.summary.members, 2);
  EXPECT_NEAR(row.difference->mean, expected.mean, 1e-12);
  EXPECT_NEAR(row.difference->interval.low, expected.interval.low, 1e-12);
  EXPECT_NEAR(row.difference->interval.high, expected.interval.high, 1e-12);
}

TEST(TableGeneralisation, LeakageIsToldForEveryArm) {
  const results::ResultTable table = table_of(ManyScenes(1));
  EXPECT_THAT(table.notes, Contains(HasSubstr("LEAKAGE scene (*): \"after-here\"")));
  EXPECT_THAT(table.notes,
              Contains(HasSubstr("Leakage none: \"after-elsewhere\" has weights of their own "
                                 "in every scene, and no view of that scene")));
  EXPECT_THAT(table.notes, Contains(HasSubstr("is in what \"before\" was trained on.")));
  EXPECT_THAT(table.notes, Not(Contains(HasSubstr("Fewer than 5 scenes"))));
  const support::internal::Grid mixed = results::internal::mixed_grid(table);
  ASSERT_EQ(mixed.rows.size(), 8U + 2U + 1U);
  EXPECT_THAT(mixed.rows[0][2], testing::EndsWith(" *"));
  EXPECT_THAT(mixed.rows[0][3], Not(HasSubstr("*")));
  EXPECT_EQ(results::internal::leaderboard_grid(table).rows[0][0], "after-here");
}

TEST(TableGeneralisation, IsInEveryForm) {
  const results::ResultTable table = table_of(ManyScenes(1));
  const std::string text = results::format_table(table, support::TableFormat::kText);
  EXPECT_THAT(text, HasSubstr("Does it carry over?"));
  EXPECT_THAT(text, HasSubstr("Pool unseen (2 scenes)"));
  EXPECT_THAT(text, HasSubstr("Rows of fewer than 5 scenes"));
  const std::string csv = results::format_table(table, support::TableFormat::kCsv);
  EXPECT_THAT(csv, HasSubstr("pool,\"pool unseen\""));
  const auto json =
      nlohmann::json::parse(results::format_table(table, support::TableFormat::kJson));
  EXPECT_EQ(json["pools"].size(), 2U);
  EXPECT_EQ(json["pools"][0]["arms"]["after-elsewhere"]["leakage"], "none");
  EXPECT_EQ(json["pools"][0]["arms"]["after-here"]["leakage"], "scene");
  EXPECT_EQ(json["generalisation"].size(), 9U);
}

TEST(TableGeneralisation, OtherRunsHaveNoneOfIt) {
  const results::ResultTable table =
      results::summarise(a_run(30), kScenes, kArms, ten_episodes());
  EXPECT_TRUE(table.pools.empty());
  EXPECT_TRUE(table.generalisation.empty());
  EXPECT_THAT(results::format_table(table, support::TableFormat::kText),
              Not(HasSubstr("carry over")));
}

}  // namespace
}  // namespace segsim::experiments
