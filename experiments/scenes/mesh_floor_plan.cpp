#include "experiments/scenes/mesh_floor_plan.h"

#include <algorithm>
#include <cmath>

#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/vec3.hpp>

namespace segsim::experiments::scenes {
namespace {

constexpr int kLargestSide_px = 2400;
constexpr core::Rgb8 kPaper{248, 248, 246}, kWall{92, 92, 96};
constexpr float kFloor_m = 0.06F;  ///< Whatever is lower is no obstacle.

/// Mean colour of a material, sRGB in [0, 1].
glm::vec3 color_of(const sim::MeshScene& scene, const sim::Material& material) {
  glm::vec3 linear = material.albedo;
  if (material.texture >= 0) {
    const auto& pixels = scene.textures[static_cast<std::size_t>(material.texture)].pixels();
    glm::dvec3 sum(0.0);
    for (const core::Rgb8& p : pixels) sum += glm::dvec3(p.r, p.g, p.b) / 255.0;
    const glm::dvec3 mean = pixels.empty() ? glm::dvec3(1.0) : sum / double(pixels.size());
    linear *= glm::vec3(mean * mean);  // The square is near enough to sRGB's curve.
  }
  return glm::sqrt(glm::clamp(linear, 0.0F, 1.0F));
}

core::Rgb8 brightened(const glm::vec3& srgb, float level) {
  const glm::vec3 c = glm::mix(srgb * level, glm::vec3(1.0F), 0.18F) * 255.0F + 0.5F;
  return {static_cast<std::uint8_t>(c.x), static_cast<std::uint8_t>(c.y),
          static_cast<std::uint8_t>(c.z)};
}

/// Heights and colours as seen from above.
class PlanRaster {
 public:
  explicit PlanRaster(drawing::FloorPlan& plan)
      : plan_(plan), height_m_(plan.rgb.width_px(), plan.rgb.height_px(), -1e9F) {}

  void add(const glm::vec3& a, const glm::vec3& b, const glm::vec3& c, const glm::vec3& srgb) {
    const glm::vec3 normal = glm::cross(b - a, c - a);
    const float length = glm::length(normal);
    if (!(length > 0.0F) || std::abs(normal.z) < 0.02F * length) return;  // Seen edge on.
    const glm::dvec2 pa = px(a), pb = px(b), pc = px(c);
    const double area = cross(pb - pa, pc - pa);
    if (area == 0.0) return;
    const glm::dvec2 low = glm::min(pa, glm::min(pb, pc)),
                     high = glm::max(pa, glm::max(pb, pc));
    const core::Rgb8 color = brightened(srgb, 0.7F + 0.3F * std::abs(normal.z) / length);
    const int x1 = std::min(plan_.rgb.width_px() - 1, static_cast<int>(std::floor(high.x)));
    const int y1 = std::min(plan_.rgb.height_px() - 1, static_cast<int>(std::floor(high.y)));
    for (int y = std::max(0, static_cast<int>(std::floor(low.y))); y <= y1; ++y) {
      for (int x = std::max(0, static_cast<int>(std::floor(low.x))); x <= x1; ++x) {
        const glm::dvec2 p(x + 0.5, y + 0.5);
        const double wb = cross(p - pa, pc - pa) / area, wc = cross(pb - pa, p - pa) / area;
        if (wb < 0.0 || wc < 0.0 || wb + wc > 1.0) continue;
        const auto z = static_cast<float>(a.z + wb * (b.z - a.z) + wc * (c.z - a.z));
        if (z <= height_m_(x, y)) continue;
        height_m_(x, y) = z;
        plan_.rgb(x, y) = color;
      }
    }
  }
  [[nodiscard]] float height_m(int x, int y) const { return height_m_(x, y); }

 private:
  [[nodiscard]] glm::dvec2 px(const glm::vec3& p) const { return plan_.to_px({p.x, p.y}); }
  static double cross(const glm::dvec2& a, const glm::dvec2& b) {
    return a.x * b.y - a.y * b.x;
  }

  drawing::FloorPlan& plan_;
  core::Image<float> height_m_;
};

void draw_tall(const sim::CollisionWorld& collision, const PlanRaster& raster,
               drawing::FloorPlan& plan) {
  for (int y = 0; y < plan.rgb.height_px(); ++y) {
    for (int x = 0; x < plan.rgb.width_px(); ++x) {
      const float z = raster.height_m(x, y);
      if (z > kFloor_m) continue;
      const glm::dvec2 p_m =
          plan.origin_m + glm::dvec2(x + 0.5, plan.rgb.height_px() - y - 0.5) / plan.px_per_m;
      const glm::ivec2 cell = collision.frame().cell_of(p_m);
      if (!collision.frame().contains(cell)) continue;
      // Where there is no floor nothing is drawn: that is outside.
      const bool solid = collision.body_layer().occupied(cell.x, cell.y) != 0;
      if (solid && z > -0.5F) plan.rgb(x, y) = kWall;
    }
  }
}

}  // namespace

drawing::FloorPlan make_mesh_floor_plan(const sim::MeshScene& scene, const sim::World& world,
                                        double max_height_m, double px_per_m) {
  const sim::GridFrame& frame = world.collision().frame();
  const glm::dvec2 size_m = frame.cell_m * glm::dvec2(frame.width, frame.height);
  drawing::FloorPlan plan;
  plan.px_per_m = std::min(px_per_m, kLargestSide_px / std::max(size_m.x, size_m.y));
  plan.origin_m = frame.origin_m;
  plan.rgb = core::Image<core::Rgb8>(
      std::max(1, static_cast<int>(std::ceil(size_m.x * plan.px_per_m))),
      std::max(1, static_cast<int>(std::ceil(size_m.y * plan.px_per_m))), kPaper);
  PlanRaster raster(plan);
  for (const sim::SubMesh& mesh : scene.meshes) {
    const glm::vec3 color =
        color_of(scene, scene.materials[static_cast<std::size_t>(mesh.material)]);
    for (const glm::uvec3& t : mesh.triangles) {
      const glm::vec3 &a = mesh.positions_m[t.x], &b = mesh.positions_m[t.y],
                      &c = mesh.positions_m[t.z];
      if (std::max({a.z, b.z, c.z}) > max_height_m) continue;
      raster.add(a, b, c, color);
    }
  }
  draw_tall(world.collision(), raster, plan);
  return plan;
}

}  // namespace segsim::experiments::scenes
