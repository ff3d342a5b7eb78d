// What it costs to ask another process for a decision that takes it no time: two copies of
// both images, the messages, and two switches between processes.
#include <benchmark/benchmark.h>

#include "peers/peer.h"

namespace segsim::peers {
namespace {

void BM_Decide(benchmark::State& state) {
  const auto width_px = static_cast<int>(state.range(0));
  const int height_px = width_px * 3 / 4;
  const core::Image<core::Rgb8> rgb(width_px, height_px, {1, 2, 3});
  const core::Image<float> depth_m(width_px, height_px, 2.0F);
  core::Observation seen;
  seen.intrinsics = core::CameraIntrinsics::from_fov(width_px, height_px, 1.2);
  seen.rgb = &rgb;
  seen.depth_m = &depth_m;
  const std::vector<core::Detection> found(10, {1, 0.5F, {1.5F, 2.5F, 30.25F, 40.0F}});

  core::PeerCommand command;
  command.command = {PEER_PROGRAM, "idle"};
  EpisodeStart start;
  start.class_names = {"chair", "couch"};
  const std::unique_ptr<core::Policy> policy =
      make_peer_policy(std::make_shared<Peer>(command, "policy"), start);
  policy->reset({"couch", 1}, 1);
  for (auto _ : state) benchmark::DoNotOptimize(policy->decide(seen, found));
}
BENCHMARK(BM_Decide)->Arg(256)->Arg(640)->Unit(benchmark::kMicrosecond)->UseRealTime();

}  // namespace
}  // namespace segsim::peers
