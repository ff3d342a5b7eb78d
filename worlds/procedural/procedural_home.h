#pragma once

/// @file
/// A furnished home, office or ward from a seed, with furniture of a library if there is one.
///
/// One to eight rooms and corridors, 30 to 250 m2; doorways at least 1.05 m wide, some with
/// half open leaves. As in procedural_flat.h, a disc of radius 0.40 m reaches every room and
/// every piece of a goal class on the floor. World frame: metres, z up, floor at z = 0, origin
/// in the middle.

#include <cstdint>
#include <string>
#include <vector>

#include "worlds/procedural/furniture_stock.h"
#include "worlds/procedural/home_kinds.h"
#include "worlds/procedural/procedural_flat.h"

namespace segsim::worlds {

struct HomeOptions {
  std::uint64_t seed = 0;
  HomePlan plan = HomePlan::kAny;  ///< kAny: the seed chooses, six of ten are apartments.
  int rooms = 0;                   ///< In home_room_range(plan); 0 = chosen by the seed.
  /// Of a furniture folder (read_furniture_folder()); empty: shapes of our own.
  std::vector<FurnitureModel> models{};
  FurniturePool pool = FurniturePool::kTrain;  ///< Of the models.
  bool ceiling = true;  ///< Without it the home can be drawn from above.
  bool boxes = false;   ///< Models of the library are plain boxes of their sizes.
};

struct Home {
  sim::MeshScene scene;
  std::vector<FlatRoom> rooms;  ///< Halls, too.
  std::vector<FlatRoom>
      doors;  ///< Floor between the walls of each doorway, named by its room.
  /// Models that stand in it: name, maker and licence, a line each, in order.
  std::vector<std::string> credits;
  int attempts = 1;  ///< Floor plans tried until all conditions held.
};

/// Deterministic. @param textures  Blank ones leave walls and furniture without pictures.
/// @throws InputError for a number of rooms that the plan has not, a seed for which no plan
/// can be furnished, or a model that cannot be loaded.
[[nodiscard]] Home make_home(const HomeOptions& options,
                             const TextureReader& textures = image_textures());

}  // namespace segsim::worlds
