#pragma once

/// @file
/// Scene <-> parameters: the unconstrained numbers of surfel_parameters.h in host memory.

#include <vector>

#include "reconstruction/rasterizer/surfel_parameters.h"
#include "renderer/scene/surfels.h"

namespace segsim::reconstruction {

/// Arrays in the layout of SurfelParameters.
struct RawSurfels {
  int sh_degree = 0;
  std::vector<float> position_m, log_scale, rotation, opacity_logit, sh;

  [[nodiscard]] std::int64_t count() const {
    return static_cast<std::int64_t>(opacity_logit.size());
  }
  /// Pointers into this object, all degrees active.
  [[nodiscard]] SurfelParameters<float> parameters() const;
};

/// Opacities of 1 become 1 - 1e-6: a logarithm of odds is finite.
/// @param sh_degree  Of the result: higher coefficients are dropped, missing ones zero.
[[nodiscard]] RawSurfels raw_surfels(const renderer::SurfelCloud& surfels, int sh_degree);

/// Without labels and features.
[[nodiscard]] renderer::SurfelCloud surfel_cloud(const RawSurfels& raw);

}  // namespace segsim::reconstruction
