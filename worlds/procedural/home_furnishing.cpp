/// What stands in rooms that only homes have.

#include <algorithm>
#include <numbers>

#include "worlds/procedural/internal/furnisher.h"

namespace segsim::worlds::internal {
namespace {

constexpr float kPi = std::numbers::pi_v<float>;
constexpr float kGap_m = 0.03F;  // Between pieces side by side.
using Kind = FurnitureKind;

}  // namespace

bool Furnisher::place_kitchen_row() {
  for (int attempt = 0; attempt < 5; ++attempt) {
    Group group;
    const float width = 2.3F - 0.3F * static_cast<float>(attempt) + dice_.between(-0.1F, 0.1F);
    const Furniture counter = make(Kind::kKitchenCounter, width), stove = make(Kind::kStove),
                    refrigerator = make(Kind::kRefrigerator);
    const float right = dice_.pick({-1.0F, 1.0F});
    group.add(counter);
    group.add(make(Kind::kKitchenSink), {-right * 0.22F * width, 0, counter.surface_height_m},
              0.0F, false);
    const auto add_beside = [&](const Furniture& piece, float side) {
      group.add(piece, {side * (0.5F * (width + piece.size_m().x) + kGap_m),
                        counter.mesh.max_m().y - piece.mesh.max_m().y, 0});
    };
    add_beside(stove, right);
    add_beside(refrigerator, -right);
    group.add(make(Kind::kAppliance), {right * 0.36F * width, 0.08F, counter.surface_height_m},
              0.0F, false);
    group.add(make(dice_.pick({Kind::kBowl, Kind::kVase, Kind::kCup, Kind::kSmallPlant})),
              {right * 0.12F * width, 0.05F, counter.surface_height_m}, 0.3F, false);
    if (placer_.at_wall(group, {})) return true;
  }
  return false;
}

bool Furnisher::cooking_kitchen() {
  if (!place_kitchen_row() || !dining_group()) return false;
  maybe(0.5F, Kind::kWashingMachine);
  maybe(0.9F, Kind::kTrashBin, in_corner());
  maybe(0.5F, Kind::kPlant, in_corner());
  pictures(2);
  return true;
}

bool Furnisher::living_kitchen() {
  if (!place_kitchen_row() || !living() || !dining_group()) return false;
  maybe(0.7F, Kind::kTrashBin, in_corner());
  return true;
}

bool Furnisher::studio() {
  if (!place_kitchen_row()) return false;
  Group bed;
  const Furniture mattress = make(dice_.chance(0.5F) ? Kind::kBed : Kind::kSingleBed),
                  stand = make(Kind::kNightstand);
  bed.add(mattress);
  bed.add(stand, {0.5F * (mattress.size_m().x + stand.size_m().x) + kGap_m,
                  mattress.mesh.max_m().y - stand.mesh.max_m().y, 0});
  if (!placer_.at_wall(bed, in_corner())) return false;
  if (!living() || !dining_group()) return false;
  WallPlace wardrobe;
  wardrobe.front_m = 0.5F;
  placer_.at_wall(single(Kind::kWardrobe), wardrobe);
  maybe(0.7F, Kind::kTrashBin, in_corner());
  return true;
}

bool Furnisher::dining_room() {
  if (!dining_group()) return false;
  maybe(0.8F, Kind::kBookshelf);
  maybe(0.6F, Kind::kWardrobe);
  maybe(0.8F, Kind::kPlant, in_corner());
  maybe(0.5F, Kind::kArmchair, in_corner());
  maybe(0.5F, Kind::kFloorLamp, in_corner());
  pictures(3);
  return true;
}

bool Furnisher::place_desk() {
  Group group;
  const Furniture desk = make(Kind::kDesk), chair = make(Kind::kOfficeChair);
  const float width = desk.size_m().x, back = desk.mesh.max_m().y;
  group.add(desk);
  group.add(chair, {0, desk.mesh.min_m().y - 0.16F, 0}, kPi + dice_.between(-0.4F, 0.4F));
  const auto put = [&](Kind kind, float x, float from_back) {
    group.add(make(kind), {x * width, back - from_back, desk.surface_height_m}, 0.0F, false);
  };
  put(Kind::kLaptop, 0.0F, 0.3F);
  if (dice_.chance(0.7F)) put(Kind::kTableLamp, 0.38F, 0.2F);
  if (dice_.chance(0.6F)) put(Kind::kBooks, -0.34F, 0.25F);
  if (dice_.chance(0.5F)) put(Kind::kCup, 0.24F, 0.4F);
  return placer_.at_wall(group, {});
}

bool Furnisher::office() {
  if (!place_desk()) return false;
  place_desk();
  maybe(0.8F, Kind::kBookshelf);
  maybe(0.4F, Kind::kWardrobe);
  maybe(0.6F, Kind::kPlant, in_corner());
  maybe(0.9F, Kind::kTrashBin, in_corner());
  maybe(0.5F, Kind::kBoxes, in_corner());
  pictures(2);
  return true;
}

bool Furnisher::meeting_room() {
  const std::uint64_t chair_seed = dice_.seed();
  bool done = false;
  for (int attempt = 0; attempt < 3 && !done; ++attempt) {
    Group group;
    // Libraries have no tables of that length for certain.
    const Furniture table = make_furniture(Kind::kDiningTable, style_, dice_.seed(), surfaces_,
                                           {2.5F - 0.4F * static_cast<float>(attempt)});
    const Furniture chair = make(Kind::kOfficeChair, chair_seed, 0.0F);
    const glm::vec3 size = table.size_m();
    const float pitch = chair.size_m().x + 0.12F,
                reach = 0.5F * (size.y + chair.size_m().y) - 0.1F;
    const int seats = std::max(1, static_cast<int>(size.x / pitch));
    group.add(table);
    for (int i = 0; i < seats; ++i) {
      const float x = (static_cast<float>(i) - 0.5F * static_cast<float>(seats - 1)) * pitch;
      group.add(chair, {x, reach, 0}, dice_.between(-0.15F, 0.15F));
      group.add(chair, {x, -reach, 0}, kPi + dice_.between(-0.15F, 0.15F));
    }
    add_clutter(group, table, {0, 0}, 4,
                {Kind::kLaptop, Kind::kCup, Kind::kBooks, Kind::kVase});
    done = placer_.in_middle(group);
  }
  if (!done && !dining_group()) return false;
  Group tv;
  const Furniture stand = make(Kind::kTvStand);
  tv.add(stand).goal = true;
  tv.add(make(Kind::kTv), {0, 0, stand.surface_height_m}, 0.0F, false);
  placer_.at_wall(tv, {});
  maybe(0.7F, Kind::kPlant, in_corner());
  maybe(0.5F, Kind::kPlant, in_corner());
  pictures(3);
  return true;
}

bool Furnisher::place_hospital_bed() {
  Group group;
  const Furniture bed = make(Kind::kHospitalBed), stand = make(Kind::kNightstand);
  const float back = bed.mesh.max_m().y, half = 0.5F * bed.size_m().x;
  const float side = dice_.pick({-1.0F, 1.0F});
  group.add(bed);
  group.add(stand, {side * (half + 0.5F * stand.size_m().x + kGap_m),
                    back - stand.mesh.max_m().y, 0});
  group.add(
      make(dice_.pick({Kind::kTableLamp, Kind::kVase, Kind::kCup, Kind::kSmallPlant})),
      {side * (half + 0.5F * stand.size_m().x + kGap_m), back - 0.2F, stand.surface_height_m},
      0.0F, false);
  return placer_.at_wall(group, {});
}

bool Furnisher::ward() {
  if (!place_hospital_bed()) return false;
  place_hospital_bed();
  maybe(0.4F, Kind::kHospitalBed);
  maybe(0.9F, Kind::kDiningChair);
  maybe(0.6F, Kind::kDiningChair, in_corner());
  maybe(0.7F, Kind::kWardrobe);
  maybe(0.4F, Kind::kArmchair, in_corner());
  maybe(0.8F, Kind::kTrashBin, in_corner());
  maybe(0.4F, Kind::kPlant, in_corner());
  pictures(1);
  return true;
}

}  // namespace segsim::worlds::internal
