// What a tile's end costs: votes of own labels, scores of a panoptic field, features. A tile
// has 256 pixels; items are pixels.

#include <benchmark/benchmark.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <memory>
#include <vector>

#include "core/random.h"
#include "renderer/raster/tile_write.h"
#include "tests/renderer/make_key.h"
#include "tests/renderer/panoptic_scenes.h"

namespace segsim::renderer::internal {
namespace {

using core::Channels;

/// A tile whose pixels see 60 surfels of a scene. They lie close together and one in sixteen
/// belongs to another object, which features and own labels tell. Neighbours share surfels.
class Tile {
 public:
  Tile() : cloud_(renderer::testing::random_scene(1, 20000)) {
    renderer::testing::add_random_features(cloud_, 2);
    for (std::size_t i = 0; i < cloud_.size(); ++i) {
      cloud_.semantic_id[i] = i % 16 == 0 ? 2 : 1;
      cloud_.instance_id[i] = cloud_.semantic_id[i];
      cloud_.position_m[i] *= 0.05F;
      mix(cloud_.semantic_feature[cloud_.semantic_id[i]], cloud_.semantic_feature[i]);
      mix(cloud_.instance_feature[cloud_.instance_id[i]], cloud_.instance_feature[i]);
    }
    field_ = fold_panoptic_model(cloud_, renderer::testing::random_model(3, 20, 100));
    core::RandomStream random(4, "tile");
    projected_.shade.resize(60);
    for (std::uint32_t slot = 0; slot < 60; ++slot) {
      SurfelShade& shade = projected_.shade[slot];
      shade.surfel = random.index(static_cast<std::uint32_t>(cloud_.size()));
      shade.label = cloud_.semantic_id[shade.surfel] |
                    static_cast<std::uint32_t>(cloud_.instance_id[shade.surfel]) << 16U;
      list_.push_back(slot);
    }
    frame_.intrinsics = {kTileSizePx, kTileSizePx, 20.0, 20.0, 8.0, 8.0};
    frame_.rgb = core::Image<core::Rgb8>(kTileSizePx, kTileSizePx);
    frame_.normal = core::Image<glm::vec3>(kTileSizePx, kTileSizePx);
    for (auto* image :
         {&frame_.alpha, &frame_.depth_m, &frame_.confidence, &frame_.instance_confidence}) {
      *image = core::Image<float>(kTileSizePx, kTileSizePx);
    }
    frame_.semantic = frame_.instance = core::Image<std::uint16_t>(kTileSizePx, kTileSizePx);
    frame_.semantic_feature = core::Image<core::SemanticFeature>(kTileSizePx, kTileSizePx);
    frame_.instance_feature = core::Image<core::InstanceFeature>(kTileSizePx, kTileSizePx);
  }

  void run(benchmark::State& loop, bool own_labels, Channels channels) {
    const auto top_k = static_cast<int>(loop.range(0));
    const ResolveJob resolve{.cloud = &cloud_,
                             .field = own_labels ? nullptr : &field_,
                             .labelled = own_labels,
                             .top_k = top_k};
    const RasterJob job{.projected = projected_,
                        .bins = bins_,
                        .frame = frame_,
                        .channels = channels,
                        .top_k = top_k,
                        .median_depth = true,
                        .labelled = own_labels,
                        .resolve = &resolve};
    const auto state = std::make_unique<TileState>();
    clear_tile(job, 0, top_k, *state);
    fill(top_k, *state);
    std::uint64_t rows = 0;
    for (auto _ : loop) {
      rows += write_tile(job, 0, list_, 0, *state);
      benchmark::ClobberMemory();
    }
    const auto tiles = static_cast<double>(loop.iterations());
    loop.SetItemsProcessed(loop.iterations() * static_cast<std::int64_t>(kTilePixels));
    loop.counters["rows_per_pixel"] = static_cast<double>(rows) / tiles / kTilePixels;
  }

 private:
  /// Brings a feature close to its object's.
  template <std::size_t kSize>
  static void mix(const std::array<float, kSize>& object, std::array<float, kSize>& feature) {
    for (std::size_t i = 0; i < kSize; ++i) feature[i] = object[i] + 0.1F * feature[i];
  }

  /// Pixel (x, y) sees surfels from about number 3 (x / 4 + y / 4) on.
  static void fill(int top_k, TileState& state) {
    core::RandomStream random(5, "keys");
    for (int y = 0; y < kTileSizePx; ++y) {
      for (int x = 0; x < kTileSizePx; ++x) {
        std::vector<std::uint32_t> keys;
        for (int k = 0; k < top_k; ++k) {
          const auto first = static_cast<std::uint32_t>(3 * (x / 4 + y / 4));
          const auto weight = static_cast<float>(random.uniform(0.01, 0.3));
          keys.push_back(make_key(weight, first + static_cast<std::uint32_t>(k)));
        }
        std::sort(keys.rbegin(), keys.rend());
        const std::size_t pixel = plane_index(x, y);
        for (std::size_t k = 0; k < keys.size(); ++k) state.keys[k][pixel] = keys[k];
        state.transmittance[pixel] = 0.01F;
        state.r[pixel] = state.g[pixel] = state.b[pixel] = 0.5F;
        state.nx[pixel] = state.ny[pixel] = state.nz[pixel] = 0.5F;
      }
    }
  }

  SurfelCloud cloud_;
  PanopticField field_;
  ProjectedSurfels projected_;
  std::vector<std::uint32_t> list_;
  TileBins bins_;
  core::Frame frame_;
};

Tile& tile() {
  static Tile tile;
  return tile;
}

void pictures(benchmark::State& loop) {
  tile().run(loop, true, Channels::kRgbd | Channels::kNormal);
}
void own_labels(benchmark::State& loop) { tile().run(loop, true, Channels::kLabels); }
void field_labels(benchmark::State& loop) { tile().run(loop, false, Channels::kLabels); }
void features(benchmark::State& loop) { tile().run(loop, true, Channels::kFeatures); }

BENCHMARK(pictures)->Arg(4);
BENCHMARK(own_labels)->Arg(1)->Arg(3)->Arg(4)->Arg(8)->Arg(16)->Arg(24);
BENCHMARK(field_labels)->Arg(1)->Arg(3)->Arg(4)->Arg(8)->Arg(16)->Arg(24);
BENCHMARK(features)->Arg(1)->Arg(3)->Arg(4)->Arg(8)->Arg(16)->Arg(24);

}  // namespace
}  // namespace segsim::renderer::internal
