/// The source style: a few plain solids per class, in the colour one expects.

#include <glm/common.hpp>

#include "worlds/procedural/internal/furniture_makers.h"

namespace segsim::worlds::internal {
namespace {

/// The class's colour with a little variation.
glm::vec3 near(Dice& dice, const glm::vec3& srgb) {
  const float gain = dice.between(0.8F, 1.15F);
  glm::vec3 colour = srgb * gain;
  for (int k = 0; k < 3; ++k) colour[k] += dice.between(-0.05F, 0.05F);
  return glm::clamp(colour, 0.02F, 0.98F);
}

const glm::vec3 kBrown(0.48F, 0.30F, 0.16F), kWhite(0.9F), kBlue(0.25F, 0.35F, 0.62F),
    kRed(0.62F, 0.2F, 0.18F), kGreen(0.2F, 0.5F, 0.2F), kBlack(0.06F), kGrey(0.45F);

void source_chair(Workshop& w) {
  const float seat = w.dice.between(0.42F, 0.5F), top = w.dice.between(0.9F, 1.15F),
              width = w.dice.between(0.4F, 0.52F);
  w.use_plain(near(w.dice, kBrown));
  w.legs(width, width, seat, 0.05F, 0);
  w.mesh().add_box({0, 0, seat}, {width, width, 0.05F});
  w.mesh().add_box({0, 0.5F * width - 0.02F, 0.5F * (seat + top)}, {width, 0.04F, top - seat});
}

void source_couch(Workshop& w) {
  const float width = w.dice.between(1.5F, 2.4F), depth = w.dice.between(0.75F, 0.95F),
              seat = w.dice.between(0.36F, 0.48F), top = w.dice.between(0.75F, 1.0F);
  w.use_plain(near(w.dice, w.dice.chance(0.5F) ? kBlue : kRed));
  w.mesh().add_box({0, 0, 0.5F * seat}, {width, depth, seat});
  w.mesh().add_box({0, 0.5F * depth - 0.11F, 0.5F * top}, {width, 0.22F, top});
  for (const float side : {-1.0F, 1.0F})
    w.mesh().add_box({side * (0.5F * width - 0.1F), 0, 0.32F}, {0.2F, depth, 0.64F});
}

void source_bed(Workshop& w) {
  const float width = w.dice.between(1.0F, 1.9F), length = w.dice.between(1.9F, 2.2F),
              top = w.dice.between(0.42F, 0.6F);
  w.use_plain(near(w.dice, kBrown));
  w.mesh().add_box({0, 0, 0.15F}, {width, length, 0.3F});
  w.mesh().add_box({0, 0.5F * length, 0.45F}, {width, 0.06F, 0.9F});
  w.use_plain(near(w.dice, kWhite));
  w.mesh().add_box({0, 0, 0.5F * (0.3F + top)}, {width - 0.02F, length - 0.04F, top - 0.3F});
  w.mesh().add_box({0, 0.5F * length - 0.3F, top + 0.06F}, {0.75F * width, 0.4F, 0.12F});
  w.use_plain(near(w.dice, kBlue));
  w.mesh().add_box({0, -0.18F * length, top}, {width + 0.02F, 0.6F * length, 0.06F});
}

void source_table(Workshop& w) {
  const float width = w.dice.between(1.1F, 1.8F), depth = w.dice.between(0.7F, 1.0F),
              height = w.dice.between(0.68F, 0.8F);
  w.use_plain(near(w.dice, kBrown));
  w.legs(width, depth, height, 0.07F, 0);
  w.mesh().add_box({0, 0, height}, {width, depth, 0.05F});
}

void source_plant(Workshop& w) {
  const float pot = w.dice.between(0.25F, 0.4F), radius = w.dice.between(0.22F, 0.34F),
              tall = w.dice.between(0.5F, 0.9F);
  w.use_plain(near(w.dice, {0.72F, 0.36F, 0.2F}));
  w.mesh().add_cylinder({0, 0, 0}, {0, 0, pot}, 0.13F, 0.18F, 16);
  w.use_plain(near(w.dice, kGreen));
  if (w.dice.chance(0.5F)) {
    w.mesh().add_ellipsoid({0, 0, pot + 0.5F * tall}, {radius, radius, 0.55F * tall}, 14);
  } else {
    w.mesh().add_cylinder({0, 0, pot}, {0, 0, pot + tall}, radius, 0.03F, 16);
  }
}

void source_tv(Workshop& w) {
  const float width = w.dice.between(0.8F, 1.4F), height = 0.6F * width;
  w.use_plain(near(w.dice, kBlack));
  w.mesh().add_box({0, 0, 0.1F + 0.5F * height}, {width, 0.07F, height});
  w.mesh().add_box({0, 0, 0.06F}, {0.1F, 0.06F, 0.12F});
  w.mesh().add_box({0, 0, 0.012F}, {0.4F, 0.24F, 0.025F});
  w.use_plain(near(w.dice, {0.1F, 0.13F, 0.2F}));
  w.mesh().add_quad({-0.46F * width, -0.04F, 0.13F}, {0.92F * width, 0, 0},
                    {0, 0, height - 0.06F});
}

void source_toilet(Workshop& w) {
  const float rim = w.dice.between(0.38F, 0.45F), top = w.dice.between(0.75F, 0.95F);
  w.use_plain(near(w.dice, kWhite));
  w.mesh().add_cylinder({0, -0.1F, 0}, {0, -0.1F, rim}, 0.13F, 0.2F, 18);
  w.mesh().add_box({0, 0.2F, 0.5F * top}, {0.4F, 0.2F, top});
  w.mesh().add_box({0, 0.05F, 0.5F * rim}, {0.24F, 0.2F, rim});
}

void source_refrigerator(Workshop& w) {
  const float width = w.dice.between(0.55F, 0.8F), height = w.dice.between(1.5F, 1.95F),
              split = w.dice.between(0.55F, 0.7F) * height;
  const float y = -0.32F;
  w.use_plain(near(w.dice, glm::vec3(0.86F, 0.88F, 0.9F)));
  w.mesh().add_box({0, 0, 0.5F * height}, {width, 0.62F, height});
  w.use_plain(near(w.dice, kGrey));
  w.mesh().add_box({0, y, split}, {width, 0.02F, 0.025F});
  for (const float z : {split - 0.2F, split + 0.2F})
    w.mesh().add_box({-0.5F * width + 0.07F, y - 0.02F, z}, {0.03F, 0.05F, 0.25F});
}

void source_foosball(Workshop& w) {
  const float width = w.dice.between(1.2F, 1.45F), depth = w.dice.between(0.66F, 0.78F),
              height = w.dice.between(0.82F, 0.92F);
  w.use_plain(near(w.dice, kBrown));
  w.legs(width, depth, height - 0.2F, 0.09F, 0);
  for (const float side : {-1.0F, 1.0F}) {
    w.mesh().add_box({0, side * (0.5F * depth - 0.02F), height - 0.12F},
                     {width, 0.04F, 0.24F});
    w.mesh().add_box({side * (0.5F * width - 0.02F), 0, height - 0.12F},
                     {0.04F, depth - 0.08F, 0.24F});
  }
  w.use_plain(near(w.dice, kGreen));
  w.mesh().add_box({0, 0, height - 0.14F}, {width - 0.08F, depth - 0.08F, 0.03F});
  const Surface rod = w.surfaces.plain(glm::vec3(0.75F)), blue = w.surfaces.plain(kBlue),
                red = w.surfaces.plain(kRed), grip = w.surfaces.plain(kBlack);
  for (int i = 0; i < 8; ++i) {
    const float x = (width - 0.2F) * (static_cast<float>(i) / 7.0F - 0.5F), z = height - 0.04F,
                side = i % 2 == 0 ? -1.0F : 1.0F;
    w.use(rod);
    w.mesh().add_cylinder({x, -0.5F * depth - 0.1F, z}, {x, 0.5F * depth + 0.1F, z}, 0.012F,
                          0.012F, 8);
    w.use(grip);
    w.mesh().add_cylinder({x, side * (0.5F * depth + 0.06F), z},
                          {x, side * (0.5F * depth + 0.18F), z}, 0.02F, 0.02F, 8);
    w.use(i % 2 == 0 ? blue : red);
    for (const float y : {-0.22F, 0.0F, 0.22F})
      w.mesh().add_box({x, y, z - 0.03F}, {0.03F, 0.035F, 0.1F});
  }
}

void source_door(Workshop& w) {
  const float width = w.size.width_m > 0 ? w.size.width_m : w.dice.between(0.8F, 0.95F),
              height = 2.0F;
  w.use_plain(near(w.dice, kBrown));
  w.mesh().add_box({0, 0, 0.5F * height}, {width, 0.04F, height});
  if (w.size.width_m <= 0) {  // On its own it hangs in a frame.
    w.use_plain(near(w.dice, kWhite));
    for (const float side : {-1.0F, 1.0F})
      w.mesh().add_box({side * (0.5F * width + 0.05F), 0, 0.5F * height},
                       {0.1F, 0.12F, height});
    w.mesh().add_box({0, 0, height + 0.05F}, {width + 0.2F, 0.12F, 0.1F});
  }
  w.use_plain(near(w.dice, kGrey));
  w.mesh().add_box({0.5F * width - 0.1F, 0, 1.0F}, {0.12F, 0.14F, 0.03F});
}

void source_wardrobe(Workshop& w) {
  const float width = w.size.width_m > 0 ? w.size.width_m : w.dice.between(0.9F, 1.7F),
              height = w.dice.between(1.8F, 2.3F);
  w.use_plain(near(w.dice, {0.7F, 0.55F, 0.38F}));
  w.mesh().add_box({0, 0, 0.5F * height}, {width, 0.58F, height});
  w.use_plain(near(w.dice, {0.25F, 0.18F, 0.1F}));
  w.mesh().add_box({0, -0.29F, 0.5F * height}, {0.02F, 0.02F, 0.94F * height});
  for (const float x : {-0.07F, 0.07F})
    w.mesh().add_box({x, -0.31F, 1.0F}, {0.03F, 0.04F, 0.18F});
}

void source_bin(Workshop& w) {
  const float height = w.dice.between(0.4F, 0.65F);
  w.use_plain(near(w.dice, glm::vec3(0.3F, 0.32F, 0.34F)));
  w.mesh().add_cylinder({0, 0, 0}, {0, 0, height}, 0.14F, 0.18F, 18);
  w.use_plain(near(w.dice, kBlack));
  w.mesh().add_cylinder({0, 0, height}, {0, 0, height + 0.015F}, 0.16F, 0.15F, 18);
}

}  // namespace

bool make_source_piece(Workshop& w, FurnitureKind kind) {
  using Kind = FurnitureKind;
  switch (kind) {
    case Kind::kDiningChair:
    case Kind::kOfficeChair:
    case Kind::kArmchair:
    case Kind::kStool:
      source_chair(w);
      return true;
    case Kind::kCouch:
    case Kind::kCornerCouch:
      source_couch(w);
      return true;
    case Kind::kBed:
    case Kind::kSingleBed:
      source_bed(w);
      return true;
    case Kind::kDiningTable:
    case Kind::kRoundTable:
      source_table(w);
      w.piece.surface_height_m = w.mesh().max_m().z;
      return true;
    case Kind::kPlant:
      source_plant(w);
      return true;
    case Kind::kTv:
      source_tv(w);
      return true;
    case Kind::kToilet:
      source_toilet(w);
      return true;
    case Kind::kRefrigerator:
      source_refrigerator(w);
      return true;
    case Kind::kFoosballTable:
      source_foosball(w);
      return true;
    case Kind::kDoorLeaf:
      source_door(w);
      return true;
    case Kind::kWardrobe:
      source_wardrobe(w);
      return true;
    case Kind::kTrashBin:
      source_bin(w);
      return true;
    default:
      return false;
  }
}

}  // namespace segsim::worlds::internal
