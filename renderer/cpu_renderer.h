#pragma once

/// @file
/// The surfel rasterizer for processors: SIMD pixels (Highway, chosen at run time), tiles
/// spread over threads (oneTBB).
///
///     clusters in view, nearest first, a slab at a time
///       -> surfels on screen -> depth order -> lists of the live tiles
///       -> pixels of those tiles, front to back -> finished tiles want no more
///
/// A pixel blends the surfels that its ray meets with alpha >= 1/255 in order of their centre
/// depth: weight = alpha T, T *= 1 - alpha, until T would fall below 1e-4. Colour is the
/// weighted sum over black; depth and normal are weighted means. A label is the class with the
/// largest weight among the `top_k` heaviest surfels. Depth, normal and labels are empty (NaN,
/// 0, void) where alpha < 0.5. In a frame of labels alone a pixel is finished once no later
/// surfel can enter its Top-K; its alpha is then only what was seen until there.
///
/// The picture does not depend on the number of threads or slabs; between instruction sets it
/// differs by rounding. Against double precision alpha is right to 5e-4 (to 2e-3 of its value,
/// but for discs of 1 : 100 and thinner), who contributes differs only within 1e-4 of a
/// threshold, and the weights that vote for labels are right to 3.1e-5 of their value.

#include <memory>

#include "core/render.h"
#include "renderer/scene/panoptic_field.h"
#include "renderer/scene/render_options.h"
#include "renderer/scene/surfels.h"

namespace segsim::renderer {

/// Sorts and packs the scene; the cloud is kept for its colours. Rendering allocates memory in
/// the first frames only. Images of at most 65535 x 65535 pixels.
/// @param field  Labels come from here if it is given, else from the surfels' own ids.
/// @throws core::ContractViolation for a scene or option out of range; from render() for
///     intrinsics out of range.
[[nodiscard]] std::unique_ptr<core::Renderer> make_cpu_renderer(
    std::shared_ptr<const SurfelCloud> surfels, RenderOptions options = {},
    std::shared_ptr<const PanopticField> field = nullptr);

}  // namespace segsim::renderer
