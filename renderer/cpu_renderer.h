#pragma once

/// @file
/// The surfel rasterizer for processors: SIMD pixels (Highway, chosen at run time), tiles
/// spread over threads (oneTBB).
///
///     clusters in view -> surfels on screen -> depth order -> tile lists -> pixels, front to
///     back
///
/// A pixel blends the surfels that its ray meets with alpha >= 1/255 in order of their centre
/// depth: weight = alpha T, T *= 1 - alpha, until T would fall below 1e-4. Colour is the
/// weighted sum over black; depth and normal are weighted means. A label is the class with the
/// largest weight among the `top_k` heaviest surfels. Depth, normal and labels are empty (NaN,
/// 0, void) where alpha < 0.5. The picture does not depend on the number of threads; between
/// instruction sets it differs by rounding.

#include <memory>

#include "core/render.h"
#include "renderer/render_options.h"
#include "renderer/surfels.h"

namespace segsim::renderer {

/// Sorts and packs the scene; the cloud is kept for its colours. Rendering allocates memory in
/// the first frames only. Images of at most 65535 x 65535 pixels.
/// @throws core::ContractViolation for a scene or option out of range.
[[nodiscard]] std::unique_ptr<core::Renderer> make_cpu_renderer(
    std::shared_ptr<const SurfelCloud> surfels, RenderOptions options = {});

}  // namespace segsim::renderer
