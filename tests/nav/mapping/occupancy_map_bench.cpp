/// One view into the log-odds map of a flat of 80 m2; images of 256 x 192.

#include <benchmark/benchmark.h>

#include "nav/mapping/occupancy_map.h"
#include "tests/nav/box_world.h"

namespace segsim::nav::test {
namespace {

void BM_OccupancyUpdate(benchmark::State& state) {
  SimulationOptions options;
  options.camera = core::CameraIntrinsics::from_fov(256, 192, 1.3788);
  Simulation simulation(four_rooms(), {5.0, 4.0, 0.3}, options);
  const core::Observation& observation = simulation.observe();
  OccupancyMap map;
  for (auto _ : state) map.integrate(observation);
}
BENCHMARK(BM_OccupancyUpdate)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace segsim::nav::test
