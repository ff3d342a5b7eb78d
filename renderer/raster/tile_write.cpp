#include "renderer/raster/tile_write.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <limits>
#include <vector>

#include "renderer/raster/field_vote.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "renderer/raster/tile_write.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#ifndef SEGSIM_RENDERER_TILE_WRITE_ONCE
#define SEGSIM_RENDERER_TILE_WRITE_ONCE
namespace segsim::renderer::internal {
namespace {

using core::Channels;
using core::has;

struct TileLabels {
  alignas(64) std::array<std::uint16_t, kTilePixels> semantic, instance;
  alignas(64) std::array<float, kTilePixels> confidence, instance_confidence;
};

/// Copies `width` pixels of every row of a plane to the image.
template <class Pixel>
void copy_rows(const Pixel* plane, const PixelRectangle& at, core::Image<Pixel>& image) {
  for (int y = 0; y < at.height; ++y) {
    const Pixel* from = plane + plane_index(0, y);
    Pixel* to = image.row(at.y + y) + at.x;
    if (at.width == kTileSizePx) {  // A constant length becomes a few instructions.
      std::memcpy(static_cast<void*>(to), from, kTileSizePx * sizeof(Pixel));
    } else {
      std::memcpy(static_cast<void*>(to), from,
                  static_cast<std::size_t>(at.width) * sizeof(Pixel));
    }
  }
}

}  // namespace
}  // namespace segsim::renderer::internal
#endif  // SEGSIM_RENDERER_TILE_WRITE_ONCE

HWY_BEFORE_NAMESPACE();
namespace segsim::renderer::internal {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using Floats = hn::CappedTag<float, kTileSizePx>;
using Ints = hn::RebindToSigned<Floats>;
using Bytes = hn::CappedTag<std::uint8_t, kTileSizePx>;
using V = hn::Vec<Floats>;

/// Where alpha reaches kMinSurfaceAlpha.
HWY_INLINE hn::Mask<Floats> surface_of(const float* transmittance) {
  const Floats d;
  return hn::Ge(hn::Sub(hn::Set(d, 1.0F), hn::Load(d, transmittance)),
                hn::Set(d, kMinSurfaceAlpha));
}

void alpha_of_tile(const TileState& state, float* alpha) {
  const Floats d;
  for (std::size_t p = 0; p < kTilePixels; p += hn::Lanes(d)) {
    hn::Store(hn::Sub(hn::Set(d, 1.0F), hn::Load(d, &state.transmittance[p])), d, alpha + p);
  }
}

void bytes_of_row(const float* values, std::uint8_t* bytes) {
  const Floats d;
  const Ints di;
  const hn::Rebind<std::uint8_t, Floats> d8;
  for (std::size_t x = 0; x < kTileSizePx; x += hn::Lanes(d)) {
    const V value = hn::Min(hn::Max(hn::Load(d, values + x), hn::Zero(d)), hn::Set(d, 1.0F));
    const V scaled = hn::Add(hn::Mul(value, hn::Set(d, 255.0F)), hn::Set(d, 0.5F));
    hn::StoreU(hn::DemoteTo(d8, hn::ConvertTo(di, scaled)), d8, bytes + x);
  }
}

void rgb_of_tile(const TileState& state, core::Rgb8* rgb) {
  const Bytes d;
  alignas(64) std::uint8_t r[kTileSizePx], g[kTileSizePx], b[kTileSizePx];
  auto* out = reinterpret_cast<std::uint8_t*>(rgb);
  for (std::size_t p = 0; p < kTilePixels; p += kTileSizePx) {
    bytes_of_row(&state.r[p], r);
    bytes_of_row(&state.g[p], g);
    bytes_of_row(&state.b[p], b);
    for (std::size_t x = 0; x < kTileSizePx; x += hn::Lanes(d)) {
      hn::StoreInterleaved3(hn::Load(d, r + x), hn::Load(d, g + x), hn::Load(d, b + x), d,
                            out + 3 * (p + x));
    }
  }
}

void depth_of_tile(const RasterJob& job, const TileState& state, float* depth_m) {
  const Floats d;
  const V none = hn::Set(d, std::numeric_limits<float>::quiet_NaN());
  for (std::size_t p = 0; p < kTilePixels; p += hn::Lanes(d)) {
    V depth = hn::Load(d, &state.depth[p]);
    if (!job.median_depth) {
      const V alpha = hn::Sub(hn::Set(d, 1.0F), hn::Load(d, &state.transmittance[p]));
      depth = hn::Div(depth, alpha);
    }
    hn::Store(hn::IfThenElse(surface_of(&state.transmittance[p]), depth, none), d,
              depth_m + p);
  }
}

void normal_of_tile(const TileState& state, glm::vec3* normal) {
  const Floats d;
  auto* out = reinterpret_cast<float*>(normal);
  static_assert(sizeof(glm::vec3) == 3 * sizeof(float));
  for (std::size_t p = 0; p < kTilePixels; p += hn::Lanes(d)) {
    const V x = hn::Load(d, &state.nx[p]), y = hn::Load(d, &state.ny[p]),
            z = hn::Load(d, &state.nz[p]);
    const V length = hn::Sqrt(hn::MulAdd(x, x, hn::MulAdd(y, y, hn::Mul(z, z))));
    const auto known =
        hn::And(surface_of(&state.transmittance[p]), hn::Gt(length, hn::Zero(d)));
    const V scale = hn::IfThenElseZero(
        known, hn::Div(hn::Set(d, 1.0F), hn::IfThenElse(known, length, hn::Set(d, 1.0F))));
    hn::StoreInterleaved3(hn::Mul(x, scale), hn::Mul(y, scale), hn::Mul(z, scale), d,
                          out + 3 * p);
  }
}

/// Empties the labels of pixels that are no surface.
void void_faint(const TileState& state, TileLabels& labels) {
  const Floats d;
  const hn::Rebind<std::uint16_t, Floats> d16;
  const Ints di;
  for (std::size_t p = 0; p < kTilePixels; p += hn::Lanes(d)) {
    const auto surface = surface_of(&state.transmittance[p]);
    if (hn::AllTrue(d, surface)) continue;
    const auto surface_i = hn::RebindMask(di, surface);
    for (float* share : {&labels.confidence[p], &labels.instance_confidence[p]}) {
      hn::Store(hn::IfThenElseZero(surface, hn::Load(d, share)), d, share);
    }
    for (std::uint16_t* id : {&labels.semantic[p], &labels.instance[p]}) {
      const auto ids = hn::PromoteTo(di, hn::Load(d16, id));
      hn::Store(hn::DemoteTo(d16, hn::IfThenElseZero(surface_i, ids)), d16, id);
    }
  }
}

/// All that is not labels and features.
void write_colours(const RasterJob& job, const PixelRectangle& at, const TileState& state) {
  core::Frame& frame = job.frame;
  alignas(64) std::array<float, kTilePixels> plane;
  alpha_of_tile(state, plane.data());
  copy_rows(plane.data(), at, frame.alpha);
  if (has(job.channels, Channels::kRgb)) {
    alignas(64) std::array<core::Rgb8, kTilePixels> rgb;
    rgb_of_tile(state, rgb.data());
    copy_rows(rgb.data(), at, frame.rgb);
  }
  if (has(job.channels, Channels::kDepth)) {
    depth_of_tile(job, state, plane.data());
    copy_rows(plane.data(), at, frame.depth_m);
  }
  if (has(job.channels, Channels::kNormal)) {
    alignas(64) std::array<glm::vec3, kTilePixels> normal;
    normal_of_tile(state, normal.data());
    copy_rows(normal.data(), at, frame.normal);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace segsim::renderer::internal
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace segsim::renderer::internal {
namespace {

HWY_EXPORT(write_colours);
HWY_EXPORT(void_faint);

/// What a thread keeps from tile to tile, so that none of it is allocated anew.
struct TileScratch {
  SelectedSurfels selected;
  BlockResolver resolver;
  TileLabels labels;
  TileLabels undecided;  ///< Labels of the pixels that vote_field() leaves, packed.
  std::vector<std::uint16_t> left;
  std::array<core::SemanticFeature, kTilePixels> semantic_feature;
  std::array<core::InstanceFeature, kTilePixels> instance_feature;
};

TileScratch& scratch_of_thread() {
  thread_local TileScratch scratch;
  return scratch;
}

void write_labels(const RasterJob& job, const PixelRectangle& at, bool known,
                  const TileState& state, TileLabels& labels) {
  if (known) {
    HWY_DYNAMIC_DISPATCH(void_faint)(state, labels);
  } else {
    labels = {};
  }
  copy_rows(labels.semantic.data(), at, job.frame.semantic);
  copy_rows(labels.instance.data(), at, job.frame.instance);
  copy_rows(labels.confidence.data(), at, job.frame.confidence);
  copy_rows(labels.instance_confidence.data(), at, job.frame.instance_confidence);
}

void write_features(const RasterJob& job, const PixelRectangle& at, bool known,
                    const TileState& state, TileScratch& scratch) {
  for (std::size_t pixel = 0; pixel < kTilePixels; ++pixel) {
    if (known && is_surface(state.transmittance[pixel])) continue;
    scratch.semantic_feature[pixel] = {};
    scratch.instance_feature[pixel] = {};
  }
  copy_rows(scratch.semantic_feature.data(), at, job.frame.semantic_feature);
  copy_rows(scratch.instance_feature.data(), at, job.frame.instance_feature);
}

/// The means of all surfels' features.
void divide_sums(const TileState& state, TileScratch& scratch) {
  const float* sums = state.all->sums.data();
  for (std::size_t pixel = 0; pixel < kTilePixels; ++pixel, sums += kFeatureChannels) {
    const float alpha = 1.0F - state.transmittance[pixel];
    const float scale = alpha > 0.0F ? 1.0F / alpha : 0.0F;
    for (std::size_t c = 0; c < core::kSemanticFeatureSize; ++c) {
      scratch.semantic_feature[pixel][c] = scale * sums[c];
    }
    for (std::size_t c = 0; c < core::kInstanceFeatureSize; ++c) {
      scratch.instance_feature[pixel][c] = scale * sums[core::kSemanticFeatureSize + c];
    }
  }
}

LabelPlanes planes_of(TileLabels& labels) {
  return {labels.semantic.data(), labels.instance.data(), labels.confidence.data(),
          labels.instance_confidence.data()};
}

/// Labels of a field: at once where the surfels of a pixel agree, else pixel by pixel.
std::uint64_t resolve_field(const RasterJob& job, std::span<const std::uint32_t> list,
                            std::uint32_t window, const TileState& state, const KeyRow& keys,
                            TileScratch& scratch) {
  const SurfelShade* shade = job.projected.shade.data();
  PixelSet undecided;
  std::uint64_t rows = vote_field(keys, list.data() + window, shade, *job.resolve->tops,
                                  planes_of(scratch.labels), undecided);
  scratch.left.clear();
  for (std::size_t word = 0; word < undecided.size(); ++word) {
    for (std::uint64_t bits = undecided[word]; bits != 0; bits &= bits - 1) {
      const std::size_t pixel = 64 * word + static_cast<std::size_t>(std::countr_zero(bits));
      // Faint pixels have no labels.
      if (is_surface(state.transmittance[pixel])) {
        scratch.left.push_back(static_cast<std::uint16_t>(pixel));
      }
    }
  }
  if (scratch.left.empty()) return rows;
  select_surfels(*job.resolve, list, window, state, scratch.left, scratch.selected);
  const LabelPlanes packed = planes_of(scratch.undecided);
  rows += scratch.resolver.resolve(*job.resolve, shade, scratch.selected,
                                   {&packed, nullptr, nullptr});
  const LabelPlanes planes = planes_of(scratch.labels);
  for (std::size_t i = 0; i < scratch.left.size(); ++i) {
    planes.set(scratch.left[i], {packed.semantic[i], packed.instance[i], packed.confidence[i],
                                 packed.instance_confidence[i]});
  }
  return rows;
}

/// Labels and features, which come from the selected surfels.
std::uint64_t write_selected(const RasterJob& job, const PixelRectangle& at,
                             std::span<const std::uint32_t> list, std::uint32_t window,
                             const TileState& state) {
  const ResolveJob& resolve = *job.resolve;
  TileScratch& scratch = scratch_of_thread();
  const bool labels = has(job.channels, Channels::kLabels);
  const bool labels_known = wants_labels(resolve, job.channels);
  const bool features = has(job.channels, Channels::kFeatures);
  const bool features_known = wants_features(resolve, job.channels);
  const bool features_summed = features_known && job.all_surfels;
  const LabelPlanes planes = planes_of(scratch.labels);
  // Straight from the keys: the common case.
  const bool plain = !features_known && !state.window_closed && resolve.top_k != kAllSurfels;
  const KeyRow keys{state.keys[0].data(), kTilePixels, resolve.top_k,
                    static_cast<int>(kTilePixels)};
  std::uint64_t rows = 0;
  if (labels_known && plain && resolve.field == nullptr) {
    rows = vote_row(keys, list.data() + window, job.projected.shade.data(), planes);
  } else if (labels_known && plain && resolve.tops != nullptr) {
    rows = resolve_field(job, list, window, state, keys, scratch);
  } else if (labels_known || (features_known && !features_summed)) {
    select_surfels(resolve, list, window, state, scratch.selected);
    ResolvedPixels out;
    if (labels_known) out.labels = &planes;
    if (features_known && !features_summed) {
      out.semantic_feature = scratch.semantic_feature.data();
      out.instance_feature = scratch.instance_feature.data();
    }
    rows =
        scratch.resolver.resolve(resolve, job.projected.shade.data(), scratch.selected, out);
  }
  if (features_summed) {
    divide_sums(state, scratch);
    rows += state.all->rows_read;
  }
  if (labels) write_labels(job, at, labels_known, state, scratch.labels);
  if (features) write_features(job, at, features_known, state, scratch);
  return rows;
}

}  // namespace

std::uint64_t write_tile(const RasterJob& job, std::size_t tile,
                         std::span<const std::uint32_t> list, std::uint32_t window,
                         TileState& state) {
  const PixelRectangle at = rectangle_of(job, tile);
  HWY_DYNAMIC_DISPATCH(write_colours)(job, at, state);
  std::uint64_t rows = 0;
  if (has(job.channels, Channels::kLabels) || has(job.channels, Channels::kFeatures)) {
    rows = write_selected(job, at, list, window, state);
  }
  return_all(state);
  return rows;
}

}  // namespace segsim::renderer::internal
#endif  // HWY_ONCE
