#pragma once

/// @file
/// Furniture from a seed, in two styles, and the one table of classes of all procedural
/// scenes.
///
/// Object coordinates: metres, z up, floor at z = 0, origin in the middle of the footprint,
/// the back (the side for the wall) at +y and the front towards -y.

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include <glm/vec3.hpp>

#include "core/scene_bundle.h"
#include "worlds/mesh/mesh_builder.h"
#include "worlds/procedural/surface_library.h"

namespace segsim::worlds {

enum class FurnitureStyle : std::uint8_t {
  kTarget,  ///< Rich shapes, patterns and colours: what the robot meets.
  kSource,  ///< Plain boxes and cylinders in colours typical of the class: what a detector is
            ///< pre-trained on.
};

/// Class ids of all procedural scenes; never renumbered.
enum class ProceduralClass : std::uint16_t {
  kVoid = 0,
  kWall,
  kFloor,
  kCeiling,
  kWindow,
  kDoor,
  kChair,
  kCouch,
  kBed,
  kDiningTable,
  kPottedPlant,
  kTv,
  kToilet,
  kRefrigerator,
  kFoosballTable,
  kWardrobe,
  kTrashBin,
  kNightstand,
  kDesk,
  kCoffeeTable,
  kBookshelf,
  kTvStand,
  kKitchenCabinet,
  kSink,
  kBathtub,
  kLamp,
  kRug,
  kPicture,
  kObject,
};

/// The table above with names; all ids in ascending order.
[[nodiscard]] const std::vector<core::SceneClass>& procedural_classes();
/// Lower case name. @pre Not kVoid.
[[nodiscard]] const std::string& class_name(ProceduralClass class_id);
/// What the detector knows (12 classes, in the order of its outputs).
[[nodiscard]] const std::vector<std::string>& goal_class_names();
/// Those of them that every flat contains (8 classes).
[[nodiscard]] const std::vector<std::string>& flat_goal_class_names();

enum class FurnitureKind : std::uint8_t {
  kDiningChair,
  kOfficeChair,
  kArmchair,
  kStool,
  kCouch,
  kCornerCouch,
  kBed,
  kSingleBed,
  kDiningTable,
  kRoundTable,
  kCoffeeTable,
  kDesk,
  kNightstand,
  kPlant,
  kSmallPlant,
  kTv,
  kTvStand,
  kToilet,
  kRefrigerator,
  kFoosballTable,
  kDoorLeaf,
  kWardrobe,
  kTrashBin,
  kBookshelf,
  kKitchenCounter,
  kKitchenSink,
  kWashbasin,
  kBathtub,
  kFloorLamp,
  kTableLamp,
  kCeilingLamp,
  kRug,
  kPicture,
  kMirror,
  kBooks,
  kVase,
  kBowl,
  kCup,
  kLaptop,
  kBoxes,
  // Only in homes with rooms that flats have not.
  kHospitalBed,
  kStove,
  kWashingMachine,
  kAppliance,  ///< A small machine on a kitchen counter.
};

struct Furniture {
  MeshBuilder mesh;
  ProceduralClass class_id = ProceduralClass::kVoid;
  float surface_height_m = 0.0F;  ///< Where things can be put on it; 0 = nowhere.
  std::string credit;             ///< Whom to name for it, in one line; empty: nobody.

  /// Footprint and height; the mesh's box.
  [[nodiscard]] glm::vec3 size_m() const { return mesh.max_m() - mesh.min_m(); }
};

[[nodiscard]] ProceduralClass class_of(FurnitureKind kind);

/// Fits a piece to its place. 0 = chosen by the seed.
struct FurnitureSize {
  float width_m = 0.0F;
};

/// Equal arguments give equal shapes. Call surfaces.finish() after the last piece. In kSource
/// style, kinds that have no class of the detector (goal_class_names()) look as in kTarget.
[[nodiscard]] Furniture make_furniture(FurnitureKind kind, FurnitureStyle style,
                                       std::uint64_t seed, SurfaceLibrary& surfaces,
                                       const FurnitureSize& size = {});

/// Adds `furniture` to the scene as a new instance, origin at `position_m`, and its row to the
/// instance table. @returns the instance id.
std::uint16_t add_instance(sim::MeshScene& scene, const Furniture& furniture,
                           const glm::vec3& position_m, float yaw_rad);

}  // namespace segsim::worlds
