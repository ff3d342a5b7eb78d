#include <algorithm>
#include <fstream>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/error.h"
#include "core/file_io.h"
#include "experiments/detection/scene_query.h"
#include "experiments/episodes/episodes.h"
#include "experiments/records/store.h"
#include "experiments/records/trial_log.h"
#include "experiments/runs/run.h"
#include "sim/trial/episode_sampling.h"
#include "tests/experiments/tiny_scene.h"
#include "tests/experiments/tiny_spec.h"
#include "tests/perception/clip_model.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;
using testing::Each;
using testing::ElementsAre;
using testing::HasSubstr;

/// The small model takes what begins with "chair" for red, and with "table" for blue.
const std::string kRed = "chair of red", kBlue = "table blue chair";
const std::string kMore =
    R"(success: {profile: segsim-object, distance_m: 1.0, visible_pixels: 30}
phrases: {model: "${data}/clip.yaml"}
)";

/// Two rooms with a red chair, a blue one, and a couch.
class RunPhrasesTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder("run_phrases");
    TinyScene(TinyScene::Chairs::kTwo).write(folder_->path() / "tiny");
    perception::write_clip(folder_->path() / "", "clip");
  }
  static void TearDownTestSuite() { delete folder_; }

  static std::string spec_text(const std::string& goals, int episodes,
                               const std::string& arms) {
    return TinySpec{.goals = goals,
                    .episodes = episodes,
                    .arms = arms,
                    .time_limit_s = 60.0,
                    .more = kMore}
        .text();
  }
  static std::string phrase(const std::string& text, int instances = 1) {
    return "{phrase: \"" + text + "\", instances: " + std::to_string(instances) + "}";
  }
  static runs::RunReport run(const std::string& work, const std::string& text) {
    runs::RunOptions options;
    options.folders = {folder_->path(), folder_->path() / work};
    const specs::ExperimentSpec spec = specs::parse_spec(text, "tiny.yaml", options.folders);
    return runs::run_experiment(spec, options);
  }
  static std::string refusal(const std::string& work, const std::string& text) {
    try {
      (void)run(work, text);
    } catch (const core::InputError& error) {
      return error.what();
    }
    return {};
  }
  static std::vector<records::TrialRow> rows(const std::string& work) {
    const records::Store store(folder_->path() / work / "results.sqlite");
    return store.trials(store.runs().back().run_id);
  }
  static episodes::EpisodeSet episodes_in(const std::string& work) {
    return episodes::read_episodes(folder_->path() / work / "episodes" / "tiny.jsonl");
  }

  static TemporaryFolder* folder_;
};
TemporaryFolder* RunPhrasesTest::folder_ = nullptr;

const std::string kOracles =
    "  - {name: path, detector: oracle, policy: oracle-path}\n"
    "  - {name: search, detector: oracle}\n";

TEST_F(RunPhrasesTest, EachPhraseIsSearchedAtTheThingThatItMeans) {
  const auto report = run("both", spec_text(phrase(kRed) + ", " + phrase(kBlue), 2, kOracles));
  EXPECT_EQ(report.trials_run, 4);
  const episodes::EpisodeSet set = episodes_in("both");
  ASSERT_EQ(set.episodes.size(), 2U);
  EXPECT_EQ(set.episodes[0].id, "tiny/chair-of-red/00");
  EXPECT_THAT(set.episodes[0].goal_instances, ElementsAre(TinyScene::kRedChair));
  EXPECT_THAT(set.episodes[1].goal_instances, ElementsAre(TinyScene::kBlueChair));
  for (const sim::Episode& episode : set.episodes) {
    EXPECT_EQ(episode.class_name, "chair");
    EXPECT_THAT(episode.view_point_instance, Each(episode.goal_instances[0]));
  }
  const std::vector<records::TrialRow> trials = rows("both");
  ASSERT_EQ(trials.size(), 4U);
  for (const records::TrialRow& trial : trials) {
    const bool red = trial.episode == set.episodes[0].id;
    EXPECT_EQ(trial.goal_class, red ? kRed : kBlue);
    EXPECT_TRUE(trial.success) << trial.episode << " " << trial.arm;
    EXPECT_GT(trial.spl, 0.2) << trial.episode << " " << trial.arm;
    EXPECT_EQ(trial.why.reached_instance, red ? TinyScene::kRedChair : TinyScene::kBlueChair);
    EXPECT_EQ(trial.why.false_detections, 0) << "the oracle knows which chair is meant";
    const records::TrialLog log =
        records::read_trial_log(folder_->path() / "both" / trial.log);
    EXPECT_EQ(log.episode.goal_name(), trial.goal_class);
    EXPECT_EQ(log.episode.goal_instances.size(), 1U);
  }
  const std::string table = core::read_file(folder_->path() / "both" / "table.txt");
  EXPECT_THAT(table, HasSubstr(kRed));
  EXPECT_THAT(table, HasSubstr(kBlue));
}

TEST_F(RunPhrasesTest, ScoresAreKeptUntilTheQuestionChanges) {
  const std::string arms = "  - {name: path, detector: oracle, policy: oracle-path}\n";
  (void)run("kept", spec_text(phrase(kRed), 1, arms));
  const fs::path file = folder_->path() / "kept" / "phrases" / "tiny.json";
  EXPECT_TRUE(fs::exists(folder_->path() / "kept" / "phrases" / "tiny.png"));
  detection::SceneQuery query = detection::read_query(file);
  EXPECT_THAT(query.phrases, ElementsAre(kRed));
  ASSERT_EQ(query.instances.size(), 3U);
  // Whoever changes the scores finds them believed: the model was not asked again.
  for (detection::QueriedInstance& instance : query.instances) {
    instance.scores = {instance.id == TinyScene::kBlueChair ? 1.0 : 0.0};
  }
  detection::write_query(file, query);
  EXPECT_THAT(refusal("kept", spec_text(phrase(kRed), 1, arms)), HasSubstr("episodes"))
      << "another thing is another set of episodes, which is another run";
  EXPECT_THAT(episodes_in("kept").episodes[0].goal_instances,
              ElementsAre(TinyScene::kBlueChair));
}

TEST_F(RunPhrasesTest, AStopAtAnotherThingOfTheClassIsNoSuccess) {
  // Both episodes begin where the red chair is seen best; the robot stops at once.
  const std::string goals = phrase(kRed) + ", " + phrase(kBlue);
  const std::string path = "  - {name: path, detector: oracle, policy: oracle-path}\n";
  (void)run("starts", spec_text(goals, 2, path));
  episodes::EpisodeSet set = episodes_in("starts");
  ASSERT_EQ(set.episodes.size(), 2U);
  const auto best = std::max_element(set.episodes[0].view_point_iou.begin(),
                                     set.episodes[0].view_point_iou.end());
  const glm::dvec2 at_m = set.episodes[0].view_points_m[static_cast<std::size_t>(
      best - set.episodes[0].view_point_iou.begin())];
  for (sim::Episode& episode : set.episodes) {
    episode.start = sim::facing(at_m, {-3.4, 1.6, 0.0}, {-2.9, 2.1, 0.9});
  }
  episodes::write_episodes(folder_->path() / "set.jsonl", set);
  std::string text = spec_text(
      "x", 1, "  - {name: stop, detector: oracle, policy: {type: script, actions: [stop]}}\n");
  const std::string rules = "    goals: [x]\n    episodes: 1\n";
  text.replace(text.find(rules), rules.size(),
               "    episode_file: ${data}/set.jsonl\n    allow_trivial: true\n");
  // Episodes of a file say what they mean. By this rule it counts what is in view at a STOP.
  text.replace(text.find("success:"), std::string::npos,
               "success: {profile: allenact-robothor, visible_pixels: 30}\n");
  (void)run("stops", text);
  const std::vector<records::TrialRow> trials = rows("stops");
  ASSERT_EQ(trials.size(), 2U);
  for (const records::TrialRow& trial : trials) {
    const bool red = trial.goal_class == kRed;
    EXPECT_EQ(trial.success, red) << trial.episode;
    EXPECT_EQ(trial.why.final_visible_px > 0, red) << "the red chair is no goal of the other";
  }
}

TEST_F(RunPhrasesTest, APhraseThatMeansTooLittleIsRefused) {
  const std::string arms = "  - {name: path, detector: oracle, policy: oracle-path}\n";
  EXPECT_THAT(refusal("many", spec_text(phrase(kRed, 3), 1, arms)),
              testing::AllOf(HasSubstr("scene tiny: phrase \"chair of red\""),
                             HasSubstr("3 things of class chair"), HasSubstr("found 2")));
  EXPECT_EQ(refusal("many", spec_text(phrase(kRed, 2), 1, arms)), "");
  EXPECT_THAT(episodes_in("many").episodes[0].goal_instances,
              ElementsAre(TinyScene::kRedChair, TinyScene::kBlueChair));
}

TEST_F(RunPhrasesTest, AModelOfAnotherKindIsRefusedBeforeAnything) {
  const std::string arms = "  - {name: path, detector: oracle, policy: oracle-path}\n";
  std::ofstream(folder_->path() / "wrong.yaml")
      << "schema: segsim.model/1\ntask: sam\nfiles: {encoder: image.onnx, decoder: "
         "text.onnx}\n";
  std::string text = spec_text(phrase(kRed), 1, arms);
  text.replace(text.find("clip.yaml"), 9, "wrong.yaml");
  EXPECT_THAT(refusal("wrong", text), HasSubstr("wrong.yaml"));
  EXPECT_FALSE(fs::exists(folder_->path() / "wrong" / "episodes"));
}

}  // namespace
}  // namespace segsim::experiments
