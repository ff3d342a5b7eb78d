#include "worlds/procedural/procedural_furniture.h"

#include <algorithm>
#include <cmath>

#include "core/check.h"
#include "worlds/procedural/internal/furniture_makers.h"

namespace segsim::worlds {
namespace {

using internal::Workshop;

void make_target_piece(Workshop& w, FurnitureKind kind) {
  using Kind = FurnitureKind;
  switch (kind) {
    case Kind::kDiningChair:
      return make_dining_chair(w);
    case Kind::kOfficeChair:
      return make_office_chair(w);
    case Kind::kArmchair:
      return make_armchair(w);
    case Kind::kStool:
      return make_stool(w);
    case Kind::kCouch:
      return make_couch(w, false);
    case Kind::kCornerCouch:
      return make_couch(w, true);
    case Kind::kBed:
      return make_bed(w, false);
    case Kind::kSingleBed:
    case Kind::kHospitalBed:
      return make_bed(w, true);
    case Kind::kDiningTable:
      return make_dining_table(w, false);
    case Kind::kRoundTable:
      return make_dining_table(w, true);
    case Kind::kCoffeeTable:
      return make_coffee_table(w);
    case Kind::kDesk:
      return make_desk(w);
    case Kind::kNightstand:
      return make_nightstand(w);
    case Kind::kPlant:
      return make_plant(w, false);
    case Kind::kSmallPlant:
      return make_plant(w, true);
    case Kind::kTv:
      return make_tv(w);
    case Kind::kTvStand:
      return make_tv_stand(w);
    case Kind::kToilet:
      return make_toilet(w);
    case Kind::kRefrigerator:
      return make_refrigerator(w);
    case Kind::kFoosballTable:
      make_source_piece(w, kind);
      return;
    case Kind::kDoorLeaf:
      return make_door_leaf(w);
    case Kind::kWardrobe:
      return make_wardrobe(w);
    case Kind::kTrashBin:
      return make_trash_bin(w);
    case Kind::kBookshelf:
      return make_bookshelf(w);
    case Kind::kKitchenCounter:
      return make_kitchen_counter(w);
    case Kind::kKitchenSink:
      return make_kitchen_sink(w);
    case Kind::kWashbasin:
      return make_washbasin(w);
    case Kind::kBathtub:
      return make_bathtub(w);
    case Kind::kFloorLamp:
    case Kind::kTableLamp:
    case Kind::kCeilingLamp:
      return make_lamp(w, kind);
    case Kind::kRug:
      return make_rug(w);
    case Kind::kPicture:
      return make_wall_panel(w, false);
    case Kind::kMirror:
      return make_wall_panel(w, true);
    case Kind::kBooks:
    case Kind::kVase:
    case Kind::kBowl:
    case Kind::kCup:
    case Kind::kLaptop:
    case Kind::kBoxes:
      return make_clutter(w, kind);
    case Kind::kStove:
      return make_stove(w);
    case Kind::kWashingMachine:
      return make_washing_machine(w);
    case Kind::kAppliance:
      return make_clutter(w, Kind::kBowl);
  }
}

}  // namespace

ProceduralClass class_of(FurnitureKind kind) {
  using Kind = FurnitureKind;
  using Class = ProceduralClass;
  switch (kind) {
    case Kind::kDiningChair:
    case Kind::kOfficeChair:
    case Kind::kArmchair:
    case Kind::kStool:
      return Class::kChair;
    case Kind::kCouch:
    case Kind::kCornerCouch:
      return Class::kCouch;
    case Kind::kBed:
    case Kind::kSingleBed:
    case Kind::kHospitalBed:
      return Class::kBed;
    case Kind::kDiningTable:
    case Kind::kRoundTable:
      return Class::kDiningTable;
    case Kind::kCoffeeTable:
      return Class::kCoffeeTable;
    case Kind::kDesk:
      return Class::kDesk;
    case Kind::kNightstand:
      return Class::kNightstand;
    case Kind::kPlant:
    case Kind::kSmallPlant:
      return Class::kPottedPlant;
    case Kind::kTv:
      return Class::kTv;
    case Kind::kTvStand:
      return Class::kTvStand;
    case Kind::kToilet:
      return Class::kToilet;
    case Kind::kRefrigerator:
      return Class::kRefrigerator;
    case Kind::kFoosballTable:
      return Class::kFoosballTable;
    case Kind::kDoorLeaf:
      return Class::kDoor;
    case Kind::kWardrobe:
      return Class::kWardrobe;
    case Kind::kTrashBin:
      return Class::kTrashBin;
    case Kind::kBookshelf:
      return Class::kBookshelf;
    case Kind::kKitchenCounter:
      return Class::kKitchenCabinet;
    case Kind::kKitchenSink:
    case Kind::kWashbasin:
      return Class::kSink;
    case Kind::kBathtub:
      return Class::kBathtub;
    case Kind::kFloorLamp:
    case Kind::kTableLamp:
    case Kind::kCeilingLamp:
      return Class::kLamp;
    case Kind::kRug:
      return Class::kRug;
    case Kind::kPicture:
      return Class::kPicture;
    default:
      return Class::kObject;
  }
}

const std::vector<core::SceneClass>& procedural_classes() {
  static const std::vector<core::SceneClass> kClasses = [] {
    struct Row {
      const char* name;
      bool thing;
    };
    const Row rows[] = {{"wall", false},        {"floor", false},
                        {"ceiling", false},     {"window", false},
                        {"door", true},         {"chair", true},
                        {"couch", true},        {"bed", true},
                        {"dining table", true}, {"potted plant", true},
                        {"tv", true},           {"toilet", true},
                        {"refrigerator", true}, {"foosball table", true},
                        {"wardrobe", true},     {"trash bin", true},
                        {"nightstand", true},   {"desk", true},
                        {"coffee table", true}, {"bookshelf", true},
                        {"tv stand", true},     {"kitchen cabinet", true},
                        {"sink", true},         {"bathtub", true},
                        {"lamp", true},         {"rug", true},
                        {"picture", true},      {"object", true}};
    std::vector<core::SceneClass> classes;
    for (const Row& row : rows) {
      classes.push_back({static_cast<std::uint16_t>(classes.size() + 1), row.name, row.thing});
    }
    return classes;
  }();
  return kClasses;
}

const std::string& class_name(ProceduralClass class_id) {
  const auto id = static_cast<std::size_t>(class_id);
  SEGSIM_CHECK(id > 0 && id <= procedural_classes().size(), std::to_string(id));
  return procedural_classes()[id - 1].name;
}

const std::vector<std::string>& goal_class_names() {
  static const std::vector<std::string> kNames{
      "chair",        "couch",          "bed",  "dining table", "potted plant", "tv", "toilet",
      "refrigerator", "foosball table", "door", "wardrobe",     "trash bin"};
  return kNames;
}

const std::vector<std::string>& flat_goal_class_names() {
  static const std::vector<std::string> kNames(goal_class_names().begin(),
                                               goal_class_names().begin() + 8);
  return kNames;
}

Furniture make_furniture(FurnitureKind kind, FurnitureStyle style, std::uint64_t seed,
                         SurfaceLibrary& surfaces, const FurnitureSize& size) {
  Workshop w{{}, internal::Dice(seed, "furniture"), surfaces, size};
  w.piece.class_id = class_of(kind);
  const bool made = style == FurnitureStyle::kSource && internal::make_source_piece(w, kind);
  if (!made) make_target_piece(w, kind);
  return std::move(w.piece);
}

std::uint16_t add_instance(sim::MeshScene& scene, const Furniture& furniture,
                           const glm::vec3& position_m, float yaw_rad) {
  const auto class_id = static_cast<std::uint16_t>(furniture.class_id);
  const auto id = static_cast<std::uint16_t>(scene.instances.size() + 1);
  int same_class = 1;
  for (const core::SceneInstance& other : scene.instances)
    same_class += other.class_id == class_id;

  core::SceneInstance instance;
  instance.id = id;
  instance.class_id = class_id;
  instance.name = class_name(furniture.class_id) + " " + std::to_string(same_class);
  instance.box_min_m = glm::dvec3(1e9);
  instance.box_max_m = glm::dvec3(-1e9);
  for (sim::SubMesh& mesh :
       furniture.mesh.build(pose_matrix(position_m, yaw_rad), class_id, id)) {
    for (const glm::vec3& p : mesh.positions_m) {
      instance.box_min_m = glm::min(instance.box_min_m, glm::dvec3(p));
      instance.box_max_m = glm::max(instance.box_max_m, glm::dvec3(p));
    }
    scene.meshes.push_back(std::move(mesh));
  }
  scene.instances.push_back(std::move(instance));
  return id;
}

}  // namespace segsim::worlds
