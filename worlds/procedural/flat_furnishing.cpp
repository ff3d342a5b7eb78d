/// What stands in which room of a flat.

#include "worlds/procedural/internal/furnisher.h"

#include <algorithm>
#include <numbers>

#include <glm/common.hpp>

namespace segsim::worlds::internal {
namespace {

constexpr float kPi = std::numbers::pi_v<float>;
using Kind = FurnitureKind;
/// Rooms are furnished one by one; so many tries each before the plan is given up.
constexpr std::uint64_t kTriesPerRoom = 6;

}  // namespace

bool Furnisher::furnish() {
  switch (room_.type) {
    case RoomType::kLiving:
      return living();
    case RoomType::kKitchen:
      return kitchen();
    case RoomType::kBathroom:
      return bathroom();
    case RoomType::kBedroom:
      return bedroom(false);
    case RoomType::kSecondBedroom:
      return bedroom(true);
    case RoomType::kStudy:
      return study();
    case RoomType::kStudio:
      return studio();
    case RoomType::kLivingKitchen:
      return living_kitchen();
    case RoomType::kCookingKitchen:
      return cooking_kitchen();
    case RoomType::kDining:
      return dining_room();
    case RoomType::kOffice:
      return office();
    case RoomType::kMeeting:
      return meeting_room();
    case RoomType::kWard:
      return ward();
    case RoomType::kHall:
      break;
  }
  return hall();
}

Furniture Furnisher::make(Kind kind, float width_m) {
  return make(kind, dice_.seed(), width_m);
}
Furniture Furnisher::make(Kind kind, std::uint64_t seed, float width_m) {
  return stock_.make(kind, style_, seed, surfaces_, {width_m});
}

Group Furnisher::single(Kind kind, float width_m) {
  Group group;
  group.add(make(kind, width_m));
  return group;
}

void Furnisher::add_clutter(Group& group, const Furniture& on, const glm::vec2& at, int most,
                            std::initializer_list<Kind> kinds) {
  const glm::vec3 size = on.size_m();
  const int count = dice_.count(1, most);
  for (int i = 0; i < count; ++i) {
    const float x =
        at.x +
        0.6F * size.x * ((static_cast<float>(i) + 0.5F) / static_cast<float>(count) - 0.5F) +
        dice_.between(-0.04F, 0.04F);
    group.add(make(dice_.pick(kinds)),
              {x, at.y + dice_.between(-0.12F, 0.12F) * size.y, on.surface_height_m + 0.001F},
              dice_.between(-0.6F, 0.6F), false);
  }
}

void Furnisher::pictures(int most) {
  const int count = dice_.count(1, most);
  for (int i = 0; i < count; ++i) {
    const Furniture picture = make(Kind::kPicture);
    const float z_m = glm::min(dice_.between(1.25F, 1.5F), 2.45F - picture.size_m().z);
    placer_.on_wall(picture, z_m, 0.1F);
  }
}

void Furnisher::maybe(float probability, Kind kind, const WallPlace& place) {
  if (dice_.chance(probability)) placer_.at_wall(single(kind), place);
}

WallPlace Furnisher::in_corner() {
  WallPlace place;
  place.corner = true;
  return place;
}

bool Furnisher::living() {
  Side couch_side = kSouth;
  if (!place_couch(couch_side)) return false;
  Group tv;
  const Furniture stand = make(Kind::kTvStand);
  tv.add(stand).goal = true;  // The television's turn: it stands on top.
  tv.add(make(Kind::kTv), {0, 0, stand.surface_height_m}, 0.0F, false);
  WallPlace opposite;
  opposite.shuffle = false;
  const Side across = static_cast<Side>((couch_side + 2) % 4);
  opposite.sides = {across, static_cast<Side>((couch_side + 1) % 4),
                    static_cast<Side>((couch_side + 3) % 4), couch_side};
  opposite.near_m = placer_.last_m()[axis_along(across)];
  if (!placer_.at_wall(tv, opposite)) return false;
  if (!placer_.at_wall(single(Kind::kPlant), in_corner())) return false;
  maybe(0.85F, Kind::kArmchair);
  maybe(0.75F, Kind::kBookshelf);
  maybe(0.4F, Kind::kArmchair, in_corner());
  maybe(0.6F, Kind::kFloorLamp, in_corner());
  maybe(0.4F, Kind::kPlant, in_corner());
  pictures(3);
  return true;
}

bool Furnisher::place_couch(Side& side) {
  for (int attempt = 0; attempt < 3; ++attempt) {
    const bool corner = attempt == 0 && dice_.chance(0.35F);
    Group group;
    const Furniture couch =
        make(corner ? Kind::kCornerCouch : Kind::kCouch, attempt < 2 ? 0.0F : 1.7F);
    const float front = couch.mesh.min_m().y;
    group.add(couch);
    if (attempt < 2 && dice_.chance(0.8F)) {
      const Furniture table = make(Kind::kCoffeeTable);
      const float x = corner ? -0.35F : 0.0F;
      const float y = (corner ? -0.45F : front) - 0.38F - 0.5F * table.size_m().y;
      if (!corner) {
        group.add(table, {x, y, 0});
        add_clutter(group, table, {x, y}, 3,
                    {Kind::kBooks, Kind::kCup, Kind::kBowl, Kind::kVase, Kind::kSmallPlant});
      }
      if (dice_.chance(0.7F))
        group.add(make(Kind::kRug), {x, glm::min(y, front), 0.002F}, 0.0F, false);
    }
    if (placer_.at_wall(group, {}, &side)) return true;
  }
  return false;
}

bool Furnisher::kitchen() {
  bool done = false;
  for (int attempt = 0; attempt < 4 && !done; ++attempt) {
    Group group;
    const float width = 2.1F - 0.2F * static_cast<float>(attempt) + dice_.between(-0.1F, 0.1F);
    const Furniture counter = make(Kind::kKitchenCounter, width),
                    refrigerator = make(Kind::kRefrigerator);
    group.add(counter);
    group.add(make(Kind::kKitchenSink), {0.22F * width, 0, counter.surface_height_m}, 0.0F,
              false);
    const float side = dice_.pick({-1.0F, 1.0F});
    const float gap = counter.mesh.max_m().y - refrigerator.mesh.max_m().y;
    group.add(refrigerator,
              {side * (0.5F * (width + refrigerator.size_m().x) + 0.03F), gap, 0});
    group.add(make(dice_.pick({Kind::kBowl, Kind::kVase, Kind::kSmallPlant})),
              {0.4F * width, 0.05F, counter.surface_height_m}, 0.3F, false);
    done = placer_.at_wall(group, {});
  }
  if (!done || !dining_group()) return false;
  maybe(0.9F, Kind::kTrashBin, in_corner());
  maybe(0.3F, Kind::kStool, in_corner());
  maybe(0.5F, Kind::kPlant, in_corner());
  pictures(2);
  return true;
}

bool Furnisher::dining_group() {
  const std::uint64_t chair_seed = dice_.seed();
  const bool round = dice_.chance(0.4F);
  for (int attempt = 0; attempt < 5; ++attempt) {
    Group group;
    const bool small = attempt >= 2;
    const Furniture table = make(round ? Kind::kRoundTable : Kind::kDiningTable,
                                 small ? (round ? 0.9F : 1.05F) : 0.0F);
    const Furniture chair = make(Kind::kDiningChair, chair_seed, 0.0F);
    const glm::vec3 size = table.size_m();
    group.add(table);
    const float tuck = 0.12F, reach_y = 0.5F * size.y + 0.5F * chair.size_m().y - tuck,
                reach_x = 0.5F * size.x + 0.5F * chair.size_m().y - tuck;
    const auto add_chair = [&](float x, float y, float yaw) {
      group.add(chair, {x, y, 0}, yaw + dice_.between(-0.12F, 0.12F));
    };
    const bool against_wall = attempt >= 3;
    // Chairs must not meet at the table's corners or side by side.
    const float chair_width = chair.size_m().x + 0.08F;
    const bool two_abreast = size.x > std::max(1.15F, 2.0F * chair_width);
    const bool all_around = size.y - 2.0F * tuck > chair_width;
    if (!round && two_abreast && attempt < 1) {
      for (const float x : {-0.25F * size.x, 0.25F * size.x}) {
        add_chair(x, reach_y, 0.0F);
        add_chair(x, -reach_y, kPi);
      }
    } else {
      add_chair(reach_x, 0, -0.5F * kPi);
      add_chair(-reach_x, 0, 0.5F * kPi);
      if (round && attempt < 2 && dice_.chance(0.6F) && all_around) {
        add_chair(0, reach_y, 0.0F);
        add_chair(0, -reach_y, kPi);
      }
    }
    add_clutter(group, table, {0, 0}, 3,
                {Kind::kBowl, Kind::kVase, Kind::kCup, Kind::kSmallPlant, Kind::kBooks});
    if (against_wall ? placer_.at_wall(group, {}) : placer_.in_middle(group)) return true;
  }
  return false;
}

bool Furnisher::bathroom() {
  for (const float width : {1.6F, 1.5F}) {
    if (placer_.at_wall(single(Kind::kBathtub, width), in_corner())) break;
  }
  if (!placer_.at_wall(single(Kind::kToilet), {}) &&
      !placer_.at_wall(single(Kind::kToilet), in_corner()))
    return false;
  Group basin;
  const Furniture bowl = make(Kind::kWashbasin);
  basin.add(bowl);
  // A tall washstand brings its own mirror.
  if (dice_.chance(0.8F) && bowl.mesh.max_m().z < 1.12F)
    basin.add(make(Kind::kMirror, 0.5F), {0, bowl.mesh.max_m().y, 1.15F}, 0.0F, false);
  placer_.at_wall(basin, {});
  maybe(0.6F, Kind::kTrashBin, in_corner());
  return true;
}

bool Furnisher::bedroom(bool second) {
  bool done = false;
  for (int attempt = 0; attempt < 4 && !done; ++attempt) {
    Group group;
    const Furniture bed = make(second ? Kind::kSingleBed : Kind::kBed);
    group.add(bed);
    const float back = bed.mesh.max_m().y, half = 0.5F * bed.size_m().x;
    const std::uint64_t stand_seed = dice_.seed(), lamp_seed = dice_.seed();
    for (const float side : {-1.0F, 1.0F}) {
      if (attempt > 0 && (side > 0.0F || attempt > 1)) continue;
      const Furniture stand = make(Kind::kNightstand, stand_seed, 0.0F);
      const glm::vec3 at(side * (half + 0.5F * stand.size_m().x + 0.04F),
                         back - stand.mesh.max_m().y, 0);
      group.add(stand, at);
      if (dice_.chance(0.7F))
        group.add(make(Kind::kTableLamp, lamp_seed, 0.0F),
                  {at.x, at.y, stand.surface_height_m}, 0.0F, false);
    }
    if (dice_.chance(0.5F))
      group.add(make(Kind::kRug, 2.0F), {0, bed.mesh.min_m().y + 0.3F, 0.002F}, 0.0F, false);
    done = placer_.at_wall(group, {});
  }
  if (!done) return false;
  WallPlace wardrobe;
  wardrobe.front_m = 0.5F;
  placer_.at_wall(single(Kind::kWardrobe), wardrobe);
  maybe(second ? 0.8F : 0.35F, Kind::kDesk);
  maybe(0.6F, Kind::kPlant, in_corner());
  maybe(0.5F, dice_.pick({Kind::kArmchair, Kind::kDiningChair}), in_corner());
  if (!second && dice_.chance(0.25F)) {
    Group tv;
    const Furniture stand = make(Kind::kTvStand);
    tv.add(stand).goal = true;
    tv.add(make(Kind::kTv), {0, 0, stand.surface_height_m}, 0.0F, false);
    placer_.at_wall(tv, {});
  }
  pictures(2);
  return true;
}

bool Furnisher::study() {
  Group group;
  const Furniture desk = make(Kind::kDesk), chair = make(Kind::kOfficeChair);
  group.add(desk);
  group.add(chair, {-0.12F, desk.mesh.min_m().y - 0.16F, 0}, kPi + dice_.between(-0.4F, 0.4F));
  group.add(make(Kind::kLaptop), {-0.12F, 0, desk.surface_height_m}, 0.0F, false);
  group.add(make(Kind::kTableLamp), {0.38F * desk.size_m().x, 0.1F, desk.surface_height_m},
            0.0F, false);
  if (dice_.chance(0.7F))
    group.add(make(Kind::kBooks), {0.2F * desk.size_m().x, 0.05F, desk.surface_height_m}, 0.2F,
              false);
  placer_.at_wall(group, {});
  if (!placer_.at_wall(single(Kind::kBookshelf), {})) return false;
  maybe(0.35F, Kind::kCouch);
  maybe(0.7F, Kind::kPlant, in_corner());
  maybe(0.7F, Kind::kTrashBin, in_corner());
  maybe(0.5F, Kind::kArmchair, in_corner());
  maybe(0.5F, Kind::kBoxes, in_corner());
  pictures(2);
  return true;
}

bool Furnisher::hall() {
  maybe(0.6F, Kind::kPlant, in_corner());
  maybe(0.5F, Kind::kDiningChair, in_corner());
  maybe(0.4F, Kind::kNightstand);
  pictures(3);
  return true;
}

bool furnish(sim::MeshScene& scene, const Room& room, SurfaceLibrary& surfaces,
             FurnitureStock& stock, std::uint64_t seed, FurnitureStyle style) {
  const std::size_t meshes = scene.meshes.size(), instances = scene.instances.size();
  const SurfaceLibrary::Mark mark = surfaces.mark();
  for (std::uint64_t attempt = 0; attempt < kTriesPerRoom; ++attempt) {
    Furnisher furnisher(scene, room, surfaces, stock, seed + attempt, style);
    if (furnisher.furnish()) {
      stock.add_credits(furnisher.credits());
      return true;
    }
    scene.meshes.resize(meshes);
    scene.instances.resize(instances);
    surfaces.rewind(mark);
  }
  return false;
}

}  // namespace segsim::worlds::internal
