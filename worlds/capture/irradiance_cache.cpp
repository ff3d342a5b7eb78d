#include "worlds/capture/irradiance_cache.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <utility>

#include <oneapi/tbb/concurrent_unordered_map.h>
#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "core/check.h"
#include "core/random.h"
#include "worlds/capture/internal/light_gatherer.h"

namespace segsim::worlds {
namespace {

using internal::Gathered;
using internal::Gatherer;
using internal::kSurfaceOffset_m;
using internal::luminance;
using internal::uniform;

/// A cell with less than this share of the scene's median irradiance is inside of something.
constexpr float kDarkShare = 0.01F;
/// Light in cracks and in the inside of furniture, as a share of the median: what many bounces
/// would bring, and no pitch-black lines in the pictures.
constexpr float kCrackShare = 0.15F;
/// Cells are shifted along their direction by this share of their size: floors and walls lie
/// at round coordinates, where the last bit would decide between two cells.
constexpr float kShift = 0.2F;

/// The axis, 0 to 2, along which `v` is longest.
int main_axis(const glm::vec3& v) {
  const glm::vec3 size = glm::abs(v);
  if (size.z >= size.x && size.z >= size.y) return 2;
  return size.x >= size.y ? 0 : 1;
}

}  // namespace

/// Which cell, packed into 64 bits: 19 bits per coordinate, 3 bits for the direction, and
/// whether the value is for the middle of the cell because no surface was found in it.
struct IrradianceCache::Key {
  std::array<int, 3> index{};
  int axis = 0;
  bool negative = false;
  bool middle = false;

  [[nodiscard]] std::uint64_t packed() const {
    std::uint64_t bits = 0;
    for (const int i : index) {
      bits = bits << 19U | (static_cast<std::uint64_t>(i + (1 << 18)) & 0x7FFFFU);
    }
    bits = bits << 2U | static_cast<std::uint64_t>(axis);
    return bits << 2U | (negative ? 2U : 0U) | (middle ? 1U : 0U);
  }
  [[nodiscard]] glm::vec3 normal() const {
    glm::vec3 n(0.0F);
    n[axis] = negative ? -1.0F : 1.0F;
    return n;
  }
};

struct IrradianceCache::Cell {
  glm::vec3 irradiance{0.0F};
  /// Mean direction to the light, scaled so that its product with the cell's normal is 1.
  glm::vec3 flow{0.0F};
};

struct IrradianceCache::Cells {
  struct Hash {
    std::size_t operator()(std::uint64_t key) const {
      return (key ^ key >> 29U) * 0x9E3779B97F4A7C15ULL >> 8U;
    }
  };
  tbb::concurrent_unordered_map<std::uint64_t, Cell, Hash> map;
};

IrradianceCache::IrradianceCache(const sim::MeshScene& scene, const sim::RayScene& rays,
                                 const SurfaceShading& surfaces,
                                 const IrradianceOptions& options)
    : rays_(rays),
      surfaces_(surfaces),
      lights_(scene.lights),
      options_(options),
      cells_(std::make_unique<Cells>()) {
  SEGSIM_CHECK(options.cell_m > 0.0F, std::to_string(options.cell_m));
  SEGSIM_CHECK(options.shadow_samples > 0, std::to_string(options.shadow_samples));
  SEGSIM_CHECK(options.bounce_samples > 0, std::to_string(options.bounce_samples));
  median_irradiance_ = find_median(scene);
}

IrradianceCache::~IrradianceCache() = default;

IrradianceCache::Cell IrradianceCache::compute(const Key& key) const {
  const float size_m = options_.cell_m;
  core::RandomStream random(0, "irradiance", key.packed());
  const glm::vec3 axis = key.normal();
  const glm::vec3 middle =
      size_m * (glm::vec3(key.index[0], key.index[1], key.index[2]) + 0.5F) -
      kShift * size_m * axis;

  const Gatherer gatherer(rays_, surfaces_, lights_, options_);
  const auto lit_at = [&](const glm::vec3& point_m, const glm::vec3& normal) -> Cell {
    const Gathered light =
        gatherer.gather(point_m + kSurfaceOffset_m * normal, normal, random);
    const float along = glm::dot(light.flow, normal);
    return {light.irradiance, along > 0.0F ? light.flow / along : normal};
  };
  if (key.middle) return lit_at(middle, axis);

  // The surface of this cell: the outermost that a ray against the direction hits in it or up
  // to a quarter of a cell outside, where a slanted surface leaves it. Of thin layers (a pane
  // in its frame) the outermost may be the dark inside of something: then the next one counts.
  constexpr int kTries = 6;
  constexpr int kLayers = 4;
  int dark_left = 3;  // The inside of a wall is dark however often one looks.
  const float reach_m = 0.75F * size_m;
  for (int attempt = 0; attempt < kTries && dark_left > 0; ++attempt) {
    glm::vec3 start = middle + reach_m * axis;
    if (attempt > 0) {
      for (int i = 0; i < 3; ++i) {
        if (i != key.axis) start[i] += size_m * (uniform(random) - 0.5F);
      }
    }
    float t = 0.0F;
    for (int layer = 0; layer < kLayers && dark_left > 0; ++layer) {
      const sim::RayHit hit = rays_.cast(start, -axis, t, 2.0F * reach_m);
      if (!hit.hit()) break;
      t = hit.t + 1e-4F;
      if (main_axis(hit.normal) != key.axis) continue;
      const glm::vec3 normal = glm::dot(hit.normal, axis) < 0.0F ? -hit.normal : hit.normal;
      const Cell found = lit_at(start - hit.t * axis, normal);
      if (luminance(found.irradiance) > kDarkShare * median_irradiance_) return found;
      --dark_left;
    }
  }
  return {};
}

const IrradianceCache::Cell& IrradianceCache::cell(const Key& key) const {
  const std::uint64_t packed = key.packed();
  const auto known = cells_->map.find(packed);
  if (known != cells_->map.end()) return known->second;
  // Two threads may compute the same cell; they get the same value.
  return cells_->map.emplace(packed, compute(key)).first->second;
}

glm::vec3 IrradianceCache::at(const glm::vec3& point_m, const glm::vec3& face_normal,
                              const glm::vec3& normal) const {
  Key key;
  key.axis = main_axis(face_normal);
  key.negative = face_normal[key.axis] < 0.0F;
  const float size_m = options_.cell_m;
  const auto value = [&](const Cell& found) {
    const float turn = std::clamp(glm::dot(found.flow, normal), 0.3F, 1.8F);
    return turn * found.irradiance;
  };

  const float shifted_m = point_m[key.axis] + (key.negative ? -kShift : kShift) * size_m;
  key.index[static_cast<std::size_t>(key.axis)] =
      static_cast<int>(std::floor(shifted_m / size_m));
  const int axis_a = (key.axis + 1) % 3;
  const int axis_b = (key.axis + 2) % 3;
  const float a = point_m[axis_a] / size_m - 0.5F;
  const float b = point_m[axis_b] / size_m - 0.5F;
  const float a0 = std::floor(a);
  const float b0 = std::floor(b);

  // Bilinear between the four cells around, without those that have no surface or no light at
  // all (the inside of walls and furniture).
  glm::vec3 sum(0.0F);
  float weight_sum = 0.0F;
  for (int i = 0; i < 2; ++i) {
    for (int j = 0; j < 2; ++j) {
      const float weight =
          (i == 1 ? a - a0 : 1.0F - (a - a0)) * (j == 1 ? b - b0 : 1.0F - (b - b0));
      if (weight < 1e-3F) continue;
      key.index[static_cast<std::size_t>(axis_a)] = static_cast<int>(a0) + i;
      key.index[static_cast<std::size_t>(axis_b)] = static_cast<int>(b0) + j;
      const Cell& found = cell(key);
      if (luminance(found.irradiance) <= 0.0F) continue;
      sum += weight * value(found);
      weight_sum += weight;
    }
  }
  if (weight_sum > 0.0F) return sum / weight_sum;

  // Thin and jagged things: the light in the middle of the point's own cell.
  key.index[static_cast<std::size_t>(axis_a)] = static_cast<int>(std::floor(a + 0.5F));
  key.index[static_cast<std::size_t>(axis_b)] = static_cast<int>(std::floor(b + 0.5F));
  key.middle = true;
  return glm::max(value(cell(key)), glm::vec3(kCrackShare * median_irradiance_));
}

float IrradianceCache::find_median(const sim::MeshScene& scene) const {
  // Running sum of areas, to draw points evenly over all surfaces.
  struct Face {
    glm::vec3 corner, edge_a, edge_b;
    double area_before;
  };
  std::vector<Face> faces;
  double area = 0.0;
  for (const sim::SubMesh& mesh : scene.meshes) {
    for (const glm::uvec3& t : mesh.triangles) {
      const glm::vec3& corner = mesh.positions_m[t.x];
      const Face face{corner, mesh.positions_m[t.y] - corner, mesh.positions_m[t.z] - corner,
                      area};
      area += static_cast<double>(glm::length(glm::cross(face.edge_a, face.edge_b)));
      faces.push_back(face);
    }
  }
  if (!(area > 0.0)) return 0.0F;

  IrradianceOptions cheap = options_;
  cheap.shadow_samples = 2;
  cheap.bounce_samples = 16;
  const Gatherer gatherer(rays_, surfaces_, lights_, cheap);
  std::vector<float> lit;
  for (std::uint64_t i = 0; i < 512; ++i) {
    core::RandomStream random(1, "median_irradiance", i);
    const double at_area = random.uniform() * area;
    const auto after = std::upper_bound(
        faces.begin(), faces.end(), at_area,
        [](double value, const Face& face) { return value < face.area_before; });
    const Face& face = *(after - 1);
    float u = uniform(random);
    float v = uniform(random);
    if (u + v > 1.0F) {
      u = 1.0F - u;
      v = 1.0F - v;
    }
    const glm::vec3 cross = glm::cross(face.edge_a, face.edge_b);
    const float length = glm::length(cross);
    if (!(length > 0.0F)) continue;
    for (const float side : {1.0F, -1.0F}) {
      const glm::vec3 normal = side / length * cross;
      const glm::vec3 point =
          face.corner + u * face.edge_a + v * face.edge_b + kSurfaceOffset_m * normal;
      const float value = luminance(gatherer.gather(point, normal, random).irradiance);
      if (value > 1e-3F) lit.push_back(value);
    }
  }
  if (lit.empty()) return 0.0F;
  const auto middle = lit.begin() + static_cast<std::ptrdiff_t>(lit.size() / 2);
  std::nth_element(lit.begin(), middle, lit.end());
  return *middle;
}

}  // namespace segsim::worlds
