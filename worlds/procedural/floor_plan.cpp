/// The floor plan: a hall between two rows of rooms; in half of the flats the living room
/// takes the hall's end. Mirrored and turned at random.

#include <algorithm>
#include <cmath>
#include <numbers>

#include <glm/common.hpp>
#include <glm/geometric.hpp>

#include "worlds/procedural/internal/floor_plan.h"

namespace segsim::worlds::internal {

float Rect::distance_m(const glm::vec2& p) const {
  return glm::length(p - glm::clamp(p, min_m, max_m));
}

glm::vec2 outward(Side side) {
  switch (side) {
    case kSouth:
      return {0.0F, -1.0F};
    case kEast:
      return {1.0F, 0.0F};
    case kNorth:
      return {0.0F, 1.0F};
    case kWest:
      break;
  }
  return {-1.0F, 0.0F};
}

float yaw_against_rad(Side side) {
  constexpr float kPi = std::numbers::pi_v<float>;
  constexpr float kYaw_rad[] = {kPi, -0.5F * kPi, 0.0F, 0.5F * kPi};
  return kYaw_rad[side];
}

namespace {

constexpr float kCornerMargin_m = 0.12F;

struct Span {
  float lo = 0.0F, hi = 0.0F;
};

}  // namespace

Rect DoorLeaf::footprint() const {
  constexpr float kHalfThickness_m = 0.09F;  // With handles on both sides.
  return {glm::min(hinge_m, tip_m) - kHalfThickness_m,
          glm::max(hinge_m, tip_m) + kHalfThickness_m};
}

DoorLeaf door_leaf(const Room& room, const Opening& opening) {
  // Beside the jamb and before the wall, so that the doorway keeps its width.
  constexpr float kAside_m = 0.03F, kBefore_m = 0.04F;
  const int along = axis_along(opening.side), across = 1 - along;
  const auto side = static_cast<float>(opening.leaf_side);
  const float inward = -outward(opening.side)[across];
  DoorLeaf leaf;
  leaf.hinge_m[along] = opening.center_m + side * (0.5F * opening.width_m + kAside_m);
  leaf.hinge_m[across] = room.wall_m(opening.side) + kBefore_m * inward;
  const float length_m = opening.width_m - 0.04F;
  leaf.tip_m = leaf.hinge_m;
  leaf.tip_m[along] -= side * std::cos(opening.leaf_angle_rad) * length_m;
  leaf.tip_m[across] += inward * std::sin(opening.leaf_angle_rad) * length_m;
  return leaf;
}

const char* room_name(RoomType type) {
  switch (type) {
    case RoomType::kLiving:
      return "living room";
    case RoomType::kKitchen:
    case RoomType::kCookingKitchen:
      return "kitchen";
    case RoomType::kBathroom:
      return "bathroom";
    case RoomType::kBedroom:
    case RoomType::kSecondBedroom:
      return "bedroom";
    case RoomType::kStudy:
      return "study";
    case RoomType::kStudio:
      return "studio";
    case RoomType::kLivingKitchen:
      return "living room with kitchen";
    case RoomType::kDining:
      return "dining room";
    case RoomType::kOffice:
      return "office";
    case RoomType::kMeeting:
      return "meeting room";
    case RoomType::kWard:
      return "ward";
    case RoomType::kHall:
      break;
  }
  return "hall";
}

float preferred_width_m(RoomType type, Dice& dice) {
  switch (type) {
    case RoomType::kLiving:
      return dice.between(4.7F, 5.4F);
    case RoomType::kKitchen:
      return dice.between(3.5F, 4.0F);
    case RoomType::kBathroom:
      return dice.between(2.4F, 2.8F);
    case RoomType::kBedroom:
      return dice.between(3.9F, 4.4F);
    case RoomType::kSecondBedroom:
      return dice.between(3.4F, 3.9F);
    case RoomType::kStudy:
      return dice.between(3.0F, 3.5F);
    case RoomType::kStudio:
    case RoomType::kLivingKitchen:
      return dice.between(6.0F, 6.8F);
    case RoomType::kCookingKitchen:
    case RoomType::kOffice:
      return dice.between(3.7F, 4.3F);
    case RoomType::kDining:
      return dice.between(3.8F, 4.4F);
    case RoomType::kMeeting:
      return dice.between(4.6F, 5.4F);
    case RoomType::kWard:
      return dice.between(4.6F, 5.3F);
    case RoomType::kHall:
      break;
  }
  return 3.0F;
}

std::vector<Room> make_row(const std::vector<RoomType>& types, float width_m, float y_from_m,
                           float y_to_m, Dice& dice) {
  std::vector<float> widths;
  float sum = 0.0F;
  for (const RoomType type : types) {
    widths.push_back(preferred_width_m(type, dice));
    sum += widths.back();
  }
  const float scale =
      (width_m - kWallThickness_m * static_cast<float>(types.size() - 1)) / sum;
  std::vector<Room> row;
  float x = 0.0F;
  for (std::size_t i = 0; i < types.size(); ++i) {
    const float next = x + scale * widths[i];
    row.push_back({types[i], {{x, y_from_m}, {next, y_to_m}}, {}});
    x = next + kWallThickness_m;
  }
  return row;
}

bool connect(Room& a, Room& b, float width_m, Dice& dice) {
  for (const Side side : {kSouth, kEast, kNorth, kWest}) {
    const int along = axis_along(side), across = 1 - along;
    const Side opposite = static_cast<Side>((side + 2) % 4);
    if (std::abs(std::abs(a.wall_m(side) - b.wall_m(opposite)) - kWallThickness_m) > 0.01F)
      continue;
    if ((b.rect.center_m()[across] - a.rect.center_m()[across]) * outward(side)[across] < 0.0F)
      continue;
    const Span shared{std::max(a.rect.min_m[along], b.rect.min_m[along]),
                      std::min(a.rect.max_m[along], b.rect.max_m[along])};
    const float room = shared.hi - shared.lo - width_m - 2.0F * kCornerMargin_m;
    if (room < 0.0F) continue;
    Opening opening;
    opening.side = side;
    opening.width_m = width_m;
    // Near a corner or anywhere.
    const float t = dice.chance(0.6F) ? dice.pick({0.0F, 1.0F}) * dice.between(0.85F, 1.0F)
                                      : dice.between(0.0F, 1.0F);
    opening.center_m = shared.lo + kCornerMargin_m + 0.5F * width_m + t * room;
    opening.owns_passage = true;
    a.openings.push_back(opening);
    opening.side = opposite;
    opening.owns_passage = false;
    b.openings.push_back(opening);
    return true;
  }
  return false;
}

void add_leaf(Room& room, Dice& dice) {
  Opening& door = room.openings.back();
  const int along = axis_along(door.side);
  const float need = 1.5F * door.width_m + 0.05F;
  const bool up = door.center_m + need < room.rect.max_m[along];
  const bool down = door.center_m - need > room.rect.min_m[along];
  if (!dice.chance(0.7F) || (!up && !down)) return;
  door.leaf_side = up && (!down || dice.chance(0.5F)) ? 1 : -1;
}

void add_window(Room& room, Side side, Dice& dice) {
  const int along = axis_along(side);
  const Span wall{room.rect.min_m[along], room.rect.max_m[along]};
  const bool bathroom = room.type == RoomType::kBathroom;
  Opening window;
  window.kind = OpeningKind::kWindow;
  window.side = side;
  window.width_m =
      std::min(bathroom ? 0.7F : dice.between(1.1F, 1.9F), wall.hi - wall.lo - 0.5F);
  window.sill_m = bathroom ? 1.35F : dice.between(0.85F, 1.0F);
  window.head_m = bathroom ? 2.05F : dice.between(2.1F, 2.3F);
  window.center_m = 0.5F * (wall.lo + wall.hi) +
                    dice.between(-0.15F, 0.15F) * (wall.hi - wall.lo - window.width_m);
  room.openings.push_back(window);
}

void move(std::vector<Room>& rooms, const glm::vec2& by_m) {
  for (Room& room : rooms) {
    room.rect.min_m += by_m;
    room.rect.max_m += by_m;
    for (Opening& opening : room.openings) opening.center_m += by_m[axis_along(opening.side)];
  }
}

void mirror(std::vector<Room>& rooms, int axis) {
  for (Room& room : rooms) {
    const float low = -room.rect.max_m[axis];
    room.rect.max_m[axis] = -room.rect.min_m[axis];
    room.rect.min_m[axis] = low;
    for (Opening& opening : room.openings) {
      if (axis_along(opening.side) == axis) {
        opening.center_m = -opening.center_m;
        opening.leaf_side = -opening.leaf_side;
      } else {
        opening.side = static_cast<Side>((opening.side + 2) % 4);
      }
    }
  }
}

void transpose(std::vector<Room>& rooms) {
  constexpr Side kTransposed[] = {kWest, kNorth, kEast, kSouth};
  for (Room& room : rooms) {
    std::swap(room.rect.min_m.x, room.rect.min_m.y);
    std::swap(room.rect.max_m.x, room.rect.max_m.y);
    for (Opening& opening : room.openings) opening.side = kTransposed[opening.side];
  }
}

std::vector<Room> make_floor_plan(int rooms, Dice& dice) {
  using Type = RoomType;
  std::vector<Type> north{Type::kLiving, Type::kKitchen},
      south{Type::kBedroom, Type::kBathroom};
  if (rooms == 5) south.push_back(Type::kStudy);
  if (rooms == 6) {
    north.push_back(Type::kBathroom);
    south = {Type::kBedroom, Type::kStudy, Type::kSecondBedroom};
  }
  if (dice.chance(0.5F)) std::reverse(south.begin(), south.end());

  const float width = rooms == 4   ? dice.between(7.6F, 8.3F)
                      : rooms == 5 ? dice.between(9.2F, 9.8F)
                                   : dice.between(10.9F, 11.6F);
  const float south_depth = dice.between(3.5F, 4.0F), north_depth = dice.between(3.6F, 4.1F);
  const float hall_depth = dice.between(1.55F, 1.85F);
  const Span hall_y{south_depth + kWallThickness_m,
                    south_depth + kWallThickness_m + hall_depth};
  std::vector<Room> plan = make_row(north, width, hall_y.hi + kWallThickness_m,
                                    hall_y.hi + kWallThickness_m + north_depth, dice);
  const std::size_t num_north = plan.size();
  for (const Room& room : make_row(south, width, 0.0F, south_depth, dice))
    plan.push_back(room);
  Room hall{Type::kHall, {{0.0F, hall_y.lo}, {width, hall_y.hi}}, {}};
  const bool open_plan = dice.chance(0.5F);
  if (open_plan) {  // The living room reaches across the hall.
    plan[0].rect.min_m.y = hall_y.lo;
    hall.rect.min_m.x = plan[0].rect.max_m.x + kWallThickness_m;
  }

  for (std::size_t i = 0; i < plan.size(); ++i) {
    const bool wide = plan[i].type == Type::kLiving;
    const float door = wide ? dice.between(1.15F, 1.35F) : dice.between(1.05F, 1.12F);
    const bool connected =
        connect(hall, plan[i], door, dice) || connect(plan[0], plan[i], door, dice);
    if (connected && !wide) add_leaf(plan[i], dice);
    add_window(plan[i], i < num_north ? kNorth : kSouth, dice);
  }
  if (dice.chance(0.6F)) connect(plan[0], plan[1], dice.between(1.1F, 1.3F), dice);
  if (!open_plan) add_window(hall, kWest, dice);
  Opening entrance;
  entrance.kind = OpeningKind::kEntrance;
  entrance.side = kEast;
  entrance.width_m = 0.95F;
  entrance.center_m = 0.5F * (hall_y.lo + hall_y.hi);
  hall.openings.push_back(entrance);
  plan.push_back(hall);

  const glm::vec2 middle(0.5F * width, 0.5F * (hall_y.hi + kWallThickness_m + north_depth));
  for (Room& room : plan) {
    room.rect.min_m -= middle;
    room.rect.max_m -= middle;
    for (Opening& opening : room.openings)
      opening.center_m -= middle[axis_along(opening.side)];
  }
  if (dice.chance(0.5F)) mirror(plan, 0);
  if (dice.chance(0.5F)) mirror(plan, 1);
  if (dice.chance(0.5F)) transpose(plan);
  return plan;
}

}  // namespace segsim::worlds::internal
