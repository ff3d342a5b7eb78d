#pragma once

/// @file
/// Can the episodes of a set be done in this world by this robot? Before a run, and before a
/// set is published.

#include <string>
#include <vector>

#include "core/scene_bundle.h"
#include "experiments/episodes/episodes.h"
#include "sim/ground/world.h"

namespace segsim::experiments::episodes {

enum class EpisodeState : std::uint8_t {
  kFine,
  kWrongLength,   ///< Can be done, but l differs from the file's by more than 1 % or 0.05 m.
  kTrivial,       ///< l = 0: it starts on a view point.
  kOffNavmesh,    ///< The start lies outside the free space.
  kBlockedStart,  ///< The robot would stand in an obstacle.
  kUnreachable,   ///< Start and view points lie on different islands, or there are none.
};
[[nodiscard]] const char* to_string(EpisodeState state);

struct EpisodeFinding {
  std::string id;
  EpisodeState state = EpisodeState::kFine;
  double file_m = 0.0, world_m = 0.0;  ///< l as written, and for this robot in this world.

  [[nodiscard]] bool infeasible() const {
    return state == EpisodeState::kOffNavmesh || state == EpisodeState::kBlockedStart ||
           state == EpisodeState::kUnreachable;
  }
};

/// Checks every episode and sets its l to the world's: infinity if it is infeasible.
/// @param place  Of the set, for messages: its file.
/// @return  One finding per episode, in order.
/// @throws core::InputError if the set belongs to another bundle, or searches for a class that
/// the bundle lacks.
std::vector<EpisodeFinding> bind_episodes(EpisodeSet& set, const std::string& place,
                                          const core::SceneBundle& bundle,
                                          const sim::World& world);

}  // namespace segsim::experiments::episodes
