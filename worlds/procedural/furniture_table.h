#pragma once

/// @file
/// What the models of Debian's sweethome3d-furniture are, by id: every row was looked at in
/// the pictures of examples/furniture_sheet.cpp. Models that are not listed are not used,
/// because they belong outdoors, are too small to matter, or look wrong (furniture_table.cpp
/// says which).

#include <span>

#include "worlds/procedural/home_kinds.h"
#include "worlds/procedural/procedural_furniture.h"

namespace segsim::worlds {

struct FurnitureTableRow {
  const char* model_id;
  FurnitureKind kind;
  FurniturePool pool;  ///< kTrain or kUnseen.
};

/// By kind; ids are unique.
[[nodiscard]] std::span<const FurnitureTableRow> furniture_table();

}  // namespace segsim::worlds
