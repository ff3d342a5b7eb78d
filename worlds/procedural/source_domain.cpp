#include "worlds/procedural/source_domain.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <glm/common.hpp>
#include <glm/geometric.hpp>
#include <glm/vector_relational.hpp>

#include "core/check.h"
#include "worlds/procedural/internal/furniture_makers.h"

namespace segsim::worlds {
namespace {

using internal::Dice;
using Kind = FurnitureKind;

constexpr float kPi = std::numbers::pi_v<float>;
constexpr float kHeight_m = 2.6F;
/// One kind per class, in the order of goal_class_names().
constexpr Kind kKinds[] = {Kind::kDiningChair, Kind::kCouch,        Kind::kBed,
                           Kind::kDiningTable, Kind::kPlant,        Kind::kTv,
                           Kind::kToilet,      Kind::kRefrigerator, Kind::kFoosballTable,
                           Kind::kDoorLeaf,    Kind::kWardrobe,     Kind::kTrashBin};

/// An object on the floor, as a disc.
struct Placed {
  glm::vec2 center_m{0.0F};
  float radius_m = 0.0F;
  float middle_z_m = 0.0F;
};

struct SourceRoom {
  sim::MeshScene scene;
  std::vector<Placed> objects;
  glm::vec2 half_m{0.0F};
};

void add_walls(sim::MeshScene& scene, const glm::vec2& half, SurfaceLibrary& surfaces,
               Dice& dice) {
  const glm::vec3 colour =
      internal::hsv(dice.between(0, 1), dice.between(0.0F, 0.2F), dice.between(0.65F, 0.95F));
  const glm::vec3 floor_colour = internal::hsv(
      dice.between(0.05F, 0.12F), dice.between(0.0F, 0.4F), dice.between(0.35F, 0.75F));
  MeshBuilder walls, floor, ceiling;
  walls.set_surface(surfaces.plain(colour));
  const glm::vec3 x(2.0F * half.x, 0, 0), y(0, 2.0F * half.y, 0), up(0, 0, kHeight_m);
  walls.add_quad({half.x, -half.y, 0}, -x, up);
  walls.add_quad({-half.x, half.y, 0}, x, up);
  walls.add_quad({-half.x, -half.y, 0}, y, up);
  walls.add_quad({half.x, half.y, 0}, -y, up);
  floor.set_surface(surfaces.plain(floor_colour));
  floor.add_quad({-half.x, -half.y, 0}, x, y);
  ceiling.set_surface(surfaces.plain(glm::vec3(0.92F)));
  ceiling.add_quad({-half.x, -half.y, kHeight_m}, y, x);
  const auto add = [&](const MeshBuilder& mesh, ProceduralClass class_id) {
    for (sim::SubMesh& part :
         mesh.build(glm::mat4(1.0F), static_cast<std::uint16_t>(class_id), 0))
      scene.meshes.push_back(std::move(part));
  };
  add(walls, ProceduralClass::kWall);
  add(floor, ProceduralClass::kFloor);
  add(ceiling, ProceduralClass::kCeiling);
}

void add_object(SourceRoom& room, Kind kind, SurfaceLibrary& surfaces, Dice& dice) {
  const Furniture piece = make_furniture(kind, FurnitureStyle::kSource, dice.seed(), surfaces);
  float base_z = 0.0F;
  Furniture stand;
  if (kind == Kind::kTv) {  // On a plain box.
    base_z = dice.between(0.4F, 0.7F);
    stand.class_id = ProceduralClass::kTvStand;
    stand.mesh.set_surface(surfaces.plain(
        internal::hsv(0.08F, dice.between(0.1F, 0.5F), dice.between(0.3F, 0.7F))));
    stand.mesh.add_box({0, 0, 0.5F * base_z}, {piece.size_m().x + 0.2F, 0.42F, base_z});
  }
  const float radius = 0.5F * glm::length(glm::vec2(piece.size_m()));
  for (int attempt = 0; attempt < 60; ++attempt) {
    // The turn follows the nearest wall in most cases, as in real rooms.
    const float yaw = 0.5F * kPi * static_cast<float>(dice.count(0, 3)) +
                      (dice.chance(0.4F) ? dice.between(-0.6F, 0.6F) : 0.0F);
    const glm::vec2 limit = room.half_m - radius - 0.05F;
    if (limit.x <= 0.0F || limit.y <= 0.0F) return;
    glm::vec2 at(dice.between(-limit.x, limit.x), dice.between(-limit.y, limit.y));
    if (dice.chance(0.7F)) {
      const glm::vec2 back(-std::sin(yaw), std::cos(yaw));
      at = glm::clamp(at + 4.0F * back, -limit, limit);
    }
    const bool hit =
        std::any_of(room.objects.begin(), room.objects.end(), [&](const Placed& other) {
          return glm::length(other.center_m - at) < other.radius_m + radius + 0.15F;
        });
    if (hit) continue;
    add_instance(room.scene, piece, {at.x, at.y, base_z}, yaw);
    if (base_z > 0.0F) add_instance(room.scene, stand, {at.x, at.y, 0.0F}, yaw);
    room.objects.push_back({at, radius, base_z + 0.5F * piece.size_m().z});
    return;
  }
}

SourceRoom build_room(std::uint64_t seed, const SourceRoomOptions& options) {
  SEGSIM_CHECK(options.min_objects >= 1 && options.min_objects <= options.max_objects,
               "number of objects");
  Dice dice(seed, "source room");
  SourceRoom room;
  room.scene.name = "source-" + std::to_string(seed);
  room.scene.source = "procedural source-domain room, seed " + std::to_string(seed);
  room.scene.classes = procedural_classes();
  SurfaceLibrary surfaces(room.scene);
  room.half_m = {dice.between(2.4F, 3.4F), dice.between(2.2F, 3.2F)};
  add_walls(room.scene, room.half_m, surfaces, dice);
  const int count = dice.count(options.min_objects, options.max_objects);
  // Consecutive seeds start with consecutive classes, so that all are equally frequent.
  for (int i = 0; i < count; ++i) {
    const std::size_t kind = i == 0 ? static_cast<std::size_t>(seed % 12)
                                    : static_cast<std::size_t>(dice.count(0, 11));
    add_object(room, kKinds[kind], surfaces, dice);
  }
  for (int i = 0; i < 2; ++i) {
    sim::PointLight light;
    light.position_m = {(static_cast<float>(i) - 0.5F) * room.half_m.x,
                        dice.between(-0.5F, 0.5F), kHeight_m - 0.3F};
    light.radiance = glm::vec3(dice.between(1.8F, 3.0F)) *
                     glm::vec3(1.0F, dice.between(0.94F, 1.0F), dice.between(0.85F, 1.0F));
    light.radius_m = 0.2F;
    room.scene.lights.push_back(light);
  }
  surfaces.finish();
  return room;
}

}  // namespace

sim::MeshScene make_source_room(std::uint64_t seed, const SourceRoomOptions& options) {
  return build_room(seed, options).scene;
}

std::vector<core::CameraPose> source_viewpoints(std::uint64_t seed, int count,
                                                const SourceRoomOptions& options) {
  SEGSIM_CHECK(count >= 0, std::to_string(count));
  const SourceRoom room = build_room(seed, options);
  Dice dice(seed, "source views");
  std::vector<core::CameraPose> poses;
  for (int attempt = 0; static_cast<int>(poses.size()) < count; ++attempt) {
    const glm::vec2 limit = room.half_m - 0.15F;
    const Placed target =
        room.objects.empty()
            ? Placed{{0, 0}, 0.3F, 0.5F}
            : room.objects[static_cast<std::size_t>(attempt) % room.objects.size()];
    const float angle = dice.between(0, 2.0F * kPi), distance = dice.between(1.2F, 3.5F);
    glm::vec2 eye = target.center_m + distance * glm::vec2(std::cos(angle), std::sin(angle));
    // A target in a full corner may have no such place: then any free place in the room.
    if (attempt > 200 * (count + 1))
      eye = {dice.between(-limit.x, limit.x), dice.between(-limit.y, limit.y)};
    const bool is_free =
        std::all_of(room.objects.begin(), room.objects.end(), [&](const Placed& other) {
          return glm::length(other.center_m - eye) > other.radius_m + 0.1F;
        });
    if (!is_free || glm::any(glm::greaterThan(glm::abs(eye), limit))) continue;
    const glm::dvec3 from(eye, dice.between(1.1F, 1.4F));
    const glm::dvec3 to(target.center_m.x + dice.between(-0.5F, 0.5F),
                        target.center_m.y + dice.between(-0.5F, 0.5F),
                        target.middle_z_m + dice.between(-0.1F, 0.5F));
    poses.push_back(core::look_at(from, to));
  }
  return poses;
}

}  // namespace segsim::worlds
