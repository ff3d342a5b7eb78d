#pragma once

#include "experiments/specs/spec.h"
#include "sim/ground/mesh_scene.h"
#include "worlds/mesh/texture_reader.h"
#include "worlds/procedural/procedural_home.h"

namespace segsim::experiments::scenes {

/// The mesh world of a source that is no recording.
[[nodiscard]] sim::MeshScene load_mesh_source(
    const specs::SourceSpec& source,
    const worlds::TextureReader& textures = worlds::image_textures());

/// The same of a kHome source, with its credits. Without furniture of a library it says so on
/// stderr.
[[nodiscard]] worlds::Home load_home(
    const specs::SourceSpec& source,
    const worlds::TextureReader& textures = worlds::image_textures());

}  // namespace segsim::experiments::scenes
