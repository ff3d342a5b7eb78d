#pragma once

/// @file
/// Gazebo worlds (SDF) as a MeshScene. Only what is seen is read: visuals of all models,
/// included and nested ones too, with meshes, SDF's solids and planes, and their materials.

#include <filesystem>

#include "sim/ground/mesh_scene.h"
#include "worlds/mesh/gazebo/gazebo_options.h"
#include "worlds/mesh/texture_reader.h"

namespace segsim::worlds {

/// Loads the first world of an SDF file.
///
/// Every model is an instance with its name. A model inside another one is an instance of its
/// own if its name says what it is ("desk::chair"), and so is a link, a visual or a mesh of a
/// model whose own name says nothing or only that it is part of the building. A model that
/// only wraps an include is one instance with it.
///
/// Departures of real worlds that are accepted: `<pose frame=''>`, siblings of one name,
/// COLLADA with an up axis that Gazebo ignores, paths of another machine, missing textures and
/// material scripts (a colour is used), numbers that are none, ground planes without end (cut
/// to the world), and errors that leave the world readable, such as an invalid inertia. What
/// might be seen of it is counted in MeshScene::warnings. Actors are left out.
/// @throws core::InputError  no such file, no world in it, a file that is missing (OnMissing)
/// or unreadable, a world without triangles.
[[nodiscard]] sim::MeshScene load_gazebo_world(
    const std::filesystem::path& world_file, const GazeboImportOptions& options = {},
    const TextureReader& textures = image_textures());

}  // namespace segsim::worlds
