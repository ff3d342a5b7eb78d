#pragma once

#include "core/error.h"

namespace segsim::sim {

/// A place is sound, and a robot finds no room in it: what Navmesh and World throw then.
class NoRoom : public core::InputError {
 public:
  explicit NoRoom(const core::InputError& error) : core::InputError(error) {}
};

}  // namespace segsim::sim
