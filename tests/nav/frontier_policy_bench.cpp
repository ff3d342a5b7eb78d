/// Map update and whole decisions on a flat of 80 m2, images of 256x192.

#include <ctime>

#include <benchmark/benchmark.h>

#include "nav/frontier_policy.h"
#include "nav/occupancy_map.h"
#include "tests/nav/box_world.h"

namespace segsim::nav::test {
namespace {

SimulationOptions camera_options() {
  SimulationOptions options;
  options.camera = core::CameraIntrinsics::from_fov(256, 192, 1.3788);
  return options;
}

/// Time of this core only, so that a busy machine does not disturb the figure.
double thread_cpu_s() {
  timespec time{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

void BM_OccupancyUpdate(benchmark::State& state) {
  Simulation simulation(four_rooms(), {5.0, 4.0, 0.3}, camera_options());
  const core::Observation& observation = simulation.observe();
  OccupancyMap map;
  for (auto _ : state) map.integrate(observation);
}
BENCHMARK(BM_OccupancyUpdate)->Unit(benchmark::kMillisecond);

/// Mean over the first 200 ticks of an exploration; the simulator's time is not counted.
void BM_Decide(benchmark::State& state) {
  double worst_ms = 0.0;
  auto policy = make_frontier_policy({});
  Simulation simulation(four_rooms(), {1.0, 2.6, 0.0}, camera_options());
  policy->reset({"thing", 0}, 1);
  for (auto _ : state) {
    const core::Observation& observation = simulation.observe();
    const double start_s = thread_cpu_s();
    const core::Decision decision = policy->decide(observation, {});
    const double took_s = thread_cpu_s() - start_s;
    state.SetIterationTime(took_s);
    worst_ms = std::max(worst_ms, took_s * 1e3);
    simulation.step(decision.command);
  }
  state.counters["worst_ms"] = worst_ms;
}
BENCHMARK(BM_Decide)->UseManualTime()->Iterations(300)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace segsim::nav::test
