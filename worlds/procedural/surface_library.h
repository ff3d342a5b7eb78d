#pragma once

/// @file
/// Adds materials and textures to a scene, each only once. Textures are painted at the end, by
/// finish(), because furniture that finds no place takes its own with it.

#include <cstdint>
#include <memory>
#include <vector>

#include <glm/vec3.hpp>

#include "sim/ground/mesh_scene.h"
#include "worlds/mesh/mesh_builder.h"
#include "worlds/procedural/procedural_texture.h"

namespace segsim::worlds {

/// Linear RGB of an sRGB colour, components in [0, 1].
[[nodiscard]] glm::vec3 linear_from_srgb(const glm::vec3& srgb);

/// Refers to the scene: it must outlive the library.
class SurfaceLibrary {
 public:
  /// @param max_textures  When they are used up, textured() falls back to the plain mean
  /// colour.
  explicit SurfaceLibrary(sim::MeshScene& scene, int max_textures = 60)
      : scene_(scene), max_textures_(max_textures), first_texture_(scene.textures.size()) {}

  [[nodiscard]] Surface plain(const glm::vec3& srgb);
  /// A lamp or a bright panel. @param radiance  Linear RGB.
  [[nodiscard]] Surface glowing(const glm::vec3& srgb, const glm::vec3& radiance);
  /// @param tile_m  Length of one repeat. @param radiance  Linear RGB, added.
  [[nodiscard]] Surface textured(const TextureRecipe& recipe, float tile_m,
                                 const glm::vec3& radiance = glm::vec3(0.0F));

  /// A surface with a picture from elsewhere, which counts to no limit. Texture coordinates
  /// are those of the mesh. @param albedo, emission  Linear RGB, as in sim::Material.
  /// @param picture  Null for none. Equal pointers are one texture.
  [[nodiscard]] Surface ready(const glm::vec3& albedo, const glm::vec3& emission,
                              std::shared_ptr<const core::Image<core::Rgb8>> picture);

  /// Undoes what was added since mark(); nothing in the scene may use it any more.
  struct Mark {
    std::size_t materials, textures;
  };
  [[nodiscard]] Mark mark() const { return {scene_.materials.size(), paints_.size()}; }
  void rewind(const Mark& mark);

  /// Drops what no mesh of the scene uses, numbers the rest anew in order, and paints the
  /// textures. The library is spent afterwards.
  /// @param painted  False: textures become one white pixel.
  void finish(bool painted = true);

 private:
  /// What a texture becomes: a recipe, or a picture that is there already.
  struct Paint {
    TextureRecipe recipe;
    std::shared_ptr<const core::Image<core::Rgb8>> picture;
  };

  int material(const sim::Material& wanted);

  sim::MeshScene& scene_;
  int max_textures_;
  int recipes_ = 0;            ///< Paints that are recipes.
  std::vector<Paint> paints_;  ///< Of the scene's textures from first_texture_ on.
  std::size_t first_texture_;
};

}  // namespace segsim::worlds
