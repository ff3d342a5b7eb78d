#include "nav/policies/policy_factory.h"

#include <gtest/gtest.h>

#include "core/error.h"
#include "tests/nav/box_world.h"
#include "tests/nav/test_view.h"

namespace segsim::nav {
namespace {

PolicySettings read(const std::string& text) {
  const core::ConfigNode root = core::ConfigNode::parse("policy: " + text + "\n", "spec.yaml");
  return read_policy_settings(root.child("policy"), [](const core::ConfigNode& node) {
    return std::filesystem::path(node.as_text());
  });
}

std::string refusal(const std::string& text) {
  try {
    (void)read(text);
  } catch (const core::InputError& error) {
    return error.what();
  }
  return "accepted";
}

TEST(PolicyFactory, EveryNameMakesAPolicyThatDecides) {
  for (const std::string& name : policy_names()) {
    PolicySettings settings =
        name == "script" ? read("{type: script, actions: [left]}") : read(name);
    PolicyContext context;
    context.class_names = {"thing"};
    context.camera_height_m = 1.1;
    context.oracle = [](const glm::dvec2& from) {
      return std::vector<glm::dvec2>{from, from + glm::dvec2(1.0, 0.0)};
    };
    const auto policy = make_policy(settings, context);
    test::BoxWorld world = test::four_rooms();
    test::SimulationOptions options;
    options.camera = core::CameraIntrinsics::from_fov(64, 48, 1.3788);
    options.time_limit_s = 8.0;
    const test::SimulationResult result =
        test::run_episode(world, {5.0, 4.0, 0.0}, options, *policy);
    EXPECT_GT(result.ticks, 0) << name;
  }
}

TEST(PolicyFactory, SettingsAreRead) {
  EXPECT_EQ(read("frontier").type, "frontier");
  const PolicySettings vlfm = read(
      "{type: vlfm, parity: vlfm, quirks: {Q4: fixed, Q14: fixed}, motion: discrete, planner: "
      "fast-marching, fusion: replace, min_score: 0.8, scorer: constant}");
  EXPECT_TRUE(vlfm.rules.published(Quirk::kAcyclicMemory));
  EXPECT_FALSE(vlfm.rules.published(Quirk::kObstaclesStay));
  EXPECT_FALSE(vlfm.rules.published(Quirk::kClosedSetRoute));
  EXPECT_EQ(vlfm.rules.text(), "fixed, vlfm: Q1 Q2 Q3 Q5 Q6 Q7 Q8 Q9 Q10 Q11 Q12 Q13");
  EXPECT_EQ(vlfm.motion, Motion::kDiscrete);
  EXPECT_EQ(vlfm.planner, GridPlanner::kFastMarching);
  EXPECT_EQ(vlfm.fusion, FusionRule::kReplace);
  EXPECT_EQ(vlfm.min_score, 0.8);
  EXPECT_FALSE(vlfm.second_look);
  EXPECT_TRUE(read("{type: vlfm}").second_look);
  EXPECT_EQ(read("{type: vlfm}").rules.text(), "fixed");
  EXPECT_EQ(read("{type: vlfm}").give_up_s, 45.0);
  EXPECT_EQ(read("{type: vlfm, give_up_s: 0}").give_up_s, 0.0);
  EXPECT_TRUE(read("{type: vlfm}").clean_cloud);
  EXPECT_FALSE(read("{type: vlfm, clean_cloud: false}").clean_cloud);
  const PolicySettings script = read("{type: script, actions: [left*12, forward*3, stop]}");
  ASSERT_EQ(script.actions.size(), 16U);
  EXPECT_EQ(script.actions[11], DiscreteAction::kTurnLeft);
  EXPECT_EQ(script.actions[12], DiscreteAction::kForward);
  EXPECT_EQ(script.actions[15], DiscreteAction::kStop);
}

PolicyContext things() {
  PolicyContext context;
  context.class_names = {"thing"};
  return context;
}

/// The camera measures nothing, so nothing new can turn up.
TEST(PolicyFactory, GivingUpCanBeTimedOrSwitchedOff) {
  for (const bool gives_up : {true, false}) {
    const std::string seconds = gives_up ? "5" : "0";
    const auto policy =
        make_policy(read("{type: vlfm, give_up_s: " + seconds + "}"), things());
    policy->reset({"thing", 0}, 1);
    test::TestView view({}, test::kNan, 1.2);
    core::Decision decision;
    for (int k = 0; k < 80 && !decision.stop; ++k) {  // 20 s: once with each inflation.
      view.observation.capture_time_ns = k * core::kNsPerSecond / 4;
      decision = policy->decide(view.observation, {});
    }
    EXPECT_STREQ(core::to_string(decision.stop), gives_up ? "nothing_new" : "");
  }
}

/// The box holds nothing but floor.
TEST(PolicyFactory, FloorIsKeptOutOfCleanCloudsOnly) {
  for (const bool clean : {true, false}) {
    const std::string word = clean ? "true" : "false";
    const auto policy = make_policy(read("{type: vlfm, clean_cloud: " + word + "}"), things());
    policy->reset({"thing", 0}, 1);
    test::TestView view({}, 5.0F, 1.2);
    const core::CameraIntrinsics& camera = view.observation.intrinsics;
    for (int y = 0; y < view.depth.height_px(); ++y) {
      const double down = (y + 0.5 - camera.cy_px) / camera.fy_px;
      for (int x = 0; x < view.depth.width_px() && down > 0.3; ++x) {
        view.depth(x, y) = static_cast<float>(1.2 / down);
      }
    }
    const auto third = static_cast<float>(camera.width_px) / 3.0F;
    core::Detection floor;
    floor.class_index = 0;
    floor.score = 1.0F;
    floor.box = {third, static_cast<float>(camera.cy_px + 0.35 * camera.fy_px), 2.0F * third,
                 static_cast<float>(camera.height_px) - 1.0F};
    (void)policy->decide(view.observation, {{floor}});
    EXPECT_EQ(policy->view().objects.empty(), clean);
  }
}

TEST(PolicyFactory, EachQuirkCanBeSwitchedByItself) {
  for (std::size_t k = 0; k < kQuirks; ++k) {
    const PolicySettings settings =
        read("{type: vlfm, quirks: {" + quirk_names()[k] + ": vlfm}}");
    for (std::size_t other = 0; other < kQuirks; ++other) {
      EXPECT_EQ(settings.rules.published(static_cast<Quirk>(other)), other == k);
    }
  }
}

TEST(PolicyFactory, MistakesAreNamed) {
  EXPECT_NE(refusal("vlmf").find("near: vlfm"), std::string::npos);
  EXPECT_NE(refusal("vlmf").find("spec.yaml:1"), std::string::npos);
  EXPECT_NE(refusal("{type: vlfm, parity: both}").find("vlfm | fixed"), std::string::npos);
  EXPECT_NE(refusal("{type: vlfm, quirks: {Q15: vlfm}}").find("Q15"), std::string::npos);
  EXPECT_NE(refusal("{type: vlfm, motoin: discrete}").find("motoin"), std::string::npos);
  EXPECT_NE(refusal("{type: frontier, parity: vlfm}").find("parity"), std::string::npos);
  EXPECT_NE(refusal("script").find("actions"), std::string::npos);
  EXPECT_NE(refusal("{type: script, actions: [jump]}").find("jump"), std::string::npos);
  EXPECT_NE(refusal("{type: script, actions: [left*0]}").find("count"), std::string::npos);
  EXPECT_NE(refusal("{type: script, actions: [left*x]}").find("count"), std::string::npos);
  EXPECT_NE(refusal("{type: vlfm, min_score: 2}").find("[0, 1]"), std::string::npos);
  EXPECT_NE(refusal("{type: vlfm, give_up_s: -1}").find("0 (never) or more"),
            std::string::npos);
  EXPECT_NE(refusal("{type: vlfm, sweep: false, give_up_s: 9}").find("sweep"),
            std::string::npos);
  EXPECT_NE(refusal("{type: vlfm, parity: vlfm, clean_cloud: true}").find("approach"),
            std::string::npos);
  EXPECT_EQ(refusal("{type: vlfm, sweep: false, give_up_s: 0}"), "accepted");
  EXPECT_NE(refusal("{type: vlfm, prior: missing.yaml}").find("missing.yaml"),
            std::string::npos);
  EXPECT_NE(refusal("{type: random, stop_chance: -1}").find("[0, 1]"), std::string::npos);
}

}  // namespace
}  // namespace segsim::nav
