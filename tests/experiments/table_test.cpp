#include "experiments/results/table.h"

#include <algorithm>
#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/random.h"

namespace segsim::experiments {
namespace {

using testing::AllOf;
using testing::Contains;
using testing::ContainsRegex;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

records::RunRow a_run(int planned) {
  records::RunRow run;
  run.run_id = 3;
  run.name = "demo";
  run.title = "Object search before and after fine-tuning";
  run.spec_sha256 = "0123456789abcdef";
  run.code_version = "0.1.0 (abc)";
  run.host = "host";
  run.success_profile = "segsim-object: STOP within 1 m";
  run.seed = 7;
  run.planned_trials = planned;
  run.started = "2026-01-31T12:00:00Z";
  return run;
}

const std::vector<records::SceneRow> kScenes{
    {"flat", "Flat", std::string(64, 'a'), std::string(64, 'b'), 10}};
const std::vector<records::ArmRow> kArms{
    {"before", "one.bin", std::string(64, 'c'), "", -1, {}},
    {"after", "two.bin", std::string(64, 'd'), "flat", -1,
     records::HeldOutPrecision{80, 0.5604, 0.3672, 0.244, 0.69, 0.57, 0.331},
     records::StartLeak{400, 0, 1.0}},
    {"oracle", "oracle", "", "", -1, {}}};

/// Ten episodes, five couches and five chairs: 2 both, 6 only after, 1 only before, 1 neither.
std::vector<records::TrialRow> ten_episodes() {
  const std::string before = "ss.....s..", after = "ssssssss..";
  std::vector<records::TrialRow> trials;
  for (int k = 0; k < 10; ++k) {
    const auto add = [&](const std::string& arm, bool success) {
      records::TrialRow t;
      t.arm = arm;
      t.scene = "flat";
      t.goal_class = k < 5 ? "couch" : "chair";
      t.episode = "flat/" + t.goal_class + "/0" + std::to_string(k);
      t.success = success;
      t.outcome = success ? "success" : "timeout";
      t.spl = success ? 0.5 : 0.0;
      t.sim_s = 20;
      t.path_m = 4;
      trials.push_back(t);
    };
    const auto at = static_cast<std::size_t>(k);
    add("before", before[at] == 's' || k == 9);
    add("after", after[at] == 's');
    add("oracle", true);
  }
  return trials;
}

/// Failures of "before": four never saw the goal, two saw and missed it; of "after" none is
/// attributed (results of an older version).
std::vector<records::TrialRow> ten_attributed_episodes() {
  std::vector<records::TrialRow> trials = ten_episodes();
  int failures = 0;
  for (records::TrialRow& t : trials) {
    if (t.arm == "after") continue;
    t.ticks = 50;
    t.why.cause =
        t.success ? "did_not_fail" : (failures++ < 4 ? "never_saw_target" : "false_negative");
    if (t.why.cause != "never_saw_target") t.why.visible_frames = 10;
    if (t.success) {
      t.first_visible_tick = 20;
      t.why.first_true_tick = 23;
      t.why.detected_frames = 6;
      t.why.stopped = true;
      t.why.final_visible_px = 100;
      t.why.object_m = t.why.planar_m = 0.0;
      t.why.shortest_object_m = 1.0;
      t.shortest_path_m = 2.0;  // Half of the path.
      t.distance_to_goal_m = 0.15;
    }
    t.why.false_detections = 1;
    t.why.false_clouds = t.success ? 0 : 1;
    t.why.misplaced_clouds = t.success ? 0 : 2;
  }
  return trials;
}

TEST(Table, CausesPerceptionAndOtherRulesAreTold) {
  const std::string text = results::format_table(
      results::summarise(a_run(30), kScenes, kArms, ten_attributed_episodes()),
      support::TableFormat::kText);
  // 60 of 80 images with the goal in view were in successes (4 x 10), where 6 of 10 are
  // detected: 24 of 60.
  for (const char* part :
       {R"(Why trials failed

Scene  Arm     Failed  false_negative  never_saw_target
-----  ------  ------  --------------  ----------------
Flat   before  6/10    2               4
Flat   oracle  0/10    -               -
)",
        R"(What the detector made of the goal

Scene  Arm     Recall in view  Saw it  Never detected  Delay [ticks]  False per 100 images  False objects  Misplaced objects
-----  ------  --------------  ------  --------------  -------------  --------------------  -------------  -----------------
Flat   before  0.40            6/10    2               3.0            2.0                   0.60           1.20
Flat   oracle  0.60            10/10   0               3.0            2.0                   0.00           0.00
)",
        R"(The same trials under named success rules (SR / SPL as that rule defines it)

Scene  Arm     segsim-object  habitat-hm3d  apexnav      semexp-gibson  allenact-robothor  barn
-----  ------  -------------  ------------  -----------  -------------  -----------------  -----------
Flat   before  0.40 / 0.20    0.00 / 0.00   0.40 / 0.20  0.40 / 0.20    0.40 / 0.20        0.40 / 0.05
Flat   oracle  1.00 / 0.50    0.00 / 0.00   1.00 / 0.50  1.00 / 0.50    1.00 / 0.50        1.00 / 0.12
)"}) {
    EXPECT_THAT(text, HasSubstr(part));
  }
}

TEST(Table, InfeasibleEpisodesAreInNoRateAndListed) {
  std::vector<records::TrialRow> trials = ten_attributed_episodes();
  for (records::TrialRow& t : trials) {
    if (t.episode != "flat/couch/02") continue;
    t.outcome = t.why.cause = "infeasible";
    t.success = false;
  }
  const results::ResultTable table = results::summarise(a_run(30), kScenes, kArms, trials);
  EXPECT_EQ(table.scenes[0].find("before")->success.trials, 9);
  EXPECT_EQ(table.scenes[0].find("before")->excluded_trials, 1);
  EXPECT_EQ(table.scenes[0].pairs.total(), 9);
  EXPECT_THAT(table.notes,
              Contains(HasSubstr("1 episode infeasible, in no rate: flat/couch/02")));
  const std::string csv = results::format_table(table, support::TableFormat::kCsv);
  EXPECT_THAT(csv, Not(HasSubstr("nan")));
  EXPECT_THAT(csv, Not(HasSubstr("inf,")));
}

TEST(Table, EpisodeSetsThatAreHardForTheOracleAreFlagged) {
  std::vector<records::SceneRow> scenes = kScenes;
  scenes[0].oracle_successes = 18;
  scenes[0].oracle_episodes = 20;
  EXPECT_THAT(results::summarise(a_run(30), scenes, kArms, ten_episodes()).notes,
              Contains(HasSubstr("FLAGGED episodes: Flat: the oracle-path arm solved 18/20")));
  scenes[0].oracle_successes = 19;
  EXPECT_THAT(results::summarise(a_run(30), scenes, kArms, ten_episodes()).notes,
              Contains(HasSubstr("Flat: the oracle-path arm solved 19/20 of the")));
}

TEST(Table, CountsPairsByHand) {
  const results::ResultTable table =
      results::summarise(a_run(30), kScenes, kArms, ten_episodes());
  ASSERT_EQ(table.scenes.size(), 1U);
  const results::GroupSummary& flat = table.scenes[0];
  EXPECT_EQ(flat.find("before")->success.successes, 4);
  EXPECT_EQ(flat.find("after")->success.successes, 8);
  EXPECT_EQ(flat.pairs.both, 3);
  EXPECT_EQ(flat.pairs.only_after, 5);
  EXPECT_EQ(flat.pairs.only_before, 1);
  EXPECT_EQ(flat.pairs.neither, 1);
  EXPECT_NEAR(flat.p, 14.0 / 64.0, 1e-12);  // 2 (C(6,0) + C(6,1)) / 2^6
  EXPECT_DOUBLE_EQ(flat.find("after")->spl, 0.4);
  EXPECT_TRUE(flat.leak);
  EXPECT_EQ(table.oracle, "oracle");
  EXPECT_FALSE(table.all.has_value());
  ASSERT_EQ(table.classes.size(), 2U);
  EXPECT_EQ(table.classes[0].name, "chair");
  EXPECT_EQ(table.classes[0].pairs.total(), 5);
}

TEST(Table, TextIsAsExpected) {
  const std::string text =
      results::format_table(results::summarise(a_run(30), kScenes, kArms, ten_episodes()),
                            support::TableFormat::kText);
  const std::string expected =
      R"(Object search before and after fine-tuning (one training)

Scene   SR-Before            SR-After             Difference [points]  Pairs        p      Verdict     SR-Oracle
------  -------------------  -------------------  -------------------  -----------  -----  ----------  ----------------------
Flat *  4/10  40 % [17, 69]  8/10  80 % [49, 94]  +40 [-4, +68]        +5 -1 of 10  0.219  unresolved  10/10  100 % [72, 100]

One training: interval and p know nothing of the variance of training; another seed may give another
result.
Success rule: segsim-object.

By goal class (exploratory; p corrected by Holm for the number of rows)

Goal   SR-Before           SR-After              Difference [points]  Pairs       p (Holm)  SR-Oracle
-----  ------------------  --------------------  -------------------  ----------  --------  --------------------
chair  2/5  40 % [12, 77]  3/5  60 % [23, 88]    +20 [-36, +63]       +2 -1 of 5  1.000     5/5  100 % [57, 100]
couch  2/5  40 % [12, 77]  5/5  100 % [57, 100]  +60 [+3, +88]        +3 -0 of 5  0.500     5/5  100 % [57, 100]

How the trials went (success: segsim-object)

Scene  Arm     SR    SPL    SoftSPL  Time [s]  Path [m]  Contacts  Holes [%]  Outcomes
-----  ------  ----  -----  -------  --------  --------  --------  ---------  --------------------
Flat   before  0.40  0.200  0.000    20.0      4.0       0.00      0.0        timeout 6, success 4
Flat   after   0.80  0.400  0.000    20.0      4.0       0.00      0.0        success 8, timeout 2
Flat   oracle  1.00  0.500  0.000    20.0      4.0       0.00      0.0        success 10

After - before on the same episodes (bootstrap 95 % interval, sign-flip test)

Scene  SPL                      p SPL  Time [s]           p time  Path [m]           p path  SR over scenes [points]
-----  -----------------------  -----  -----------------  ------  -----------------  ------  -----------------------
Flat   +0.200 [+0.000, +0.400]  0.219  +0.0 [+0.0, +0.0]  1.000   +0.0 [+0.0, +0.0]  1.000   -

Detectors on held-out views of the scenes

Arm    AP50  AP    Precision  Recall  Score threshold  Views  AP50 source rooms  AP50 unseen homes
-----  ----  ----  ---------  ------  ---------------  -----  -----------------  -----------------
after  56.0  36.7  0.69       0.57    0.244            80     33.1               -
)";
  EXPECT_EQ(text.substr(0, expected.size()), expected);
  for (const char* note : {"LEAKAGE", "Fewer than 5 scenes", "seed 7",
                           "Success profile: segsim-object", "cccccccccccc"}) {
    EXPECT_THAT(text, HasSubstr(note));
  }
  EXPECT_THAT(text, Not(HasSubstr("INTERIM")));
}

TEST(Table, TrainingViewsInTheStartRegionAreALeak) {
  const results::ResultTable clean =
      results::summarise(a_run(30), kScenes, kArms, ten_episodes());
  EXPECT_THAT(clean.notes, Contains(HasSubstr("Start region: 0 of the 400 views")));
  EXPECT_THAT(clean.notes,
              Contains(HasSubstr("SR 20 % -> 100 % (laboratory) and 25 % -> 50 % (house)")));
  std::vector<records::ArmRow> arms = kArms;
  arms[1].start_leak->near_starts = 17;
  const results::ResultTable table =
      results::summarise(a_run(30), kScenes, arms, ten_episodes());
  EXPECT_THAT(table.notes, Contains(HasSubstr("LEAKAGE start region: 17 of the 400 views")));
  arms[1].start_leak.reset();
  arms[1].tuned_on.clear();  // Neither the paper's effect: nothing was adapted.
  const results::ResultTable plain =
      results::summarise(a_run(30), kScenes, arms, ten_episodes());
  EXPECT_THAT(plain.notes, Not(Contains(HasSubstr("tart region"))));
  EXPECT_THAT(plain.notes, Not(Contains(HasSubstr("The paper reports"))));
}

/// The run's two arms with what they had seen of the scene.
results::ResultTable with_exposures(const records::SceneExposure& before,
                                    const records::SceneExposure& after) {
  std::vector<records::ArmRow> arms = kArms;
  arms[0].exposure = before;
  arms[1].exposure = after;
  arms[1].tuned_on.clear();
  return results::summarise(a_run(30), kScenes, arms, ten_episodes());
}

/// What the arm's line of the scene says in the last column.
std::string csv_leakage(const results::ResultTable& table, const std::string& arm) {
  const std::string csv = results::format_table(table, support::TableFormat::kCsv);
  const std::size_t line = csv.find("scene,\"flat\",");
  const std::size_t begin = csv.find("\"" + arm + "\"", line);
  const std::string row = csv.substr(begin, csv.find('\n', begin) - begin);
  return row.substr(row.rfind(',') + 1);
}

TEST(Table, WhatAFileDoesNotSayIsUnknownInEveryForm) {
  const records::SceneExposure unknown{.known = records::TrainingDataKnown::kNothing};
  const results::ResultTable table = with_exposures({}, unknown);
  for (const support::TableFormat format :
       {support::TableFormat::kText, support::TableFormat::kMarkdown,
        support::TableFormat::kLatex, support::TableFormat::kJson}) {
    std::string text = results::format_table(table, format);
    for (std::size_t at = text.find("\n  "); at != std::string::npos; at = text.find("\n  "))
      text.replace(at, 3, " ");  // Lines that were wrapped.
    EXPECT_THAT(text, HasSubstr("LEAKAGE unknown: "));
    EXPECT_THAT(text, HasSubstr("the file does not say what it was trained on."));
  }
  EXPECT_EQ(csv_leakage(table, "after"), "unknown");
  EXPECT_EQ(csv_leakage(table, "before"), "none");
  EXPECT_EQ(csv_leakage(table, "oracle"), "none");
  const auto json =
      nlohmann::json::parse(results::format_table(table, support::TableFormat::kJson));
  EXPECT_EQ(json.at("scenes")[0].at("leakage"), "unknown");
  EXPECT_EQ(json.at("scenes")[0].at("arms").at("before").at("leakage"), "none");
  EXPECT_EQ(json.at("classes")[0].at("leakage"), "unknown");
  EXPECT_EQ(json.at("provenance").at("arms").at("after").at("leakage"), "unknown");
  EXPECT_FALSE(table.scenes[0].leak);

  records::SceneExposure part = unknown;
  part.known = records::TrainingDataKnown::kPart;
  EXPECT_THAT(
      with_exposures({}, part).notes,
      Contains("LEAKAGE unknown: \"after\" (two.bin): the file does not say all that it "
               "was trained on."));
  // Results of a version that did not look.
  EXPECT_THAT(
      results::summarise(a_run(30), kScenes, kArms, ten_episodes()).notes,
      Contains("LEAKAGE unknown: \"before\" (one.bin): these results do not say what it "
               "was trained on."));
}

TEST(Table, ArmsThatSawNoSceneSaySo) {
  const results::ResultTable table = with_exposures({}, {});
  EXPECT_THAT(table.notes,
              Contains("Leakage none: no view of the evaluation scenes is in what \"before\" "
                       "and \"after\" were trained on."));
  EXPECT_THAT(table.notes, Not(Contains(HasSubstr("LEAKAGE"))));
  EXPECT_EQ(csv_leakage(table, "after"), "none");
  const auto json =
      nlohmann::json::parse(results::format_table(table, support::TableFormat::kJson));
  EXPECT_EQ(json.at("scenes")[0].at("leakage"), "none");
}

TEST(Table, AnArmThatSawTheSceneLeaksWhicheverArmItIs) {
  const records::SceneExposure seen{.trained_on = {"flat"}};
  const results::ResultTable after = with_exposures({}, seen);
  EXPECT_TRUE(after.scenes[0].leak);
  EXPECT_THAT(after.notes, Contains(HasSubstr("LEAKAGE scene (*): \"after\" was fine-tuned")));
  const results::ResultTable before = with_exposures(seen, {});
  EXPECT_FALSE(before.scenes[0].leak);
  EXPECT_THAT(before.notes,
              Contains("LEAKAGE scene: \"before\" was trained on views of Flat."));
  EXPECT_EQ(csv_leakage(before, "before"), "scene");
  EXPECT_EQ(csv_leakage(before, "after"), "none");

  // Without a comparison, too.
  std::vector<records::ArmRow> alone{kArms[0]};
  alone[0].exposure = seen;
  const results::ResultTable single =
      results::summarise(a_run(10), kScenes, alone, ten_episodes());
  EXPECT_THAT(single.notes, Contains(HasSubstr("LEAKAGE scene: \"before\" was trained")));

  const records::SceneExposure alike{.same_name = {"flat"}};
  const results::ResultTable hint = with_exposures({}, alike);
  EXPECT_THAT(hint.notes, Contains(HasSubstr("a scene of the same name as flat but another")));
  EXPECT_EQ(csv_leakage(hint, "after"), "unknown");
}

TEST(Table, ThresholdsChosenOnTheScenesAreToldInOneLine) {
  const records::SceneExposure chosen{.threshold_on = {"flat"}};
  EXPECT_THAT(
      with_exposures(chosen, chosen).notes,
      Contains("Score thresholds of \"before\" and \"after\" were chosen on other views "
               "of the same scenes."));
  EXPECT_THAT(with_exposures({}, {}).notes, Not(Contains(HasSubstr("hreshold"))));
  std::vector<records::ArmRow> arms = kArms;
  arms[0].exposure = arms[1].exposure = chosen;
  arms[1].score_threshold = 0.4;  // The spec's own.
  EXPECT_THAT(
      results::summarise(a_run(30), kScenes, arms, ten_episodes()).notes,
      Contains("The score threshold of \"before\" was chosen on other views of the same "
               "scenes."));
}

TEST(Table, AnUnfinishedRunIsMarked) {
  const results::ResultTable table =
      results::summarise(a_run(60), kScenes, kArms, ten_episodes());
  EXPECT_THAT(table.notes, Contains(HasSubstr("INTERIM: 30 of 60 trials")));
}

TEST(Table, FailedTrialsAreInNoRateAndNoPair) {
  std::vector<records::TrialRow> trials = ten_episodes();
  trials[0].outcome = "error";  // "before" of the first episode
  const results::ResultTable table = results::summarise(a_run(30), kScenes, kArms, trials);
  EXPECT_EQ(table.scenes[0].find("before")->success.trials, 9);
  EXPECT_EQ(table.scenes[0].pairs.total(), 9);
  EXPECT_EQ(table.scenes[0].dropped_pairs, 1);
  EXPECT_EQ(table.finished_trials, 29);
  EXPECT_THAT(table.notes, Contains(HasSubstr("1 trial failed")));
  EXPECT_THAT(table.notes, Contains(HasSubstr("1 episode without")));
}

TEST(Table, RepetitionsAreNotIndependentEpisodes) {
  std::vector<records::TrialRow> trials = ten_episodes();
  const std::size_t single = trials.size();
  for (int repetition = 1; repetition < 3; ++repetition) {
    for (std::size_t i = 0; i < single; ++i) {
      trials.push_back(trials[i]);
      trials.back().repetition = repetition;
    }
  }
  // One repetition of three turned round changes no episode.
  for (records::TrialRow& t : trials) {
    if (t.repetition == 2) t.success = !t.success;
  }
  const results::ResultTable table = results::summarise(a_run(90), kScenes, kArms, trials);
  EXPECT_EQ(table.scenes[0].pairs.total(), 10);
  EXPECT_EQ(table.scenes[0].find("after")->success.successes, 8);
  EXPECT_EQ(table.scenes[0].find("after")->trials, 30);
}

TEST(Table, FewDiscordantPairsAndAWeakOracleAreTold) {
  std::vector<records::TrialRow> trials = ten_episodes();
  for (records::TrialRow& t : trials) {
    if (t.arm == "after") t.success = trials[0].success && t.episode == trials[0].episode;
    if (t.arm == "oracle" && t.goal_class == "chair") t.success = false;
  }
  const results::ResultTable table = results::summarise(a_run(30), kScenes, kArms, trials);
  EXPECT_THAT(table.notes, Contains(HasSubstr("at least 6")));
  EXPECT_THAT(table.notes, Contains(HasSubstr("oracle SR 5/10")));
}

TEST(Table, TheSameArmTwiceHasNoDiscordantPairs) {
  std::vector<records::TrialRow> trials;
  for (const records::TrialRow& t : ten_episodes()) {
    if (t.arm != "before") continue;
    trials.push_back(t);
    trials.push_back(t);
    trials.back().arm = "after";
  }
  const results::GroupSummary group =
      results::summarise(a_run(20), kScenes, kArms, trials).scenes[0];
  EXPECT_EQ(group.pairs.discordant(), 0);
  EXPECT_EQ(group.p, 1.0);
}

records::TrialRow a_trial(const std::string& scene, const std::string& arm,
                          std::size_t episode, bool success) {
  records::TrialRow t;
  t.arm = arm;
  t.scene = scene;
  t.goal_class = episode < 2 ? "couch" : "chair";
  t.episode = "flat/" + t.goal_class + "/0" + std::to_string(episode);
  t.success = success;
  t.outcome = success ? "success" : "timeout";
  t.spl = success ? 0.5 : 0.0;
  t.sim_s = 20;
  t.path_m = 4;
  return t;
}

records::ArmRow a_row(const std::string& name, const std::string& family, int reconstruction,
                      std::optional<std::uint64_t> seed) {
  records::ArmRow row{name,
                      name + ".weights",
                      std::string(64, family == "before" ? 'b' : 'a'),
                      "",
                      -1,
                      records::HeldOutPrecision{80, 0.5, 0.3, 0.25, 0.7, 0.6}};
  row.family = family;
  row.reconstruction = reconstruction;
  row.finetune_seed = seed;
  if (seed) row.tuned_on = reconstruction == 1 ? "flat" : "flat.r2";
  if (seed) row.start_leak = records::StartLeak{100, 3, 0.5};
  return row;
}

/// Four episodes; two trainings in the first reconstruction, one in the second.
struct Trained {
  std::vector<records::SceneRow> scenes{{"flat", "Flat", "s", "e", 4},
                                        {"flat.r2", "Flat, 2", "t", "f", 4}};
  std::vector<records::ArmRow> arms{
      a_row("before", "before", 1, {}), a_row("after", "after", 1, 2),
      a_row("after.s3", "after", 1, 3), a_row("before.r2", "before", 2, {}),
      a_row("after.r2", "after", 2, 2)};
  std::vector<records::TrialRow> trials;

  explicit Trained(bool second_reconstruction) {
    scenes[1].family = "flat";
    scenes[1].reconstruction = 2;
    add("flat", "before", "s...");
    add("flat", "after", "ss.s");     // +2 -0
    add("flat", "after.s3", ".ss.");  // +2 -1
    if (second_reconstruction) {
      add("flat.r2", "before.r2", "ss..");
      add("flat.r2", "after.r2", "sss.");  // +1 -0
    } else {
      scenes.pop_back();
      arms.resize(3);
    }
  }
  void add(const std::string& scene, const std::string& arm, const std::string& outcomes) {
    for (std::size_t k = 0; k < outcomes.size(); ++k) {
      trials.push_back(a_trial(scene, arm, k, outcomes[k] == 's'));
    }
  }
};

/// Counted by hand: 5 of 8, +4 -1, and what the statistics make of these very values.
TEST(Table, TrainingsOfAnArmArePooled) {
  const Trained run(false);
  const results::ResultTable table =
      results::summarise(a_run(12), run.scenes, run.arms, run.trials);
  ASSERT_EQ(table.scenes.size(), 1U);
  const results::GroupSummary& flat = table.scenes[0];
  ASSERT_EQ(flat.arms.size(), 2U);
  const results::ArmSummary &before = *flat.find("before"), &after = *flat.find("after");
  EXPECT_EQ(before.success.trials, 4);
  EXPECT_EQ(after.success.successes, 5);
  EXPECT_EQ(after.success.trials, 8);
  EXPECT_EQ(after.members, 2);
  EXPECT_DOUBLE_EQ(after.spl, 5 * 0.5 / 8);
  EXPECT_EQ(flat.pairs.both, 1);
  EXPECT_EQ(flat.pairs.only_after, 4);
  EXPECT_EQ(flat.pairs.only_before, 1);
  EXPECT_EQ(flat.pairs.neither, 2);
  EXPECT_DOUBLE_EQ(flat.difference.difference, 3.0 / 8.0);
  EXPECT_TRUE(flat.leak);

  // Episodes are sorted by name: chairs (2, 3) before couches (0, 1).
  const double after_values[2][4] = {{0, 1, 1, 1}, {1, 0, 0, 1}};
  const double before_values[4] = {0, 0, 1, 0};
  std::vector<results::SeededValue> rates, differences;
  for (int episode = 0; episode < 4; ++episode) {
    for (int training = 0; training < 2; ++training) {
      rates.push_back({1, training, 0, episode, after_values[training][episode]});
      differences.push_back(rates.back());
      differences.back().value -= before_values[episode];
    }
  }
  const results::Interval rate = results::hierarchical_rate_interval(rates).interval;
  EXPECT_EQ(after.interval().low, rate.low);
  EXPECT_EQ(after.interval().high, rate.high);
  EXPECT_EQ(before.interval().low, results::wilson_interval({1, 4}).low);
  const results::Interval difference = results::hierarchical_interval(differences).interval;
  EXPECT_EQ(flat.difference.interval.low, std::max(-1.0, difference.low));
  EXPECT_EQ(flat.difference.interval.high, std::min(1.0, difference.high));
  EXPECT_EQ(flat.p, results::training_test(differences).p);
  EXPECT_EQ(flat.verdict, results::verdict(flat.pairs, flat.p, flat.difference));

  ASSERT_EQ(table.trainings.size(), 2U);
  EXPECT_EQ(table.trainings[0].success.successes, 3);
  EXPECT_EQ(table.trainings[1].arm, "after.s3");
  EXPECT_EQ(table.trainings[1].pairs.only_after, 2);
  EXPECT_EQ(table.trainings[1].pairs.only_before, 1);

  // Goal classes pool in the same way: chairs are episodes 2 and 3.
  EXPECT_EQ(table.classes[0].name, "chair");
  EXPECT_EQ(table.classes[0].find("after")->success.successes, 2);
  EXPECT_EQ(table.classes[0].find("after")->success.trials, 4);
  EXPECT_EQ(table.classes[0].pairs.only_after, 2);
}

TEST(Table, TrainingsAreToldOneByOne) {
  const Trained run(false);
  const results::ResultTable table =
      results::summarise(a_run(12), run.scenes, run.arms, run.trials);
  const std::string text = results::format_table(table, support::TableFormat::kText);
  for (const char* part : {"Object search before and after fine-tuning (2 trainings)\n",
                           "5/8  62 % [", "+4 -1 of 8",
                           R"(
Training  Seed  Reconstruction  Weights       Score threshold  AP50 held out  SR                  Difference [points]  Pairs
--------  ----  --------------  ------------  ---------------  -------------  ------------------  -------------------  ----------
after     2     1               aaaaaaaaaaaa  0.250            50.0           3/4  75 % [30, 95]  +50 [-14, +79]       +2 -0 of 4
after.s3  3     1               aaaaaaaaaaaa  0.250            50.0           2/4  50 % [15, 85]  +25 [-46, +75]       +2 -1 of 4

SR by training: 75 %, 50 %; mean 62 %, standard deviation 17.7 points (0.0)"}) {
    EXPECT_THAT(text, HasSubstr(part));
  }
  EXPECT_THAT(text, Not(HasSubstr("ONE TRAINING")));
  EXPECT_THAT(table.notes, Contains(HasSubstr("LEAKAGE start region: 6 of the 200 views")));
  EXPECT_THAT(table.notes, Not(Contains(HasSubstr("discordant pair"))));

  const nlohmann::json json =
      nlohmann::json::parse(results::format_table(table, support::TableFormat::kJson));
  EXPECT_FALSE(json.at("one_training").get<bool>());
  EXPECT_EQ(json.at("trainings").size(), 2U);
  EXPECT_EQ(json.at("trainings")[1].at("seed"), 3);
  EXPECT_NEAR(json.at("training_rate_sd").get<double>(), 0.125 * std::sqrt(2.0), 1e-12);
  const nlohmann::json& scene = json.at("scenes")[0];
  EXPECT_EQ(scene.at("arms").at("after").at("trainings"), 2);
  EXPECT_TRUE(scene.at("arms").at("after").contains("hierarchical95"));
  EXPECT_FALSE(scene.at("arms").at("after").contains("wilson95"));
  EXPECT_TRUE(scene.at("arms").at("before").contains("wilson95"));
  EXPECT_EQ(scene.at("comparison").at("p_trainings"), scene.at("comparison").at("p"));
  EXPECT_FALSE(scene.at("comparison").contains("p_mcnemar_exact"));

  const std::string csv = results::format_table(table, support::TableFormat::kCsv);
  EXPECT_THAT(csv, HasSubstr("\ntraining,\"after.s3\",0,\"after.s3\",2,4,0.5,"));
  for (std::size_t at = csv.find('\n'); at + 1 < csv.size();) {  // Equal numbers of fields.
    const std::size_t end = csv.find('\n', at + 1);
    const auto commas = [&](std::size_t from, std::size_t to) {
      return std::count(csv.begin() + static_cast<std::ptrdiff_t>(from),
                        csv.begin() + static_cast<std::ptrdiff_t>(to), ',');
    };
    EXPECT_EQ(commas(at, end), commas(0, csv.find('\n'))) << csv.substr(at, end - at);
    at = end;
  }
}

/// A training is compared with 'before' of its own reconstruction.
TEST(Table, ReconstructionsPoolAndPairWithinThemselves) {
  const Trained run(true);
  const results::ResultTable table =
      results::summarise(a_run(20), run.scenes, run.arms, run.trials);
  ASSERT_EQ(table.scenes.size(), 1U);
  EXPECT_FALSE(table.all.has_value());
  const results::GroupSummary& flat = table.scenes[0];
  EXPECT_EQ(flat.title, "Flat");
  EXPECT_EQ(flat.find("before")->success.successes, 3);
  EXPECT_EQ(flat.find("before")->success.trials, 8);
  EXPECT_EQ(flat.find("before")->members, 2);
  EXPECT_EQ(flat.find("after")->success.successes, 8);
  EXPECT_EQ(flat.find("after")->success.trials, 12);
  EXPECT_EQ(flat.pairs.only_after, 5);
  EXPECT_EQ(flat.pairs.only_before, 1);
  EXPECT_EQ(flat.pairs.total(), 12);
  EXPECT_EQ(flat.dropped_pairs, 0);
  ASSERT_EQ(table.trainings.size(), 3U);
  EXPECT_EQ(table.trainings[2].before, "before.r2");
  EXPECT_EQ(table.trainings[2].pairs.only_after, 1);
  EXPECT_EQ(table.trainings[2].pairs.both, 2);
  EXPECT_THAT(results::format_table(table, support::TableFormat::kText),
              HasSubstr("(3 trainings in 2 reconstructions)"));
}

/// What all trainings of an arm share is told once, of the arm.
TEST(Table, LeakageIsThatOfAllTrainings) {
  Trained run(true);
  for (records::ArmRow& arm : run.arms) {
    arm.tuned_on.clear();
    arm.exposure = records::SceneExposure{};
    arm.exposure->threshold_on = {arm.reconstruction == 1 ? "flat" : "flat.r2"};
    arm.score_threshold = -1;
  }
  const auto table = [&] {
    return results::summarise(a_run(20), run.scenes, run.arms, run.trials);
  };
  const auto json = [&] {
    return nlohmann::json::parse(results::format_table(table(), support::TableFormat::kJson));
  };
  EXPECT_FALSE(table().scenes[0].leak);
  EXPECT_THAT(table().notes,
              Contains("Leakage none: no view of the evaluation scenes is in what \"before\" "
                       "and \"after\" were trained on."));
  EXPECT_THAT(table().notes,
              Contains("Score thresholds of \"before\" and \"after\" were chosen on other "
                       "views of the same scenes."));
  EXPECT_EQ(csv_leakage(table(), "after"), "none");

  for (records::ArmRow& arm : run.arms) {
    if (arm.family != "after") continue;
    arm.exposure->known = records::TrainingDataKnown::kPart;
    arm.exposure->trained_on = arm.exposure->threshold_on;
  }
  EXPECT_TRUE(table().scenes[0].leak);
  EXPECT_THAT(table().notes,
              Contains(StartsWith("LEAKAGE scene (*): \"after\" was fine-tuned")));
  EXPECT_THAT(table().notes,
              Contains("LEAKAGE unknown: \"after\" (3 files): the files do not say all that "
                       "it was trained on."));
  EXPECT_THAT(table().notes,
              Not(Contains(AllOf(StartsWith("LEAKAGE"), HasSubstr("after.s3")))));
  // One of the trainings in a comparison of its own: the arm is still told of as a whole.
  const results::ResultTable chosen =
      results::summarise(a_run(20), run.scenes, run.arms, run.trials, "before", "after.s3");
  EXPECT_THAT(chosen.notes, Contains(StartsWith("LEAKAGE scene (*): \"after.s3\"")));
  EXPECT_THAT(chosen.notes,
              Contains("LEAKAGE scene: \"after\" was trained on views of Flat."));

  // One training that differs from the others is told by itself, and makes the arm's word.
  for (records::ArmRow& arm : run.arms) {
    arm.exposure = records::SceneExposure{};
    if (arm.name == "after.r2") arm.exposure->trained_on = {"flat.r2"};
  }
  EXPECT_TRUE(table().scenes[0].leak);
  EXPECT_THAT(
      table().notes,
      Contains("LEAKAGE scene: \"after.r2\" (one training) was trained on views of Flat."));
  EXPECT_THAT(table().notes,
              Contains("Leakage none: no view of the evaluation scenes is in what \"before\", "
                       "\"after\" (one training) and \"after.s3\" (one training) were trained "
                       "on."));
  EXPECT_EQ(csv_leakage(table(), "after"), "scene");
  EXPECT_EQ(csv_leakage(table(), "before"), "none");
  EXPECT_EQ(json().at("scenes")[0].at("leakage"), "scene");
  EXPECT_EQ(json().at("scenes")[0].at("arms").at("after").at("leakage"), "scene");
  EXPECT_EQ(json().at("trainings")[0].at("leakage"), "none");
  EXPECT_EQ(json().at("trainings")[2].at("leakage"), "scene");
  EXPECT_THAT(results::format_table(table(), support::TableFormat::kCsv),
              ContainsRegex("\ntraining,\"after\\.r2\",[^\n]*,scene\n"));
  EXPECT_THAT(results::format_table(table(), support::TableFormat::kCsv),
              ContainsRegex("\ntraining,\"after\\.s3\",[^\n]*,none\n"));
}

TEST(Table, OneTrainingCanBeChosen) {
  const Trained run(false);
  const results::ResultTable table =
      results::summarise(a_run(12), run.scenes, run.arms, run.trials, "before", "after.s3");
  EXPECT_EQ(table.trainings.size(), 1U);
  EXPECT_EQ(table.scenes[0].pairs.total(), 4);
  EXPECT_EQ(table.scenes[0].pairs.only_before, 1);
  EXPECT_EQ(table.scenes[0].p, results::mcnemar_exact_p(2, 1));
  EXPECT_THAT(table.notes, Contains(HasSubstr("ONE TRAINING")));
  // Trainings of two arms pair by their seeds.
  Trained other(false);
  for (const char* name : {"tuned", "tuned.s3"}) {
    other.arms.push_back(a_row(name, "tuned", 1, std::string(name) == "tuned" ? 2 : 3));
    other.add("flat", name, std::string(name) == "tuned" ? "ssss" : "....");
  }
  const results::ResultTable pairs =
      results::summarise(a_run(20), other.scenes, other.arms, other.trials, "after", "tuned");
  ASSERT_EQ(pairs.trainings.size(), 2U);
  EXPECT_EQ(pairs.trainings[0].before, "after");
  EXPECT_EQ(pairs.trainings[0].pairs.only_after, 1);
  EXPECT_EQ(pairs.trainings[1].before, "after.s3");
  EXPECT_EQ(pairs.trainings[1].pairs.only_before, 2);
}

TEST(Table, OneTrainingIsMarked) {
  const results::ResultTable table =
      results::summarise(a_run(30), kScenes, kArms, ten_attributed_episodes());
  for (const support::TableFormat format :
       {support::TableFormat::kText, support::TableFormat::kMarkdown,
        support::TableFormat::kLatex}) {
    EXPECT_THAT(results::format_table(table, format), HasSubstr("fine-tuning (one training)"));
  }
  EXPECT_THAT(results::format_table(table, support::TableFormat::kText),
              HasSubstr("\nOne training: "));
  EXPECT_THAT(results::format_table(table, support::TableFormat::kMarkdown),
              HasSubstr("Success rule: segsim-object. By the strictest named rule, "
                        "habitat-hm3d ("));
  EXPECT_THAT(results::format_table(table, support::TableFormat::kMarkdown),
              HasSubstr("before 0/10 (0 %)"));
  EXPECT_THAT(table.notes, Contains(HasSubstr("ONE TRAINING: \"after\"")));
  EXPECT_TRUE(nlohmann::json::parse(results::format_table(table, support::TableFormat::kJson))
                  .at("one_training")
                  .get<bool>());
  // Two policies with the same weights: no training is what differs.
  std::vector<records::ArmRow> arms = kArms;
  arms[1].weights_sha256 = arms[0].weights_sha256;
  const results::ResultTable same =
      results::summarise(a_run(30), kScenes, arms, ten_attributed_episodes());
  EXPECT_THAT(results::format_table(same, support::TableFormat::kText),
              Not(HasSubstr("ne training")));
  EXPECT_THAT(same.notes, Not(Contains(HasSubstr("ONE TRAINING"))));
}

TEST(Table, ArmsCanBeChosenAndUnknownOnesAreRefused) {
  const results::ResultTable table =
      results::summarise(a_run(30), kScenes, kArms, ten_episodes(), "after", "oracle");
  EXPECT_EQ(table.scenes[0].pairs.only_after, 2);
  EXPECT_THROW((void)results::summarise(a_run(30), kScenes, kArms, ten_episodes(), "afer", ""),
               core::InputError);
}

TEST(Table, JsonAndCsvAreComplete) {
  const results::ResultTable table =
      results::summarise(a_run(30), kScenes, kArms, ten_episodes());
  const nlohmann::json json =
      nlohmann::json::parse(results::format_table(table, support::TableFormat::kJson));
  EXPECT_EQ(json.at("scenes")[0].at("arms").at("after").at("successes"), 8);
  EXPECT_EQ(json.at("scenes")[0].at("leakage"), "scene");
  EXPECT_NEAR(json.at("scenes")[0].at("comparison").at("p_mcnemar_exact").get<double>(),
              0.21875, 1e-12);
  EXPECT_EQ(json.at("provenance").at("seed"), 7);

  const std::string csv = results::format_table(table, support::TableFormat::kCsv);
  std::size_t start = 0, fields = 0, lines = 0;
  while (start < csv.size()) {
    const std::size_t end = csv.find('\n', start);
    const auto commas = static_cast<std::size_t>(
        std::count(csv.begin() + static_cast<std::ptrdiff_t>(start),
                   csv.begin() + static_cast<std::ptrdiff_t>(end), ','));
    if (lines++ == 0) fields = commas;
    EXPECT_EQ(commas, fields) << csv.substr(start, end - start);
    start = end + 1;
  }
  EXPECT_EQ(lines, 1U + 3U * 3U);  // Header; scene and two classes, three arms each.
}

TEST(Table, MarkdownKeepsItsColumns) {
  const std::string text =
      results::format_table(results::summarise(a_run(30), kScenes, kArms, ten_episodes()),
                            support::TableFormat::kMarkdown);
  EXPECT_THAT(text, HasSubstr("| Scene | SR-Before | SR-After |"));
  EXPECT_THAT(text, HasSubstr("Flat \\*"));
}

TEST(Table, FormatWords) {
  EXPECT_EQ(results::table_format_from("md"), support::TableFormat::kMarkdown);
  EXPECT_THROW((void)results::table_format_from("markdwn"), core::InputError);
}

/// Trials of two arms that are equally good: each succeeds in an episode with its probability.
std::vector<records::TrialRow> equal_arms(std::uint64_t seed, bool common_numbers) {
  core::RandomStream random(seed, "a/a");
  std::vector<records::TrialRow> trials;
  for (int k = 0; k < 40; ++k) {
    const double ease = random.uniform();
    const double shared = random.uniform();
    for (const std::string& arm : std::vector<std::string>{"before", "after"}) {
      records::TrialRow t;
      t.arm = arm;
      t.scene = "flat";
      t.goal_class = "chair";
      t.episode = "flat/chair/" + std::to_string(k);
      t.success = (common_numbers ? shared : random.uniform()) < ease;
      t.outcome = t.success ? "success" : "timeout";
      trials.push_back(t);
    }
  }
  return trials;
}

TEST(Table, TheSameArmTwiceIsRarelySignificant) {
  const std::vector<records::ArmRow> arms(kArms.begin(), kArms.begin() + 2);
  int significant = 0, discordant = 0;
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    const results::ResultTable table =
        results::summarise(a_run(80), kScenes, arms, equal_arms(seed, false));
    significant += table.scenes[0].p < 0.05 ? 1 : 0;
    discordant += table.scenes[0].pairs.discordant();
  }
  EXPECT_LE(significant, 16);       // 8 % of 200; the exact test keeps below 5 % on average.
  EXPECT_GE(discordant, 200 * 10);  // The arms did differ: a third of all pairs does.
}

TEST(Table, TheSameArmTwiceWithTheSameNoiseHasNoDiscordantPair) {
  const std::vector<records::ArmRow> arms(kArms.begin(), kArms.begin() + 2);
  const results::ResultTable table =
      results::summarise(a_run(80), kScenes, arms, equal_arms(7, true));
  EXPECT_EQ(table.scenes[0].pairs.discordant(), 0);
  EXPECT_EQ(table.scenes[0].p, 1.0);
}

TEST(Table, PairedMeansByHand) {
  const results::ResultTable table =
      results::summarise(a_run(30), kScenes, kArms, ten_episodes());
  // SPL is 0.5 for each success, and nothing else.
  const results::GroupSummary& scene = table.scenes[0];
  const double expected =
      0.5 * (scene.pairs.only_after - scene.pairs.only_before) / scene.pairs.total();
  EXPECT_NEAR(scene.spl.difference.mean, expected, 1e-12);
  EXPECT_GT(scene.spl.difference.interval.low, -0.5);
  EXPECT_LT(scene.spl.difference.interval.low, expected);
  EXPECT_EQ(scene.sim_s.difference.mean, 0.0);
  EXPECT_EQ(scene.sim_s.p, 1.0);
  EXPECT_FALSE(table.all.has_value());
}

TEST(Table, LatexEscapesAndAligns) {
  std::vector<records::SceneRow> scenes = kScenes;
  scenes[0].title = "Flat_1 & 50 % {x}";
  const std::string latex =
      results::format_table(results::summarise(a_run(30), scenes, kArms, ten_episodes()),
                            support::TableFormat::kLatex);
  EXPECT_THAT(latex, HasSubstr(R"(Flat\_1 \& 50 \% \{x\} *)"));
  EXPECT_THAT(latex, HasSubstr("\\toprule"));
  EXPECT_EQ(results::table_format_from("tex"), support::TableFormat::kLatex);
  EXPECT_THROW((void)results::table_format_from("latec"), core::InputError);
}

}  // namespace
}  // namespace segsim::experiments
