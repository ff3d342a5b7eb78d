#pragma once

/// @file
/// Rooms, doorways and windows of a flat. Private to sim/procedural_flat*.cpp.

#include <cstdint>
#include <vector>

#include <glm/vec2.hpp>

#include "worlds/procedural/internal/furniture_makers.h"

namespace segsim::worlds::internal {

inline constexpr float kWallThickness_m = 0.12F;
inline constexpr float kWallHeight_m = 2.6F;
inline constexpr float kDoorHeight_m = 2.05F;

/// Axis-aligned rectangle on the floor.
struct Rect {
  glm::vec2 min_m{0.0F}, max_m{0.0F};

  [[nodiscard]] glm::vec2 size_m() const { return max_m - min_m; }
  [[nodiscard]] glm::vec2 center_m() const { return 0.5F * (min_m + max_m); }
  [[nodiscard]] bool overlaps(const Rect& other) const {
    return min_m.x < other.max_m.x && other.min_m.x < max_m.x && min_m.y < other.max_m.y &&
           other.min_m.y < max_m.y;
  }
  [[nodiscard]] bool contains(const Rect& other) const {
    return min_m.x <= other.min_m.x && min_m.y <= other.min_m.y && other.max_m.x <= max_m.x &&
           other.max_m.y <= max_m.y;
  }
  /// 0 inside.
  [[nodiscard]] float distance_m(const glm::vec2& p) const;
};

/// Walls of a room by the direction one looks at them from inside.
enum Side : std::uint8_t { kSouth, kEast, kNorth, kWest };  // -y, +x, +y, -x.
/// Outwards through that wall.
[[nodiscard]] glm::vec2 outward(Side side);
/// Yaw of a piece whose back (+y) is turned to that wall.
[[nodiscard]] float yaw_against_rad(Side side);
/// 0 if the wall runs along x, 1 if along y.
[[nodiscard]] inline int axis_along(Side side) { return side % 2 == 0 ? 0 : 1; }

enum class OpeningKind : std::uint8_t { kDoorway, kEntrance, kWindow };

struct Opening {
  OpeningKind kind = OpeningKind::kDoorway;
  Side side = kSouth;
  float center_m = 0.0F;  ///< World coordinate along the wall.
  float width_m = 1.05F;
  float sill_m = 0.0F, head_m = kDoorHeight_m;
  /// An open door leaf stands against this wall on the side of larger (+1) or smaller (-1)
  /// coordinates; 0 = none.
  int leaf_side = 0;
  bool owns_passage = false;  ///< Of a doorway's two openings, one builds the jambs.
};

enum class RoomType : std::uint8_t {
  kLiving,
  kKitchen,
  kBathroom,
  kBedroom,
  kSecondBedroom,
  kStudy,
  kHall
};

struct Room {
  RoomType type = RoomType::kHall;
  Rect rect;  ///< Inside of the walls.
  std::vector<Opening> openings;

  /// Coordinate of the inner face of a wall.
  [[nodiscard]] float wall_m(Side side) const {
    const int across = 1 - axis_along(side);
    return side == kSouth || side == kWest ? rect.min_m[across] : rect.max_m[across];
  }
};

/// `rooms` rooms and a hall, centred on the origin; every room has a doorway.
[[nodiscard]] std::vector<Room> make_floor_plan(int rooms, Dice& dice);

/// Walls, floors, ceilings, windows, doors and lamps of the rooms.
void build_shell(sim::MeshScene& scene, const std::vector<Room>& rooms,
                 SurfaceLibrary& surfaces, Dice& dice, FurnitureStyle style, bool ceiling);

/// Furnishes one room. @returns false if something that the room must have found no place.
[[nodiscard]] bool furnish_room(sim::MeshScene& scene, const Room& room,
                                SurfaceLibrary& surfaces, std::uint64_t seed,
                                FurnitureStyle style);

}  // namespace segsim::worlds::internal
