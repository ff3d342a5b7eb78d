#include "worlds/procedural/procedural_flat.h"

#include <optional>

#include "core/check.h"
#include "worlds/procedural/internal/floor_plan.h"

namespace segsim::worlds {
namespace {

using internal::Dice;
using internal::Room;
using internal::RoomType;

constexpr int kMaxPlans = 40;
/// Rooms are furnished one by one; so many tries each before the plan is given up.
constexpr std::uint64_t kTriesPerRoom = 6;

const char* room_name(RoomType type) {
  switch (type) {
    case RoomType::kLiving:
      return "living room";
    case RoomType::kKitchen:
      return "kitchen";
    case RoomType::kBathroom:
      return "bathroom";
    case RoomType::kBedroom:
    case RoomType::kSecondBedroom:
      return "bedroom";
    case RoomType::kStudy:
      return "study";
    case RoomType::kHall:
      break;
  }
  return "hall";
}

/// Furnishes a room; a try that fails leaves nothing behind.
bool furnish(sim::MeshScene& scene, const Room& room, SurfaceLibrary& surfaces,
             std::uint64_t seed, FurnitureStyle style) {
  const std::size_t meshes = scene.meshes.size(), instances = scene.instances.size();
  const SurfaceLibrary::Mark mark = surfaces.mark();
  for (std::uint64_t attempt = 0; attempt < kTriesPerRoom; ++attempt) {
    if (internal::furnish_room(scene, room, surfaces, seed + attempt, style)) return true;
    scene.meshes.resize(meshes);
    scene.instances.resize(instances);
    surfaces.rewind(mark);
  }
  return false;
}

std::optional<Flat> try_flat(const FlatOptions& options, std::uint64_t seed) {
  Dice dice(seed, "flat");
  Flat flat;
  flat.scene.name = "flat-" + std::to_string(options.seed);
  flat.scene.source = "procedural flat, seed " + std::to_string(options.seed);
  flat.scene.classes = procedural_classes();
  SurfaceLibrary surfaces(flat.scene);
  const int rooms = options.rooms == 0 ? dice.count(4, 6) : options.rooms;
  const std::vector<Room> plan = internal::make_floor_plan(rooms, dice);
  internal::build_shell(flat.scene, plan, surfaces, dice, options.style, options.ceiling);
  for (const Room& room : plan) {
    flat.rooms.push_back({room_name(room.type), room.rect.min_m, room.rect.max_m});
    if (!furnish(flat.scene, room, surfaces, dice.seed(), options.style)) return std::nullopt;
  }
  surfaces.finish(options.painted);
  return flat;
}

}  // namespace

Flat make_flat_with_rooms(const FlatOptions& options) {
  SEGSIM_CHECK(options.rooms == 0 || (options.rooms >= 4 && options.rooms <= 6),
               std::to_string(options.rooms));
  core::RandomStream plans(options.seed, "floor plans");
  for (int attempt = 1; attempt <= kMaxPlans; ++attempt) {
    if (std::optional<Flat> flat = try_flat(options, plans.next_u32())) {
      flat->attempts = attempt;
      return std::move(*flat);
    }
  }
  SEGSIM_CHECK(false, "no furnished flat for seed " + std::to_string(options.seed));
  return {};
}

sim::MeshScene make_flat(const FlatOptions& options) {
  return make_flat_with_rooms(options).scene;
}

}  // namespace segsim::worlds
