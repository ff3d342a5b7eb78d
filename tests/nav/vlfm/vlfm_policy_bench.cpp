/// What the size of a map costs: one tick of VLFM and of the frontier policy on the floor of a
/// building, where the maps grow to 30 m x 24 m and VLFM's begin with 50 m x 50 m. Synthetic:
/// boxes for furniture, depth images of 160 x 120 enlarged to 640 x 480, no detection, no
/// value scorer; the simulator's time is not counted. Ticks as a run has them, with real
/// depth, detections and scorer, are tests/experiments/trials/navigation_tick_bench.cpp.

#include <algorithm>
#include <memory>
#include <vector>

#include <benchmark/benchmark.h>

#include "nav/frontier/frontier_policy.h"
#include "nav/vlfm/vlfm_policy.h"
#include "tests/nav/box_world.h"
#include "tests/nav/robots.h"
#include "tests/thread_time.h"

namespace segsim::nav::test {
namespace {

using tests::thread_cpu_s;

constexpr int kScale = 4;

/// The simulator casts every fourth ray of the camera; widened() makes its image 640 x 480.
SimulationOptions camera_options() {
  SimulationOptions options;
  options.camera = core::CameraIntrinsics::from_fov(640 / kScale, 480 / kScale, 1.378810109);
  options.mast_m = 1.2;
  options.pitch_down_rad = 0.14;
  return options;
}

/// The observation with an image of 640 x 480 in `depth_m`.
core::Observation widened(const core::Observation& coarse, core::Image<float>& depth_m) {
  depth_m.resize(640, 480);
  for (int y = 0; y < 480; ++y) {
    for (int x = 0; x < 640; ++x) {
      depth_m(x, y) = (*coarse.depth_m)(x / kScale, y / kScale);
    }
  }
  core::Observation observation = coarse;
  observation.intrinsics = coarse.intrinsics.resized(640, 480);
  observation.depth_m = &depth_m;
  return observation;
}

/// Three by three copies of the four rooms without their side walls: 30 m x 24 m.
BoxWorld building() {
  BoxWorld block = four_rooms(), all;
  all.ceiling_m = block.ceiling_m;
  for (int column = 0; column < 3; ++column) {
    for (int row = 0; row < 3; ++row) {
      for (const Box& box : block.boxes) {
        const glm::dvec3 shift(10.0 * column, 8.0 * row, 0.0);
        // The outer walls get out of the way of the corridors, and of the way north.
        const bool side = box.high.x - box.low.x < 0.2 && box.high.y - box.low.y > 7.0;
        if (side) continue;
        all.boxes.push_back({box.low + shift, box.high + shift});
      }
    }
  }
  return all;
}

void run(benchmark::State& state, const BoxWorld& world, const core::Pose2& start,
         std::unique_ptr<core::Policy> policy) {
  Simulation simulation(world, start, camera_options());
  policy->reset({"thing", 0}, 1);
  std::vector<double> ms;
  core::Image<float> depth_m;
  for (auto _ : state) {
    const core::Observation observation = widened(simulation.observe(), depth_m);
    const double start_s = thread_cpu_s();
    const core::Decision decision = policy->decide(observation, {});
    const double took_s = thread_cpu_s() - start_s;
    state.SetIterationTime(took_s);
    ms.push_back(took_s * 1e3);
    if (decision.stop) policy->reset({"thing", 0}, 1);
    simulation.step(decision.command);
  }
  std::sort(ms.begin(), ms.end());
  const auto at = [&](double share) {
    return ms[static_cast<std::size_t>(share * static_cast<double>(ms.size() - 1))];
  };
  state.counters["p50_ms"] = at(0.5);
  state.counters["p99_ms"] = at(0.99);
  state.counters["cells"] = static_cast<double>(policy->view().cells.size());
}

void BM_VlfmBuilding(benchmark::State& state) {
  VlfmOptions options = vlfm_for(jackal(), VlfmRules(), 1.2);
  options.obstacles.growth.start_extent_m = 50.0;
  options.values.growth.start_extent_m = 50.0;
  run(state, building(), {15.0, 12.0, 0.0}, make_vlfm_policy(options));
}
BENCHMARK(BM_VlfmBuilding)->UseManualTime()->Iterations(400)->Unit(benchmark::kMillisecond);

void BM_FrontierBuilding(benchmark::State& state) {
  run(state, building(), {15.0, 12.0, 0.0}, make_frontier_policy());
}
BENCHMARK(BM_FrontierBuilding)
    ->UseManualTime()
    ->Iterations(400)
    ->Unit(benchmark::kMillisecond);

/// The parts by themselves, on one view of the flat.
template <class Map>
void update_map(benchmark::State& state, Map& map) {
  Simulation simulation(four_rooms(), {5.0, 4.0, 0.3}, camera_options());
  core::Image<float> depth_m;
  const core::Observation observation = widened(simulation.observe(), depth_m);
  for (auto _ : state) {
    if constexpr (std::is_same_v<Map, ValueMap>) {
      map.update(observation, 0.5);
    } else {
      map.update(observation);
    }
  }
}

void BM_ValueMap(benchmark::State& state) {
  ValueMap map;
  update_map(state, map);
}
BENCHMARK(BM_ValueMap)->Unit(benchmark::kMillisecond);

void BM_ObstacleMap(benchmark::State& state) {
  const VlfmOptions options =
      vlfm_for(jackal(), VlfmRules(static_cast<Rule>(state.range(0))), 1.2);
  ObstacleMap map(options.obstacles, options.rules);
  update_map(state, map);
}
BENCHMARK(BM_ObstacleMap)->Arg(0)->Arg(1)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace segsim::nav::test
