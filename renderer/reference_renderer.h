#pragma once

/// @file
/// The definition of the picture, in double precision and without cleverness: every pixel
/// meets every surfel, by intersecting its ray with the surfel's plane. The oracle for fast
/// renderers; far too slow for anything else.

#include <memory>

#include "core/render.h"
#include "renderer/scene/render_options.h"
#include "renderer/scene/surfels.h"

namespace segsim::renderer {

/// Same rules and outputs as make_cpu_renderer(); labels are those of the surfels' own ids.
/// `stats.evaluations` and `contributions` count as if no pixel outside a surfel's outline
/// were looked at. TileBounds matter only where they may miss pixels: kAabb and kPaper. With
/// Compat::kInria and kGsplat the program's own bounds and near plane apply, and
/// RenderOptions::bounds and near_m do not (internal/compat_rules.h has the rules).
/// `stats.pairs_binned` counts the tiles' lists where bounds apply, and is 0 otherwise.
[[nodiscard]] std::unique_ptr<core::Renderer> make_reference_renderer(
    std::shared_ptr<const SurfelCloud> surfels, RenderOptions options = {});

}  // namespace segsim::renderer
