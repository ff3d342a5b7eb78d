#pragma once

/// @file
/// Floor plans of homes, offices and wards.

#include <vector>

#include "worlds/procedural/internal/floor_plan.h"
#include "worlds/procedural/procedural_home.h"

namespace segsim::worlds::internal {

/// Centred on the origin. Every room has a doorway into a hall or into the living room, and
/// the whole has one entrance.
/// @param rooms  Halls not counted, in home_room_range(plan). @param plan  Not kAny.
[[nodiscard]] std::vector<Room> make_home_plan(HomePlan plan, int rooms, Dice& dice);

}  // namespace segsim::worlds::internal
