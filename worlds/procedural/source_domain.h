#pragma once

/// @file
/// Plain single rooms for pre-training a detector: few objects of the detector's classes,
/// plain walls, colours typical of each class. They differ from the flats on purpose: a
/// detector trained here is weak there until it is fine-tuned.

#include <cstdint>
#include <vector>

#include "core/frames.h"
#include "sim/ground/mesh_scene.h"

namespace segsim::worlds {

/// What made such a place, in the records of data sets. The version is raised when a seed no
/// longer makes the same place.
inline constexpr const char* kRoomGenerator = "source_rooms/1";

struct SourceRoomOptions {
  int min_objects = 2, max_objects = 6;  ///< Fewer if they do not fit.
};

/// World frame: z up, floor at z = 0, room centred on the origin. Classes as
/// procedural_classes().
[[nodiscard]] sim::MeshScene make_source_room(std::uint64_t seed,
                                              const SourceRoomOptions& options = {});

/// `count` cameras of make_source_room(seed, options), 1.1 to 1.4 m high, each looking at an
/// object from 1.2 to 3.5 m with some pitch and offset; never inside an object.
[[nodiscard]] std::vector<core::CameraPose> source_viewpoints(
    std::uint64_t seed, int count, const SourceRoomOptions& options = {});

}  // namespace segsim::worlds
