#include "nav/policies/policy_registry.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <fstream>

#include "core/check.h"
#include "core/error.h"
#include "nav/mapping/depth_inference.h"
#include "nav/objects/segmenter.h"
#include "nav/policies/built_in_policies.h"
#include "nav/value/image_text_scorer.h"
#include "tests/nav/box_world.h"
#include "tests/nav/robots.h"
#include "tests/nav/test_view.h"
#include "tests/temporary_folder.h"

namespace segsim::nav {
namespace {

PolicyChoice read(const std::string& text,
                  const PolicyRegistry& registry = PolicyRegistry::instance()) {
  const core::ConfigNode root = core::ConfigNode::parse("policy: " + text + "\n", "spec.yaml");
  return registry.read(root.child("policy"), [](const core::ConfigNode& node) {
    return std::filesystem::path(node.as_text());
  });
}

VlfmSettings vlfm(const std::string& text) { return *read(text).settings<VlfmSettings>(); }

std::string refusal(const std::string& text) {
  try {
    (void)read(text);
  } catch (const core::InputError& error) {
    return error.what();
  }
  return "accepted";
}

TEST(PolicyRegistry, EveryNameMakesAPolicyThatDecides) {
  const PolicyRegistry registry;
  for (const std::string& name : registry.names()) {
    const PolicyChoice choice = name == "script"    ? read("{type: script, actions: [left]}")
                                : name == "process" ? read("{type: process, command: [mine]}")
                                                    : read(name);
    EXPECT_EQ(choice.name(), name);
    PolicyContext context;
    context.class_names = {"thing"};
    context.robot = test::jackal();
    context.camera_height_m = 1.1;
    context.oracle = [](const glm::dvec2& from) {
      return std::vector<glm::dvec2>{from, from + glm::dvec2(1.0, 0.0)};
    };
    context.models.process = [](const core::PeerCommand& command, const PolicyContext& of) {
      EXPECT_EQ(command.in_words(), "mine");
      EXPECT_EQ(of.camera_height_m, 1.1);
      return make_random_policy();
    };
    context.models.ros2 = [](const Ros2Settings& settings, const PolicyContext& of) {
      EXPECT_EQ(settings, Ros2Settings());
      EXPECT_EQ(of.camera_height_m, 1.1);
      return make_random_policy();
    };
    const auto policy = choice.make(context);
    test::BoxWorld world = test::four_rooms();
    test::SimulationOptions options;
    options.camera = core::CameraIntrinsics::from_fov(64, 48, 1.3788);
    options.time_limit_s = 8.0;
    const test::SimulationResult result =
        test::run_episode(world, {5.0, 4.0, 0.0}, options, *policy);
    EXPECT_GT(result.ticks, 0) << name;
  }
}

TEST(PolicyRegistry, SettingsAreRead) {
  EXPECT_EQ(read("frontier").name(), "frontier");
  const VlfmSettings published = vlfm(
      "{type: vlfm, parity: vlfm, quirks: {Q4: fixed, Q14: fixed}, motion: discrete, planner: "
      "fast-marching, fusion: replace, min_score: 0.8, scorer: constant}");
  EXPECT_TRUE(published.rules.published(Quirk::kAcyclicMemory));
  EXPECT_FALSE(published.rules.published(Quirk::kObstaclesStay));
  EXPECT_FALSE(published.rules.published(Quirk::kClosedSetRoute));
  EXPECT_EQ(published.rules.text(), "fixed, vlfm: Q1 Q2 Q3 Q5 Q6 Q7 Q8 Q9 Q10 Q11 Q12 Q13");
  EXPECT_EQ(published.motion, Motion::kDiscrete);
  EXPECT_EQ(published.planner, GridPlanner::kFastMarching);
  EXPECT_EQ(published.fusion, FusionRule::kReplace);
  EXPECT_EQ(published.min_score, 0.8);
  EXPECT_EQ(published.scorer.type, "constant");
  EXPECT_FALSE(published.second_look);
  EXPECT_TRUE(vlfm("{type: vlfm}").second_look);
  EXPECT_EQ(vlfm("{type: vlfm}").motion, Motion::kPursuit);
  EXPECT_EQ(vlfm("{type: vlfm}").rules.text(), "fixed");
  EXPECT_EQ(vlfm("{type: vlfm}").give_up_s, 45.0);
  EXPECT_EQ(vlfm("{type: vlfm, give_up_s: 0}").give_up_s, 0.0);
  EXPECT_TRUE(vlfm("{type: vlfm}").clean_cloud);
  EXPECT_FALSE(vlfm("{type: vlfm, clean_cloud: false}").clean_cloud);
  EXPECT_TRUE(vlfm("{type: vlfm, follower: dwa}").dynamic_window);
  const PolicyChoice frontier = read("{type: frontier, follower: dwa, rival_iou: 1}");
  EXPECT_TRUE(frontier.settings<FrontierSettings>()->dynamic_window);
  EXPECT_EQ(frontier.settings<FrontierSettings>()->rival_iou, 1.0);
  EXPECT_EQ(frontier.settings<VlfmSettings>(), nullptr);
  const PolicyChoice value = read("{type: frontier-value, scorer: open-space, follower: dwa}");
  EXPECT_TRUE(value.settings<FrontierValueSettings>()->search.dynamic_window);
  EXPECT_EQ(value.settings<FrontierValueSettings>()->scorer.type, "open-space");
  EXPECT_EQ(read("{type: random, stop_chance: 0.5}").settings<RandomSettings>()->stop_chance,
            0.5);
  const PolicyChoice script = read("{type: script, actions: [left*12, forward*3, stop]}");
  const std::vector<DiscreteAction>& actions = script.settings<ScriptSettings>()->actions;
  ASSERT_EQ(actions.size(), 16U);
  EXPECT_EQ(actions[11], DiscreteAction::kTurnLeft);
  EXPECT_EQ(actions[12], DiscreteAction::kForward);
  EXPECT_EQ(actions[15], DiscreteAction::kStop);
}

PolicyContext things() {
  PolicyContext context;
  context.class_names = {"thing"};
  context.robot = test::jackal();
  return context;
}

/// Promises a lot, and says what it was made with.
class FakeScorer final : public ImageTextScorer {
 public:
  double score(const core::Observation&, std::span<const core::Detection>,
               const core::ObjectGoal& target) override {
    targets.push_back(target.text());
    return 0.9;
  }
  std::vector<std::string> targets;
};

/// A wall at one distance, whatever the camera measures.
class FakeDepth final : public DepthInference {
 public:
  void infer(const core::Observation& observation, core::Image<float>& depth_m) override {
    ++calls;
    depth_m = core::Image<float>(observation.depth_m->width_px(),
                                 observation.depth_m->height_px(), 2.0F);
  }
  int calls = 0;
};

/// A camera that measures nothing explores nothing; with inferred depth the policy knows the
/// wall.
TEST(PolicyRegistry, DepthMayBeInferred) {
  const tests::TemporaryFolder folder;
  std::ofstream(folder / "depth.yaml") << "task: depth";
  const PolicyChoice choice =
      read("{type: vlfm, inferred_depth: " + (folder / "depth.yaml").string() + "}");
  const auto depth = std::make_shared<FakeDepth>();
  PolicyContext context = things();
  context.models.depth = [&](const std::filesystem::path&) { return depth; };
  const auto inferring = choice.make(context);
  const auto measuring = read("vlfm").make(things());
  test::TestView view({}, test::kNan, 1.2);
  const auto obstacles_of = [&](core::Policy& policy) {
    policy.reset({"thing", 0}, 1);
    (void)policy.decide(view.observation, {});
    const core::PolicyView seen = policy.view();
    return std::count(seen.cells.pixels().begin(), seen.cells.pixels().end(), 2);
  };
  EXPECT_GT(obstacles_of(*inferring), 0);
  EXPECT_EQ(depth->calls, 1);
  EXPECT_EQ(obstacles_of(*measuring), 0);
}

TEST(PolicyRegistry, AProcessIsStartedByWhoeverMakesThePolicy) {
  const PolicyChoice choice = read("python:my.module:Mine");
  EXPECT_EQ(choice.name(), "process");
  EXPECT_EQ(choice.settings<ProcessSettings>()->peer.python, "my.module:Mine");
  EXPECT_THROW((void)choice.make(things()), core::InputError) << "nobody starts programs here";
  EXPECT_THROW((void)read("'python:mine'"), core::InputError);
  EXPECT_THROW((void)read("'python:$(rm):Mine'"), core::InputError);
}

TEST(PolicyRegistry, ANetworkIsReachedByWhoeverMakesThePolicy) {
  const PolicyChoice choice =
      read("{type: ros2, domain: 7, distro: humble, cmd_vel: twist_stamped, answer_s: 2}");
  const Ros2Settings& settings = *choice.settings<Ros2Settings>();
  EXPECT_EQ(settings.domain, 7);
  EXPECT_TRUE(settings.humble && settings.stamped && settings.waits && settings.detections);
  EXPECT_EQ(settings.answer_s, 2.0);
  EXPECT_THROW((void)choice.make(things()), core::InputError) << "nobody speaks ROS 2 here";
  EXPECT_THAT(refusal("{type: ros2, domain: 233}"), testing::HasSubstr("[0, 232]"));
  EXPECT_THAT(refusal("{type: ros2, domain: 1.5}"), testing::HasSubstr("whole number"));
  EXPECT_THAT(refusal("{type: ros2, distro: foxy}"), testing::HasSubstr("jazzy"));
  EXPECT_THAT(refusal("{type: ros2, topic: /x}"), testing::HasSubstr("topic"));
}

TEST(PolicyRegistry, ModelsComeFromWhoeverMakesThePolicy) {
  const tests::TemporaryFolder folder;
  for (const char* name : {"clip.yaml", "sam.yaml"}) std::ofstream(folder / name) << "task: x";
  const std::string clip = (folder / "clip.yaml").string();
  const std::string sam = (folder / "sam.yaml").string();
  const PolicyChoice choice = read("{type: vlfm, scorer: {model: " + clip +
                                   ", prompt: \"a {}\"}, segmenter: " + sam + "}");
  EXPECT_EQ(choice.settings<VlfmSettings>()->scorer.model, clip);
  EXPECT_EQ(choice.settings<VlfmSettings>()->segmenter, sam);
  EXPECT_EQ(vlfm("{type: vlfm, scorer: {model: " + clip + "}}").scorer.prompt,
            "Seems like there is a {} ahead.");
  EXPECT_THROW((void)choice.make(things()), core::InputError) << "nobody loads models here";

  PolicyContext context = things();
  const auto scorer = std::make_shared<FakeScorer>();
  std::vector<std::string> loaded;
  context.models.scorer = [&](const std::filesystem::path& model, const std::string& prompt) {
    loaded.push_back(model.filename().string() + " " + prompt);
    return scorer;
  };
  context.models.segmenter = [&](const std::filesystem::path& model) {
    loaded.push_back(model.filename().string());
    return std::shared_ptr<Segmenter>(make_depth_segmenter());
  };
  const auto policy = choice.make(context);
  EXPECT_THAT(loaded, testing::UnorderedElementsAre("clip.yaml a {}", "sam.yaml"));
  policy->reset({"thing", 0}, 1);
  const test::TestView view({}, 3.0F, 1.2);
  (void)policy->decide(view.observation, {});
  EXPECT_THAT(scorer->targets, testing::Contains("thing"));

  EXPECT_THAT(refusal("{type: vlfm, scorer: {model: " + clip + "x}}"),
              testing::HasSubstr("no file"));
  EXPECT_THAT(refusal("{type: vlfm, segmenter: " + sam + "x}"), testing::HasSubstr("no file"));
  EXPECT_THAT(refusal("{type: vlfm, scorer: {model: " + clip + ", prompt: here}}"),
              testing::HasSubstr("{}"));
  EXPECT_THAT(refusal("{type: vlfm, scorer: {model: " + clip + ", promt: x}}"),
              testing::HasSubstr("promt"));
  EXPECT_THAT(refusal("{type: vlfm, scorer: {model: " + clip + "}, prior: " + clip + "}"),
              testing::HasSubstr("prior"));
}

/// The camera measures nothing, so nothing new can turn up.
TEST(PolicyRegistry, GivingUpCanBeTimedOrSwitchedOff) {
  for (const bool gives_up : {true, false}) {
    const std::string seconds = gives_up ? "5" : "0";
    const auto policy = read("{type: vlfm, give_up_s: " + seconds + "}").make(things());
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
TEST(PolicyRegistry, FloorIsKeptOutOfCleanCloudsOnly) {
  for (const bool clean : {true, false}) {
    const std::string word = clean ? "true" : "false";
    const auto policy = read("{type: vlfm, clean_cloud: " + word + "}").make(things());
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

TEST(PolicyRegistry, EachQuirkCanBeSwitchedByItself) {
  for (std::size_t k = 0; k < kQuirks; ++k) {
    const VlfmSettings settings =
        vlfm("{type: vlfm, quirks: {" + quirk_names()[k] + ": vlfm}}");
    for (std::size_t other = 0; other < kQuirks; ++other) {
      EXPECT_EQ(settings.rules.published(static_cast<Quirk>(other)), other == k);
    }
  }
}

TEST(PolicyRegistry, MistakesAreNamed) {
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

/// Drives straight ahead.
class Straight final : public core::Policy {
 public:
  explicit Straight(double speed_mps) : speed_mps_(speed_mps) {}
  void reset(const core::ObjectGoal&, std::uint64_t) override {}
  core::Decision decide(const core::Observation&, std::span<const core::Detection>) override {
    return {{speed_mps_, 0.0}, core::PolicyMode::kExplore, {}};
  }
  [[nodiscard]] core::PolicyView view() const override { return {}; }

 private:
  double speed_mps_;
};

struct StraightSettings {
  double speed_mps = 0.3;
};

double speed_of(const PolicyChoice& choice) {
  const auto policy = choice.make(things());
  return policy->decide({}, {}).command.forward_mps;
}

TEST(PolicyRegistry, OnesOwnPolicyIsOneCall) {
  PolicyRegistry registry;
  registry.add<StraightSettings>(
      "straight",
      [](const SettingsNode& node, StraightSettings& settings) {
        settings.speed_mps = node.number_or("speed_mps", settings.speed_mps);
      },
      [](const StraightSettings& settings, const PolicyContext& context) {
        return std::make_unique<Straight>(
            std::min(settings.speed_mps, context.robot.max_forward_mps));
      });
  EXPECT_EQ(speed_of(registry.usual("straight")), 0.3);
  EXPECT_EQ(speed_of(read("straight", registry)), 0.3);
  EXPECT_EQ(speed_of(read("{type: straight, speed_mps: 0.1}", registry)), 0.1);
  EXPECT_EQ(speed_of(read("{type: straight, speed_mps: 9}", registry)), 0.8);
  EXPECT_THROW((void)read("{type: straight, speed: 0.1}", registry), core::InputError);
  EXPECT_THROW((void)read("straight"), core::InputError) << "not in the shared registry";

  registry.add("still", [](const PolicyContext&) { return std::make_unique<Straight>(0.0); });
  EXPECT_EQ(speed_of(read("still", registry)), 0.0);
  EXPECT_EQ(speed_of(read("{type: still}", registry)), 0.0);
  EXPECT_THROW((void)read("{type: still, speed_mps: 1}", registry), core::InputError);
  EXPECT_EQ(registry.names().back(), "still");
}

TEST(PolicyRegistry, ANameIsGivenOnce) {
  PolicyRegistry registry;
  const auto make = [](const PolicyContext&) { return std::make_unique<Straight>(0.0); };
  EXPECT_THROW(registry.add("vlfm", make), core::ContractViolation);
  EXPECT_THROW(registry.add("", make), core::ContractViolation);
  EXPECT_THROW((void)registry.usual("nothing"), core::ContractViolation);
  EXPECT_THROW((void)registry.usual("script"), core::ContractViolation) << "needs actions";
}

}  // namespace
}  // namespace segsim::nav
