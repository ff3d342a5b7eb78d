#include "worlds/capture/surface_shading.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <utility>

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "core/check.h"

namespace segsim::worlds {
namespace {

/// Nothing reflects more: without this bound, white paper in a corner would keep light for
/// ever.
constexpr float kMaxAlbedo = 0.9F;

float linear_from_srgb_exact(float c) {
  return c <= 0.04045F ? c / 12.92F : std::pow((c + 0.055F) / 1.055F, 2.4F);
}

float srgb_from_linear_exact(float c) {
  return c <= 0.0031308F ? 12.92F * c : 1.055F * std::pow(c, 1.0F / 2.4F) - 0.055F;
}

const std::array<float, 256>& linear_of_byte() {
  static const std::array<float, 256> table = [] {
    std::array<float, 256> values{};
    for (std::size_t i = 0; i < values.size(); ++i) {
      values[i] = linear_from_srgb_exact(static_cast<float>(i) / 255.0F);
    }
    return values;
  }();
  return table;
}

/// sRGB bytes of 4096 evenly spread linear values; steps are below one byte above 0.004.
const std::array<std::uint8_t, 4097>& byte_of_linear() {
  static const std::array<std::uint8_t, 4097> table = [] {
    std::array<std::uint8_t, 4097> values{};
    for (std::size_t i = 0; i < values.size(); ++i) {
      const float srgb = srgb_from_linear_exact(static_cast<float>(i) / 4096.0F);
      values[i] = static_cast<std::uint8_t>(std::lround(255.0F * srgb));
    }
    return values;
  }();
  return table;
}

glm::vec3 linear(const core::Rgb8& texel) {
  const auto& table = linear_of_byte();
  return {table[texel.r], table[texel.g], table[texel.b]};
}

/// Halves both sides (at least 1); each texel is the mean of the four above it in linear
/// light.
core::Image<core::Rgb8> half_size(const core::Image<core::Rgb8>& image) {
  core::Image<core::Rgb8> half(std::max(1, image.width_px() / 2),
                               std::max(1, image.height_px() / 2));
  for (int y = 0; y < half.height_px(); ++y) {
    for (int x = 0; x < half.width_px(); ++x) {
      const int x1 = std::min(2 * x + 1, image.width_px() - 1);
      const int y1 = std::min(2 * y + 1, image.height_px() - 1);
      half(x, y) =
          srgb_from_linear(0.25F * (linear(image(2 * x, 2 * y)) + linear(image(x1, 2 * y)) +
                                    linear(image(2 * x, y1)) + linear(image(x1, y1))));
    }
  }
  return half;
}

int wrapped(int i, int size) {
  const int rest = i % size;
  return rest < 0 ? rest + size : rest;
}

glm::vec3 bilinear(const core::Image<core::Rgb8>& image, float u, float v) {
  const float x = (u - std::floor(u)) * static_cast<float>(image.width_px()) - 0.5F;
  const float y = (1.0F - (v - std::floor(v))) * static_cast<float>(image.height_px()) - 0.5F;
  const int x0 = static_cast<int>(std::floor(x));
  const int y0 = static_cast<int>(std::floor(y));
  const float fx = x - static_cast<float>(x0);
  const float fy = y - static_cast<float>(y0);
  const int left = wrapped(x0, image.width_px());
  const int right = wrapped(x0 + 1, image.width_px());
  const int top = wrapped(y0, image.height_px());
  const int bottom = wrapped(y0 + 1, image.height_px());
  return (1.0F - fy) *
             ((1.0F - fx) * linear(image(left, top)) + fx * linear(image(right, top))) +
         fy * ((1.0F - fx) * linear(image(left, bottom)) + fx * linear(image(right, bottom)));
}

float uv_density(const sim::SubMesh& mesh, const glm::uvec3& t) {
  const glm::vec3 edge_a = mesh.positions_m[t.y] - mesh.positions_m[t.x];
  const glm::vec3 edge_b = mesh.positions_m[t.z] - mesh.positions_m[t.x];
  const glm::vec2 uv_a = mesh.uvs[t.y] - mesh.uvs[t.x];
  const glm::vec2 uv_b = mesh.uvs[t.z] - mesh.uvs[t.x];
  const float area_m2 = glm::length(glm::cross(edge_a, edge_b));
  const float uv_area = std::abs(uv_a.x * uv_b.y - uv_a.y * uv_b.x);
  return area_m2 > 0.0F ? std::sqrt(uv_area / area_m2) : 0.0F;
}

}  // namespace

core::Rgb8 srgb_from_linear(const glm::vec3& colour) {
  const auto& table = byte_of_linear();
  const auto byte = [&](float c) {
    // min(max()) in this order makes NaN black.
    const float clamped = std::min(1.0F, std::max(0.0F, c));
    return table[static_cast<std::size_t>(std::floor(clamped * 4096.0F + 0.5F))];
  };
  return {byte(colour.x), byte(colour.y), byte(colour.z)};
}

SurfaceShading::SurfaceShading(const sim::MeshScene& scene) : materials_(scene.materials) {
  for (sim::Material& material : materials_) {
    SEGSIM_CHECK(material.texture < static_cast<int>(scene.textures.size()),
                 "texture " + std::to_string(material.texture));
    material.albedo = glm::min(material.albedo, glm::vec3(kMaxAlbedo));
  }
  for (const core::Image<core::Rgb8>& texture : scene.textures) {
    SEGSIM_CHECK(!texture.empty(), "empty texture");
    MipChain chain{texture};
    while (chain.back().size() > 1) chain.push_back(half_size(chain.back()));
    textures_.push_back(std::move(chain));
  }
  for (const sim::SubMesh& source : scene.meshes) {
    SEGSIM_CHECK(source.material >= 0 && source.material < static_cast<int>(materials_.size()),
                 "material " + std::to_string(source.material));
    Mesh mesh;
    mesh.triangles = source.triangles;
    mesh.material = source.material;
    if (source.normals.size() == source.positions_m.size()) mesh.normals = source.normals;
    const bool textured = materials_[static_cast<std::size_t>(mesh.material)].texture >= 0;
    if (textured && source.uvs.size() == source.positions_m.size()) {
      mesh.uvs = source.uvs;
      for (const glm::uvec3& t : source.triangles)
        mesh.uv_per_m.push_back(uv_density(source, t));
    }
    meshes_.push_back(std::move(mesh));
  }
}

glm::vec3 SurfaceShading::smooth_normal(const sim::RayHit& hit,
                                        const glm::vec3& direction) const {
  const glm::vec3 facing = glm::dot(hit.normal, direction) > 0.0F ? -hit.normal : hit.normal;
  const Mesh& mesh = meshes_[hit.mesh];
  if (mesh.normals.empty()) return facing;
  const glm::uvec3& t = mesh.triangles[hit.triangle];
  glm::vec3 smooth = (1.0F - hit.u - hit.v) * mesh.normals[t.x] + hit.u * mesh.normals[t.y] +
                     hit.v * mesh.normals[t.z];
  const float length = glm::length(smooth);
  if (!(length > 0.5F)) return facing;  // Normals that cancel out: a broken file.
  smooth /= length;
  if (glm::dot(smooth, facing) < 0.0F) smooth = -smooth;
  return glm::dot(smooth, facing) < 0.5F ? facing : smooth;
}

glm::vec3 SurfaceShading::albedo(const sim::RayHit& hit, float footprint_m) const {
  const Mesh& mesh = meshes_[hit.mesh];
  const sim::Material& material = materials_[static_cast<std::size_t>(mesh.material)];
  if (mesh.uvs.empty()) return material.albedo;
  const glm::uvec3& t = mesh.triangles[hit.triangle];
  const glm::vec2 uv =
      (1.0F - hit.u - hit.v) * mesh.uvs[t.x] + hit.u * mesh.uvs[t.y] + hit.v * mesh.uvs[t.z];
  if (!std::isfinite(uv.x) || !std::isfinite(uv.y)) return material.albedo;
  const MipChain& chain = textures_[static_cast<std::size_t>(material.texture)];
  const auto side_px =
      static_cast<float>(std::max(chain.front().width_px(), chain.front().height_px()));
  const float texels = footprint_m * mesh.uv_per_m[hit.triangle] * side_px;
  const int last = static_cast<int>(chain.size()) - 1;
  // The exponent of a float is the floor of its logarithm; 1.41 rounds to the nearest level.
  const int level = texels > 1.0F ? std::min(last, std::ilogb(texels * 1.41F)) : 0;
  return material.albedo * bilinear(chain[static_cast<std::size_t>(level)], uv.x, uv.y);
}

}  // namespace segsim::worlds
