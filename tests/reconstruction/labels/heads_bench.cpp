// One step of label training: 16384 pixels of about 10 surfels each, out of 60 000 that the
// view sees of 300 000. `queries` has no effect on the heads without queries.

#include <benchmark/benchmark.h>

#include <memory>
#include <string>
#include <vector>

#include "core/random.h"
#include "reconstruction/labels/panoptic_head.h"

namespace {

using namespace segsim;
using namespace segsim::reconstruction;
using namespace segsim::renderer;

constexpr int kSurfels = 300'000, kVisible = 60'000, kPixels = 16384, kPerPixel = 10;

/// A floor of 12 m in boxes of one square metre, each an instance.
struct Batch {
  Batch() {
    core::RandomStream random(1, "heads_bench");
    row_start.push_back(0);
    for (int p = 0; p < kPixels; ++p) {
      const auto first = static_cast<std::int32_t>(random.index(kVisible - kPerPixel));
      for (int k = 0; k < kPerPixel; ++k) {
        surfel.push_back(first + k);
        weight.push_back(0.09F);
      }
      row_start.push_back(static_cast<std::int32_t>(surfel.size()));
      const int cell = first / 3000;
      semantic.push_back(static_cast<std::uint16_t>(cell % 2 == 0 ? 1 : 2 + cell % 9));
      instance.push_back(static_cast<std::uint16_t>(cell % 2 == 0 ? 0 : 1 + cell));
    }
    batch.weights = {kPixels, static_cast<std::int64_t>(surfel.size()), row_start.data(),
                     surfel.data(), weight.data()};
    batch.semantic = semantic.data();
    batch.instance = instance.data();
  }
  std::vector<std::int32_t> row_start, surfel;
  std::vector<float> weight;
  std::vector<std::uint16_t> semantic, instance;
  PanopticBatch batch;
};

PanopticHeadInputs inputs(int queries) {
  core::RandomStream random(2, "heads_bench");
  PanopticHeadInputs in;
  for (int i = 0; i < kSurfels; ++i) {
    const double strip = 12.0 * i / kSurfels;
    in.position_m.emplace_back(strip, random.uniform(0.0, 6.0), random.uniform(0.0, 2.0));
  }
  for (std::uint16_t c = 1; c <= 10; ++c) in.classes.push_back({c, std::to_string(c), c > 1});
  for (int q = 0; q < queries; ++q) {
    in.query_seeds.push_back(
        {{random.uniform(0.0, 12.0), random.uniform(0.0, 6.0), 1.0}, glm::vec3(0.5F)});
  }
  return in;
}

void step(benchmark::State& state, const std::string& name) {
  PanopticTrainingConfig config;
  config.loss.panoptic_from = 0.0;  // All losses.
  const auto head =
      make_panoptic_head(name, inputs(static_cast<int>(state.range(0))), config, 1);
  Batch batch;
  std::int64_t iteration = config.iterations * 7 / 10;
  double total = 0.0;
  for (auto _ : state) total = head->step(batch.batch, iteration++).back().value;
  if (!(total > 0.0)) state.SkipWithError("no loss");
}

BENCHMARK_CAPTURE(step, query, std::string("query"))
    ->ArgName("queries")
    ->Arg(20)
    ->Arg(60)
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(step, panoptic_lifting, std::string("panoptic-lifting"))
    ->ArgName("queries")
    ->Arg(0)
    ->Unit(benchmark::kMillisecond);

}  // namespace
