#pragma once

/// @file
/// The SDF of a world with everything that it includes.

#include <filesystem>
#include <string>
#include <vector>

#include <sdf/sdf.hh>

#include "worlds/mesh/gazebo/internal/missing_files.h"
#include "worlds/mesh/gazebo/internal/resource_finder.h"

namespace segsim::worlds::internal {

/// Reads an SDF file with a world. Then, as Gazebo does,
///
///   - siblings of one name are numbered: chair, chair_0, chair_1, ...
///   - models are where the world's <state> has put them.
///
/// Models that cannot be found are left out and added to `missing`.
/// @throws core::InputError  the file is no SDF with a world, or a model is unreadable.
void read_world(const std::filesystem::path& world_file, const ResourceFinder& finder,
                sdf::Root& root, MissingFiles& missing, std::vector<std::string>& warnings);

/// Reads a model of its own, by its URI. @throws core::InputError as above, or if it is
/// missing.
void read_model(const std::string& uri, const ResourceFinder& finder, sdf::Root& root,
                MissingFiles& missing, std::vector<std::string>& warnings);

}  // namespace segsim::worlds::internal
