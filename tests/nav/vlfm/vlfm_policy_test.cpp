#include "nav/vlfm/vlfm_policy.h"

#include <gmock/gmock.h>

#include "core/check.h"
#include "tests/nav/box_world.h"
#include "tests/nav/robots.h"
#include "tests/nav/test_view.h"

namespace segsim::nav {
namespace {

using namespace test;

constexpr double kMast_m = 1.1;

SimulationOptions small_camera(std::uint64_t seed) {
  SimulationOptions options;
  options.camera = core::CameraIntrinsics::from_fov(96, 72, 1.3788);
  options.min_object_px = 15;
  options.mast_m = kMast_m;
  options.seed = seed;
  options.period_s = 0.25;
  options.time_limit_s = 120.0;
  return options;
}

VlfmRules with(Quirk quirk, Rule rule, Rule others = Rule::kFixed) {
  VlfmRules rules(others);
  rules.set(quirk, rule);
  return rules;
}

SimulationResult search(const VlfmOptions& options, const core::Pose2& start,
                        std::optional<Box> object, std::uint64_t seed = 1) {
  BoxWorld world = four_rooms();
  world.object = object;
  auto policy = make_vlfm_policy(options);
  return run_episode(world, start, small_camera(seed), *policy);
}

TEST(VlfmPolicy, PublishedNumbers) {  // A15
  const VlfmOptions o = published_vlfm();
  EXPECT_EQ(o.rules.text(), "vlfm");
  EXPECT_EQ(o.spin_turns, 12);
  EXPECT_EQ(o.stop_radius_m, 0.9);
  EXPECT_EQ(o.min_score, 0.8);
  EXPECT_FALSE(o.second_look);
  EXPECT_EQ(o.actions.forward_m, 0.25);
  EXPECT_NEAR(o.actions.turn_rad * o.spin_turns, 2.0 * kPi, 1e-6);
  EXPECT_EQ(o.obstacles.band_min_m, 0.61);
  EXPECT_EQ(o.obstacles.band_max_m, 0.88);
  EXPECT_EQ(o.obstacles.robot_radius_m, 0.18);
  EXPECT_EQ(o.obstacles.depth.min_depth_m, 0.5);
  EXPECT_EQ(o.obstacles.depth.max_depth_m, 5.0);
  EXPECT_EQ(o.obstacles.depth.hole_area_px2, 100'000.0);
  EXPECT_EQ(o.obstacles.frontiers.min_pocket_m2, 1.5);
  EXPECT_EQ(o.obstacles.frontiers.explored_dilation_cells, 5);
  EXPECT_EQ(o.obstacles.frontiers.blur_cells, 3);
  EXPECT_EQ(o.obstacles.fog.overshoot, 1.05);
  EXPECT_EQ(o.obstacles.fog.cut_thickness_cells, 2);
  EXPECT_EQ(o.obstacles.fog.max_gap_cells, 3.0);
  EXPECT_EQ(o.values.min_confidence, 0.25);
  EXPECT_EQ(o.values.decision_threshold, 0.35);
  EXPECT_EQ(o.values.fusion, FusionRule::kWeighted);
  EXPECT_EQ(o.value_radius_m, 0.5);
  EXPECT_EQ(o.choice.unseen_value, -1.0);
  EXPECT_EQ(o.choice.stick_radius_m, 0.5);
  EXPECT_EQ(o.choice.stick_margin, 0.01);
  EXPECT_EQ(o.choice.tie_margin, 0.0);
  EXPECT_EQ(o.cloud.erosion_passes, 5);
  EXPECT_EQ(o.cloud.max_points, 5000);
  EXPECT_EQ(o.cloud.cluster_eps_m, 0.2);
  EXPECT_EQ(o.cloud.cluster_min_points, 100);
  EXPECT_EQ(o.cloud.trusted_share, 0.95);
  EXPECT_EQ(o.cloud.refute_share, 0.5);
  EXPECT_EQ(o.cloud.too_close_m, 1.0);
  EXPECT_EQ(o.cloud.edge_share, 0.05);
  EXPECT_EQ(o.cloud.keep_below_m, 0.1);
  EXPECT_EQ(o.cloud.keep_far_below_m, 0.5);
  EXPECT_EQ(o.cloud.far_m, 2.0);
  const GrowthOptions grid = published_square();
  EXPECT_EQ(grid.start_extent_m / grid.resolution_m, 1000.0);
}

TEST(VlfmPolicy, FixedRulesFindTheObjectFromEverywhere) {
  const std::array<core::Pose2, 3> starts{{{1.0, 2.6, 0.0}, {9.3, 4.0, 3.1}, {3.0, 5.4, 2.0}}};
  const std::array<Box, 3> objects{{{{9.3, 7.3, 0.0}, {9.8, 7.8, 0.9}},
                                    {{0.2, 5.2, 0.0}, {0.7, 5.7, 0.8}},
                                    {{5.2, 0.3, 0.0}, {5.8, 0.8, 0.8}}}};
  int successes = 0;
  for (std::size_t k = 0; k < starts.size() * objects.size(); ++k) {
    const SimulationResult result = search(vlfm_for(test::jackal(), VlfmRules(), kMast_m),
                                           starts[k / 3], objects[k % 3], k + 1);
    successes += result.success() ? 1 : 0;
    EXPECT_TRUE(result.spun);
    EXPECT_LE(result.contacts, 3);
    if (!result.success()) {
      std::printf("object %zu start %zu: '%s' after %.1f s, %.2f m away\n", k % 3, k / 3,
                  result.stop_reason.c_str(), result.time_s, result.to_object_m);
    }
  }
  EXPECT_GE(successes, 8);
}

TEST(VlfmPolicy, DiscreteActionsFindItToo) {
  for (const GridPlanner planner : {GridPlanner::kAstar, GridPlanner::kFastMarching}) {
    VlfmOptions options = vlfm_for(test::jackal(), VlfmRules(), kMast_m);
    options.motion = Motion::kDiscrete;
    GridLocalOptions local;
    local.planner = planner;
    options.local = make_grid_local_policy(local);
    const SimulationResult result =
        search(options, {1.0, 2.6, 0.0}, Box{{5.2, 0.3, 0.0}, {5.8, 0.8, 0.8}});
    EXPECT_TRUE(result.success()) << result.stop_reason << " " << result.to_object_m;
  }
}

TEST(VlfmPolicy, TheFirstTurnsAreTwelve) {
  // Counted on a script of observations: nothing else turns left twelve times in a row.
  VlfmOptions options = vlfm_for(test::jackal(), VlfmRules(Rule::kVlfm), kMast_m);
  options.motion = Motion::kDiscrete;
  auto policy = make_vlfm_policy(options);
  Simulation simulation(four_rooms(), {5.0, 4.0, 0.0}, small_camera(1));
  policy->reset({"thing", 0}, 1);
  double turned = 0.0, last = 0.0;
  for (int k = 0; k < 200; ++k) {
    const core::Decision d = policy->decide(simulation.observe(), {});
    if (d.mode != core::PolicyMode::kInitialize) break;
    EXPECT_GE(d.command.turn_radps, 0.0);
    EXPECT_EQ(d.command.forward_mps, 0.0);
    simulation.step(d.command);
    turned += core::wrap_angle_rad(simulation.pose().yaw_rad - last);
    last = simulation.pose().yaw_rad;
  }
  EXPECT_NEAR(turned, 2.0 * kPi, 12 * 0.05);
}

TEST(VlfmPolicy, SaysWhenNothingIsLeftToExplore) {
  const SimulationResult result =
      search(vlfm_for(test::jackal(), VlfmRules(), kMast_m), {1.0, 2.6, 0.0}, std::nullopt);
  EXPECT_EQ(result.stop_reason, "no_frontier_left");
  EXPECT_GT(result.path_m, 5.0);
}

/// Stops as soon as it is asked to drive.
class StoppingLocalPolicy final : public LocalPolicy {
 public:
  void reset() override {}
  DiscreteAction act(const core::Observation&, const core::Pose2&, const glm::dvec2&,
                     const CostMap&) override {
    return DiscreteAction::kStop;
  }
};

TEST(VlfmPolicy, StopOfTheLocalPolicyLeaksOnlyAsPublished) {  // Q5
  for (const Rule rule : {Rule::kVlfm, Rule::kFixed}) {
    VlfmOptions options = vlfm_for(test::jackal(), with(Quirk::kLocalStop, rule), kMast_m);
    options.motion = Motion::kDiscrete;
    options.local = std::make_shared<StoppingLocalPolicy>();
    const SimulationResult result = search(options, {1.0, 2.6, 0.0}, std::nullopt);
    // Fixed: every frontier is given up, one after the other.
    EXPECT_EQ(result.stop_reason, rule == Rule::kVlfm ? "pointnav_stop" : "no_frontier_left");
  }
}

TEST(VlfmPolicy, StuckIsNoticedOnlyWhenFixed) {  // Q6
  for (const Rule rule : {Rule::kVlfm, Rule::kFixed}) {
    VlfmOptions options = vlfm_for(test::jackal(), with(Quirk::kNoRecovery, rule), kMast_m);
    BoxWorld world = four_rooms();
    const core::Pose2 start{6.0, 4.0, 0.0};
    for (const double d : {-0.4, 0.3}) {  // Glass all around.
      world.invisible.push_back({{5.6, 4.0 + d, 0.0}, {6.4, 4.1 + d, 0.5}});
      world.invisible.push_back({{6.0 + d, 3.6, 0.0}, {6.1 + d, 4.4, 0.5}});
    }
    SimulationOptions camera = small_camera(7);
    camera.time_limit_s = 240.0;  // What was felt is felt anew with each inflation.
    auto policy = make_vlfm_policy(options);
    const SimulationResult result = run_episode(world, start, camera, *policy);
    EXPECT_EQ(result.recovered, rule == Rule::kFixed);
    if (rule == Rule::kFixed) {
      EXPECT_EQ(result.stop_reason, "no_frontier_left");
    } else {
      EXPECT_EQ(result.stop_reason, "");
    }
  }
}

/// The object is in view and no way leads to it: glass that the camera does not see.
TEST(VlfmPolicy, AGoalBehindGlassIsGivenUp) {
  BoxWorld world;
  WorldBuilder b;
  b.wall_x(0, 0, 6);
  b.wall_x(4, 0, 6);
  b.wall_y(0, 0, 4);
  b.wall_y(6, 0, 4);
  world = b.world;
  world.object = Box{{5.2, 1.7, 0.0}, {5.7, 2.3, 0.9}};
  world.invisible.push_back({{3.6, 0.0, 0.0}, {3.7, 4.0, 2.0}});
  SimulationOptions camera = small_camera(3);
  camera.time_limit_s = 400.0;
  auto policy = make_vlfm_policy(vlfm_for(test::jackal(), VlfmRules(), kMast_m));
  const SimulationResult result = run_episode(world, {1.2, 2.0, 0.0}, camera, *policy);
  EXPECT_EQ(result.stop_reason, "nothing_new");
  EXPECT_TRUE(result.navigated);
  EXPECT_GT(result.to_object_m, 1.0);
}

/// Everything within reach of the eyes is black: no depth at all.
TEST(VlfmPolicy, ACameraWithoutDepthEndsTheSearch) {
  for (const double give_up_s : {10.0, 1e6}) {
    VlfmOptions options = vlfm_for(test::jackal(), VlfmRules(), kMast_m);
    options.give_up_s = give_up_s;
    auto policy = make_vlfm_policy(options);
    policy->reset({"thing", 0}, 1);
    TestView view({}, kNan, kMast_m);
    core::Decision decision;
    for (int k = 0; k < 160 && !decision.stop; ++k) {  // 40 s: once with each inflation.
      view.observation.capture_time_ns = k * core::kNsPerSecond / 4;
      decision = policy->decide(view.observation, {});
    }
    EXPECT_STREQ(core::to_string(decision.stop), give_up_s < 100.0 ? "nothing_new" : "");
  }
}

TEST(VlfmPolicy, LeavingTheMapEndsTheEpisodeAsPublished) {  // Q9
  for (const Rule rule : {Rule::kVlfm, Rule::kFixed}) {
    auto policy =
        make_vlfm_policy(vlfm_for(test::jackal(), with(Quirk::kMapEdge, rule), kMast_m));
    policy->reset({"thing", 0}, 1);
    TestView view({}, 3.0F, kMast_m);
    EXPECT_FALSE(policy->decide(view.observation, {}).stop);
    view.move_to({26.0, 0.0, 0.0});
    view.observation.capture_time_ns = core::kNsPerSecond;
    const core::Decision decision = policy->decide(view.observation, {});
    EXPECT_STREQ(core::to_string(decision.stop), rule == Rule::kVlfm ? "map_exhausted" : "");
  }
}

TEST(VlfmPolicy, SecondLookRefutesWhatIsNotThere) {
  // One false detection on the wardrobe.
  for (const bool second_look : {false, true}) {
    VlfmOptions options = vlfm_for(test::jackal(), VlfmRules(), kMast_m);
    options.second_look = second_look;
    SimulationOptions camera = small_camera(4);
    camera.time_limit_s = 300.0;  // The sweep at the end takes its time.
    camera.false_positives.push_back({0, {20, 20, 80, 60}});
    auto policy = make_vlfm_policy(options);
    const SimulationResult result =
        run_episode(four_rooms(), {8.0, 2.4, 0.0}, camera, *policy);
    EXPECT_EQ(result.stop_reason, second_look ? "no_frontier_left" : "goal_reached");
  }
}

TEST(VlfmPolicy, EqualSeedsGiveEqualTracks) {
  for (const Rule rule : {Rule::kVlfm, Rule::kFixed}) {
    VlfmOptions options = vlfm_for(test::jackal(), VlfmRules(rule), kMast_m);
    const Box object{{5.2, 0.3, 0.0}, {5.8, 0.8, 0.8}};
    const SimulationResult a = search(options, {3.0, 5.4, 2.0}, object, 5);
    const SimulationResult b = search(options, {3.0, 5.4, 2.0}, object, 5);
    ASSERT_EQ(a.track.size(), b.track.size());
    for (std::size_t k = 0; k < a.track.size(); ++k) {
      ASSERT_EQ(a.track[k].x_m, b.track[k].x_m);
      ASSERT_EQ(a.track[k].yaw_rad, b.track[k].yaw_rad);
    }
    EXPECT_EQ(a.stop_reason, b.stop_reason);
  }
}

TEST(VlfmPolicy, DegenerateInputHasADefinedOutcome) {
  const float infinity = std::numeric_limits<float>::infinity();
  for (const Rule rule : {Rule::kVlfm, Rule::kFixed}) {
    for (const float depth : {kNan, infinity, 0.0F}) {
      auto policy = make_vlfm_policy(vlfm_for(test::jackal(), VlfmRules(rule), kMast_m));
      policy->reset({"thing", 0}, 1);
      TestView view({}, depth, kMast_m);
      const core::Detection everywhere{0, 0.9F, {-10, -10, 1000, 1000}};
      for (int k = 0; k < 40; ++k) {
        view.observation.capture_time_ns = k * core::kNsPerSecond / 4;
        view.move_to({0.0, 0.0, 0.3 * k});
        const core::Decision d = policy->decide(view.observation, {&everywhere, 1});
        ASSERT_TRUE(std::isfinite(d.command.forward_mps + d.command.turn_radps));
        if (d.stop) break;
      }
    }
    auto policy = make_vlfm_policy(vlfm_for(test::jackal(), VlfmRules(rule), kMast_m));
    policy->reset({"thing", -1}, 1);  // The detector cannot name it.
    TestView view({}, 3.0F, kMast_m);
    view.move_to({std::nan(""), 0.0, 0.0});
    const core::Decision d = policy->decide(view.observation, {});
    EXPECT_FALSE(d.stop);
    EXPECT_EQ(d.command.forward_mps, 0.0);
    EXPECT_THROW((void)make_vlfm_policy([] {
                   VlfmOptions bad;
                   bad.stop_radius_m = 0.0;
                   return bad;
                 }()),
                 core::ContractViolation);
  }
}

TEST(VlfmPolicy, StartInsideAnObstacle) {
  const core::Pose2 on_the_bed{1.2, 1.0, 0.0};
  SimulationOptions camera = small_camera(1);
  camera.time_limit_s = 180.0;  // It tries with each inflation.
  for (const Rule rule : {Rule::kVlfm, Rule::kFixed}) {
    auto policy = make_vlfm_policy(vlfm_for(test::jackal(), VlfmRules(rule), kMast_m));
    const SimulationResult result = run_episode(four_rooms(), on_the_bed, camera, *policy);
    // It cannot get off. Fixed, it notices and says so; published, it has no way to.
    EXPECT_LT(result.path_m, 1.0);
    if (rule == Rule::kFixed) {
      EXPECT_TRUE(result.recovered);
      EXPECT_EQ(result.stop_reason, "nothing_new");
    } else {
      EXPECT_FALSE(result.recovered);
      EXPECT_EQ(result.stop_reason, "");
    }
  }
}

/// A passage of 0.55 m, through which the robot (0.43 m wide) fits, and no other way.
TEST(VlfmPolicy, SqueezesThroughANarrowPassageAtLast) {
  WorldBuilder b;
  b.wall_x(0, 0, 6);
  b.wall_x(4, 0, 6);
  b.wall_y(0, 0, 4);
  b.wall_y(6, 0, 4);
  b.add(2.9, 0.0, 0.0, 3.1, 1.725, 0.5);
  b.add(2.9, 2.275, 0.0, 3.1, 4.0, 0.5);
  b.world.object = Box{{5.2, 1.7, 0.0}, {5.7, 2.3, 0.9}};
  for (const double last_m : {0.28, 0.235}) {
    VlfmOptions options = vlfm_for(test::jackal(), VlfmRules(), kMast_m);
    options.tight_radii_m = {0.28, last_m};
    SimulationOptions camera = small_camera(2);
    camera.body_radius_m = 0.22;
    camera.time_limit_s = 300.0;
    auto policy = make_vlfm_policy(options);
    const SimulationResult result = run_episode(b.world, {1.2, 2.0, 0.0}, camera, *policy);
    EXPECT_EQ(result.success(), last_m < 0.28)
        << result.stop_reason << " at " << result.pose.x_m << ", " << result.pose.y_m;
  }
}

/// Corners that only far views covered are looked at before the search ends.
TEST(VlfmPolicy, SweepsWhatWasSeenOnlyFromAfar) {
  double path_m[2] = {0.0, 0.0};
  for (const int places : {0, 4}) {
    VlfmOptions options = vlfm_for(test::jackal(), VlfmRules(), kMast_m);
    options.sweep.most_places = places;
    const SimulationResult result = search(options, {1.0, 2.6, 0.0}, std::nullopt);
    EXPECT_EQ(result.stop_reason, "no_frontier_left");
    path_m[places == 0 ? 0 : 1] = result.path_m;
  }
  EXPECT_GT(path_m[1], path_m[0] + 0.5);
}

TEST(VlfmPolicy, TenThousandStepsStayBounded) {
  // The maps and the cloud, without the decisions: fifty times round the same circle.
  VlfmOptions options = vlfm_for(test::jackal(), VlfmRules(), kMast_m);
  options.obstacles.growth.max_extent_m = options.values.growth.max_extent_m = 40.0;
  options.obstacles.depth.max_depth_m = options.values.max_depth_m = 2.0;
  ObstacleMap obstacles(options.obstacles);
  ValueMap values(options.values);
  ClassCloud cloud(options.cloud);
  TestView view({}, 1.5F, kMast_m, 24, 18);
  const core::Image<std::uint8_t> mask(24, 18, 1);
  std::size_t after_one_round = 0;
  for (int step = 0; step < 10'000; ++step) {
    const double a = 2.0 * kPi * (step % 200) / 200.0;
    if (step == 200) after_one_round = cloud.points().size();
    view.move_to({10.0 * std::cos(a), 10.0 * std::sin(a), a + 0.5 * kPi});
    obstacles.update(view.observation);
    values.update(view.observation, 0.5);
    if (step % 10 == 0) (void)cloud.add(view.observation, mask);
  }
  EXPECT_FALSE(obstacles.exhausted());
  EXPECT_LE(obstacles.frame().width_cells, 800);
  EXPECT_LE(values.frame().width_cells, 800);
  EXPECT_GT(after_one_round, 1000U);
  EXPECT_EQ(cloud.points().size(), after_one_round);
}

TEST(VlfmPolicy, RouteOfTargets) {  // Q14
  const std::vector<std::string> coco{"chair", "couch", "tv"};
  VlfmRules published(Rule::kVlfm);
  const auto is = [](const DetectorRoute& route, bool closed_set, bool open_set) {
    return route.closed_set == closed_set && route.open_set == open_set;
  };
  EXPECT_TRUE(is(route_target("chair", coco, {"chair"}, published), true, false));
  EXPECT_TRUE(is(route_target("chair", coco, {"chair"}, VlfmRules()), false, true));
  EXPECT_TRUE(is(route_target("chair", coco, {}, VlfmRules()), true, false));
  EXPECT_TRUE(is(route_target("armchair", coco, {}, published), false, true));
  EXPECT_TRUE(is(route_target("armchair", coco, {}, VlfmRules()), false, true));
  EXPECT_TRUE(is(route_target("couch|sofa", coco, {}, published), true, true));
}

}  // namespace
}  // namespace segsim::nav
