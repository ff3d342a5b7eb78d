#include "worlds/procedural/procedural_home.h"

#include <algorithm>
#include <optional>

#include "core/error.h"
#include "worlds/procedural/internal/furnisher.h"
#include "worlds/procedural/internal/home_plan.h"

namespace segsim::worlds {
namespace {

using internal::Dice;
using internal::Opening;
using internal::Room;

constexpr int kMaxPlans = 60;
/// Large homes have many walls and floors.
constexpr int kMaxTextures = 120;

struct Wanted {
  HomePlan plan;
  int rooms;
};

Wanted wanted_of(const HomeOptions& options) {
  Dice dice(options.seed, "kind of home");
  Wanted wanted{options.plan, options.rooms};
  if (wanted.plan == HomePlan::kAny) {
    const float choice = dice.between(0.0F, 1.0F);
    wanted.plan = choice < 0.6F   ? HomePlan::kApartment
                  : choice < 0.8F ? HomePlan::kOffice
                                  : HomePlan::kWard;
    // A number of rooms that was asked for narrows the choice.
    const auto [fewest, most] = home_room_range(wanted.plan);
    if (wanted.rooms != 0 && (wanted.rooms < fewest || wanted.rooms > most)) {
      wanted.plan = HomePlan::kApartment;
    }
  }
  const auto [fewest, most] = home_room_range(wanted.plan);
  if (wanted.rooms == 0) wanted.rooms = dice.count(fewest, most);
  if (wanted.rooms < fewest || wanted.rooms > most) {
    throw core::InputError::expected(
        std::string("rooms of a home with plan ") + kHomePlanNames.name(options.plan),
        std::to_string(fewest) + " to " + std::to_string(most), std::to_string(wanted.rooms));
  }
  return wanted;
}

/// The floor of a doorway, from room to room.
FlatRoom passage(const Room& room, const Opening& door) {
  const int along = internal::axis_along(door.side), across = 1 - along;
  FlatRoom floor{internal::room_name(room.type), {}, {}};
  floor.min_m[along] = door.center_m - 0.5F * door.width_m;
  floor.max_m[along] = door.center_m + 0.5F * door.width_m;
  const float near = room.wall_m(door.side),
              far = near + internal::kWallThickness_m * internal::outward(door.side)[across];
  floor.min_m[across] = std::min(near, far);
  floor.max_m[across] = std::max(near, far);
  return floor;
}

std::optional<Home> try_home(const HomeOptions& options, const Wanted& wanted, bool painted,
                             FurnitureStock& stock, std::uint64_t seed) {
  Dice dice(seed, "home");
  Home home;
  home.scene.name = "home-" + std::to_string(options.seed);
  home.scene.source = "procedural home, seed " + std::to_string(options.seed);
  home.scene.classes = procedural_classes();
  SurfaceLibrary surfaces(home.scene, kMaxTextures);
  const FurnitureStyle style = FurnitureStyle::kTarget;
  const std::vector<Room> plan = internal::make_home_plan(wanted.plan, wanted.rooms, dice);
  internal::build_shell(home.scene, plan, surfaces, dice, style, options.ceiling);
  for (const Room& room : plan) {
    home.rooms.push_back({internal::room_name(room.type), room.rect.min_m, room.rect.max_m});
    for (const Opening& opening : room.openings) {
      if (opening.owns_passage) home.doors.push_back(passage(room, opening));
    }
    if (!internal::furnish(home.scene, room, surfaces, stock, dice.seed(), style)) {
      static_cast<void>(stock.take_credits());
      return std::nullopt;
    }
  }
  surfaces.finish(painted);
  home.credits = stock.take_credits();
  return home;
}

}  // namespace

std::pair<int, int> home_room_range(HomePlan plan) {
  switch (plan) {
    case HomePlan::kOffice:
      return {4, 8};
    case HomePlan::kWard:
      return {6, 8};
    case HomePlan::kAny:
    case HomePlan::kApartment:
      break;
  }
  return {1, 8};
}

Home make_home(const HomeOptions& options, const TextureReader& textures) {
  const Wanted wanted = wanted_of(options);
  FurnitureStock stock(options.models, options.pool, options.seed, options.boxes, textures);
  core::RandomStream plans(options.seed, "home plans");
  for (int attempt = 1; attempt <= kMaxPlans; ++attempt) {
    if (std::optional<Home> home =
            try_home(options, wanted, !textures.is_blank(), stock, plans.next_u32())) {
      home->attempts = attempt;
      return std::move(*home);
    }
  }
  throw core::InputError::expected(
      "home of seed " + std::to_string(options.seed), "room for its furniture",
      "none in " + std::to_string(kMaxPlans) + " floor plans; another seed may do");
}

}  // namespace segsim::worlds
