#include "reconstruction/training/raw_surfels.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "core/check.h"

namespace segsim::reconstruction {
namespace {

constexpr float kLargestOpacity = 1.0F - 1e-6F, kSmallestOpacity = 1e-7F;

float logit(float opacity) {
  const float o = std::clamp(opacity, kSmallestOpacity, kLargestOpacity);
  return std::log(o / (1.0F - o));
}

float sigmoid(float x) {
  return std::clamp(1.0F / (1.0F + std::exp(-x)), kSmallestOpacity, 1.0F);
}

}  // namespace

SurfelParameters<float> RawSurfels::parameters() const {
  SurfelParameters<float> p;
  p.count = count();
  p.sh_degree = p.active_sh_degree = sh_degree;
  p.position_m = position_m.data();
  p.log_scale = log_scale.data();
  p.rotation = rotation.data();
  p.opacity_logit = opacity_logit.data();
  p.sh = sh.data();
  return p;
}

RawSurfels raw_surfels(const renderer::SurfelCloud& surfels, int sh_degree) {
  SEGSIM_CHECK(sh_degree >= 0 && sh_degree <= 3, "SH degree " + std::to_string(sh_degree));
  RawSurfels raw;
  raw.sh_degree = sh_degree;
  const std::size_t stored = surfels.sh_count();
  const auto wanted = static_cast<std::size_t>((sh_degree + 1) * (sh_degree + 1));
  raw.sh.assign(surfels.size() * wanted * 3, 0.0F);
  for (std::size_t i = 0; i < surfels.size(); ++i) {
    for (int axis = 0; axis < 3; ++axis) {
      raw.position_m.push_back(surfels.position_m[i][axis]);
    }
    raw.log_scale.push_back(std::log(surfels.scale_m[i].x));
    raw.log_scale.push_back(std::log(surfels.scale_m[i].y));
    const glm::quat& q = surfels.R_world_surfel[i];
    raw.rotation.insert(raw.rotation.end(), {q.w, q.x, q.y, q.z});
    raw.opacity_logit.push_back(logit(surfels.opacity[i]));
    for (std::size_t k = 0; k < std::min(stored, wanted); ++k) {
      const glm::vec3& c = surfels.sh[i * stored + k];
      std::copy_n(&c.x, 3, raw.sh.begin() + static_cast<std::ptrdiff_t>((i * wanted + k) * 3));
    }
  }
  return raw;
}

renderer::SurfelCloud surfel_cloud(const RawSurfels& raw) {
  renderer::SurfelCloud surfels;
  surfels.sh_degree = raw.sh_degree;
  const auto count = static_cast<std::size_t>(raw.count());
  for (std::size_t i = 0; i < count; ++i) {
    const float* p = raw.position_m.data() + 3 * i;
    const float* q = raw.rotation.data() + 4 * i;
    surfels.position_m.emplace_back(p[0], p[1], p[2]);
    surfels.R_world_surfel.push_back(glm::normalize(glm::quat(q[0], q[1], q[2], q[3])));
    surfels.scale_m.emplace_back(std::exp(raw.log_scale[2 * i]),
                                 std::exp(raw.log_scale[2 * i + 1]));
    surfels.opacity.push_back(sigmoid(raw.opacity_logit[i]));
  }
  for (std::size_t k = 0; k < raw.sh.size(); k += 3) {
    surfels.sh.emplace_back(raw.sh[k], raw.sh[k + 1], raw.sh[k + 2]);
  }
  return surfels;
}

}  // namespace segsim::reconstruction
