/// Chairs, couches and beds in the target style, and the materials that all makers share.

#include <cmath>
#include <numbers>

#include <glm/common.hpp>

#include "worlds/procedural/internal/furniture_makers.h"

namespace segsim::worlds::internal {

glm::vec3 hsv(float hue, float saturation, float value) {
  glm::vec3 rgb(0.0F);
  for (int k = 0; k < 3; ++k) {
    const float position = hue + static_cast<float>(3 - k) / 3.0F;
    const float turn = 6.0F * (position - std::floor(position));
    rgb[k] = value * (1.0F - saturation +
                      saturation * glm::clamp(std::abs(turn - 3.0F) - 1.0F, 0.0F, 1.0F));
  }
  return rgb;
}

Surface Workshop::wood() {
  const float hue = dice.between(0.05F, 0.105F), value = dice.between(0.3F, 0.85F);
  const float saturation = dice.between(0.3F, 0.65F);
  return surfaces.textured(
      {TextureKind::kWood,
       {hsv(hue, saturation, value), hsv(hue, saturation, 0.72F * value), glm::vec3(0.2F)},
       256,
       dice.seed()},
      0.8F);
}

Surface Workshop::painted() {
  if (dice.chance(0.35F)) return surfaces.plain(glm::vec3(dice.between(0.82F, 0.95F)));
  if (dice.chance(0.2F)) return surfaces.plain(glm::vec3(dice.between(0.1F, 0.25F)));
  return surfaces.plain(
      hsv(dice.between(0.0F, 1.0F), dice.between(0.1F, 0.45F), dice.between(0.4F, 0.85F)));
}

Surface Workshop::metal() {
  const float value =
      dice.chance(0.4F) ? dice.between(0.12F, 0.25F) : dice.between(0.6F, 0.8F);
  return surfaces.plain(glm::vec3(value, value, 1.03F * value));
}

Surface Workshop::ceramic_white() {
  const float value = dice.between(0.88F, 0.97F);
  return surfaces.plain(glm::vec3(value, value, value - dice.between(0.0F, 0.06F)));
}

Surface Workshop::fabric() {
  const float hue = dice.between(0.0F, 1.0F), saturation = dice.between(0.06F, 0.5F);
  const float value = dice.between(0.3F, 0.85F);
  const float other_hue = dice.chance(0.5F) ? hue : dice.between(0.0F, 1.0F);
  TextureRecipe recipe;
  recipe.kind = dice.pick({TextureKind::kWeave, TextureKind::kWeave, TextureKind::kStripes,
                           TextureKind::kChecks, TextureKind::kFloral, TextureKind::kLeather});
  recipe.palette = {hsv(hue, saturation, value),
                    hsv(other_hue, 0.8F * saturation, 0.75F * value),
                    hsv(other_hue, 0.5F * saturation, glm::min(1.0F, 1.25F * value))};
  recipe.seed = dice.seed();
  return surfaces.textured(recipe, dice.between(0.35F, 0.6F));
}

namespace {
/// Slanted legs start so high above the floor that their rim does not dip into it.
constexpr float kFoot_m = 0.006F;
}  // namespace

void Workshop::legs(float width_m, float depth_m, float height_m, float thickness_m,
                    int kind) {
  for (const float sx : {-1.0F, 1.0F}) {
    for (const float sy : {-1.0F, 1.0F}) {
      const float x = sx * (0.5F * width_m - 0.6F * thickness_m);
      const float y = sy * (0.5F * depth_m - 0.6F * thickness_m);
      if (kind == 0) {
        mesh().add_box({x, y, 0.5F * height_m}, {thickness_m, thickness_m, height_m});
      } else {
        const float out = kind == 2 ? 0.05F : 0.0F;
        const float foot = kind == 2 ? 0.3F * thickness_m : 0.5F * thickness_m;
        mesh().add_cylinder({x + sx * (out - 0.02F), y + sy * (out - 0.02F), kFoot_m},
                            {x - sx * 0.02F, y - sy * 0.02F, height_m}, foot,
                            0.55F * thickness_m, 10);
      }
    }
  }
}

void Workshop::fronts(const glm::vec3& min_m, const glm::vec3& max_m, int columns, int rows,
                      const Surface& front, const Surface& handle, bool knobs) {
  constexpr float kGap_m = 0.008F, kThickness_m = 0.018F;
  const float width = (max_m.x - min_m.x) / static_cast<float>(columns);
  const float height = (max_m.z - min_m.z) / static_cast<float>(rows);
  for (int c = 0; c < columns; ++c) {
    for (int r = 0; r < rows; ++r) {
      const glm::vec3 middle(min_m.x + (static_cast<float>(c) + 0.5F) * width,
                             min_m.y - 0.5F * kThickness_m,
                             min_m.z + (static_cast<float>(r) + 0.5F) * height);
      use(front);
      mesh().add_box(middle, {width - kGap_m, kThickness_m, height - kGap_m});
      use(handle);
      const float y = min_m.y - kThickness_m - 0.02F;
      const bool door = height > 1.2F * width;
      const float side = c % 2 == 0 ? 1.0F : -1.0F;
      const glm::vec3 grip =
          door ? glm::vec3(middle.x + side * (0.5F * width - 0.05F), y, middle.z)
               : glm::vec3(middle.x, y, middle.z + 0.2F * height);
      if (knobs) {
        mesh().add_ellipsoid(grip, glm::vec3(0.02F), 8);
      } else if (door) {
        mesh().add_box(grip, {0.02F, 0.03F, glm::min(0.3F, 0.4F * height)});
      } else {
        mesh().add_box(grip, {glm::min(0.3F, 0.4F * width), 0.03F, 0.02F});
      }
    }
  }
}

namespace {

/// Back of a dining chair between its two posts, at y = `y`, from z0 to z1.
void add_chair_back(Workshop& w, float width, float y, float z0, float z1,
                    const Surface& frame, const Surface& cloth) {
  const int kind = w.dice.count(0, 3);
  const float inner = width - 0.05F, height = z1 - z0;
  w.use(frame);
  if (kind == 0) {  // Upright slats under a top rail.
    w.mesh().add_rounded_box({0, y, z1 - 0.04F}, {width, 0.035F, 0.09F}, 0.012F, 1);
    const int slats = w.dice.count(3, 5);
    for (int i = 0; i < slats; ++i) {
      const float x =
          inner * ((static_cast<float>(i) + 0.5F) / static_cast<float>(slats) - 0.5F);
      w.mesh().add_box({x, y, z0 + 0.5F * height - 0.04F}, {0.035F, 0.02F, height - 0.08F});
    }
  } else if (kind == 1) {  // Ladder.
    const int rungs = w.dice.count(2, 4);
    for (int i = 0; i < rungs; ++i) {
      const float z = z0 + 0.12F +
                      (height - 0.16F) * static_cast<float>(i) / static_cast<float>(rungs - 1);
      w.mesh().add_rounded_box({0, y, z}, {inner + 0.03F, 0.022F, 0.07F}, 0.008F, 1);
    }
  } else if (kind == 2) {  // Solid board.
    w.mesh().add_rounded_box({0, y, z0 + 0.55F * height},
                             {inner + 0.03F, 0.03F, 0.85F * height}, 0.014F, 2);
  } else {  // Padded.
    w.use(cloth);
    w.mesh().add_rounded_box({0, y - 0.01F, z0 + 0.55F * height},
                             {inner + 0.03F, 0.07F, 0.9F * height}, 0.034F, 2);
  }
}

/// Soft cushion: a box that is nearly all rounding.
void add_cushion(MeshBuilder& mesh, const glm::vec3& center, const glm::vec3& size) {
  mesh.add_rounded_box(center, size, 0.42F * glm::min(size.x, glm::min(size.y, size.z)), 2);
}

void add_arm(Workshop& w, float x, float thickness, float depth, float z0, float height,
             int kind) {
  if (kind == 2) {  // Rolled: a panel with a cylinder on top.
    const float r = 0.5F * thickness;
    w.mesh().add_rounded_box({x, 0, z0 + 0.5F * (height - r)},
                             {0.8F * thickness, depth, height - r}, 0.03F, 1);
    w.mesh().add_cylinder({x, -0.5F * depth, z0 + height - r},
                          {x, 0.5F * depth, z0 + height - r}, r, r, 16);
  } else {
    w.mesh().add_rounded_box({x, 0, z0 + 0.5F * height}, {thickness, depth, height},
                             kind == 0 ? 0.025F : 0.45F * thickness, 2);
  }
}

}  // namespace

void make_dining_chair(Workshop& w) {
  Dice& dice = w.dice;
  const float width = dice.between(0.41F, 0.48F), depth = dice.between(0.41F, 0.47F);
  const float seat = dice.between(0.44F, 0.48F), top = dice.between(0.84F, 1.04F);
  const bool metal_legs = dice.chance(0.3F);
  const Surface frame = dice.chance(0.25F) ? w.painted() : w.wood();
  const Surface leg = metal_legs ? w.metal() : frame;
  const Surface cloth = w.fabric();
  const float thickness = metal_legs ? 0.035F : dice.between(0.038F, 0.05F);
  w.use(leg);
  w.legs(width, depth, seat - 0.03F, thickness,
         metal_legs ? dice.count(1, 2) : dice.count(0, 2));
  if (!metal_legs) {  // Apron.
    w.mesh().add_box({0, 0, seat - 0.065F}, {width - 0.04F, depth - 0.04F, 0.06F});
  }
  const bool padded = dice.chance(0.5F);
  w.use(padded ? cloth : frame);
  w.mesh().add_rounded_box({0, 0, seat - 0.015F}, {width, depth, padded ? 0.06F : 0.035F},
                           padded ? 0.028F : 0.012F, 2);
  const float y = 0.5F * depth - 0.6F * thickness;
  const float lean = dice.between(0.04F, 0.14F);
  w.mesh().set_frame(turned_matrix({0, y, seat}, {1, 0, 0}, -lean));
  w.use(frame);
  for (const float side : {-1.0F, 1.0F}) {
    w.mesh().add_rounded_box(
        {side * (0.5F * width - 0.6F * thickness), 0, 0.5F * (top - seat)},
        {thickness, thickness * 0.9F, top - seat}, 0.01F, 1);
  }
  add_chair_back(w, width, 0, dice.between(0.06F, 0.16F), top - seat, frame, cloth);
  w.mesh().reset_frame();
}

void make_office_chair(Workshop& w) {
  Dice& dice = w.dice;
  const float seat = dice.between(0.46F, 0.52F), width = dice.between(0.46F, 0.52F);
  const Surface cloth =
      dice.chance(0.5F) ? w.surfaces.plain(glm::vec3(dice.between(0.1F, 0.2F))) : w.fabric();
  const Surface frame = w.surfaces.plain(glm::vec3(dice.chance(0.5F) ? 0.12F : 0.65F));
  const float star = dice.between(0.28F, 0.31F);
  w.use(frame);
  for (int i = 0; i < 5; ++i) {
    const float angle =
        2.0F * std::numbers::pi_v<float> * (static_cast<float>(i) + 0.25F) / 5.0F;
    const glm::vec3 tip(star * std::cos(angle), star * std::sin(angle), 0.075F);
    w.mesh().add_cylinder({0, 0, 0.12F}, tip, 0.035F, 0.022F, 8);
    w.mesh().add_ellipsoid({tip.x, tip.y, 0.03F}, {0.032F, 0.032F, 0.03F}, 10);
  }
  w.mesh().add_cylinder({0, 0, 0.08F}, {0, 0, seat - 0.04F}, 0.032F, 0.028F, 12);
  w.mesh().add_box({0, 0, seat - 0.06F}, {0.2F, 0.26F, 0.04F});
  w.use(cloth);
  w.mesh().add_rounded_box({0, -0.02F, seat}, {width, 0.47F, 0.1F}, 0.045F, 2);
  const float back = dice.between(0.45F, 0.68F);
  w.mesh().set_frame(turned_matrix({0, 0.24F, seat + 0.06F}, {1, 0, 0}, -0.14F));
  w.mesh().add_rounded_box({0, 0, 0.08F + 0.5F * back}, {width - 0.03F, 0.08F, back}, 0.038F,
                           2);
  if (dice.chance(0.4F)) {
    w.mesh().add_rounded_box({0, 0, 0.17F + back}, {0.28F, 0.07F, 0.15F}, 0.034F, 2);
  }
  w.use(frame);
  w.mesh().add_box({0, 0.05F, 0.08F}, {0.07F, 0.035F, 0.4F});
  w.mesh().reset_frame();
  w.mesh().add_box({0, 0.15F, seat - 0.06F}, {0.07F, 0.28F, 0.03F});
  if (dice.chance(0.7F)) {
    for (const float side : {-1.0F, 1.0F}) {
      const float x = side * (0.5F * width + 0.02F);
      w.mesh().add_box({x, 0.04F, seat + 0.1F}, {0.035F, 0.05F, 0.22F});
      w.mesh().add_rounded_box({x, -0.02F, seat + 0.22F}, {0.07F, 0.26F, 0.035F}, 0.015F, 1);
    }
  }
}

void make_armchair(Workshop& w) {
  Dice& dice = w.dice;
  const float width = dice.between(0.76F, 0.92F), depth = dice.between(0.78F, 0.88F);
  const float leg = dice.between(0.08F, 0.16F), seat = dice.between(0.40F, 0.45F);
  const float top = dice.between(0.82F, 1.02F), arm = dice.between(0.12F, 0.17F);
  const Surface cloth = w.fabric(), feet = w.wood();
  w.use(feet);
  w.legs(width - 0.08F, depth - 0.1F, leg + 0.02F, 0.045F, 1);
  w.use(cloth);
  w.mesh().add_rounded_box({0, 0, 0.5F * (leg + seat - 0.1F)},
                           {width - 0.04F, depth, seat - 0.1F - leg}, 0.03F, 1);
  const int arm_kind = dice.count(0, 2);
  const float arm_height = dice.between(0.55F, 0.64F);
  for (const float side : {-1.0F, 1.0F}) {
    add_arm(w, side * 0.5F * (width - arm), arm, depth, leg, arm_height - leg, arm_kind);
  }
  add_cushion(w.mesh(), {0, -0.06F, seat - 0.02F}, {width - 2.0F * arm, depth - 0.16F, 0.17F});
  w.mesh().set_frame(turned_matrix({0, 0.5F * depth - 0.1F, leg}, {1, 0, 0}, -0.1F));
  w.mesh().add_rounded_box({0, 0, 0.5F * (top - leg)}, {width - 0.06F, 0.18F, top - leg},
                           0.07F, 2);
  w.mesh().reset_frame();
}

void make_stool(Workshop& w) {
  const float height = w.dice.between(0.44F, 0.5F);
  w.use(w.wood());
  w.legs(0.36F, 0.36F, height - 0.02F, 0.04F, 2);
  w.use(w.dice.chance(0.5F) ? w.fabric() : w.painted());
  w.mesh().add_cylinder({0, 0, height - 0.05F}, {0, 0, height}, 0.18F, 0.19F, 20);
}

void make_couch(Workshop& w, bool corner) {
  Dice& dice = w.dice;
  const float width = w.size.width_m > 0 ? w.size.width_m : dice.between(1.7F, 2.25F);
  const float depth = dice.between(0.84F, 0.95F), leg = dice.between(0.05F, 0.13F);
  const float seat = dice.between(0.40F, 0.46F), top = dice.between(0.74F, 0.92F);
  const float arm = dice.between(0.14F, 0.24F), arm_top = dice.between(0.54F, 0.66F);
  const Surface cloth = w.fabric(), feet = dice.chance(0.5F) ? w.wood() : w.metal();
  const Surface loose = w.fabric();
  const int arm_kind = dice.count(0, 2), cushions = width > 1.95F ? dice.count(2, 3) : 2;
  const float back = 0.2F, inner = width - 2.0F * arm;
  w.use(feet);
  w.legs(width - 0.1F, depth - 0.08F, leg + 0.02F, 0.05F, 1);
  w.use(cloth);
  w.mesh().add_rounded_box({0, 0, leg + 0.5F * (seat - 0.12F - leg)},
                           {width - 0.03F, depth, seat - 0.12F - leg}, 0.03F, 1);
  for (const float side : {-1.0F, 1.0F}) {
    if (corner && side > 0.0F) continue;
    add_arm(w, side * 0.5F * (width - arm), arm, depth, leg, arm_top - leg, arm_kind);
  }
  w.mesh().add_rounded_box(
      {0, 0.5F * (depth - back) + 0.02F, leg + 0.5F * (top - 0.06F - leg)},
      {width - 0.02F, back - 0.04F, top - 0.06F - leg}, 0.05F, 2);
  const float seat_width = inner / static_cast<float>(cushions);
  const bool high_back = dice.chance(0.8F);
  for (int i = 0; i < cushions; ++i) {
    const float x =
        inner * ((static_cast<float>(i) + 0.5F) / static_cast<float>(cushions) - 0.5F);
    add_cushion(w.mesh(), {x, -0.5F * back, seat - 0.04F},
                {seat_width - 0.01F, depth - back + 0.01F, 0.17F});
    if (!high_back) continue;
    w.mesh().set_frame(
        turned_matrix({x, 0.5F * depth - back - 0.02F, seat + 0.02F}, {1, 0, 0}, -0.2F));
    add_cushion(w.mesh(), {0, 0, 0.5F * (top - seat) + 0.02F},
                {seat_width - 0.015F, 0.17F, top - seat + 0.04F});
    w.mesh().reset_frame();
  }
  if (corner) {  // The seat goes on towards the front at the right end.
    const float chaise = 0.5F * inner * 0.9F, length = dice.between(0.55F, 0.75F);
    const float x = 0.5F * width - 0.5F * chaise;
    w.mesh().add_rounded_box(
        {x, -0.5F * depth - 0.5F * length + 0.02F, leg + 0.5F * (seat - 0.12F - leg)},
        {chaise, length, seat - 0.12F - leg}, 0.03F, 1);
    add_cushion(w.mesh(), {x, -0.5F * depth - 0.5F * length + 0.02F, seat - 0.04F},
                {chaise, length + 0.04F, 0.17F});
    add_cushion(w.mesh(), {x + 0.5F * (chaise - arm), -0.5F * back, seat - 0.04F},
                {arm, depth - back, 0.17F});
  }
  w.use(loose);
  const int pillows = dice.count(0, 3);
  for (int i = 0; i < pillows; ++i) {
    const int from_end = i / 2;  // They come in pairs, one from each end.
    const float x = (i % 2 == 0 ? -1.0F : 1.0F) *
                    (0.5F * inner - 0.22F - 0.2F * static_cast<float>(from_end));
    w.mesh().set_frame(turned_matrix({x, -0.02F, seat + 0.2F}, {1, 0, 0}, -0.45F));
    add_cushion(w.mesh(), {0, 0, 0.02F}, {0.4F, 0.15F, 0.38F});
    w.mesh().reset_frame();
  }
}

void make_bed(Workshop& w, bool single) {
  Dice& dice = w.dice;
  const float width = single ? dice.between(0.95F, 1.2F) : dice.between(1.45F, 1.8F);
  const float length = dice.between(2.0F, 2.12F), frame_top = dice.between(0.26F, 0.36F);
  const float mattress = dice.between(0.16F, 0.24F), top = frame_top + mattress;
  const Surface frame = dice.chance(0.65F) ? w.wood() : w.painted();
  const Surface blanket = w.fabric(),
                pillow = dice.chance(0.5F) ? w.fabric() : w.ceramic_white();
  const bool box_frame = dice.chance(0.5F);
  w.use(frame);
  if (box_frame) {
    w.mesh().add_box({0, 0, 0.5F * frame_top + 0.02F},
                     {width + 0.06F, length + 0.04F, frame_top - 0.04F});
  } else {
    w.legs(width, length, frame_top, 0.07F, dice.count(0, 1));
    w.mesh().add_box({0, 0, frame_top - 0.07F}, {width + 0.05F, length + 0.04F, 0.14F});
  }
  const int head = dice.count(0, 2);
  const float head_top = dice.between(0.85F, 1.2F), y_head = 0.5F * length + 0.04F;
  if (head == 0) {
    w.mesh().add_rounded_box({0, y_head, 0.5F * head_top}, {width + 0.1F, 0.05F, head_top},
                             0.02F, 2);
  } else if (head == 1) {  // Posts, rails and bars.
    for (const float side : {-1.0F, 1.0F}) {
      w.mesh().add_box({side * 0.5F * width, y_head, 0.5F * head_top + 0.03F},
                       {0.07F, 0.07F, head_top + 0.06F});
    }
    for (const float z : {head_top - 0.05F, frame_top + 0.15F}) {
      w.mesh().add_box({0, y_head, z}, {width, 0.045F, 0.09F});
    }
    for (int i = 1; i < 8; ++i) {
      w.mesh().add_box({width * (static_cast<float>(i) / 8.0F - 0.5F), y_head,
                        0.5F * (head_top + frame_top)},
                       {0.035F, 0.03F, head_top - frame_top});
    }
  } else {  // Padded fields.
    w.use(w.fabric());
    for (int i = 0; i < 4; ++i) {
      w.mesh().add_rounded_box(
          {(width + 0.08F) * ((static_cast<float>(i) + 0.5F) / 4.0F - 0.5F), y_head,
           0.5F * head_top},
          {(width + 0.08F) / 4.0F, 0.11F, head_top}, 0.04F, 2);
    }
    w.use(frame);
  }
  if (dice.chance(0.35F)) {
    w.mesh().add_rounded_box({0, -y_head, 0.3F}, {width + 0.08F, 0.05F, 0.6F}, 0.02F, 1);
  }
  w.use(w.surfaces.plain(glm::vec3(0.92F, 0.91F, 0.88F)));
  w.mesh().add_rounded_box({0, 0, frame_top + 0.5F * mattress}, {width, length, mattress},
                           0.05F, 2);
  w.use(blanket);
  const float covered = dice.between(0.58F, 0.72F) * length, drop = dice.between(0.1F, 0.24F);
  w.mesh().add_rounded_box({0, 0.5F * (covered - length) - 0.02F, top + 0.02F - 0.5F * drop},
                           {width + 0.06F, covered, drop + 0.04F}, 0.035F, 2);
  w.use(pillow);  // The turned-down edge matches the pillows.
  w.mesh().add_rounded_box({0, covered - 0.5F * length - 0.12F, top + 0.035F - 0.5F * drop},
                           {width + 0.075F, 0.22F, drop + 0.045F}, 0.03F, 2);
  const int pillows = single ? 1 : 2;
  for (int i = 0; i < pillows; ++i) {
    const float x = single ? 0.0F : (static_cast<float>(i) - 0.5F) * 0.5F * width;
    w.mesh().set_frame(turned_matrix({x, 0.5F * length - 0.3F, top + 0.09F}, {1, 0, 0}, 0.3F));
    add_cushion(w.mesh(), glm::vec3(0.0F),
                {glm::min(0.68F, 0.46F * width * (single ? 1.4F : 1.0F)), 0.42F, 0.17F});
    w.mesh().reset_frame();
  }
}

}  // namespace segsim::worlds::internal
