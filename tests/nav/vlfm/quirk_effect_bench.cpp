/// What each rule of VLFM does by itself: the same searches in the flat of boxes, everything
/// fixed but one rule. The argument counts: 0 fixed, 1 .. 14 that quirk as published, 15
/// without the second look, 16 without the approach rule, 17 without the sweep, 18 all as
/// published.

#include <array>

#include <benchmark/benchmark.h>

#include "nav/vlfm/vlfm_policy.h"
#include "tests/nav/box_world.h"
#include "tests/nav/robots.h"

namespace segsim::nav::test {
namespace {

constexpr double kMast_m = 1.1;
constexpr int kArms = 19;

VlfmOptions options_of(int arm) {
  VlfmRules rules(arm == 18 ? Rule::kVlfm : Rule::kFixed);
  if (arm >= 1 && arm <= static_cast<int>(kQuirks)) {
    rules.set(static_cast<Quirk>(arm - 1), Rule::kVlfm);
  }
  VlfmOptions options = vlfm_for(jackal(), rules, kMast_m);
  if (arm == 15 || arm == 18) options.second_look = false;
  if (arm == 16 || arm == 18) options.approach = false;
  if (arm == 17 || arm == 18) options.sweep.most_places = 0;
  return options;
}

/// Six starts by four places of the object. Half of the worlds have a pane of glass in a
/// corridor that can be passed beside it; half of the searches see one false box early on.
void BM_QuirkEffect(benchmark::State& state) {
  const std::array<core::Pose2, 6> starts{{{1.0, 2.6, 0.0},
                                           {9.3, 4.0, 3.1},
                                           {3.0, 5.4, 2.0},
                                           {8.0, 6.0, -1.5},
                                           {6.0, 2.0, 1.0},
                                           {2.5, 4.0, 0.5}}};
  const std::array<Box, 4> objects{{{{9.3, 7.3, 0.0}, {9.8, 7.8, 0.9}},
                                    {{0.2, 5.2, 0.0}, {0.7, 5.7, 0.8}},
                                    {{5.2, 0.3, 0.0}, {5.8, 0.8, 0.8}},
                                    {{2.8, 0.2, 0.0}, {3.4, 0.7, 0.6}}}};
  double successes = 0.0, time_s = 0.0, path_m = 0.0, contacts = 0.0, searches = 0.0;
  for (auto _ : state) {
    for (std::size_t k = 0; k < starts.size() * objects.size(); ++k) {
      BoxWorld world = four_rooms();
      world.object = objects[k % objects.size()];
      if (k % 2 == 1) world.invisible.push_back({{2.4, 3.4, 0.0}, {2.5, 3.85, 0.5}});
      SimulationOptions simulation;
      simulation.camera = core::CameraIntrinsics::from_fov(80, 60, 1.3788);
      simulation.min_object_px = 12;
      simulation.mast_m = kMast_m;
      simulation.period_s = 0.25;
      simulation.time_limit_s = 120.0;
      simulation.depth_noise = 0.003;
      simulation.seed = k + 1;
      if (k % 4 < 2) simulation.false_positives.push_back({0, {20, 15, 60, 45}});
      auto policy = make_vlfm_policy(options_of(static_cast<int>(state.range(0))));
      const SimulationResult result =
          run_episode(world, starts[k / objects.size()], simulation, *policy);
      successes += result.success() ? 1.0 : 0.0;
      time_s += result.time_s;
      path_m += result.path_m;
      contacts += result.contacts;
      searches += 1.0;
    }
  }
  state.counters["n"] = searches;
  state.counters["found"] = successes;
  state.counters["time_s"] = time_s / searches;
  state.counters["path_m"] = path_m / searches;
  state.counters["contacts"] = contacts / searches;
}
BENCHMARK(BM_QuirkEffect)->DenseRange(0, kArms - 1)->Iterations(1)->Unit(benchmark::kSecond);

}  // namespace
}  // namespace segsim::nav::test
