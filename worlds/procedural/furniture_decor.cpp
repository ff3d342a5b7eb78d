/// Plants, lamps, rugs, pictures and small things in the target style.

#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "worlds/procedural/internal/furniture_makers.h"

namespace segsim::worlds::internal {
namespace {

constexpr float kTwoPi = 2.0F * std::numbers::pi_v<float>;

/// @returns height of the soil.
float add_pot(Workshop& w, float radius, float height) {
  Dice& dice = w.dice;
  const int kind = dice.count(0, 3);
  w.use(dice.chance(0.4F) ? w.surfaces.plain(hsv(0.04F, 0.6F, 0.7F)) : w.painted());
  if (kind == 0) {  // Flower pot with a rim.
    const std::array<glm::vec2, 6> profile{{{0, 0},
                                            {0.7F * radius, 0},
                                            {0.92F * radius, 0.8F * height},
                                            {radius, 0.8F * height},
                                            {radius, height},
                                            {0.86F * radius, height}}};
    w.mesh().add_lathe(glm::vec3(0.0F), profile, 20);
  } else if (kind == 1) {  // Bulb.
    const std::array<glm::vec2, 7> profile{{{0, 0},
                                            {0.6F * radius, 0},
                                            {0.95F * radius, 0.3F * height},
                                            {radius, 0.55F * height},
                                            {0.85F * radius, 0.85F * height},
                                            {0.88F * radius, height},
                                            {0.8F * radius, height}}};
    w.mesh().add_lathe(glm::vec3(0.0F), profile, 20);
  } else if (kind == 2) {  // Square planter.
    w.mesh().add_rounded_box({0, 0, 0.5F * height}, {1.8F * radius, 1.8F * radius, height},
                             0.015F, 1);
  } else {  // Cylinder.
    w.mesh().add_cylinder({0, 0, 0}, {0, 0, height}, 0.92F * radius, 0.95F * radius, 20);
  }
  w.use(w.surfaces.plain(glm::vec3(0.22F, 0.15F, 0.1F)));
  w.mesh().add_cylinder({0, 0, height - 0.03F}, {0, 0, height + 0.006F}, 0.8F * radius,
                        0.78F * radius, 16);
  return height;
}

glm::vec3 direction_of(float azimuth, float elevation) {
  return {std::cos(azimuth) * std::cos(elevation), std::sin(azimuth) * std::cos(elevation),
          std::sin(elevation)};
}

/// Long leaves that rise from the pot and arch over.
void add_fan(Workshop& w, float z, float height, float spread) {
  const int leaves = w.dice.count(14, 22);
  for (int i = 0; i < leaves; ++i) {
    const float azimuth = kTwoPi * (static_cast<float>(i) + w.dice.between(0, 0.6F)) * 0.382F;
    const float elevation = w.dice.between(0.75F, 1.45F);
    w.mesh().add_leaf({0.02F * std::cos(azimuth), 0.02F * std::sin(azimuth), z},
                      direction_of(azimuth, elevation), w.dice.between(0.75F, 1.05F) * height,
                      w.dice.between(0.07F, 0.11F), spread * w.dice.between(0.5F, 1.0F), 5);
  }
}

/// Stems with broad leaves all the way up.
void add_stems(Workshop& w, float z, float height, const Surface& leaf, const Surface& bark) {
  const int stems = w.dice.count(1, 3);
  for (int s = 0; s < stems; ++s) {
    const float turn = w.dice.between(0, kTwoPi);
    const glm::vec3 foot(0.03F * std::cos(turn), 0.03F * std::sin(turn), z);
    const float tall = height * w.dice.between(0.75F, 0.95F);
    const glm::vec3 tip =
        foot + glm::vec3(0.12F * std::cos(turn), 0.12F * std::sin(turn), 1.0F) * tall;
    w.use(bark);
    w.mesh().add_cylinder(foot, tip, 0.018F, 0.01F, 7);
    w.use(leaf);
    const int leaves = w.dice.count(13, 19);
    for (int i = 0; i < leaves; ++i) {
      const float t = 0.25F + 0.75F * static_cast<float>(i) / static_cast<float>(leaves - 1);
      w.mesh().add_leaf(
          glm::mix(foot, tip, t),
          direction_of(turn + 2.4F * static_cast<float>(i), w.dice.between(0.2F, 0.8F)),
          w.dice.between(0.2F, 0.32F), w.dice.between(0.1F, 0.15F), w.dice.between(0.4F, 0.8F),
          4);
    }
  }
}

void add_bush(Workshop& w, float z, float height, float radius, const Surface& leaf,
              const Surface& bark) {
  w.use(bark);
  w.mesh().add_cylinder({0, 0, z}, {0, 0, z + 0.5F * height}, 0.02F, 0.016F, 8);
  w.use(leaf);
  const float mid = z + 0.62F * height;
  for (int i = 0; i < 8; ++i) {
    const glm::vec3 out =
        direction_of(2.4F * static_cast<float>(i), w.dice.between(-0.4F, 1.0F));
    w.mesh().add_ellipsoid(glm::vec3(0, 0, mid) + 0.5F * radius * out * glm::vec3(1, 1, 0.8F),
                           glm::vec3(radius * w.dice.between(0.4F, 0.55F)), 9);
  }
  for (int i = 0; i < 40; ++i) {
    const glm::vec3 out =
        direction_of(2.4F * static_cast<float>(i), w.dice.between(-0.6F, 1.4F));
    w.mesh().add_leaf(glm::vec3(0, 0, mid) + 0.7F * radius * out, out, 0.5F * radius, 0.08F,
                      0.4F, 3);
  }
}

void add_blades(Workshop& w, float z, float height, float radius) {
  const int blades = w.dice.count(9, 14);
  for (int i = 0; i < blades; ++i) {
    const float azimuth = 2.4F * static_cast<float>(i),
                r = 0.6F * radius * std::sqrt(w.dice.between(0, 1));
    w.mesh().add_leaf({r * std::cos(azimuth), r * std::sin(azimuth), z},
                      direction_of(azimuth, w.dice.between(1.3F, 1.52F)),
                      height * w.dice.between(0.6F, 1.0F), w.dice.between(0.07F, 0.1F),
                      w.dice.between(-0.1F, 0.1F), 4);
  }
}

}  // namespace

void make_plant(Workshop& w, bool small) {
  Dice& dice = w.dice;
  const float radius = small ? dice.between(0.07F, 0.1F) : dice.between(0.15F, 0.21F);
  const float pot = small ? dice.between(0.11F, 0.16F) : dice.between(0.26F, 0.42F);
  const float height = small ? dice.between(0.22F, 0.34F) : dice.between(0.6F, 1.05F);
  const float hue = dice.between(0.22F, 0.38F), saturation = dice.between(0.45F, 0.75F),
              value = dice.between(0.3F, 0.6F);
  const Surface leaf = w.surfaces.textured(
      {TextureKind::kLeaf,
       {hsv(hue, saturation, value), hsv(hue - 0.03F, saturation, 1.25F * value),
        hsv(hue - 0.06F, 0.5F, 1.4F * value)},
       128,
       dice.seed()},
      1.0F);
  const Surface bark = w.surfaces.plain(hsv(0.08F, 0.45F, 0.38F));
  const float soil = add_pot(w, radius, pot);
  const int kind = dice.count(0, 3);
  w.use(leaf);
  if (kind == 0) {
    add_fan(w, soil, (small ? 0.8F : 0.72F) * height, 0.75F);
  } else if (kind == 1 && !small) {
    add_stems(w, soil, height, leaf, bark);
  } else if (kind == 2) {
    add_blades(w, soil, 0.9F * height, radius);
  } else {
    add_bush(w, soil, height, small ? 0.12F : dice.between(0.24F, 0.32F), leaf, bark);
  }
}

void make_lamp(Workshop& w, FurnitureKind kind) {
  Dice& dice = w.dice;
  const glm::vec3 shade_colour =
      hsv(dice.between(0.06F, 0.16F), dice.between(0.05F, 0.35F), 0.95F);
  const Surface shade =
      w.surfaces.glowing(shade_colour, 0.55F * linear_from_srgb(shade_colour));
  const Surface stand = dice.chance(0.6F) ? w.metal() : w.wood();
  if (kind == FurnitureKind::kCeilingLamp) {  // Hangs down from z = 0.
    w.use(shade);
    if (dice.chance(0.5F)) {
      w.mesh().add_cylinder({0, 0, -0.08F}, {0, 0, 0}, 0.2F, 0.2F, 24);
    } else {
      const std::array<glm::vec2, 5> dome{
          {{0.0F, -0.1F}, {0.08F, -0.092F}, {0.15F, -0.065F}, {0.19F, -0.03F}, {0.2F, 0.0F}}};
      w.mesh().add_lathe(glm::vec3(0.0F), dome, 24);
    }
    return;
  }
  const bool floor_lamp = kind == FurnitureKind::kFloorLamp;
  const float height = floor_lamp ? dice.between(1.4F, 1.65F) : dice.between(0.38F, 0.5F),
              scale = floor_lamp ? 1.0F : 0.62F;
  w.use(stand);
  if (floor_lamp) {
    w.mesh().add_cylinder({0, 0, 0}, {0, 0, 0.03F}, 0.14F, 0.14F, 20);
    w.mesh().add_cylinder({0, 0, 0}, {0, 0, height - 0.1F}, 0.018F, 0.018F, 10);
  } else {
    const std::array<glm::vec2, 6> foot{{{0, 0},
                                         {0.07F, 0},
                                         {0.05F, 0.05F},
                                         {0.075F, 0.13F},
                                         {0.03F, 0.2F},
                                         {0.015F, height - 0.1F}}};
    w.mesh().add_lathe(glm::vec3(0.0F), foot, 16);
  }
  w.use(shade);
  const float top = dice.between(0.1F, 0.19F) * scale,
              bottom = dice.between(0.19F, 0.23F) * scale, tall = 0.3F * scale;
  const std::array<glm::vec2, 4> profile{
      {{0, height - tall}, {bottom, height - tall}, {top, height}, {0, height}}};
  w.mesh().add_lathe(glm::vec3(0.0F), profile, 20);
}

void make_rug(Workshop& w) {
  Dice& dice = w.dice;
  const float hue = dice.between(0, 1);
  const Surface pattern = w.surfaces.textured(
      {TextureKind::kRug,
       {hsv(hue, dice.between(0.2F, 0.6F), dice.between(0.35F, 0.75F)),
        hsv(hue + dice.between(0.1F, 0.6F), 0.4F, dice.between(0.4F, 0.85F)),
        hsv(hue, 0.15F, 0.88F)},
       256,
       dice.seed()},
      1.0F);
  const float width = w.size.width_m > 0 ? w.size.width_m : dice.between(1.5F, 2.1F),
              depth = width * dice.between(0.6F, 0.72F);
  const float thickness = 0.012F;
  w.use(w.surfaces.plain(hsv(hue, 0.2F, 0.5F)));
  for (const float side : {-1.0F, 1.0F}) {
    w.mesh().add_quad({side * -0.5F * width, side * -0.5F * depth, 0}, {side * width, 0, 0},
                      {0, 0, thickness});
    w.mesh().add_quad({side * 0.5F * width, side * -0.5F * depth, 0}, {0, side * depth, 0},
                      {0, 0, thickness});
  }
  w.use(pattern);
  w.mesh().add_quad({-0.5F * width, -0.5F * depth, thickness}, {width, 0, 0}, {0, depth, 0},
                    true);
}

void make_wall_panel(Workshop& w, bool mirror) {  // Back at y = 0, lower edge at z = 0.
  Dice& dice = w.dice;
  const float width = w.size.width_m > 0 ? w.size.width_m : dice.between(0.45F, 1.0F);
  const float height = mirror ? 1.3F * width : width * dice.pick({0.7F, 0.75F, 1.0F, 1.3F}),
              depth = 0.03F, border = mirror ? 0.03F : 0.045F;
  w.use(dice.chance(0.5F) ? w.wood() : w.painted());
  w.mesh().add_box({0, -0.5F * depth, 0.5F * height}, {width, depth, height});
  const auto colour = [&] {
    return hsv(dice.between(0, 1), dice.between(0.2F, 0.7F), dice.between(0.35F, 0.9F));
  };
  w.use(mirror ? w.surfaces.plain(glm::vec3(0.72F, 0.78F, 0.8F))
               : w.surfaces.textured(
                     {TextureKind::kPicture, {colour(), colour(), colour()}, 256, dice.seed()},
                     1.0F));
  w.mesh().add_quad({-0.5F * width + border, -depth - 0.003F, border},
                    {width - 2.0F * border, 0, 0}, {0, 0, height - 2.0F * border}, true);
}

void make_clutter(Workshop& w, FurnitureKind kind) {
  Dice& dice = w.dice;
  using Kind = FurnitureKind;
  if (kind == Kind::kBooks || kind == Kind::kBoxes) {
    const bool books = kind == Kind::kBooks;
    float z = 0.0F;
    const int count = books ? dice.count(2, 4) : 2;
    for (int i = 0; i < count; ++i) {
      const glm::vec3 size =
          books ? glm::vec3(dice.between(0.18F, 0.25F), dice.between(0.13F, 0.18F),
                            dice.between(0.025F, 0.045F))
                : glm::vec3(dice.between(0.26F, 0.4F), dice.between(0.24F, 0.34F),
                            dice.between(0.2F, 0.3F));
      w.use(books ? w.painted()
                  : w.surfaces.plain(
                        hsv(0.09F, dice.between(0.3F, 0.5F), dice.between(0.55F, 0.75F))));
      w.mesh().set_frame(pose_matrix({0, 0, z}, dice.between(-0.2F, 0.2F)));
      w.mesh().add_box({0, 0, 0.5F * size.z}, size);
      z += size.z;
    }
    w.mesh().reset_frame();
  } else if (kind == Kind::kVase || kind == Kind::kCup) {
    const float s = kind == Kind::kVase ? dice.between(0.9F, 1.3F) : 0.42F;
    const std::array<glm::vec2, 6> vase{{{0, 0},
                                         {0.05F * s, 0},
                                         {0.085F * s, 0.1F * s},
                                         {0.04F * s, 0.2F * s},
                                         {0.055F * s, 0.25F * s},
                                         {0.03F * s, 0.25F * s}}};
    const std::array<glm::vec2, 4> cup{
        {{0, 0}, {0.08F * s, 0}, {0.1F * s, 0.24F * s}, {0.0F, 0.22F * s}}};
    w.use(w.painted());
    if (kind == Kind::kVase) {
      w.mesh().add_lathe(glm::vec3(0.0F), vase, 16);
    } else {
      w.mesh().add_lathe(glm::vec3(0.0F), cup, 14);
    }
  } else if (kind == Kind::kBowl) {
    w.use(w.painted());
    const std::array<glm::vec2, 6> bowl{
        {{0, 0}, {0.06F, 0}, {0.15F, 0.07F}, {0.14F, 0.07F}, {0.06F, 0.02F}, {0, 0.015F}}};
    w.mesh().add_lathe(glm::vec3(0.0F), bowl, 20);
    for (int i = 0; i < 4; ++i) {
      w.use(w.surfaces.plain(hsv(dice.pick({0.0F, 0.08F, 0.14F, 0.25F}), 0.75F, 0.8F)));
      const float angle = kTwoPi * static_cast<float>(i) / 4.0F;
      w.mesh().add_ellipsoid({0.06F * std::cos(angle), 0.06F * std::sin(angle), 0.06F},
                             glm::vec3(0.042F), 10);
    }
  } else {  // Laptop.
    w.use(w.metal());
    w.mesh().add_box({0, 0, 0.01F}, {0.34F, 0.24F, 0.02F});
    w.mesh().set_frame(turned_matrix({0, 0.12F, 0.02F}, {1, 0, 0}, -0.3F));
    w.mesh().add_box({0, 0, 0.11F}, {0.34F, 0.012F, 0.22F});
    w.use(w.surfaces.plain(glm::vec3(0.2F, 0.28F, 0.4F)));
    w.mesh().add_quad({-0.155F, -0.008F, 0.015F}, {0.31F, 0, 0}, {0, 0, 0.19F}, true);
    w.mesh().reset_frame();
  }
}

}  // namespace segsim::worlds::internal
