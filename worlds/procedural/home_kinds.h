#pragma once

/// @file
/// The words in which a spec asks for a home.

#include <cstdint>
#include <utility>

#include "core/name_table.h"

namespace segsim::worlds {

enum class HomePlan : std::uint8_t { kAny, kApartment, kOffice, kWard };
inline constexpr core::NameTable<HomePlan, HomePlan::kWard> kHomePlanNames("a plan of a home",
                                                                           {"any", "apartment",
                                                                            "office", "ward"});

/// Fewest and most rooms, halls not counted.
[[nodiscard]] std::pair<int, int> home_room_range(HomePlan plan);

/// Models that a detector may be tuned on, and models for what it never saw.
enum class FurniturePool : std::uint8_t { kTrain, kUnseen, kAll };
inline constexpr core::NameTable<FurniturePool, FurniturePool::kAll> kFurniturePoolNames(
    "a pool of furniture", {"train", "unseen", "all"});

}  // namespace segsim::worlds
