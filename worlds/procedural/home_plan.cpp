/// Four layouts: one room and perhaps a bathroom; rooms along one or both sides of a corridor;
/// rooms around a living room; two wings at a right angle.

#include <algorithm>
#include <numbers>

#include <glm/common.hpp>

#include "core/check.h"
#include "worlds/procedural/internal/home_plan.h"

namespace segsim::worlds::internal {
namespace {

using Type = RoomType;
using Types = std::vector<Type>;

constexpr float kWall = kWallThickness_m;
constexpr float kPi = std::numbers::pi_v<float>;

Types room_types(HomePlan plan, int rooms) {
  const auto count = static_cast<std::size_t>(rooms);
  if (plan == HomePlan::kOffice) {
    Types types{Type::kOffice, Type::kBathroom, Type::kMeeting, Type::kCookingKitchen};
    types.resize(std::max(types.size(), count), Type::kOffice);
    return types;
  }
  if (plan == HomePlan::kWard) {
    Types types{Type::kWard, Type::kBathroom, Type::kWard, Type::kOffice, Type::kDining};
    types.resize(std::max(types.size(), count), Type::kWard);
    return types;
  }
  if (rooms == 1) return {Type::kStudio};
  if (rooms == 2) return {Type::kStudio, Type::kBathroom};
  if (rooms == 3) return {Type::kLivingKitchen, Type::kBedroom, Type::kBathroom};
  const Types all{Type::kLiving,   Type::kCookingKitchen, Type::kBedroom,
                  Type::kBathroom, Type::kSecondBedroom,  Type::kStudy,
                  Type::kDining,   Type::kBathroom};
  return {all.begin(), all.begin() + rooms};
}

bool is_wide(Type type) {
  return type == Type::kLiving || type == Type::kLivingKitchen || type == Type::kStudio ||
         type == Type::kMeeting;
}

/// A doorway between the rooms, with a leaf in the second one: against the wall, half open, or
/// none.
void add_door(Room& from, Room& room, Dice& dice) {
  const bool wide = is_wide(room.type);
  const float width_m = wide ? dice.between(1.15F, 1.35F) : dice.between(1.05F, 1.12F);
  if (!connect(from, room, width_m, dice)) return;
  if (wide) return;
  if (dice.chance(0.5F)) return add_leaf(room, dice);
  Opening& door = room.openings.back();
  for (const int side : {dice.pick({-1, 1}), -1, 1}) {
    door.leaf_side = side;
    door.leaf_angle_rad = dice.between(0.5F, 0.65F) * kPi;
    const DoorLeaf leaf = door_leaf(room, door);
    const Rect place{glm::min(leaf.hinge_m, leaf.tip_m) - 0.03F,
                     glm::max(leaf.hinge_m, leaf.tip_m) + 0.03F};
    if (room.rect.contains(place)) return;
  }
  door.leaf_side = 0;
}

void add_entrance(Room& room, Side side, Dice& dice) {
  const int along = axis_along(side);
  const float lo = room.rect.min_m[along] + 0.6F, hi = room.rect.max_m[along] - 0.6F;
  Opening entrance;
  entrance.kind = OpeningKind::kEntrance;
  entrance.side = side;
  entrance.width_m = 0.95F;
  entrance.center_m = hi - lo < 1.0F ? 0.5F * (lo + hi) : dice.pick({lo + 0.2F, hi - 0.2F});
  room.openings.push_back(entrance);
}

/// What the types take side by side.
float length_m(const Types& types, Dice& dice) {
  float sum = kWall * static_cast<float>(types.size() - 1);
  for (const Type type : types) sum += preferred_width_m(type, dice);
  return sum;
}

/// Along a column instead of a row: x from `x_from_m` to `x_to_m`, y from 0.
std::vector<Room> make_column(const Types& types, float length, float x_from_m, float x_to_m,
                              Dice& dice) {
  std::vector<Room> column = make_row(types, length, x_from_m, x_to_m, dice);
  transpose(column);
  return column;
}

void append(std::vector<Room>& plan, std::vector<Room> rooms) {
  plan.insert(plan.end(), rooms.begin(), rooms.end());
}

/// Deals the types out so that both parts become about equally long.
std::pair<Types, Types> halves(const Types& types, Dice& dice) {
  std::pair<Types, Types> parts;
  float first_m = 0.0F, second_m = 0.0F;
  for (const Type type : types) {
    const float width = preferred_width_m(type, dice);
    (first_m <= second_m ? parts.first : parts.second).push_back(type);
    (first_m <= second_m ? first_m : second_m) += width;
  }
  for (Types* part : {&parts.first, &parts.second}) {
    if (dice.chance(0.5F)) std::reverse(part->begin(), part->end());
  }
  return parts;
}

std::vector<Room> one_room(const Types& types, Dice& dice) {
  const float width = dice.between(6.2F, 7.0F), depth = dice.between(5.6F, 6.2F);
  std::vector<Room> plan{{Type::kStudio, {{0, 0}, {width, depth}}, {}}};
  if (types.size() > 1) {
    const float bath_depth = dice.between(2.6F, 3.0F);
    plan.push_back({Type::kBathroom,
                    {{width + kWall, depth - bath_depth},
                     {width + kWall + dice.between(2.4F, 2.8F), depth}},
                    {}});
    add_door(plan[0], plan[1], dice);
    add_window(plan[1], kNorth, dice);
  }
  add_window(plan[0], kNorth, dice);
  add_window(plan[0], kWest, dice);
  add_entrance(plan[0], kSouth, dice);
  return plan;
}

/// @param both_sides  Else all rooms lie on one side, and the corridor has the windows.
std::vector<Room> along_corridor(const Types& types, float corridor_m, bool both_sides,
                                 Dice& dice) {
  const auto [north, south] =
      both_sides ? halves(types, dice) : std::pair<Types, Types>{types, {}};
  const bool deep = types[0] == Type::kLivingKitchen || types[0] == Type::kWard;
  const auto depth = [&] {
    return deep ? dice.between(4.4F, 5.0F) : dice.between(3.7F, 4.3F);
  };
  const float width =
      std::max(length_m(north, dice), south.empty() ? 0.0F : length_m(south, dice));
  const float south_depth = south.empty() ? 0.0F : depth();
  const float y0 = south.empty() ? 0.0F : south_depth + kWall, y1 = y0 + corridor_m;
  Room hall{Type::kHall, {{0, y0}, {width, y1}}, {}};
  std::vector<Room> plan = make_row(north, width, y1 + kWall, y1 + kWall + depth(), dice);
  const std::size_t num_north = plan.size();
  if (!south.empty()) append(plan, make_row(south, width, 0.0F, south_depth, dice));
  for (std::size_t i = 0; i < plan.size(); ++i) {
    add_door(hall, plan[i], dice);
    add_window(plan[i], i < num_north ? kNorth : kSouth, dice);
  }
  if (south.empty()) add_window(hall, kSouth, dice);
  add_window(hall, kWest, dice);
  add_entrance(hall, kEast, dice);
  plan.push_back(hall);
  return plan;
}

std::vector<Room> around_living(const Types& types, Dice& dice) {
  const auto [west, east] = halves({types.begin() + 1, types.end()}, dice);
  const float length =
      std::max({length_m(west, dice), east.empty() ? 0.0F : length_m(east, dice), 5.6F});
  const float x0 = dice.between(3.5F, 4.2F), x1 = x0 + kWall + dice.between(4.4F, 5.2F);
  std::vector<Room> plan{{types[0], {{x0 + kWall, 0}, {x1, length}}, {}}};
  append(plan, make_column(west, length, 0.0F, x0, dice));
  const std::size_t num_west = plan.size();
  if (!east.empty()) {
    append(plan,
           make_column(east, length, x1 + kWall, x1 + kWall + dice.between(3.5F, 4.2F), dice));
  }
  for (std::size_t i = 1; i < plan.size(); ++i) {
    add_door(plan[0], plan[i], dice);
    add_window(plan[i], i < num_west ? kWest : kEast, dice);
  }
  add_window(plan[0], kNorth, dice);
  add_entrance(plan[0], kSouth, dice);
  return plan;
}

/// A corridor with rooms on both sides, and at its end another one to the north, with rooms in
/// the east.
std::vector<Room> two_wings(const Types& types, float corridor_m, Dice& dice) {
  const std::size_t in_wing = std::max<std::size_t>(2, types.size() / 3);
  const Types first(types.begin(), types.end() - static_cast<std::ptrdiff_t>(in_wing));
  const Types second(types.end() - static_cast<std::ptrdiff_t>(in_wing), types.end());
  std::vector<Room> plan = along_corridor(first, corridor_m, true, dice);
  Room& hall = plan.back();
  // The second corridor takes the place of the entrance at the end of the first.
  hall.openings.pop_back();
  const glm::vec2 corner = {hall.rect.max_m.x + kWall, hall.rect.min_m.y};
  float top = 0.0F;
  for (const Room& room : plan) top = std::max(top, room.rect.max_m.y);
  const float length = std::max(length_m(second, dice), top - corner.y);
  const float depth =
      second[0] == Type::kWard ? dice.between(4.4F, 5.0F) : dice.between(3.7F, 4.3F);
  std::vector<Room> wing =
      make_column(second, length, corridor_m + kWall, corridor_m + kWall + depth, dice);
  Room passage{Type::kHall, {{0, 0}, {corridor_m, length}}, {}};
  for (Room& room : wing) {
    add_door(passage, room, dice);
    add_window(room, kEast, dice);
  }
  add_window(passage, kNorth, dice);
  add_entrance(passage, kSouth, dice);
  wing.push_back(passage);
  move(wing, corner);
  connect(hall, wing.back(), corridor_m - 0.3F, dice);
  append(plan, wing);
  return plan;
}

std::vector<Room> lay_out(HomePlan plan, const Types& types, Dice& dice) {
  if (types.size() <= 2) return one_room(types, dice);
  const bool ward = plan == HomePlan::kWard;
  const float corridor_m = ward ? dice.between(2.0F, 2.4F) : dice.between(1.6F, 1.9F);
  if (ward) return two_wings(types, corridor_m, dice);
  if (types.size() >= 6 && dice.chance(0.3F)) return two_wings(types, corridor_m, dice);
  if (plan == HomePlan::kApartment && types.size() <= 7 && dice.chance(0.35F)) {
    return around_living(types, dice);
  }
  const bool both_sides = types.size() > 4 || (types.size() > 3 && dice.chance(0.7F));
  return along_corridor(types, corridor_m, both_sides, dice);
}

}  // namespace

std::vector<Room> make_home_plan(HomePlan plan, int rooms, Dice& dice) {
  SEGSIM_CHECK(plan != HomePlan::kAny, "a plan is chosen before");
  std::vector<Room> home = lay_out(plan, room_types(plan, rooms), dice);
  glm::vec2 low(1e9F), high(-1e9F);
  for (const Room& room : home) {
    low = glm::min(low, room.rect.min_m);
    high = glm::max(high, room.rect.max_m);
  }
  for (Room& room : home) room.all_inside = true;
  move(home, -0.5F * (low + high));
  if (dice.chance(0.5F)) mirror(home, 0);
  if (dice.chance(0.5F)) mirror(home, 1);
  if (dice.chance(0.5F)) transpose(home);
  return home;
}

}  // namespace segsim::worlds::internal
