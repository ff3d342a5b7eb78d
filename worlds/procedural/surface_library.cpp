#include "worlds/procedural/surface_library.h"

#include <cmath>
#include <utility>

namespace segsim::worlds {
namespace {

bool same(const TextureRecipe& a, const TextureRecipe& b) {
  return a.kind == b.kind && a.palette == b.palette && a.size_px == b.size_px &&
         a.seed == b.seed;
}

}  // namespace

glm::vec3 linear_from_srgb(const glm::vec3& srgb) {
  glm::vec3 linear(0.0F);
  for (int k = 0; k < 3; ++k) {
    linear[k] =
        srgb[k] <= 0.04045F ? srgb[k] / 12.92F : std::pow((srgb[k] + 0.055F) / 1.055F, 2.4F);
  }
  return linear;
}

int SurfaceLibrary::material(const sim::Material& wanted) {
  for (std::size_t i = 0; i < scene_.materials.size(); ++i) {
    const sim::Material& m = scene_.materials[i];
    if (m.albedo == wanted.albedo && m.texture == wanted.texture &&
        m.emission == wanted.emission) {
      return static_cast<int>(i);
    }
  }
  scene_.materials.push_back(wanted);
  return static_cast<int>(scene_.materials.size() - 1);
}

Surface SurfaceLibrary::plain(const glm::vec3& srgb) {
  return {material({linear_from_srgb(srgb), -1, glm::vec3(0.0F)}), 1.0F};
}

Surface SurfaceLibrary::glowing(const glm::vec3& srgb, const glm::vec3& radiance) {
  return {material({linear_from_srgb(srgb), -1, radiance}), 1.0F};
}

Surface SurfaceLibrary::textured(const TextureRecipe& recipe, float tile_m,
                                 const glm::vec3& radiance) {
  const auto textured_with = [&](std::size_t index) -> Surface {
    return {material({glm::vec3(1.0F), static_cast<int>(first_texture_ + index), radiance}),
            tile_m};
  };
  for (std::size_t i = 0; i < paints_.size(); ++i) {
    if (paints_[i].picture == nullptr && same(paints_[i].recipe, recipe)) {
      return textured_with(i);
    }
  }
  if (recipes_ >= max_textures_) {
    const glm::vec3 mean = 0.5F * (recipe.palette[0] + recipe.palette[1]);
    return radiance == glm::vec3(0.0F) ? plain(mean) : glowing(mean, radiance);
  }
  paints_.push_back({recipe, nullptr});
  ++recipes_;
  return textured_with(paints_.size() - 1);
}

Surface SurfaceLibrary::ready(const glm::vec3& albedo, const glm::vec3& emission,
                              std::shared_ptr<const core::Image<core::Rgb8>> picture) {
  if (picture == nullptr) return {material({albedo, -1, emission}), 1.0F};
  std::size_t index = 0;
  while (index < paints_.size() && paints_[index].picture != picture) ++index;
  if (index == paints_.size()) paints_.push_back({{}, std::move(picture)});
  return {material({albedo, static_cast<int>(first_texture_ + index), emission}), 1.0F};
}

void SurfaceLibrary::rewind(const Mark& mark) {
  scene_.materials.resize(mark.materials);
  for (std::size_t i = mark.textures; i < paints_.size(); ++i) {
    if (paints_[i].picture == nullptr) --recipes_;
  }
  paints_.resize(mark.textures);
}

void SurfaceLibrary::finish(bool painted) {
  const auto painting = [&](std::size_t index) {
    if (!painted) return core::Image<core::Rgb8>(1, 1, core::Rgb8{255, 255, 255});
    const Paint& paint = paints_[index];
    return paint.picture != nullptr ? *paint.picture : make_texture(paint.recipe);
  };
  std::vector<int> new_material(scene_.materials.size(), -1);
  std::vector<int> new_texture(first_texture_ + paints_.size(), -1);
  for (const sim::SubMesh& mesh : scene_.meshes)
    new_material[static_cast<std::size_t>(mesh.material)] = 0;
  std::vector<sim::Material> materials;
  std::vector<core::Image<core::Rgb8>> textures;
  for (std::size_t i = 0; i < new_material.size(); ++i) {
    if (new_material[i] < 0) continue;
    new_material[i] = static_cast<int>(materials.size());
    sim::Material& kept = materials.emplace_back(scene_.materials[i]);
    if (kept.texture < 0) continue;
    const auto old = static_cast<std::size_t>(kept.texture);
    if (new_texture[old] < 0) {
      new_texture[old] = static_cast<int>(textures.size());
      textures.push_back(old < first_texture_ ? scene_.textures[old]
                                              : painting(old - first_texture_));
    }
    kept.texture = new_texture[old];
  }
  for (sim::SubMesh& mesh : scene_.meshes)
    mesh.material = new_material[static_cast<std::size_t>(mesh.material)];
  scene_.materials = std::move(materials);
  scene_.textures = std::move(textures);
}

}  // namespace segsim::worlds
