// Sensors within the closed loop: what the policy sees of them, and what they leave alone.
#include <cmath>
#include <map>

#include <gtest/gtest.h>

#include "sim/trial/oracle_detector.h"
#include "sim/trial/trial.h"
#include "tests/box_mesh.h"
#include "tests/sim/rooms.h"
#include "tests/sim/trial/box_renderer.h"

namespace segsim::sim {
namespace {

constexpr std::uint16_t kWall = 1, kCouch = 4;
constexpr core::TimeNs kMs = 1'000'000;

/// The couch is white, all else grey.
class PaintedRenderer final : public core::Renderer {
 public:
  using core::Renderer::render;
  void render(const core::CameraPose& T_world_camera, const core::CameraIntrinsics& camera,
              core::Channels channels, core::Frame& frame) override {
    boxes_.render(T_world_camera, camera, channels, frame);
    for (std::size_t k = 0; k < frame.rgb.size(); ++k) {
      const std::uint8_t code = frame.semantic.pixels()[k] == kCouch ? 255 : 100;
      frame.rgb.pixels()[k] = {code, code, code};
    }
    ++calls;
  }
  int calls = 0;

 private:
  BoxRenderer boxes_{{{{5.3, 2.4, 0.0}, {6.0, 4.0, 0.7}, kCouch, 1},
                      {{2.9, 0.0, 0.0}, {3.1, 2.6, 2.0}, kWall, 0}}};
};

/// Turns in place for ten ticks, stands for ten; keeps what it was shown.
class Watcher final : public core::Policy {
 public:
  void reset(const core::ObjectGoal&, std::uint64_t) override { seen.clear(); }
  core::Decision decide(const core::Observation& observation,
                        std::span<const core::Detection>) override {
    Seen& now = seen.emplace_back();
    now.rgb = observation.rgb->pixels();
    now.depth_m = observation.depth_m->pixels();
    now.p_m = observation.T_odom_robot.translation_m();
    const double turn = seen.size() <= 10 ? 0.9 : 0.0;
    core::Decision decision{{0.0, turn}, core::PolicyMode::kExplore};
    if (seen.size() > 20) decision.stop = core::StopReason::kGoalReached;
    return decision;
  }
  core::PolicyView view() const override { return {}; }

  struct Seen {
    std::vector<core::Rgb8> rgb;
    std::vector<float> depth_m;
    glm::dvec3 p_m{0.0};
  };
  std::vector<Seen> seen;
};

class TrialSensors : public testing::Test {
 protected:
  TrialSensors() : world_(World::from_mesh(make_mesh(), robot_, {49.9, 8.9, 0.0, 0.0})) {
    core::SceneManifest manifest;
    manifest.classes = {{kWall, "wall", false}, {kCouch, "couch", true}};
    world_.set_manifest(manifest);
    options_.camera = core::CameraIntrinsics::from_fov(64, 48, 1.4);
    episode_.id = "rooms/couch/00";
    episode_.class_name = "couch";
    episode_.start = {2.0, 3.3, -0.5};
    episode_.view_points_m = {{4.7, 3.3}};
    episode_.seed = 42;
  }
  static TriangleMesh make_mesh() {
    TriangleMesh mesh = make_two_rooms();
    append_box(mesh, {5.3F, 2.4F, 0.0F}, {6.0F, 4.0F, 0.7F});
    return mesh;
  }
  TrialResult run(const std::optional<SensorSettings>& sensors = {}) {
    options_.sensors = sensors ? std::make_shared<const SensorSettings>(*sensors) : nullptr;
    OracleDetector detector(world_.manifest().classes, {"chair", "couch"});
    renderer_.calls = 0;
    const TickObserver observer = [this](const TickRecord& tick, const core::Frame& frame,
                                         const auto&, const auto&) {
      true_depth_[tick.time_ns] = frame.depth_m.pixels();
    };
    return run_trial({.episode = episode_,
                      .options = options_,
                      .world = world_,
                      .robot = robot_,
                      .renderer = renderer_,
                      .detector = detector,
                      .policy = policy_,
                      .truth = &detector,
                      .observer = observer});
  }

  RobotModel robot_ = RobotModel::jackal_gentle();
  World world_;
  TrialOptions options_;
  Episode episode_;
  PaintedRenderer renderer_;
  Watcher policy_;
  std::map<core::TimeNs, std::vector<float>> true_depth_;
};

bool equal_or_nan(const std::vector<float>& a, const std::vector<float>& b) {
  for (std::size_t k = 0; k < a.size(); ++k) {
    if (a[k] != b[k] && !(std::isnan(a[k]) && std::isnan(b[k]))) return false;
  }
  return a.size() == b.size();
}

TEST_F(TrialSensors, SensorsThatNobodyReadsChangeNothing) {
  const TrialResult without = run();
  const auto seen = policy_.seen;
  EXPECT_TRUE(without.sensors.digests().empty());
  EXPECT_TRUE(without.sensors.camera.empty());
  SensorSettings sensors;
  sensors.lidar = {{}, 37 * kMs, 3 * kMs, 0};
  sensors.imu = {{}, 11 * kMs, 0, 0};
  sensors.odometry = {{}, 20 * kMs, 0, 0};
  sensors.gps = {{}, 25 * kMs, 0, 0};
  sensors.compass = {{}, 13 * kMs, 1 * kMs, 0};
  const TrialResult with = run(sensors);
  EXPECT_EQ(with.state_hash, without.state_hash);
  ASSERT_EQ(with.track.size(), without.track.size());
  for (std::size_t k = 0; k < with.track.size(); ++k) {
    EXPECT_EQ(with.track[k].pose.yaw_rad, without.track[k].pose.yaw_rad) << "to the last bit";
  }
  for (std::size_t k = 0; k < seen.size(); ++k) {
    EXPECT_EQ(policy_.seen[k].rgb, seen[k].rgb);
    EXPECT_TRUE(equal_or_nan(policy_.seen[k].depth_m, seen[k].depth_m));
  }
  EXPECT_EQ(with.sensors.digests().size(), 5U);
  EXPECT_EQ(with.sensors.imu.size(), static_cast<std::size_t>(with.sim_s / 0.011));
  EXPECT_EQ(run(sensors).sensors.digests(), with.sensors.digests());
  episode_.seed = 43;
  EXPECT_NE(run(sensors).sensors.digests(), with.sensors.digests());
}

TEST_F(TrialSensors, ThePolicySeesNoiseAndTheJudgeDoesNot) {
  (void)run();
  const auto clean = policy_.seen;
  const auto truth = true_depth_;
  SensorSettings sensors;
  sensors.camera.rgb.full_well_e = 2000.0;
  sensors.camera.rgb.read_noise_e = 10.0;
  sensors.camera.depth.noise = DepthNoise::kKinectAxial;
  const TrialResult result = run(sensors);
  ASSERT_EQ(policy_.seen.size(), clean.size());
  EXPECT_NE(policy_.seen[15].rgb, clean[15].rgb);
  EXPECT_FALSE(equal_or_nan(policy_.seen[15].depth_m, clean[15].depth_m));
  EXPECT_NE(policy_.seen[15].rgb, policy_.seen[16].rgb) << "another capture, another noise";
  double squares = 0.0;
  int count = 0;
  for (std::size_t k = 0; k < clean[15].depth_m.size(); ++k) {
    const float z = clean[15].depth_m[k];
    const float e = (policy_.seen[15].depth_m[k] - z) / kinect_axial_sigma_m(z);
    if (std::isnan(e)) continue;
    squares += e * e;
    ++count;
  }
  ASSERT_GT(count, 500);
  EXPECT_NEAR(squares / count, 1.0, 4.0 * std::sqrt(2.0 / count));
  ASSERT_EQ(true_depth_.size(), truth.size());
  ASSERT_GT(truth.size(), 15U);
  for (const auto& [time_ns, depth_m] : true_depth_) {
    EXPECT_TRUE(equal_or_nan(depth_m, truth.at(time_ns)));
  }
  const auto noisy = policy_.seen;
  EXPECT_EQ(run(sensors).state_hash, result.state_hash);
  EXPECT_EQ(policy_.seen[7].rgb, noisy[7].rgb);
}

/// Pixels of a colour that the renderer does not know.
std::size_t mixed(const std::vector<core::Rgb8>& rgb) {
  return static_cast<std::size_t>(std::count_if(
      rgb.begin(), rgb.end(), [](core::Rgb8 c) { return c.g != 100 && c.g != 255; }));
}

TEST_F(TrialSensors, ATurningCameraBlursItsImage) {
  options_.camera = core::CameraIntrinsics::from_fov(256, 48, 1.4);
  const TrialResult sharp = run();
  const int renders = renderer_.calls;
  const auto clean = policy_.seen;
  SensorSettings sensors;
  sensors.camera.rgb.exposure_s = 0.04;
  sensors.camera.rgb.sub_poses = 5;
  const TrialResult blurred = run(sensors);
  EXPECT_EQ(blurred.state_hash, sharp.state_hash) << "the oracle does not look at colours";
  EXPECT_EQ(mixed(clean[8].rgb), 0U);
  // 0.9 rad/s for 32 ms between the outermost sub-poses: some 5 px of blur at each side of
  // the couch, wherever it is seen.
  EXPECT_GT(mixed(policy_.seen[8].rgb), 40U);
  EXPECT_EQ(policy_.seen[19].rgb, clean[19].rgb) << "a robot that stands sees sharply";
  EXPECT_TRUE(equal_or_nan(policy_.seen[8].depth_m, clean[8].depth_m));
  EXPECT_GE(renderer_.calls, renders + 4 * 9);
  EXPECT_LT(renderer_.calls, renders + 4 * 16) << "none for a robot that stands";
}

TEST_F(TrialSensors, NoisyLocalisation) {
  (void)run();
  const auto exact = policy_.seen;
  options_.localiser = LocaliserModel{};
  const TrialResult result = run();
  double largest_m = 0.0;
  for (std::size_t k = 0; k < exact.size(); ++k) {
    largest_m = std::max(largest_m, std::hypot(policy_.seen[k].p_m.x - exact[k].p_m.x,
                                               policy_.seen[k].p_m.y - exact[k].p_m.y));
  }
  EXPECT_GT(largest_m, 0.005);
  EXPECT_LT(largest_m, 0.5);
  EXPECT_NE(policy_.seen[0].p_m.x, exact[0].p_m.x) << "from the first image on";
  EXPECT_NE(result.final_estimate.x_m, result.track.back().pose.x_m);
  EXPECT_NEAR(result.final_estimate.x_m, result.track.back().pose.x_m, 0.5);
}

TEST_F(TrialSensors, EveryImageIsJudgedForHoles) {
  SensorSettings sensors;
  sensors.camera.hole_limit = 0.01;
  sensors.training_views = std::make_shared<const std::vector<core::CameraPose>>(
      std::vector{core::transform_from_pose2<core::frame::World>({2.0, 4.3, -0.5}) *
                  core::mast_camera(1.2, 0.0)});
  const TrialResult result = run(sensors);
  ASSERT_EQ(result.sensors.camera.size(), static_cast<std::size_t>(result.ticks));
  double holes = 0.0;
  for (const auto& image : result.sensors.camera) {
    holes += image.value.hole_share / result.ticks;
    EXPECT_NEAR(image.value.view_m, 1.0, 1e-9);
    EXPECT_EQ(image.value.render_invalid, image.value.hole_share > 0.01);
  }
  EXPECT_NEAR(holes, result.invalid_pixel_fraction, 1e-12) << "the trial's own mean";
  EXPECT_GT(holes, 0.0) << "sky";
  EXPECT_NEAR(result.sensors.camera.front().value.view_rad, 0.0, 1e-6);
}

}  // namespace
}  // namespace segsim::sim
