#include "worlds/procedural/procedural_texture.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/vec2.hpp>

#include "core/check.h"
#include "core/random.h"

namespace segsim::worlds {
namespace {

constexpr float kTwoPi = 2.0F * std::numbers::pi_v<float>;

/// Value noise on a lattice that repeats, so that the texture does.
class Noise {
 public:
  explicit Noise(std::uint64_t seed)
      : seed_(static_cast<std::uint32_t>(seed ^ (seed >> 32)) * 0x9E3779B1U + 0x85EBCA77U) {}

  /// Uniform in [0, 1) for each lattice point and layer.
  [[nodiscard]] float cell(int x, int y, std::uint32_t layer = 0) const {
    std::uint32_t h = seed_ ^ (layer * 0x27D4EB2FU);
    h = (h ^ static_cast<std::uint32_t>(x)) * 0x85EBCA6BU;
    h = (h ^ (h >> 15) ^ static_cast<std::uint32_t>(y)) * 0xC2B2AE35U;
    h ^= h >> 13;
    h *= 0x27D4EB2FU;
    h ^= h >> 16;
    return static_cast<float>(h >> 8) * 0x1.0p-24F;
  }

  /// Smooth in [0, 1]; period (px, py) lattice steps.
  [[nodiscard]] float smooth(float x, float y, int px, int py, std::uint32_t layer = 0) const {
    const float fx = std::floor(x), fy = std::floor(y);
    const auto wrap = [](int i, int n) { return ((i % n) + n) % n; };
    const int x0 = wrap(static_cast<int>(fx), px), y0 = wrap(static_cast<int>(fy), py);
    const int x1 = x0 + 1 == px ? 0 : x0 + 1, y1 = y0 + 1 == py ? 0 : y0 + 1;
    const float tx = x - fx, ty = y - fy;
    const float sx = tx * tx * (3.0F - 2.0F * tx), sy = ty * ty * (3.0F - 2.0F * ty);
    return glm::mix(glm::mix(cell(x0, y0, layer), cell(x1, y0, layer), sx),
                    glm::mix(cell(x0, y1, layer), cell(x1, y1, layer), sx), sy);
  }

  /// Sum of octaves in [0, 1]; (u, v) in [0, 1] is one period; (px, py) lattice steps in the
  /// first.
  [[nodiscard]] float fractal(float u, float v, int px, int py, int octaves,
                              std::uint32_t layer = 0) const {
    float sum = 0.0F, weight = 0.5F, total = 0.0F;
    for (int k = 0; k < octaves; ++k) {
      sum += weight * smooth(u * static_cast<float>(px), v * static_cast<float>(py), px, py,
                             layer + static_cast<std::uint32_t>(k));
      total += weight;
      weight *= 0.5F;
      px *= 2;
      py *= 2;
    }
    return sum / total;
  }

 private:
  std::uint32_t seed_;
};

float step_smooth(float lo, float hi, float x) {
  const float t = std::clamp((x - lo) / (hi - lo), 0.0F, 1.0F);
  return t * t * (3.0F - 2.0F * t);
}

float fraction(float x) { return x - std::floor(x); }

/// Everything that a pixel function needs. (u, v) in [0, 1), v upwards.
struct Paint {
  const TextureRecipe& recipe;
  Noise noise;
  glm::vec3 a, b, c;

  [[nodiscard]] glm::vec3 grain(float u, float v, std::uint32_t layer) const {
    const float wave = noise.fractal(u, v, 2, 24, 3, layer);
    const float fine = noise.smooth(u * 8.0F, v * 128.0F, 8, 128, layer + 7);
    return glm::mix(a, b, std::clamp(1.6F * wave - 0.3F, 0.0F, 1.0F)) * (0.9F + 0.16F * fine);
  }

  [[nodiscard]] glm::vec3 planks(float u, float v) const {
    constexpr int kRows = 8;
    const float row_v = v * kRows;
    const int row = static_cast<int>(row_v);
    const float along = u * 2.0F + noise.cell(row, 3, 1);
    const int plank = static_cast<int>(std::floor(along)) % 2;
    const float tone = 0.78F + 0.36F * noise.cell(row, plank, 2);
    const float edge = std::min(fraction(row_v), 1.0F - fraction(row_v)) / kRows;
    const float joint = std::min(fraction(along), 1.0F - fraction(along)) / 2.0F;
    const float gap = step_smooth(0.0015F, 0.005F, std::min(edge, joint));
    return grain(u, fraction(v + 0.37F * static_cast<float>(plank)), 20) * tone *
           (0.45F + 0.55F * gap);
  }

  [[nodiscard]] glm::vec3 parquet(float u, float v) const {
    constexpr int kBlocks = 4, kStrips = 4;
    const int bx = static_cast<int>(u * kBlocks), by = static_cast<int>(v * kBlocks);
    const bool turned = (bx + by) % 2 == 1;
    const float x = fraction((turned ? v : u) * kBlocks),
                y = fraction((turned ? u : v) * kBlocks);
    const int strip = static_cast<int>(y * kStrips);
    const float tone = 0.75F + 0.4F * noise.cell(bx * kBlocks + by, strip, 5);
    const float edge = std::min({fraction(y * kStrips), 1.0F - fraction(y * kStrips),
                                 kStrips * x, kStrips * (1.0F - x)});
    return grain(turned ? v : u, turned ? u : v, 30) * tone *
           (0.5F + 0.5F * step_smooth(0.02F, 0.09F, edge));
  }

  [[nodiscard]] glm::vec3 tiles(float u, float v) const {
    constexpr int kCount = 4;
    const int x = static_cast<int>(u * kCount), y = static_cast<int>(v * kCount);
    const float fu = fraction(u * kCount), fv = fraction(v * kCount);
    const float edge = std::min({fu, 1.0F - fu, fv, 1.0F - fv});
    const glm::vec3 base = (x + y) % 2 == 0 ? a : b;
    const float tone =
        0.93F + 0.1F * noise.cell(x, y, 1) + 0.05F * noise.fractal(u, v, 8, 8, 3);
    return glm::mix(c, base * tone, step_smooth(0.018F, 0.035F, edge));
  }

  [[nodiscard]] glm::vec3 cloth(float u, float v, const glm::vec3& colour) const {
    constexpr int kThreads = 64;
    const float x = u * kThreads, y = v * kThreads;
    const bool over = (static_cast<int>(x) + static_cast<int>(y)) % 2 == 0;
    const float bump = std::sin(0.5F * kTwoPi * fraction(over ? x : y));
    return colour * (0.78F + 0.2F * bump + 0.12F * (noise.fractal(u, v, 16, 16, 2) - 0.5F));
  }

  [[nodiscard]] glm::vec3 stripes(float u, float v) const {
    const float x = fraction(u * 4.0F);
    glm::vec3 colour = x < 0.45F ? a : b;
    if ((x > 0.18F && x < 0.25F) || (x > 0.68F && x < 0.75F)) colour = c;
    return cloth(u, v, colour);
  }

  [[nodiscard]] glm::vec3 checks(float u, float v) const {
    const auto band = [](float t) { return fraction(t * 3.0F) < 0.5F ? 1.0F : 0.0F; };
    const auto line = [](float t) { return std::abs(fraction(t * 3.0F) - 0.75F) < 0.05F; };
    glm::vec3 colour = glm::mix(a, b, 0.5F * (band(u) + band(v)));
    if (line(u) || line(v)) colour = c;
    return cloth(u, v, colour);
  }

  [[nodiscard]] glm::vec3 floral(float u, float v) const {
    constexpr int kCells = 4;
    const int x = static_cast<int>(u * kCells), y = static_cast<int>(v * kCells);
    const glm::vec2 centre(0.35F + 0.3F * noise.cell(x, y, 1),
                           0.35F + 0.3F * noise.cell(x, y, 2));
    const glm::vec2 d = glm::vec2(fraction(u * kCells), fraction(v * kCells)) - centre;
    const float radius = 0.2F + 0.12F * noise.cell(x, y, 3);
    const float petal = radius * (0.7F + 0.3F * std::cos(5.0F * std::atan2(d.y, d.x)));
    const float r = glm::length(d);
    glm::vec3 colour = r < petal ? (noise.cell(x, y, 4) < 0.5F ? b : c) : a;
    if (r < 0.07F) colour = 0.4F * a + 0.6F * glm::vec3(0.95F, 0.85F, 0.4F);
    return cloth(u, v, colour);
  }

  [[nodiscard]] glm::vec3 wallpaper(float u, float v) const {
    glm::vec3 colour = fraction(u * 4.0F) < 0.5F ? a : glm::mix(a, b, 0.6F);
    const float row = v * 4.0F + (static_cast<int>(u * 8.0F) % 2 == 0 ? 0.0F : 0.5F);
    const glm::vec2 d(fraction(u * 8.0F) - 0.5F, fraction(row) - 0.5F);
    if (std::abs(d.x) * 1.4F + std::abs(d.y) < 0.22F) colour = glm::mix(a, c, 0.55F);
    return colour * (0.97F + 0.06F * noise.fractal(u, v, 32, 32, 2));
  }

  [[nodiscard]] glm::vec3 marble(float u, float v) const {
    const float warp = noise.fractal(u, v, 4, 4, 5);
    const float vein = std::abs(std::sin(kTwoPi * (u + 2.0F * v + 1.6F * warp)));
    return glm::mix(glm::mix(a, b, noise.fractal(u, v, 3, 3, 4, 11)), c,
                    0.8F * (1.0F - step_smooth(0.0F, 0.16F, vein)));
  }

  [[nodiscard]] glm::vec3 leather(float u, float v) const {
    const float crease = std::abs(noise.fractal(u, v, 32, 32, 2) - 0.5F);
    return glm::mix(a, b, noise.fractal(u, v, 4, 4, 3, 9)) *
           (0.78F + 0.22F * step_smooth(0.0F, 0.08F, crease));
  }

  [[nodiscard]] glm::vec3 rug(float u, float v) const {
    const float edge = std::min({u, 1.0F - u, v, 1.0F - v});
    glm::vec3 colour = a;
    if (edge < 0.03F) {
      colour = c;
    } else if (edge < 0.12F) {
      colour = fraction((u + v) * 14.0F) < 0.5F ? b : c;
    } else if (edge < 0.15F) {
      colour = a * 0.6F;
    } else {
      const glm::vec2 d(fraction(u * 3.0F) - 0.5F, fraction(v * 3.0F) - 0.5F);
      const float ring = recipe.seed % 2 == 0 ? std::abs(d.x) + std::abs(d.y) : glm::length(d);
      if (fraction(ring * 5.0F) < 0.4F) colour = ring < 0.3F ? c : b;
    }
    return colour * (0.82F + 0.3F * noise.cell(static_cast<int>(u * 256.0F),
                                               static_cast<int>(v * 256.0F), 2));
  }

  [[nodiscard]] glm::vec3 screen(float u, float v) const {
    const glm::vec3 low(0.02F, 0.03F, 0.07F), high(0.10F, 0.18F, 0.36F);
    const float hill = 0.25F + 0.2F * noise.fractal(u, 0.5F, 4, 4, 3);
    glm::vec3 colour = glm::mix(low, high, v * v);
    if (v < hill) colour = glm::vec3(0.03F, 0.07F, 0.08F);
    return colour +
           0.12F * step_smooth(0.25F, 0.0F, glm::length(glm::vec2(u - 0.7F, v - 0.75F)));
  }

  [[nodiscard]] glm::vec3 view(float u, float v) const {
    const glm::vec3 sky =
        glm::mix(glm::vec3(0.86F, 0.91F, 0.95F), glm::vec3(0.52F, 0.72F, 0.92F), v);
    const float cloud = step_smooth(0.52F, 0.75F, noise.fractal(u, v, 3, 5, 4));
    glm::vec3 colour = glm::mix(sky, glm::vec3(0.97F), cloud);
    const int house = static_cast<int>(u * 6.0F);
    const float roof = 0.12F + 0.3F * noise.cell(house, 1, 3);
    if (recipe.seed % 3 == 0 && v < roof) {
      const bool pane = fraction(u * 24.0F) > 0.45F && fraction(v * 18.0F) > 0.5F;
      colour = pane ? glm::vec3(0.5F, 0.58F, 0.66F)
                    : glm::mix(a, glm::vec3(0.75F, 0.68F, 0.62F), noise.cell(house, 2, 3));
    } else if (v < 0.18F + 0.25F * noise.fractal(u, 0.0F, 5, 5, 4, 9)) {
      colour = glm::vec3(0.42F, 0.56F, 0.34F) * (0.7F + 0.6F * noise.fractal(u, v, 24, 24, 2));
    }
    return colour;
  }

  [[nodiscard]] glm::vec3 leaf(float u, float v) const {
    const float rib = std::abs(u - 0.5F);
    const float vein = std::abs(fraction(v * 6.0F + 1.5F * rib) - 0.5F);
    glm::vec3 colour = glm::mix(a, b, noise.fractal(u, v, 4, 4, 3));
    if (rib < 0.03F || vein < 0.05F) colour = glm::mix(colour, c, 0.6F);
    return colour;
  }

  [[nodiscard]] glm::vec3 at(float u, float v) const {
    switch (recipe.kind) {
      case TextureKind::kWood:
        return grain(u, v, 0);
      case TextureKind::kPlanks:
        return planks(u, v);
      case TextureKind::kParquet:
        return parquet(u, v);
      case TextureKind::kTiles:
        return tiles(u, v);
      case TextureKind::kPlaster:
        return glm::mix(a, b, 0.35F * noise.fractal(u, v, 4, 4, 4)) *
               (0.96F + 0.06F * noise.smooth(u * 96.0F, v * 96.0F, 96, 96, 8));
      case TextureKind::kWallpaper:
        return wallpaper(u, v);
      case TextureKind::kWeave:
        return cloth(u, v, glm::mix(a, b, noise.fractal(u, v, 32, 32, 2, 4)));
      case TextureKind::kStripes:
        return stripes(u, v);
      case TextureKind::kChecks:
        return checks(u, v);
      case TextureKind::kFloral:
        return floral(u, v);
      case TextureKind::kMarble:
        return marble(u, v);
      case TextureKind::kLeather:
        return leather(u, v);
      case TextureKind::kCarpet:
        return glm::mix(a, b,
                        0.6F * noise.fractal(u, v, 8, 8, 2) +
                            0.4F * noise.smooth(u * 128.0F, v * 128.0F, 128, 128, 5));
      case TextureKind::kMetal:
        return a * (0.9F + 0.2F * noise.fractal(u, v, 2, 96, 2));
      case TextureKind::kScreen:
        return screen(u, v);
      case TextureKind::kView:
        return view(u, v);
      case TextureKind::kRug:
        return rug(u, v);
      case TextureKind::kLeaf:
        return leaf(u, v);
      case TextureKind::kPicture:
        break;  // Painted shape by shape below.
    }
    return a;
  }
};

/// A painting: ground in two colours, then discs, bars and a horizon.
class Painting {
 public:
  explicit Painting(const TextureRecipe& recipe) : recipe_(recipe) {
    core::RandomStream random(recipe.seed, "painting");
    horizon_ = static_cast<float>(random.uniform(0.25, 0.6));
    const std::uint32_t count = 4 + random.index(6);
    for (std::uint32_t i = 0; i < count; ++i) {
      Shape shape;
      shape.disc = random.chance(0.5);
      shape.centre = {static_cast<float>(random.uniform()),
                      static_cast<float>(random.uniform())};
      shape.half = {static_cast<float>(random.uniform(0.05, 0.22)),
                    static_cast<float>(random.uniform(0.05, 0.3))};
      shape.angle_rad = static_cast<float>(random.uniform(0.0, 3.1));
      for (int k = 0; k < 3; ++k)
        shape.colour[k] = static_cast<float>(random.uniform(0.05, 0.95));
      shape.colour = glm::mix(shape.colour, recipe.palette[random.index(3)], 0.5F);
      shapes_.push_back(shape);
    }
  }

  [[nodiscard]] glm::vec3 at(float u, float v) const {
    const auto& [a, b, c] = recipe_.palette;
    glm::vec3 colour = v > horizon_ ? glm::mix(a, b, (v - horizon_) / (1.0F - horizon_))
                                    : glm::mix(c, 0.5F * c, 1.0F - v / horizon_);
    for (const Shape& s : shapes_) {
      const glm::vec2 d = glm::vec2(u, v) - s.centre;
      const glm::vec2 turned(d.x * std::cos(s.angle_rad) + d.y * std::sin(s.angle_rad),
                             d.y * std::cos(s.angle_rad) - d.x * std::sin(s.angle_rad));
      const glm::vec2 q = glm::abs(turned / s.half);
      if (s.disc ? glm::length(d) < s.half.x : (q.x < 1.0F && q.y < 1.0F)) colour = s.colour;
    }
    return colour;
  }

 private:
  struct Shape {
    bool disc = false;
    glm::vec2 centre{0.0F}, half{0.1F};
    float angle_rad = 0.0F;
    glm::vec3 colour{0.5F};
  };
  const TextureRecipe& recipe_;
  float horizon_ = 0.5F;
  std::vector<Shape> shapes_;
};

std::uint8_t to_byte(float value) {
  return static_cast<std::uint8_t>(std::lround(255.0F * std::clamp(value, 0.0F, 1.0F)));
}

}  // namespace

core::Image<core::Rgb8> make_texture(const TextureRecipe& recipe) {
  SEGSIM_CHECK(recipe.size_px > 0, std::to_string(recipe.size_px));
  const Paint paint{recipe, Noise(recipe.seed), recipe.palette[0], recipe.palette[1],
                    recipe.palette[2]};
  const Painting painting(recipe);
  core::Image<core::Rgb8> image(recipe.size_px, recipe.size_px);
  const float pixel = 1.0F / static_cast<float>(recipe.size_px);
  for (int y = 0; y < recipe.size_px; ++y) {
    for (int x = 0; x < recipe.size_px; ++x) {
      const float u = (static_cast<float>(x) + 0.5F) * pixel;
      const float v = 1.0F - (static_cast<float>(y) + 0.5F) * pixel;
      const glm::vec3 colour =
          recipe.kind == TextureKind::kPicture ? painting.at(u, v) : paint.at(u, v);
      image(x, y) = {to_byte(colour.x), to_byte(colour.y), to_byte(colour.z)};
    }
  }
  return image;
}

}  // namespace segsim::worlds
