#include "worlds/procedural/procedural_flat.h"

#include <algorithm>
#include <optional>

#include "core/check.h"
#include "worlds/procedural/internal/furnisher.h"

namespace segsim::worlds {
namespace {

using internal::Dice;
using internal::Room;

constexpr int kMaxPlans = 40;

std::optional<Flat> try_flat(const FlatOptions& options, std::uint64_t seed) {
  Dice dice(seed, "flat");
  Flat flat;
  flat.scene.name = "flat-" + std::to_string(options.seed);
  flat.scene.source = "procedural flat, seed " + std::to_string(options.seed);
  flat.scene.classes = procedural_classes();
  SurfaceLibrary surfaces(flat.scene);
  FurnitureStock stock;
  const int rooms = options.rooms == 0 ? dice.count(4, 6) : options.rooms;
  const std::vector<Room> plan = internal::make_floor_plan(rooms, dice);
  // A room between living room and hall can have too little wall with either for a door.
  if (std::any_of(plan.begin(), plan.end(), [](const Room& room) {
        return std::none_of(room.openings.begin(), room.openings.end(),
                            [](const auto& opening) {
                              return opening.kind == internal::OpeningKind::kDoorway;
                            });
      })) {
    return std::nullopt;
  }
  internal::build_shell(flat.scene, plan, surfaces, dice, options.style, options.ceiling);
  for (const Room& room : plan) {
    flat.rooms.push_back({internal::room_name(room.type), room.rect.min_m, room.rect.max_m});
    if (!internal::furnish(flat.scene, room, surfaces, stock, dice.seed(), options.style)) {
      return std::nullopt;
    }
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
