#include "renderer/scene/surfels.h"

#include <cmath>

#include <glm/geometric.hpp>

#include "core/check.h"
#include "renderer/scene/render_options.h"

namespace segsim::renderer {
namespace {

bool is_finite(const glm::vec3& v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

void check_surfel(const SurfelCloud& surfels, std::size_t i) {
  // Called only where a check fails: scenes have hundreds of thousands of surfels.
  const auto name = [i] { return "surfel " + std::to_string(i); };
  SEGSIM_CHECK(is_finite(surfels.position_m[i]), name());
  const glm::quat& q = surfels.R_world_surfel[i];
  const float norm2 = q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z;
  SEGSIM_CHECK(std::abs(norm2 - 1.0F) < 1e-3F, name() + ", |q|^2 = " + std::to_string(norm2));
  const glm::vec2& scale_m = surfels.scale_m[i];
  SEGSIM_CHECK(
      scale_m.x > 0.0F && scale_m.y > 0.0F && std::isfinite(scale_m.x + scale_m.y),
      name() + ", scale_m = " + std::to_string(scale_m.x) + " " + std::to_string(scale_m.y));
  const float opacity = surfels.opacity[i];
  SEGSIM_CHECK(opacity > 0.0F && opacity <= 1.0F,
               name() + ", opacity = " + std::to_string(opacity));
  for (std::size_t c = 0; c < surfels.sh_count(); ++c) {
    SEGSIM_CHECK(is_finite(surfels.sh[i * surfels.sh_count() + c]), name());
  }
}

}  // namespace

void check_surfels(const SurfelCloud& surfels) {
  const std::size_t n = surfels.size();
  SEGSIM_CHECK(surfels.sh_degree >= 0 && surfels.sh_degree <= 3,
               "sh_degree = " + std::to_string(surfels.sh_degree));
  SEGSIM_CHECK(surfels.R_world_surfel.size() == n, "surfel rotations");
  SEGSIM_CHECK(surfels.scale_m.size() == n, "surfel scales");
  SEGSIM_CHECK(surfels.opacity.size() == n, "surfel opacities");
  SEGSIM_CHECK(surfels.sh.size() == n * surfels.sh_count(), "surfel colours");
  SEGSIM_CHECK(surfels.semantic_id.empty() || surfels.semantic_id.size() == n,
               "surfel classes");
  SEGSIM_CHECK(surfels.instance_id.size() == surfels.semantic_id.size(), "surfel instances");
  SEGSIM_CHECK(surfels.semantic_feature.empty() || surfels.semantic_feature.size() == n,
               "surfel semantic features");
  SEGSIM_CHECK(surfels.instance_feature.size() == surfels.semantic_feature.size(),
               "surfel instance features");
  for (std::size_t i = 0; i < n; ++i) check_surfel(surfels, i);
}

void check_render_options(const RenderOptions& options) {
  SEGSIM_CHECK(options.top_k >= kAllSurfels && options.top_k <= kMaxTopK,
               "top_k = " + std::to_string(options.top_k));
  SEGSIM_CHECK(options.near_m > 0.0F && std::isfinite(options.near_m),
               "near_m = " + std::to_string(options.near_m));
  SEGSIM_CHECK(options.threads >= 0, "threads = " + std::to_string(options.threads));
}

}  // namespace segsim::renderer
