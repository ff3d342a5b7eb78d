/// Appliances, sanitary ware, bins and doors in the target style.

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

}  // namespace
void make_tv(Workshop& w) {  // Origin on what it stands on.
  Dice& dice = w.dice;
  const float width = dice.between(0.98F, 1.28F), height = 0.57F * width, foot = 0.07F;
  const Surface black = w.surfaces.plain(glm::vec3(dice.between(0.03F, 0.08F)));
  w.use(black);
  w.mesh().add_rounded_box({0, 0.02F, foot + 0.5F * height}, {width, 0.05F, height}, 0.01F, 1);
  w.mesh().add_box({0, 0.05F, foot + 0.4F * height}, {0.5F * width, 0.04F, 0.4F * height});
  if (dice.chance(0.5F)) {
    for (const float side : {-1.0F, 1.0F}) {
      w.mesh().add_box({side * 0.35F * width, 0, 0.01F}, {0.04F, 0.22F, 0.02F});
      w.mesh().add_box({side * 0.35F * width, 0.02F, 0.5F * foot}, {0.03F, 0.03F, foot});
    }
  } else {
    w.use(w.metal());
    w.mesh().add_box({0, 0.01F, 0.01F}, {0.36F * width, 0.22F, 0.02F});
    w.mesh().add_box({0, 0.03F, 0.5F * foot + 0.02F}, {0.1F, 0.04F, foot + 0.04F});
  }
  w.use(w.surfaces.textured({TextureKind::kScreen,
                             {glm::vec3(0.05F), glm::vec3(0.1F), glm::vec3(0.1F)},
                             256,
                             dice.seed()},
                            1.0F, glm::vec3(0.002F, 0.004F, 0.009F)));
  const float bezel = 0.018F;
  w.mesh().add_quad({-0.5F * width + bezel, -0.008F, foot + bezel + 0.01F},
                    {width - 2.0F * bezel, 0, 0}, {0, 0, height - 2.0F * bezel - 0.01F}, true);
}

void make_toilet(Workshop& w) {
  Dice& dice = w.dice;
  const Surface white = w.ceramic_white(),
                seat = dice.chance(0.25F) ? w.wood() : w.ceramic_white(),
                chrome = w.surfaces.plain(glm::vec3(0.7F));
  const float rim = dice.between(0.39F, 0.43F), width = dice.between(0.35F, 0.39F),
              length = dice.between(0.46F, 0.52F);
  const float tank_top = dice.between(0.74F, 0.86F), tank_depth = 0.19F;
  const glm::vec2 oval(1.0F, length / width);
  const float y = -0.1F, r = 0.5F * width;
  w.use(white);
  const bool straight = dice.chance(0.3F);
  const std::array<glm::vec2, 7> profile{{{0, 0},
                                          {(straight ? 0.92F : 0.66F) * r, 0},
                                          {(straight ? 0.92F : 0.58F) * r, 0.14F},
                                          {(straight ? 0.95F : 0.72F) * r, 0.24F},
                                          {0.98F * r, rim - 0.05F},
                                          {r, rim},
                                          {0.74F * r, rim}}};
  w.mesh().add_lathe({0, y, 0}, profile, 24, oval);
  w.mesh().add_rounded_box({0, y + 0.5F * length - 0.02F, 0.5F * rim},
                           {0.62F * width, 0.2F, rim}, 0.04F, 1);
  w.mesh().add_rounded_box({0, y + 0.5F * length + 0.07F, 0.5F * (rim + tank_top)},
                           {width + 0.04F, tank_depth, tank_top - rim + 0.02F}, 0.035F, 2);
  w.mesh().add_rounded_box({0, y + 0.5F * length + 0.07F, tank_top + 0.01F},
                           {width + 0.06F, tank_depth + 0.02F, 0.035F}, 0.015F, 1);
  w.use(chrome);
  w.mesh().add_cylinder({0, y + 0.5F * length + 0.07F, tank_top + 0.02F},
                        {0, y + 0.5F * length + 0.07F, tank_top + 0.04F}, 0.03F, 0.03F, 12);
  w.use(w.surfaces.plain(glm::vec3(0.42F, 0.47F, 0.5F)));  // The bowl's shaded inside.
  const std::array<glm::vec2, 3> inside{
      {{0.75F * r, rim + 0.004F}, {0.45F * r, rim - 0.1F}, {0.0F, rim - 0.16F}}};
  w.mesh().add_lathe({0, y, 0}, inside, 20, oval);
  w.use(seat);
  const std::array<glm::vec2, 4> ring{{{1.02F * r, rim},
                                       {1.02F * r, rim + 0.02F},
                                       {0.9F * r, rim + 0.028F},
                                       {0.62F * r, rim + 0.02F}}};
  w.mesh().add_lathe({0, y, 0}, ring, 24, oval);
  if (dice.chance(0.35F)) {  // Lid closed...
    const std::array<glm::vec2, 4> lid{{{1.0F * r, rim + 0.025F},
                                        {1.0F * r, rim + 0.045F},
                                        {0.8F * r, rim + 0.055F},
                                        {0.0F, rim + 0.06F}}};
    w.mesh().add_lathe({0, y, 0}, lid, 24, oval);
  } else {  // ... or leaning against the tank.
    w.mesh().set_frame(
        turned_matrix({0, y + 0.5F * length - 0.04F, rim + 0.02F}, {1, 0, 0}, 1.45F));
    std::vector<glm::vec2> outline;
    for (int i = 0; i < 20; ++i) {
      const float angle = kTwoPi * static_cast<float>(i) / 20.0F;
      outline.emplace_back(r * std::cos(angle),
                           0.46F * length * std::sin(angle) + 0.46F * length);
    }
    w.mesh().add_prism(outline, -0.012F, 0.012F);
    w.mesh().reset_frame();
  }
}

void make_refrigerator(Workshop& w) {
  Dice& dice = w.dice;
  const bool wide = dice.chance(0.3F);
  const float width = wide ? dice.between(0.84F, 0.92F) : dice.between(0.6F, 0.72F);
  const float depth = dice.between(0.62F, 0.7F), height = dice.between(1.65F, 1.9F),
              door = 0.06F, gap = 0.014F;
  const int finish = dice.count(0, 3);
  const glm::vec3 colour =
      finish == 0   ? glm::vec3(0.92F)
      : finish == 3 ? dice.pick({glm::vec3(0.62F, 0.2F, 0.18F), glm::vec3(0.62F, 0.78F, 0.72F),
                                 glm::vec3(0.2F), glm::vec3(0.85F, 0.8F, 0.68F)})
                    : glm::vec3(0.72F, 0.73F, 0.75F);
  const Surface front =
      finish == 1 || finish == 2
          ? w.surfaces.textured(
                {TextureKind::kMetal, {colour, colour, colour}, 256, dice.seed()}, 0.7F)
          : w.surfaces.plain(colour);
  const Surface handle = w.surfaces.plain(glm::vec3(dice.pick({0.15F, 0.6F})));
  w.use(w.surfaces.plain(glm::vec3(0.12F)));
  w.mesh().add_box({0, 0.03F, 0.035F}, {width - 0.06F, depth - 0.12F, 0.07F});
  w.mesh().add_box({0, -0.5F * depth + door + 0.005F, 0.5F * height},
                   {width - 0.02F, 0.02F, height - 0.1F});
  w.use(finish == 1 || finish == 2 ? w.surfaces.plain(glm::vec3(0.42F, 0.43F, 0.45F)) : front);
  w.mesh().add_box({0, 0.5F * door + 0.005F, 0.5F * height + 0.03F},
                   {width, depth - door - 0.02F, height - 0.06F});
  const float y = -0.5F * depth + 0.5F * door, y_handle = -0.5F * depth - 0.045F;
  const auto leaf = [&](float x0, float x1, float z0, float z1, float handle_x, bool upright) {
    w.use(front);
    w.mesh().add_rounded_box({0.5F * (x0 + x1), y, 0.5F * (z0 + z1)},
                             {x1 - x0 - gap, door - 0.01F, z1 - z0 - gap}, 0.015F, 1);
    w.use(handle);
    const float middle = 0.5F * (z0 + z1), half = glm::min(0.28F, 0.36F * (z1 - z0));
    if (upright) {
      w.mesh().add_cylinder({handle_x, y_handle, middle - half},
                            {handle_x, y_handle, middle + half}, 0.014F, 0.014F, 8);
      for (const float end : {-0.85F, 0.85F})
        w.mesh().add_box({handle_x, y_handle + 0.025F, middle + end * half},
                         {0.022F, 0.05F, 0.022F});
    } else {
      w.mesh().add_box({handle_x, y_handle + 0.02F, z1 - 0.07F},
                       {0.6F * (x1 - x0), 0.035F, 0.028F});
    }
  };
  const float half = 0.5F * width, low = 0.08F;
  if (wide) {
    leaf(-half, 0, 0.62F, height, -0.05F, true);
    leaf(0, half, 0.62F, height, 0.05F, true);
    leaf(-half, half, low, 0.62F, 0, false);
  } else {
    const float split = dice.chance(0.5F) ? 0.38F * height : 0.68F * height;
    const float x = dice.pick({-1.0F, 1.0F}) * (half - 0.06F);
    leaf(-half, half, split, height, x, true);
    leaf(-half, half, low, split, x, true);
  }
  const int magnets = dice.count(0, 4);
  for (int i = 0; i < magnets; ++i) {
    w.use(w.surfaces.plain(hsv(dice.between(0, 1), 0.6F, 0.85F)));
    w.mesh().add_box(
        {dice.between(-0.2F, 0.15F), -0.5F * depth + 0.002F, dice.between(1.25F, 1.5F)},
        {dice.between(0.05F, 0.12F), 0.008F, dice.between(0.05F, 0.14F)});
  }
}

void make_washbasin(Workshop& w) {
  Dice& dice = w.dice;
  const Surface white = w.ceramic_white(), chrome = w.surfaces.plain(glm::vec3(0.7F));
  const float width = dice.between(0.5F, 0.62F), depth = 0.44F,
              height = dice.between(0.82F, 0.88F);
  if (dice.chance(0.5F)) {  // Pedestal.
    w.use(white);
    const std::array<glm::vec2, 5> foot{
        {{0, 0}, {0.11F, 0}, {0.08F, 0.2F}, {0.08F, 0.5F}, {0.13F, height - 0.14F}}};
    w.mesh().add_lathe({0, 0.08F, 0}, foot, 16);
  } else {  // Cabinet.
    const Surface body = dice.chance(0.5F) ? w.wood() : w.painted();
    w.use(body);
    w.mesh().add_box({0, 0.02F, 0.15F + 0.5F * (height - 0.28F)},
                     {width - 0.03F, depth - 0.04F, height - 0.28F});
    w.fronts({-0.5F * width + 0.02F, -0.5F * depth + 0.04F, 0.16F},
             {0.5F * width - 0.02F, 0, height - 0.14F}, 2, 1, body, chrome, true);
  }
  w.use(white);
  w.mesh().add_rounded_box({0, 0, height - 0.07F}, {width, depth, 0.14F}, 0.05F, 2);
  w.use(w.surfaces.plain(glm::vec3(0.55F, 0.59F, 0.61F)));
  const std::array<glm::vec2, 3> bowl{
      {{0.165F, height + 0.003F}, {0.09F, height - 0.002F}, {0.0F, height - 0.006F}}};
  w.mesh().add_lathe({0, -0.03F, 0}, bowl, 20, {1.2F, 0.85F});
  w.use(chrome);
  w.mesh().add_cylinder({0, 0.16F, height}, {0, 0.16F, height + 0.16F}, 0.02F, 0.016F, 10);
  w.mesh().add_cylinder({0, 0.16F, height + 0.15F}, {0, 0.03F, height + 0.13F}, 0.016F, 0.014F,
                        10);
}

void make_bathtub(Workshop& w) {
  Dice& dice = w.dice;
  const float width = w.size.width_m > 0 ? w.size.width_m : dice.between(1.5F, 1.65F),
              depth = 0.72F, height = 0.56F, wall = 0.08F;
  const Surface white = w.ceramic_white();
  w.use(white);
  for (const float side : {-1.0F, 1.0F}) {
    w.mesh().add_rounded_box({side * 0.5F * (width - wall), 0, 0.5F * height},
                             {wall, depth, height}, 0.03F, 2);
    w.mesh().add_rounded_box({0, side * 0.5F * (depth - wall), 0.5F * height},
                             {width, wall, height}, 0.03F, 2);
  }
  w.mesh().add_box({0, 0, 0.09F}, {width - wall, depth - wall, 0.06F});
  w.use(w.surfaces.plain(glm::vec3(0.7F)));
  w.mesh().add_cylinder({0.5F * width - 0.04F, 0, height},
                        {0.5F * width - 0.04F, 0, height + 0.14F}, 0.02F, 0.02F, 10);
  w.mesh().add_cylinder({0.5F * width - 0.04F, 0, height + 0.13F},
                        {0.5F * width - 0.2F, 0, height + 0.1F}, 0.018F, 0.018F, 10);
}

void make_trash_bin(Workshop& w) {
  Dice& dice = w.dice;
  const float height = dice.between(0.36F, 0.62F), radius = dice.between(0.13F, 0.17F);
  const int kind = dice.count(0, 2);
  w.use(kind == 1 ? w.metal() : w.painted());
  if (kind == 0) {  // Open basket.
    const std::array<glm::vec2, 5> profile{{{0, 0},
                                            {0.78F * radius, 0},
                                            {radius, height},
                                            {0.93F * radius, height},
                                            {0.74F * radius, 0.04F}}};
    w.mesh().add_lathe(glm::vec3(0.0F), profile, 20);
    w.use(w.surfaces.plain(glm::vec3(0.88F)));
    w.mesh().add_ellipsoid({0.02F, 0, height - 0.06F}, {0.07F, 0.06F, 0.05F}, 8);
  } else if (kind == 1) {  // Pedal bin with a domed lid.
    w.mesh().add_cylinder({0, 0, 0.02F}, {0, 0, height}, radius, radius, 24);
    const std::array<glm::vec2, 4> lid{{{1.03F * radius, height},
                                        {1.03F * radius, height + 0.03F},
                                        {0.7F * radius, height + 0.08F},
                                        {0, height + 0.1F}}};
    w.use(w.surfaces.plain(glm::vec3(0.15F)));
    w.mesh().add_lathe(glm::vec3(0.0F), lid, 24);
    w.mesh().add_box({0, -radius - 0.03F, 0.03F}, {0.08F, 0.08F, 0.02F});
  } else {  // Swing lid.
    w.mesh().add_rounded_box({0, 0, 0.5F * height}, {0.3F, 0.24F, height}, 0.03F, 1);
    w.use(w.painted());
    w.mesh().add_rounded_box({0, 0, height + 0.04F}, {0.32F, 0.26F, 0.12F}, 0.05F, 2);
  }
}

void make_door_leaf(Workshop& w) {
  Dice& dice = w.dice;
  const float width = w.size.width_m > 0 ? w.size.width_m : 0.95F, height = 2.02F,
              thickness = 0.04F;
  const Surface body =
      dice.chance(0.5F) ? w.wood() : w.surfaces.plain(glm::vec3(dice.between(0.85F, 0.93F)));
  const Surface field = dice.chance(0.5F) ? body : w.painted();
  w.use(body);
  w.mesh().add_box({0, 0, 0.5F * height + 0.01F}, {width, thickness, height - 0.02F});
  w.use(field);
  const int rows = dice.count(2, 3), columns = dice.count(1, 2);
  for (int r = 0; r < rows; ++r) {
    for (int c = 0; c < columns; ++c) {
      const float cell_w = (width - 0.16F) / static_cast<float>(columns),
                  cell_h = (height - 0.2F) / static_cast<float>(rows);
      const glm::vec3 middle(-0.5F * width + 0.08F + (static_cast<float>(c) + 0.5F) * cell_w,
                             0, 0.1F + (static_cast<float>(r) + 0.5F) * cell_h);
      w.mesh().add_rounded_box(middle, {cell_w - 0.1F, thickness + 0.03F, cell_h - 0.1F},
                               0.012F, 1);
    }
  }
  w.use(w.surfaces.plain(glm::vec3(0.6F, 0.58F, 0.5F)));
  for (const float side : {-1.0F, 1.0F}) {
    const float y = side * 0.06F;
    w.mesh().add_cylinder({0.5F * width - 0.06F, 0, 1.02F}, {0.5F * width - 0.06F, y, 1.02F},
                          0.014F, 0.014F, 8);
    w.mesh().add_cylinder({0.5F * width - 0.055F, y, 1.02F}, {0.5F * width - 0.18F, y, 1.02F},
                          0.014F, 0.012F, 8);
  }
}

void make_stove(Workshop& w) {
  const float width = 0.6F, depth = 0.6F, height = 0.85F;
  const Surface body = w.dice.chance(0.5F) ? w.metal() : w.ceramic_white();
  const Surface black = w.surfaces.plain(glm::vec3(0.06F));
  w.use(body);
  w.mesh().add_box({0, 0.01F, 0.5F * height}, {width, depth - 0.02F, height});
  w.use(black);
  w.mesh().add_box({0, 0, height + 0.005F}, {width - 0.03F, depth - 0.06F, 0.01F});
  w.mesh().add_box({0, -0.5F * depth + 0.01F, 0.4F}, {width - 0.12F, 0.02F, 0.38F});
  w.use(w.surfaces.plain(glm::vec3(0.28F)));
  for (const float x : {-0.14F, 0.14F}) {
    for (const float y : {-0.12F, 0.12F}) {
      w.mesh().add_cylinder({x, y, height + 0.01F}, {x, y, height + 0.018F}, 0.09F, 0.09F, 20);
    }
  }
  w.use(w.metal());
  w.mesh().add_cylinder({-0.22F, -0.5F * depth - 0.03F, 0.64F},
                        {0.22F, -0.5F * depth - 0.03F, 0.64F}, 0.012F, 0.012F, 10);
  for (const float x : {-0.21F, -0.07F, 0.07F, 0.21F}) {
    w.mesh().add_cylinder({x, -0.5F * depth + 0.02F, 0.76F}, {x, -0.5F * depth - 0.02F, 0.76F},
                          0.022F, 0.02F, 12);
  }
  w.piece.surface_height_m = height + 0.018F;
}

void make_washing_machine(Workshop& w) {
  const float width = 0.6F, depth = 0.6F, height = 0.85F, front = -0.5F * depth;
  w.use(w.ceramic_white());
  w.mesh().add_rounded_box({0, 0.01F, 0.5F * height}, {width, depth - 0.02F, height}, 0.015F,
                           1);
  w.use(w.metal());
  w.mesh().add_cylinder({0, front + 0.03F, 0.42F}, {0, front - 0.02F, 0.42F}, 0.2F, 0.18F, 28);
  w.use(w.surfaces.plain(glm::vec3(0.1F, 0.12F, 0.15F)));
  w.mesh().add_cylinder({0, front, 0.42F}, {0, front - 0.03F, 0.42F}, 0.14F, 0.12F, 24);
  w.mesh().add_box({0.1F, front + 0.01F, 0.77F}, {0.3F, 0.012F, 0.07F});
  w.piece.surface_height_m = height;
}

}  // namespace segsim::worlds::internal
