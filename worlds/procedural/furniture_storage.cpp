/// Tables, cabinets and shelves in the target style.

#include <array>
#include <cmath>
#include <vector>

#include <glm/common.hpp>

#include "worlds/procedural/internal/furniture_makers.h"

namespace segsim::worlds::internal {
namespace {

Surface table_top(Workshop& w) {
  Dice& dice = w.dice;
  if (dice.chance(0.2F)) {
    const float value = dice.between(0.75F, 0.92F);
    return w.surfaces.textured(
        {TextureKind::kMarble,
         {glm::vec3(value), glm::vec3(0.9F * value), glm::vec3(0.5F * value)},
         256,
         dice.seed()},
        1.0F);
  }
  return dice.chance(0.15F) ? w.painted() : w.wood();
}

void add_pedestal(Workshop& w, float height, float reach) {
  const std::array<glm::vec2, 7> profile{{{0.0F, 0.0F},
                                          {reach, 0.0F},
                                          {reach, 0.03F},
                                          {0.07F, 0.08F},
                                          {0.045F, 0.3F},
                                          {0.06F, height - 0.06F},
                                          {0.16F, height}}};
  w.mesh().add_lathe(glm::vec3(0.0F), profile, 20);
}

/// Carcass and fronts of a cabinet that stands on a plinth or on legs.
void add_cabinet(Workshop& w, const glm::vec3& size, float foot, int columns, int rows,
                 const Surface& body, const Surface& front, const Surface& handle) {
  w.use(body);
  w.mesh().add_box({0, 0.01F, foot + 0.5F * (size.z - foot)},
                   {size.x, size.y - 0.02F, size.z - foot});
  w.fronts({-0.5F * size.x, -0.5F * size.y + 0.02F, foot}, {0.5F * size.x, 0.0F, size.z},
           columns, rows, front, handle, w.dice.chance(0.4F));
}

}  // namespace

void make_dining_table(Workshop& w, bool round) {
  Dice& dice = w.dice;
  const float height = dice.between(0.72F, 0.77F), top = dice.between(0.03F, 0.05F);
  const Surface plate = table_top(w), leg = dice.chance(0.3F) ? w.metal() : w.wood();
  if (round) {
    const float radius =
        0.5F * (w.size.width_m > 0 ? w.size.width_m : dice.between(0.95F, 1.2F));
    w.use(plate);
    w.mesh().add_cylinder({0, 0, height - top}, {0, 0, height}, radius, radius, 32);
    w.use(leg);
    if (dice.chance(0.6F)) {
      add_pedestal(w, height - top, 0.5F * radius);
    } else {
      w.legs(1.25F * radius, 1.25F * radius, height - top, 0.055F, dice.count(1, 2));
    }
  } else {
    const float width = w.size.width_m > 0 ? w.size.width_m : dice.between(1.2F, 1.6F);
    const float depth = dice.between(0.76F, 0.9F);
    w.use(plate);
    w.mesh().add_rounded_box({0, 0, height - 0.5F * top}, {width, depth, top}, 0.012F, 1);
    w.use(leg);
    const int kind = dice.count(0, 3);
    if (kind < 3) {
      w.legs(width - 0.08F, depth - 0.08F, height - top, dice.between(0.05F, 0.085F), kind);
      w.mesh().add_box({0, 0, height - top - 0.04F}, {width - 0.16F, depth - 0.16F, 0.08F});
    } else {  // Trestles.
      for (const float side : {-1.0F, 1.0F}) {
        const float x = side * (0.5F * width - 0.22F);
        w.mesh().add_box({x, 0, 0.03F}, {0.08F, depth - 0.16F, 0.06F});
        w.mesh().add_box({x, 0, 0.5F * (height - top)}, {0.07F, 0.16F, height - top});
        w.mesh().add_box({x, 0, height - top - 0.03F}, {0.08F, depth - 0.2F, 0.06F});
      }
      w.mesh().add_box({0, 0, 0.3F}, {width - 0.44F, 0.04F, 0.1F});
    }
  }
  w.piece.surface_height_m = height;
}

void make_coffee_table(Workshop& w) {
  Dice& dice = w.dice;
  const float height = dice.between(0.36F, 0.46F);
  const Surface plate = table_top(w), leg = dice.chance(0.4F) ? w.metal() : w.wood();
  if (dice.chance(0.35F)) {
    const float radius = dice.between(0.34F, 0.44F);
    w.use(plate);
    w.mesh().add_cylinder({0, 0, height - 0.035F}, {0, 0, height}, radius, radius, 28);
    w.use(leg);
    w.legs(1.3F * radius, 1.3F * radius, height - 0.03F, 0.04F, dice.count(1, 2));
  } else {
    const float width = dice.between(0.8F, 1.1F), depth = dice.between(0.48F, 0.6F);
    w.use(plate);
    w.mesh().add_rounded_box({0, 0, height - 0.02F}, {width, depth, 0.04F}, 0.012F, 1);
    w.use(leg);
    w.legs(width - 0.03F, depth - 0.03F, height - 0.03F, 0.05F, dice.count(0, 2));
    if (dice.chance(0.5F))
      w.mesh().add_box({0, 0, 0.13F}, {width - 0.1F, depth - 0.1F, 0.025F});
  }
  w.piece.surface_height_m = height;
}

void make_desk(Workshop& w) {
  Dice& dice = w.dice;
  const float width = dice.between(1.1F, 1.4F), depth = dice.between(0.58F, 0.68F),
              height = dice.between(0.72F, 0.76F);
  const Surface plate = table_top(w), body = dice.chance(0.5F) ? w.painted() : w.wood(),
                handle = w.metal();
  w.use(plate);
  w.mesh().add_box({0, 0, height - 0.015F}, {width, depth, 0.03F});
  w.use(body);
  const bool panels = dice.chance(0.5F);
  if (panels) {
    w.mesh().add_box({-0.5F * width + 0.03F, 0, 0.5F * (height - 0.03F)},
                     {0.04F, depth - 0.04F, height - 0.03F});
  } else {
    w.legs(width - 0.04F, depth - 0.04F, height - 0.03F, 0.05F, dice.count(0, 1));
  }
  const float chest = 0.38F, x = 0.5F * width - 0.5F * chest - 0.02F;
  w.mesh().add_box({x, 0.01F, 0.5F * (height - 0.03F) + 0.03F},
                   {chest, depth - 0.08F, height - 0.09F});
  w.fronts({x - 0.5F * chest, -0.5F * depth + 0.05F, 0.08F},
           {x + 0.5F * chest, 0.0F, height - 0.04F}, 1, 3, plate, handle, dice.chance(0.5F));
  w.piece.surface_height_m = height;
}

void make_nightstand(Workshop& w) {
  Dice& dice = w.dice;
  const glm::vec3 size(dice.between(0.38F, 0.46F), dice.between(0.34F, 0.4F),
                       dice.between(0.45F, 0.58F));
  const Surface body = dice.chance(0.6F) ? w.wood() : w.painted(), handle = w.metal();
  const float foot = dice.pick({0.03F, 0.14F});
  w.use(body);
  if (foot > 0.1F) w.legs(size.x - 0.02F, size.y - 0.04F, foot, 0.035F, 1);
  add_cabinet(w, size, foot, 1, dice.count(1, 2), body, body, handle);
  w.piece.surface_height_m = size.z;
}

void make_tv_stand(Workshop& w) {
  Dice& dice = w.dice;
  const glm::vec3 size(dice.between(1.25F, 1.7F), dice.between(0.38F, 0.44F),
                       dice.between(0.42F, 0.55F));
  const Surface body = dice.chance(0.6F) ? w.wood() : w.painted(),
                front = dice.chance(0.5F) ? w.painted() : body;
  const float foot = dice.pick({0.04F, 0.15F});
  w.use(body);
  if (foot > 0.1F) w.legs(size.x - 0.1F, size.y - 0.06F, foot, 0.04F, dice.count(1, 2));
  add_cabinet(w, size, foot, dice.count(2, 4), 1, body, front, w.metal());
  w.piece.surface_height_m = size.z;
}

void make_wardrobe(Workshop& w) {
  Dice& dice = w.dice;
  const int doors = dice.count(2, 3);
  const float width = w.size.width_m > 0
                          ? w.size.width_m
                          : 0.48F * static_cast<float>(doors) + dice.between(0.0F, 0.15F);
  const glm::vec3 size(width, dice.between(0.52F, 0.6F), dice.between(1.9F, 2.2F));
  const Surface body = dice.chance(0.65F) ? w.wood() : w.painted();
  const Surface front = dice.chance(0.4F) ? w.painted() : body;
  const bool drawers = dice.chance(0.4F);
  const Surface handle = w.metal();
  w.use(w.surfaces.plain(glm::vec3(0.15F)));
  w.mesh().add_box({0, 0.02F, 0.04F}, {size.x - 0.04F, size.y - 0.06F, 0.08F});
  w.use(body);
  w.mesh().add_box({0, 0.01F, 0.5F * size.z + 0.03F},
                   {size.x, size.y - 0.02F, size.z - 0.06F});
  w.mesh().add_box({0, 0, size.z + 0.015F}, {size.x + 0.04F, size.y + 0.03F, 0.03F});
  const float low = drawers ? 0.5F : 0.08F, y = -0.5F * size.y + 0.02F;
  if (drawers)
    w.fronts({-0.5F * size.x, y, 0.08F}, {0.5F * size.x, 0, 0.5F}, 1, 2, front, handle, false);
  w.fronts({-0.5F * size.x, y, low}, {0.5F * size.x, 0, size.z}, doors, 1, front, handle,
           dice.chance(0.3F));
  if (dice.chance(0.5F)) {  // Raised fields on the doors.
    w.use(body);
    const float door = size.x / static_cast<float>(doors);
    for (int i = 0; i < doors; ++i) {
      const float x = -0.5F * size.x + (static_cast<float>(i) + 0.5F) * door;
      for (const float t : {0.27F, 0.73F}) {
        w.mesh().add_rounded_box({x, y - 0.02F, low + t * (size.z - low)},
                                 {0.62F * door, 0.025F, 0.36F * (size.z - low)}, 0.01F, 1);
      }
    }
  }
}

void make_bookshelf(Workshop& w) {
  Dice& dice = w.dice;
  const glm::vec3 size(dice.between(0.75F, 1.05F), dice.between(0.28F, 0.34F),
                       dice.between(1.5F, 2.05F));
  const Surface body = dice.chance(0.6F) ? w.wood() : w.painted();
  std::array<Surface, 6> covers;
  for (Surface& cover : covers) {
    cover = w.surfaces.plain(
        hsv(dice.between(0.0F, 1.0F), dice.between(0.2F, 0.8F), dice.between(0.25F, 0.85F)));
  }
  const int shelves = dice.count(4, 5);
  w.use(body);
  for (const float side : {-1.0F, 1.0F}) {
    w.mesh().add_box({side * (0.5F * size.x - 0.015F), 0, 0.5F * size.z},
                     {0.03F, size.y, size.z});
  }
  w.mesh().add_box({0, 0.5F * size.y - 0.008F, 0.5F * size.z}, {size.x, 0.016F, size.z});
  const float pitch = (size.z - 0.08F) / static_cast<float>(shelves);
  for (int s = 0; s <= shelves; ++s) {
    const float z = 0.06F + pitch * static_cast<float>(s);
    w.use(body);
    w.mesh().add_box({0, 0, z}, {size.x - 0.06F, size.y - 0.01F, 0.03F});
    if (s == shelves) break;
    float x = -0.5F * size.x + 0.04F;
    const float end = 0.5F * size.x - 0.05F - dice.between(0.0F, 0.35F);
    while (x < end) {
      const float thickness = dice.between(0.03F, 0.07F),
                  tall = dice.between(0.62F, 0.88F) * pitch;
      w.use(covers[static_cast<std::size_t>(dice.count(0, 5))]);
      w.mesh().add_box({x + 0.5F * thickness, -0.02F, z + 0.015F + 0.5F * tall},
                       {thickness - 0.004F, size.y - dice.between(0.08F, 0.14F), tall});
      x += thickness;
    }
  }
}

void make_kitchen_counter(Workshop& w) {
  Dice& dice = w.dice;
  const float width = w.size.width_m > 0 ? w.size.width_m : 1.8F, depth = 0.6F, height = 0.9F;
  const int columns = glm::max(2, static_cast<int>(width / 0.55F));
  const Surface body = dice.chance(0.5F) ? w.wood() : w.painted(),
                front = dice.chance(0.6F) ? w.painted() : body;
  const Surface handle = w.metal();
  const Surface plate = table_top(w);
  w.use(w.surfaces.plain(glm::vec3(0.15F)));
  w.mesh().add_box({0, 0.04F, 0.05F}, {width, depth - 0.12F, 0.1F});
  w.use(body);
  w.mesh().add_box({0, 0.02F, 0.1F + 0.5F * (height - 0.14F)},
                   {width, depth - 0.06F, height - 0.14F});
  const float y = -0.5F * depth + 0.05F;
  w.fronts({-0.5F * width, y, 0.1F}, {0.5F * width, 0, 0.66F}, columns, 1, front, handle,
           false);
  w.fronts({-0.5F * width, y, 0.67F}, {0.5F * width, 0, 0.85F}, columns, 1, front, handle,
           false);
  w.use(plate);
  w.mesh().add_box({0, 0, height - 0.02F}, {width, depth, 0.04F});
  // Hob near the left end, extractor above it, wall cabinets on the rest.
  const float hob = -0.5F * width + 0.4F;
  w.use(w.surfaces.plain(glm::vec3(0.06F)));
  w.mesh().add_box({hob, -0.01F, height + 0.004F}, {0.54F, 0.48F, 0.012F});
  w.use(w.surfaces.plain(glm::vec3(0.28F)));
  for (const float dx : {-0.13F, 0.13F}) {
    for (const float dy : {-0.12F, 0.1F}) {
      w.mesh().add_cylinder({hob + dx, dy, height + 0.008F}, {hob + dx, dy, height + 0.02F},
                            0.085F, 0.08F, 16);
    }
  }
  w.use(handle);
  w.mesh().add_box({hob, 0.09F, 1.62F}, {0.6F, 0.4F, 0.06F});
  w.mesh().add_box({hob, 0.18F, 1.9F}, {0.24F, 0.22F, 0.5F});
  const float x0 = hob + 0.36F, x1 = 0.5F * width, upper = 0.33F;
  if (x1 - x0 > 0.4F && dice.chance(0.8F)) {
    w.use(body);
    w.mesh().add_box({0.5F * (x0 + x1), 0.5F * (depth - upper) + 0.01F, 1.8F},
                     {x1 - x0, upper - 0.02F, 0.68F});
    w.fronts({x0, 0.5F * depth - upper + 0.02F, 1.46F}, {x1, 0, 2.14F},
             glm::max(1, columns - 1), 1, front, handle, false);
  }
  w.piece.surface_height_m = height;
}

void make_kitchen_sink(Workshop& w) {  // Set onto a counter; origin at the counter's top.
  const Surface steel = w.surfaces.plain(glm::vec3(0.68F, 0.69F, 0.71F));
  w.use(steel);
  const float width = 0.52F, depth = 0.42F;
  for (const float side : {-1.0F, 1.0F}) {
    w.mesh().add_box({side * 0.5F * (width - 0.03F), 0, 0.01F}, {0.03F, depth, 0.03F});
    w.mesh().add_box({0, side * 0.5F * (depth - 0.03F), 0.01F}, {width - 0.06F, 0.03F, 0.03F});
  }
  w.use(w.surfaces.plain(glm::vec3(0.36F, 0.37F, 0.39F)));
  w.mesh().add_box({0, 0, 0.003F}, {width - 0.06F, depth - 0.06F, 0.008F});
  w.use(steel);
  w.mesh().add_cylinder({0, 0.16F, 0}, {0, 0.16F, 0.28F}, 0.018F, 0.015F, 10);
  w.mesh().add_cylinder({0, 0.16F, 0.27F}, {0, -0.02F, 0.25F}, 0.015F, 0.013F, 10);
}

}  // namespace segsim::worlds::internal
