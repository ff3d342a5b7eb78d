#pragma once

/// @file
/// A furnished flat from a seed: the world that needs no files.
///
/// A hall with rooms on both sides; 0.12 m walls, doorways at least 1.05 m wide, ceiling
/// at 2.6 m. Every room is connected for a disc-shaped robot of radius 0.40 m and every piece
/// of a goal class (flat_goal_class_names()) on the floor can be approached within 0.8 m; both
/// are enforced on a 5 cm grid while furniture is placed. World frame: metres, z up, floor at
/// z = 0, origin in the middle of the flat.

#include <cstdint>
#include <string>
#include <vector>

#include <glm/vec2.hpp>

#include "sim/ground/mesh_scene.h"
#include "worlds/procedural/procedural_furniture.h"

namespace segsim::worlds {

/// What made such a place, in the records of data sets. The version is raised when a seed no
/// longer makes the same place.
inline constexpr const char* kFlatGenerator = "procedural_flats/1";

struct FlatOptions {
  std::uint64_t seed = 0;
  int rooms = 0;  ///< 4 to 6, the hall not counted; 0 = chosen by the seed.
  FurnitureStyle style = FurnitureStyle::kTarget;
  bool ceiling = true;  ///< Without it the flat can be drawn from above.
  bool painted = true;  ///< Without it every texture is one white pixel: shapes alone.
};

/// Inside of a room's walls.
struct FlatRoom {
  std::string name;  ///< "living room", "kitchen", "bathroom", "bedroom", "study", "hall".
  glm::vec2 min_m{0.0F}, max_m{0.0F};
};

struct Flat {
  sim::MeshScene scene;
  std::vector<FlatRoom> rooms;
  int attempts = 1;  ///< Floor plans tried until all conditions held.
};

/// Deterministic. @throws ContractViolation if options.rooms is not 0 or in [4, 6].
[[nodiscard]] Flat make_flat_with_rooms(const FlatOptions& options);
[[nodiscard]] sim::MeshScene make_flat(const FlatOptions& options);

}  // namespace segsim::worlds
