#pragma once

/// @file
/// What stands in which room: of flats in flat_furnishing.cpp, of homes in
/// home_furnishing.cpp.

#include <initializer_list>
#include <string>
#include <vector>

#include "worlds/procedural/furniture_stock.h"
#include "worlds/procedural/internal/room_placer.h"

namespace segsim::worlds::internal {

class Furnisher {
 public:
  /// All but `seed` and `style` outlive the furnisher.
  Furnisher(sim::MeshScene& scene, const Room& room, SurfaceLibrary& surfaces,
            FurnitureStock& stock, std::uint64_t seed, FurnitureStyle style)
      : room_(room),
        surfaces_(surfaces),
        stock_(stock),
        dice_(seed, "furnishing"),
        style_(style),
        placer_(scene, room, dice_) {}

  /// @returns false if something that the room must have found no place.
  [[nodiscard]] bool furnish();
  /// Of the pieces that found a place.
  [[nodiscard]] const std::vector<std::string>& credits() const { return placer_.credits(); }

 private:
  Furniture make(FurnitureKind kind, float width_m = 0.0F);
  Furniture make(FurnitureKind kind, std::uint64_t seed, float width_m);
  Group single(FurnitureKind kind, float width_m = 0.0F);
  /// One to `most` small things on the piece `on`, which lies at the group's (x, y).
  void add_clutter(Group& group, const Furniture& on, const glm::vec2& at, int most,
                   std::initializer_list<FurnitureKind> kinds);
  void pictures(int most);
  /// Optional pieces: it does not matter whether they find a place.
  void maybe(float probability, FurnitureKind kind, const WallPlace& place = {});
  WallPlace in_corner();

  bool living();
  bool place_couch(Side& side);
  bool kitchen();
  /// A table with chairs pushed in; smaller if the first does not fit.
  bool dining_group();
  bool bathroom();
  bool bedroom(bool second);
  bool study();
  bool hall();

  bool studio();
  bool living_kitchen();
  bool cooking_kitchen();
  bool dining_room();
  bool office();
  bool meeting_room();
  bool ward();
  /// Counter with sink and things on it, stove and refrigerator in one row.
  bool place_kitchen_row();
  /// A desk with a chair before it and what one works with on it.
  bool place_desk();
  bool place_hospital_bed();

  const Room& room_;
  SurfaceLibrary& surfaces_;
  FurnitureStock& stock_;
  Dice dice_;
  FurnitureStyle style_;
  RoomPlacer placer_;
};

/// Furnishes one room, with several seeds that follow from `seed`; a try that fails leaves
/// nothing behind. @returns false if something that the room must have found no place.
[[nodiscard]] bool furnish(sim::MeshScene& scene, const Room& room, SurfaceLibrary& surfaces,
                           FurnitureStock& stock, std::uint64_t seed, FurnitureStyle style);

}  // namespace segsim::worlds::internal
