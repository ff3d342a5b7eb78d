// What the simulator itself costs: one substep of 5 ms, and a scripted drive without camera.
// SEGSIM_BENCH_MESH names a collision mesh (collision.ply of a bundle); default: flat 3.
#include <cmath>
#include <cstdlib>

#include <benchmark/benchmark.h>

#include "core/random.h"
#include "sim/trial/trial.h"
#include "worlds/procedural/procedural_flat.h"

namespace segsim::sim {
namespace {

TriangleMesh bench_mesh() {
  if (const char* file = std::getenv("SEGSIM_BENCH_MESH")) return read_mesh_ply(file);
  worlds::FlatOptions options;
  options.seed = 3;
  TriangleMesh mesh;
  for (const SubMesh& part : worlds::make_flat(options).meshes) {
    const auto first = static_cast<unsigned>(mesh.positions_m.size());
    mesh.positions_m.insert(mesh.positions_m.end(), part.positions_m.begin(),
                            part.positions_m.end());
    for (const glm::uvec3& t : part.triangles) mesh.triangles.push_back(t + first);
  }
  return mesh;
}

const World& bench_world() {
  static const World world = World::from_mesh(bench_mesh(), RobotModel::jackal_gentle());
  return world;
}

/// Somewhere with room around.
core::Pose2 free_start() {
  core::RandomStream random(1, "bench_start");
  const GridFrame& frame = bench_world().collision().frame();
  for (;;) {
    const glm::dvec2 p =
        frame.origin_m + frame.cell_m * glm::dvec2(random.uniform(0, frame.width),
                                                   random.uniform(0, frame.height));
    if (bench_world().collision().body_distance_m(p) > 1.0) return {p.x, p.y, 0.0};
  }
}

void BM_Substep(benchmark::State& state) {
  const World& world = bench_world();
  Robot robot(world.robot(), free_start());
  core::RandomStream random(1, "bench_drive");
  std::int64_t step = 0;
  int contacts = 0;
  for (auto _ : state) {
    if (step++ % 100 == 0) {
      robot.set_command({random.uniform(-0.2, 0.8), random.uniform(-1.5, 1.5)});
    } else if (step % 20 == 0) {
      robot.set_command({robot.state().forward_mps, robot.state().turn_radps});
    }
    const core::VelocityCommand velocity = robot.update_velocity(0.005);
    const MoveResult moved = world.collision().move(robot.state().pose, velocity, 0.005);
    robot.set_pose(moved.pose);
    if (moved.contact) {
      robot.set_velocity({});
      ++contacts;
    }
  }
  state.counters["contact_share"] =
      static_cast<double>(contacts) / static_cast<double>(state.iterations());
}
BENCHMARK(BM_Substep)->Unit(benchmark::kMicrosecond);

class NoRenderer final : public core::Renderer {
 public:
  using core::Renderer::render;
  void render(const core::CameraPose&, const core::CameraIntrinsics&, core::Channels,
              core::Frame&) override {}
};

class NoDetector final : public core::Detector {
 public:
  const std::vector<std::string>& class_names() const override { return names_; }
  std::vector<core::Detection> detect(const core::Observation&) override { return {}; }

 private:
  std::vector<std::string> names_{"couch"};
};

class Eight final : public core::Policy {
 public:
  void reset(const core::ObjectGoal&, std::uint64_t) override {}
  core::Decision decide(const core::Observation& seen,
                        std::span<const core::Detection>) override {
    // Circles of 0.31 m, to the left and to the right in turns.
    const double turns = core::seconds(seen.capture_time_ns) * 0.8 / 6.2831853;
    const double side = static_cast<int>(turns) % 2 == 0 ? 1.0 : -1.0;
    return {{0.25, 0.8 * side}, core::PolicyMode::kExplore};
  }
  core::PolicyView view() const override { return {}; }
};

/// 60 s; times real time in `real_time_factor`. Arguments: a budget with latencies or none; a
/// goal, to which the distances are computed once per trial, or none.
void BM_ScriptedDrive(benchmark::State& state) {
  const World& world = bench_world();
  Episode episode;
  episode.class_name = "couch";
  episode.start = free_start();
  if (state.range(1) != 0) {
    episode.view_points_m = {{episode.start.x_m, episode.start.y_m}};
  }
  TrialOptions options;
  options.time_limit_s = 60.0;
  if (state.range(0) != 0) {
    options.clock.mode = ClockMode::kVirtual;
    options.clock.budget.resources = {{"gpu", 1}};
    StageBudget detect;
    detect.name = "detect";
    detect.on = "gpu";
    detect.duration.a_ms = 130;
    options.clock.budget.stages = {detect};
  }
  NoRenderer renderer;
  NoDetector detector;
  Eight policy;
  double simulated_s = 0.0;
  for (auto _ : state) {
    const TrialResult result = run_trial({.episode = episode,
                                          .options = options,
                                          .world = world,
                                          .robot = world.robot(),
                                          .renderer = renderer,
                                          .detector = detector,
                                          .policy = policy});
    if (result.path_m < 1.0) state.SkipWithError("ERROR OCCURRED: the robot did not drive");
    if (result.contacts > 0) state.SkipWithError("ERROR OCCURRED: the robot met something");
    simulated_s += result.sim_s;
  }
  state.counters["real_time_factor"] =
      benchmark::Counter(simulated_s, benchmark::Counter::kIsRate);
}
/// Straight on, whatever is in the way; argument: with a turn, or without.
class Pusher final : public core::Policy {
 public:
  explicit Pusher(double turn_radps) : turn_radps_(turn_radps) {}
  void reset(const core::ObjectGoal&, std::uint64_t) override {}
  core::Decision decide(const core::Observation& seen,
                        std::span<const core::Detection>) override {
    const double turn = turn_radps_ * std::cos(core::seconds(seen.capture_time_ns));
    return {{0.5, turn}, core::PolicyMode::kExplore};
  }
  core::PolicyView view() const override { return {}; }

 private:
  double turn_radps_;
};

void BM_PushingDrive(benchmark::State& state) {
  const World& world = bench_world();
  Episode episode;
  episode.class_name = "couch";
  episode.start = free_start();
  TrialOptions options;
  options.time_limit_s = 60.0;
  NoRenderer renderer;
  NoDetector detector;
  Pusher policy(static_cast<double>(state.range(0)));
  double simulated_s = 0.0;
  for (auto _ : state) {
    const TrialResult result = run_trial({.episode = episode,
                                          .options = options,
                                          .world = world,
                                          .robot = world.robot(),
                                          .renderer = renderer,
                                          .detector = detector,
                                          .policy = policy});
    if (result.contact_s < 20.0) state.SkipWithError("ERROR OCCURRED: it did not push");
    simulated_s += result.sim_s;
  }
  state.counters["real_time_factor"] =
      benchmark::Counter(simulated_s, benchmark::Counter::kIsRate);
}
BENCHMARK(BM_PushingDrive)->Arg(0)->Arg(1)->Unit(benchmark::kMillisecond);

BENCHMARK(BM_ScriptedDrive)->ArgsProduct({{0, 1}, {0, 1}})->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace segsim::sim
