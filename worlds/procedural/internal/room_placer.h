#pragma once

/// @file
/// Finds places for groups of furniture in a room so that a robot can still get everywhere.

#include <string>
#include <utility>
#include <vector>

#include "worlds/procedural/internal/floor_plan.h"

namespace segsim::worlds::internal {

/// Radius of the disc that must pass, with a margin over the promised 0.40 m for the grid.
inline constexpr float kPassRadius_m = 0.43F;
/// From the disc's centre to the footprint of a piece that must be reachable.
inline constexpr float kReach_m = 0.7F;
inline constexpr float kGridCell_m = 0.05F;

/// A piece of a group; poses are relative to the group.
struct Piece {
  Furniture furniture;
  glm::vec3 position_m{0.0F};
  float yaw_rad = 0.0F;
  bool blocks = true;  ///< Stands on the floor and is in the robot's way.
  bool goal = false;   ///< Must be reachable; only with `blocks`.
};

/// Pieces that keep their positions relative to one another; back at +y as in Furniture.
struct Group {
  std::vector<Piece> pieces;

  Piece& add(Furniture furniture, const glm::vec3& position_m = glm::vec3(0.0F),
             float yaw_rad = 0.0F, bool blocks = true);
  /// Of the pieces that block.
  [[nodiscard]] Rect footprint() const;
  [[nodiscard]] float height_m() const;
};

/// Axis-aligned footprint of a piece after a further motion by `yaw_rad` and `offset_m`.
[[nodiscard]] Rect footprint_of(const Piece& piece,
                                const glm::vec2& offset_m = glm::vec2(0.0F),
                                float yaw_rad = 0.0F);

struct WallPlace {
  std::vector<Side> sides{kSouth, kEast, kNorth, kWest};  ///< Tried in this order.
  float front_m = 0.0F;  ///< Depth kept free of earlier furniture in front.
  bool corner = false;   ///< Prefer the ends of the wall.
  bool shuffle = true;   ///< Try the sides in random order.
  float near_m = -1e9F;  ///< If set: prefer this coordinate along the wall.
};

class RoomPlacer {
 public:
  RoomPlacer(sim::MeshScene& scene, const Room& room, Dice& dice);

  /// @returns the wall it stands at through `side`, if wanted. @returns false if there is no
  /// place.
  bool at_wall(const Group& group, const WallPlace& place, Side* side = nullptr);
  /// Anywhere, turned by a multiple of 90 degrees, nearest to the middle first.
  bool in_middle(const Group& group);
  /// On a wall above the furniture; `piece` with its back at y = 0.
  bool on_wall(const Furniture& piece, float z_m, float clear_below_m);
  /// World position of the last group placed.
  [[nodiscard]] glm::vec2 last_m() const { return last_m_; }
  /// Of the pieces placed, those that have one.
  [[nodiscard]] const std::vector<std::string>& credits() const { return credits_; }

 private:
  bool try_place(const Group& group, const glm::vec2& offset_m, float yaw_rad, float front_m);
  void lower_clearance(const Rect& rect);
  [[nodiscard]] bool walkable(const std::vector<Rect>& rects,
                              const std::vector<Rect>& goals) const;
  [[nodiscard]] glm::vec2 cell_center_m(int x, int y) const;
  template <class Visit>
  void for_cells_near(const Rect& rect, float distance_m, const Visit& visit) const;

  sim::MeshScene& scene_;
  const Room& room_;
  Dice& dice_;
  int columns_, rows_;
  std::vector<float> clearance_m_;    ///< Of each cell to walls and furniture.
  std::vector<glm::vec2> entries_m_;  ///< Where one stands after coming in, per doorway.
  std::vector<Rect> blocked_, goals_, reserved_;
  std::vector<std::pair<Rect, float>> heights_;  ///< Of what stands, for pictures.
  std::vector<std::string> credits_;
  glm::vec2 last_m_{0.0F};
};

}  // namespace segsim::worlds::internal
