#pragma once

/// @file
/// Rooms, doorways and windows of a flat or a home.

#include <cstdint>
#include <numbers>
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
  /// How far that leaf is open. Half open it stands in the room.
  float leaf_angle_rad = std::numbers::pi_v<float>;
  bool owns_passage = false;  ///< Of a doorway's two openings, one builds the jambs.
};

enum class RoomType : std::uint8_t {
  kLiving,
  kKitchen,
  kBathroom,
  kBedroom,
  kSecondBedroom,
  kStudy,
  kHall,
  // Only in homes (home_plan.h).
  kStudio,          ///< Living, sleeping and cooking in one.
  kLivingKitchen,   ///< Living and cooking in one.
  kCookingKitchen,  ///< With a stove.
  kDining,
  kOffice,
  kMeeting,
  kWard
};
[[nodiscard]] const char* room_name(RoomType type);

struct Room {
  RoomType type = RoomType::kHall;
  Rect rect;  ///< Inside of the walls.
  std::vector<Opening> openings;
  /// Whether rugs and what stands on furniture must lie between the walls as well. In flats
  /// they need not, so that a seed keeps its flat.
  bool all_inside = false;

  /// Coordinate of the inner face of a wall.
  [[nodiscard]] float wall_m(Side side) const {
    const int across = 1 - axis_along(side);
    return side == kSouth || side == kWest ? rect.min_m[across] : rect.max_m[across];
  }
};

/// Where the leaf of a doorway of `room` stands, seen from above.
struct DoorLeaf {
  glm::vec2 hinge_m{0.0F}, tip_m{0.0F};

  /// With the handles.
  [[nodiscard]] Rect footprint() const;
};
/// @pre opening.leaf_side is not 0.
[[nodiscard]] DoorLeaf door_leaf(const Room& room, const Opening& opening);

/// Rooms side by side along x from x = 0, together `width_m` wide, from `y_from_m` to
/// `y_to_m`.
[[nodiscard]] std::vector<Room> make_row(const std::vector<RoomType>& types, float width_m,
                                         float y_from_m, float y_to_m, Dice& dice);
/// What a room of that type is wide in a row where nothing is stretched.
[[nodiscard]] float preferred_width_m(RoomType type, Dice& dice);
/// Adds a doorway if the rooms share a wall of sufficient length.
bool connect(Room& a, Room& b, float width_m, Dice& dice);
/// The leaf of the doorway just added to `room`, turned by 180 degrees onto the wall beside
/// it; now and then none.
void add_leaf(Room& room, Dice& dice);
void add_window(Room& room, Side side, Dice& dice);
void move(std::vector<Room>& rooms, const glm::vec2& by_m);
/// About the coordinate 0 of the axis.
void mirror(std::vector<Room>& rooms, int axis);
/// Swaps x and y.
void transpose(std::vector<Room>& rooms);

/// `rooms` rooms and a hall, centred on the origin; every room has a doorway.
[[nodiscard]] std::vector<Room> make_floor_plan(int rooms, Dice& dice);

/// Walls, floors, ceilings, windows, doors and lamps of the rooms.
void build_shell(sim::MeshScene& scene, const std::vector<Room>& rooms,
                 SurfaceLibrary& surfaces, Dice& dice, FurnitureStyle style, bool ceiling);

}  // namespace segsim::worlds::internal
