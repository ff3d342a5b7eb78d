#include "experiments/scenes/mesh_source.h"

#include "core/check.h"
#include "worlds/mesh/gazebo_import.h"
#include "worlds/mesh/mesh_import.h"
#include "worlds/procedural/procedural_flat.h"

namespace segsim::experiments::scenes {

sim::MeshScene load_mesh_source(const specs::SourceSpec& source,
                                const worlds::TextureReader& textures) {
  switch (source.type) {
    case specs::SourceType::kFlat: {
      worlds::FlatOptions options;
      options.seed = source.seed;
      options.painted = !textures.is_blank();
      return worlds::make_flat(options);
    }
    case specs::SourceType::kGazebo: {
      worlds::GazeboImportOptions options;
      options.add_ceiling = true;
      return worlds::load_gazebo_world(source.world, options, textures);
    }
    case specs::SourceType::kMesh:
      return worlds::load_mesh_file(source.world, {}, textures);
    case specs::SourceType::kRgbd:
      break;
  }
  SEGSIM_CHECK(false, "a recording has no mesh");
  return {};
}

}  // namespace segsim::experiments::scenes
