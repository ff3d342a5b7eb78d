#pragma once

#include "experiments/specs/spec.h"
#include "sim/ground/mesh_scene.h"
#include "worlds/mesh/texture_reader.h"

namespace segsim::experiments::scenes {

/// The mesh world of a kFlat, kGazebo or kMesh source.
[[nodiscard]] sim::MeshScene load_mesh_source(
    const specs::SourceSpec& source,
    const worlds::TextureReader& textures = worlds::image_textures());

}  // namespace segsim::experiments::scenes
