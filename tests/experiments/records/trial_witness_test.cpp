#include "experiments/records/trial_witness.h"

#include <cmath>
#include <map>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "experiments/results/trial_insights.h"
#include "tests/experiments/tiny_scene.h"

namespace segsim::experiments {
namespace {

constexpr std::uint16_t kCouch = TinyScene::kCouch;

/// A frame of 40 x 30 pixels with rectangles of labels.
class Labels {
 public:
  Labels() {
    frame_.semantic.resize(40, 30);
    frame_.instance.resize(40, 30);
    for (std::uint16_t& id : frame_.semantic.pixels()) id = TinyScene::kWall;
    for (std::uint16_t& id : frame_.instance.pixels()) id = 0;
  }
  Labels& box(int x0, int y0, int x1, int y1, std::uint16_t class_id, std::uint16_t instance) {
    for (int j = y0; j < y1; ++j) {
      for (int i = x0; i < x1; ++i) {
        frame_.semantic(i, j) = class_id;
        frame_.instance(i, j) = instance;
      }
    }
    return *this;
  }
  [[nodiscard]] const core::Frame& frame() const { return frame_; }

 private:
  core::Frame frame_;
};

core::SceneManifest two_couches() {
  core::SceneManifest manifest;
  manifest.classes = {{TinyScene::kWall, "wall", false}, {kCouch, "couch", true}};
  manifest.instances = {{1, kCouch, "a", {0, 0, 0}, {1, 1, 1}},
                        {2, kCouch, "b", {5, 0, 0}, {6, 1, 1}}};
  return manifest;
}

sim::Episode couch_episode() {
  sim::Episode episode;
  episode.class_name = "couch";
  return episode;
}

/// A tick at which the policy decides on what the camera just saw.
void look(records::TrialWitness& witness, int tick, const core::Frame& frame,
          std::span<const core::Detection> detections) {
  const auto index = static_cast<std::uint64_t>(tick);
  witness.judge(index, frame, detections);
  witness.add(tick, frame, index);
}

TEST(TrialWitness, CountsTheInstanceSeenBest) {
  records::TrialWitness witness(two_couches(), couch_episode(), 0);
  look(witness, 0, Labels().frame(), {});
  look(witness, 1, Labels().box(0, 0, 4, 4, kCouch, 1).box(20, 5, 30, 10, kCouch, 2).frame(),
       {});
  ASSERT_EQ(witness.evidence().size(), 2U);
  EXPECT_EQ(witness.evidence()[0].largest_px, 0);
  EXPECT_EQ(witness.evidence()[1].largest_px, 50);
  EXPECT_EQ(witness.evidence()[1].instance, 2);
}

TEST(TrialWitness, TicksWithoutAnImageSawNothing) {
  records::TrialWitness witness(two_couches(), couch_episode(), 0);
  const core::Detection detections[] = {{0, 0.5F, {10, 10, 20, 20}}};
  look(witness, 3, Labels().box(10, 10, 20, 20, kCouch, 1).frame(), detections);
  ASSERT_EQ(witness.evidence().size(), 4U);
  EXPECT_EQ(witness.evidence()[2].largest_px, 0);
  EXPECT_EQ(witness.evidence()[3].largest_px, 100);
  EXPECT_EQ(witness.detections()[0].tick, 3);
}

TEST(TrialWitness, JudgesDetectionsByTheLabels) {
  // Couch at [10, 20) x [10, 20).
  const Labels labels = Labels().box(10, 10, 20, 20, kCouch, 1);
  const struct {
    core::BoxPx box;
    bool is_goal;
  } cases[] = {
      {{10, 10, 20, 20}, true},    // Exact.
      {{12, 12, 15, 15}, true},    // A part of it: all its pixels are goal pixels, IoU 0.09.
      {{5, 5, 25, 25}, false},     // Much too large: IoU 0.25, a quarter of its pixels.
      {{7, 7, 23, 23}, true},      // Too large: IoU 100 / 256 = 0.39.
      {{25, 10, 35, 20}, false},   // Beside it.
      {{16, 10, 26, 20}, false},   // IoU 0.25, 40 % of its pixels.
      {{15, 10, 25, 20}, true},    // IoU 1/3.
      {{-5, -5, -1, -1}, false},   // Outside the image.
      {{12, 12, 12, 12}, false}};  // Empty.
  for (const auto& c : cases) {
    records::TrialWitness witness(two_couches(), couch_episode(), 3);
    const core::Detection detections[] = {{3, 0.5F, c.box}, {1, 0.9F, {10, 10, 20, 20}}};
    look(witness, 0, labels.frame(), detections);
    ASSERT_EQ(witness.detections().size(), 1U);  // The other is of another class.
    EXPECT_EQ(witness.detections()[0].is_goal, c.is_goal) << c.box.x0 << " " << c.box.y0;
    EXPECT_EQ(witness.evidence()[0].true_detections, c.is_goal ? 1 : 0);
    EXPECT_EQ(witness.evidence()[0].false_detections, c.is_goal ? 0 : 1);
  }
}

/// The robot turns: when the answer is there, the couch has moved on in the image.
TEST(TrialWitness, LateAnswersAreJudgedByTheirOwnImageAndCountedOnce) {
  records::TrialWitness witness(two_couches(), couch_episode(), 0);
  const Labels then = Labels().box(10, 10, 20, 20, kCouch, 1);
  const Labels now = Labels().box(28, 10, 38, 20, kCouch, 1);
  const core::Detection detections[] = {{0, 0.9F, {10, 10, 20, 20}}};
  witness.judge(7, then.frame(), detections);
  witness.add(0, now.frame(), std::nullopt);
  witness.add(1, now.frame(), 7);
  witness.add(2, now.frame(), std::nullopt);  // Still in use.
  ASSERT_EQ(witness.images().size(), 1U);
  EXPECT_EQ(witness.images()[0].true_detections, 1);
  EXPECT_EQ(witness.images()[0].false_detections, 0);
  EXPECT_EQ(witness.images()[0].largest_px, 100);
  ASSERT_EQ(witness.detections().size(), 1U);
  EXPECT_EQ(witness.detections()[0].tick, 1);
  EXPECT_EQ(witness.evidence()[0].true_detections, 0);
  EXPECT_EQ(witness.evidence()[1].true_detections, 1);
  EXPECT_EQ(witness.evidence()[2].true_detections, 0);
  EXPECT_EQ(witness.evidence()[2].largest_px, 100);
}

TEST(TrialWitness, AClassThatTheDetectorOrTheSceneLacks) {
  records::TrialWitness unnamed(two_couches(), couch_episode(), -1);
  const core::Detection detections[] = {{-1, 0.5F, {10, 10, 20, 20}}};
  look(unnamed, 0, Labels().box(10, 10, 20, 20, kCouch, 1).frame(), detections);
  EXPECT_TRUE(unnamed.detections().empty());
  EXPECT_EQ(unnamed.evidence()[0].largest_px, 100);
  sim::Episode toilet;
  toilet.class_name = "toilet";
  records::TrialWitness absent(two_couches(), toilet, 0);
  const core::Detection toilets[] = {{0, 0.5F, {10, 10, 20, 20}}};
  look(absent, 0, Labels().frame(), toilets);
  EXPECT_EQ(absent.evidence()[0].false_detections, 1);
  EXPECT_EQ(absent.evidence()[0].largest_px, 0);
}

/// Attribution in two rooms with a couch at [2, 3.9] x [-2.4, -1.5].
class AttributeTest : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder("attribute");
    const core::SceneBundle bundle =
        core::load_bundle(TinyScene().write(folder_->path() / "tiny"));
    world_ = new sim::World(sim::World::load(bundle, sim::RobotModel::jackal_gentle()));
  }
  static void TearDownTestSuite() {
    delete world_;
    delete folder_;
  }
  AttributeTest() {
    episode_.class_name = "couch";
    episode_.start = {1.0, 1.0, 0.0};
    episode_.view_points_m = {{2.5, -1.0}, {3.0, -0.5}};
    episode_.view_point_instance = {1, 7};
    result_.outcome = sim::Outcome::kStoppedFar;
    result_.stop_reason = core::StopReason::kGoalReached;
    for (int k = 0; k < 4; ++k)
      add_tick({1.0 + 0.1 * k, 1.0, 0.0}, core::PolicyMode::kNavigate);
    result_.track.back().mode = core::PolicyMode::kStop;
  }
  void add_tick(const core::Pose2& pose, core::PolicyMode mode) {
    sim::TickRecord tick;
    tick.time_ns = static_cast<core::TimeNs>(result_.track.size()) * core::kNsPerSecond;
    tick.pose = pose;
    tick.mode = mode;
    result_.track.push_back(tick);
    result_.final_pose = result_.final_estimate = pose;
    const Labels nothing;
    look(witness_, static_cast<int>(result_.track.size()) - 1, nothing.frame(), {});
  }
  [[nodiscard]] records::Attribution attributed() {
    const records::AttributionContext context{
        world_, &world_->manifest(), &episode_, &profile_, 0, 60.0};
    return records::attribute(context, result_, witness_, &distance_m_);
  }

  static TemporaryFolder* folder_;
  static sim::World* world_;
  sim::Episode episode_;
  sim::SuccessProfile profile_;
  sim::TrialResult result_;
  records::TrialWitness witness_{world_->manifest(), couch_episode(), 0};
  std::vector<double> distance_m_;
};
TemporaryFolder* AttributeTest::folder_ = nullptr;
sim::World* AttributeTest::world_ = nullptr;

TEST_F(AttributeTest, TargetsNearAGoalBoxAreTrue) {
  result_.final_view.target_m = glm::dvec2(2.0, -0.6);  // 0.9 m from the couch.
  EXPECT_EQ(attributed().cause, records::Cause::kBadStopTruePositive);
  result_.final_view.target_m = glm::dvec2(2.0, -0.4);  // 1.1 m.
  EXPECT_EQ(attributed().cause, records::Cause::kFalsePositive);
}

/// The robot believes to be 2 m further along x, and turned by 90 degrees.
TEST_F(AttributeTest, PlacesOfThePolicysMapAreBroughtIntoTheWorld) {
  const core::Pose2 truth = result_.final_pose;
  result_.final_estimate = {truth.x_m + 2.0, truth.y_m,
                            truth.yaw_rad + 0.5 * 3.14159265358979};
  const auto in_odom = [&](const glm::dvec2& p_m) {
    return glm::dvec2(truth.x_m + 2.0 - (p_m.y - truth.y_m), truth.y_m + (p_m.x - truth.x_m));
  };
  const glm::dvec2 couch_m(2.5, -2.0);
  EXPECT_NEAR(glm::distance(records::world_from_odom(result_, in_odom(couch_m)), couch_m), 0.0,
              1e-9);
  result_.final_view.target_m = in_odom({2.0, -0.6});
  result_.final_view.objects = {{in_odom(couch_m), 0, 0.9F}, {couch_m, 0, 0.9F}};
  const records::Attribution why = attributed();
  EXPECT_EQ(why.cause, records::Cause::kBadStopTruePositive);
  EXPECT_EQ(why.true_clouds, 1);
  EXPECT_EQ(why.false_clouds, 1);
}

/// An object far from the couch may be the detector's mistake, or that of the depth in its
/// box.
TEST_F(AttributeTest, ObjectsElsewhereAreFalseOrMisplacedByWhatTheyAreMadeOf) {
  const Labels couch = Labels().box(10, 10, 20, 20, kCouch, 1);
  const core::BoxPx on{10, 10, 20, 20}, beside{30, 10, 39, 20};
  const core::Detection both[] = {{0, 0.9F, on}, {0, 0.8F, beside}};
  records::TrialWitness witness(world_->manifest(), episode_, 0);
  look(witness, 0, couch.frame(), both);
  look(witness, 1, couch.frame(), both);
  look(witness, 2, couch.frame(), {});
  look(witness, 3, couch.frame(), {});
  const records::AttributionContext context{
      world_, &world_->manifest(), &episode_, &profile_, 0, 60.0};
  const glm::dvec2 elsewhere_m(0.5, 2.0), at_couch_m(2.5, -2.0);
  // Of an image that was never decided on (5) and of an unknown box nothing is known.
  const struct {
    glm::dvec2 place_m;
    std::vector<core::DetectionRef> made_of;
    int is_true, is_misplaced, is_false;
  } cases[] = {{elsewhere_m, {{0, on}}, 0, 1, 0},
               {elsewhere_m, {{0, beside}}, 0, 0, 1},
               {elsewhere_m, {{0, on}, {1, on}, {1, beside}}, 0, 1, 0},
               {elsewhere_m, {{0, on}, {1, beside}}, 0, 1, 0},
               {elsewhere_m, {{0, on}, {0, beside}, {1, beside}}, 0, 0, 1},
               {elsewhere_m, {{0, on}, {5, beside}, {1, {1, 2, 3, 4}}}, 0, 1, 0},
               {elsewhere_m, {{5, on}}, 0, 0, 1},
               {elsewhere_m, {}, 0, 0, 1},
               {at_couch_m, {{0, beside}}, 1, 0, 0},
               {at_couch_m, {}, 1, 0, 0}};
  for (const auto& c : cases) {
    result_.final_view.objects = {{c.place_m, 0, 0.9F, c.made_of}};
    const records::Attribution why = records::attribute(context, result_, witness);
    EXPECT_EQ(why.true_clouds, c.is_true);
    EXPECT_EQ(why.misplaced_clouds, c.is_misplaced);
    EXPECT_EQ(why.false_clouds, c.is_false);
  }
}

TEST_F(AttributeTest, TheEndIsWhereTheStopTookEffect) {
  result_.final_pose = {3.0, -0.9, 0.0};  // It rolled on until it stood beside the couch.
  result_.final_goal_pixels = 321;
  const records::Attribution why = attributed();
  EXPECT_EQ(why.object_m, 0.0);
  EXPECT_NEAR(*why.planar_m, 0.4, 1e-9);
  EXPECT_EQ(why.final_visible_px, 321);
}

TEST_F(AttributeTest, WithoutATargetTheNearestObjectCounts) {
  result_.final_view.objects = {
      {{2.5, -2.0}, 0, 0.9F}, {{1.2, 1.4}, 0, 0.5F}, {{1.3, 1.0}, 5, 0.5F}};
  const records::Attribution why = attributed();
  EXPECT_EQ(why.cause, records::Cause::kFalsePositive);
  EXPECT_EQ(why.true_clouds, 1);
  EXPECT_EQ(why.false_clouds, 1);  // The third is of another class.
  result_.final_view.objects.erase(result_.final_view.objects.begin() + 1);
  EXPECT_EQ(attributed().cause, records::Cause::kBadStopTruePositive);
}

TEST_F(AttributeTest, DistancesOfTheEnd) {
  const records::Attribution why = attributed();
  EXPECT_TRUE(why.stopped);
  ASSERT_TRUE(why.planar_m && why.object_m && why.shortest_object_m);
  EXPECT_NEAR(*why.planar_m, std::hypot(3.0 - 1.3, -0.5 - 1.0), 1e-9);
  // Straight down to within 1 m of the couch, whose near side is y = -1.5.
  EXPECT_NEAR(*why.object_m, std::hypot(2.0 - 1.3, 2.5) - 1.0, 0.12);
  ASSERT_EQ(distance_m_.size(), 4U);
  EXPECT_GT(distance_m_[0], distance_m_[3]);
  EXPECT_EQ(why.off_navmesh_ticks, 0);
  add_tick({40.0, 0.0, 0.0}, core::PolicyMode::kStop);
  EXPECT_EQ(attributed().off_navmesh_ticks, 1);
  result_.final_pose = {3.0, -0.9, 0.0};  // Beside the couch.
  EXPECT_EQ(attributed().object_m, 0.0);
}

TEST_F(AttributeTest, TheInstanceThatWasReached) {
  result_.success = true;
  result_.outcome = sim::Outcome::kSuccess;
  result_.final_pose = {3.0, -0.4, 0.0};
  EXPECT_EQ(attributed().reached_instance, 7);
  EXPECT_EQ(attributed().cause, records::Cause::kDidNotFail);
  result_.final_pose = {2.3, -0.95, 0.0};
  EXPECT_EQ(attributed().reached_instance, 1);
}

TEST_F(AttributeTest, ContactsAndSightingsAreCounted) {
  result_.track[1].in_contact = result_.track[2].in_contact = true;
  const Labels couch = Labels().box(10, 10, 20, 20, kCouch, 1);
  const core::Detection right[] = {{0, 0.9F, {10, 10, 20, 20}}};
  const core::Detection wrong[] = {{0, 0.9F, {30, 10, 39, 20}}};
  add_tick({1.5, 1.0, 0.0}, core::PolicyMode::kNavigate);
  records::TrialWitness witness(world_->manifest(), episode_, 0);
  look(witness, 0, Labels().frame(), wrong);
  look(witness, 1, couch.frame(), {});
  look(witness, 2, couch.frame(), right);
  look(witness, 3, couch.frame(), wrong);
  look(witness, 4, Labels().frame(), {});
  const records::AttributionContext context{
      world_, &world_->manifest(), &episode_, &profile_, 0, 60.0};
  const records::Attribution why = records::attribute(context, result_, witness);
  EXPECT_EQ(why.collision_ticks, 2);
  EXPECT_EQ(why.visible_frames, 3);
  EXPECT_EQ(why.detected_frames, 1);
  EXPECT_EQ(why.true_detections, 1);
  EXPECT_EQ(why.false_detections, 2);
  EXPECT_EQ(why.first_true_tick, 2);
}

TEST(TrialInsights, SumsAndMedians) {
  std::vector<records::TrialRow> rows(5);
  for (std::size_t k = 0; k < rows.size(); ++k) {
    rows[k].ticks = 100;
    rows[k].outcome = records::TrialOutcome::kTimeout;
    rows[k].why.cause =
        k == 0 ? records::Cause::kFalseNegative : records::Cause::kNeverSawTarget;
    rows[k].why.visible_frames = static_cast<int>(k);
    rows[k].why.false_detections = 1;
    rows[k].why.false_clouds = 2;
    rows[k].why.misplaced_clouds = static_cast<int>(k);
  }
  rows[1].first_visible_tick = 10;
  rows[1].why.first_true_tick = 12;
  rows[2].first_visible_tick = 10;
  rows[2].why.first_true_tick = 17;
  rows[2].why.detected_frames = 2;
  rows[3].outcome = records::TrialOutcome::kInfeasible;  // In nothing.
  rows[4].why = {};                                      // Older than attribution: in nothing.
  std::vector<const records::TrialRow*> pointers;
  for (const records::TrialRow& row : rows) pointers.push_back(&row);
  const results::TrialInsights in = results::gain_insights(pointers);
  EXPECT_EQ(in.trials, 3);
  const std::vector<std::pair<std::string, int>> causes{{"never_saw_target", 2},
                                                        {"false_negative", 1}};
  EXPECT_EQ(in.causes, causes);
  EXPECT_EQ(in.frames, 300);
  EXPECT_DOUBLE_EQ(*in.recall(), 2.0 / 3.0);
  EXPECT_DOUBLE_EQ(*in.delay_ticks, 4.5);
  EXPECT_EQ(in.saw_goal, 2);
  EXPECT_EQ(in.never_detected, 0);
  EXPECT_DOUBLE_EQ(in.false_clouds, 2.0);
  EXPECT_DOUBLE_EQ(in.misplaced_clouds.value(), 1.0);
  rows[1].why.misplaced_clouds = -1;  // Older: then nothing is known of the group.
  EXPECT_FALSE(results::gain_insights(pointers).misplaced_clouds.has_value());
  EXPECT_FALSE(results::gain_insights({}).recall().has_value());
  EXPECT_TRUE(results::gain_insights({}).profiles.empty());
}

TEST(TrialInsights, OneTrialUnderEveryRule) {
  records::TrialRow row;
  row.outcome = records::TrialOutcome::kSuccess;
  row.success = true;
  row.why.cause = records::Cause::kDidNotFail;
  row.why.stopped = true;
  row.stop_reason = core::StopReason::kGoalReached;
  row.why.final_visible_px = 500;
  row.why.object_m = 0.0;
  row.why.shortest_object_m = 3.0;
  row.why.planar_m = 0.5;
  row.distance_to_goal_m = 0.5;
  row.shortest_path_m = 4.0;
  row.path_m = 8.0;
  row.sim_s = 10.0;
  const records::TrialRow* const rows[] = {&row};
  const results::TrialInsights in = results::gain_insights(rows);
  std::map<std::string, std::pair<int, double>> rates;
  for (const results::ProfileRate& rate : in.profiles)
    rates[rate.profile] = {rate.successes, rate.spl};
  EXPECT_EQ(rates["segsim-object"], std::make_pair(1, 0.5));
  EXPECT_EQ(rates["habitat-hm3d"], std::make_pair(0, 0.0));
  EXPECT_EQ(rates["apexnav"], std::make_pair(0, 0.0));
  EXPECT_EQ(rates["semexp-gibson"].first, 1);
  EXPECT_NEAR(rates["semexp-gibson"].second, 4.0 / 8.0, 1e-5);
  EXPECT_EQ(rates["allenact-robothor"], std::make_pair(1, 0.5));
  // OT = 4 / 2 = 2 s, t = 10 s within [4, 16]: 0.2.
  EXPECT_EQ(rates["barn"], std::make_pair(1, 0.2));

  row.success = false;
  row.outcome = records::TrialOutcome::kGaveUp;
  // In the same place: for the rules of others the same.
  row.stop_reason = core::StopReason::kNoFrontierLeft;
  const results::TrialInsights given_up = results::gain_insights(rows);
  EXPECT_EQ(given_up.profiles[0].successes, 0);
  EXPECT_EQ(given_up.any_stop_successes, 1);
  EXPECT_EQ(given_up.profiles[4].profile, "allenact-robothor");
  EXPECT_EQ(given_up.profiles[4].successes, 1);
}

}  // namespace
}  // namespace segsim::experiments
