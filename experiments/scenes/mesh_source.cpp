#include "experiments/scenes/mesh_source.h"

#include <cstdio>
#include <functional>
#include <optional>
#include <string>

#include "core/check.h"
#include "experiments/specs/home_spec.h"
#include "perception/data/class_map.h"
#include "worlds/mesh/gazebo/gazebo_import.h"
#include "worlds/mesh/mesh_import.h"
#include "worlds/procedural/procedural_flat.h"

namespace segsim::experiments::scenes {
namespace {

/// What a class map says about the words of a model's name; empty without a map.
std::function<std::optional<std::string>(const std::string&)> corrections(
    const std::filesystem::path& class_map) {
  if (class_map.empty()) return {};
  return [map = perception::read_class_map(class_map)](const std::string& words) {
    std::optional<std::string> found = map.find(words);
    if (found && found->empty()) found = "unknown";  // Left out on purpose.
    return found;
  };
}

}  // namespace

sim::MeshScene load_mesh_source(const specs::SourceSpec& source,
                                const worlds::TextureReader& textures) {
  switch (source.type) {
    case specs::SourceType::kFlat: {
      worlds::FlatOptions options;
      options.seed = source.seed;
      options.painted = !textures.is_blank();
      return worlds::make_flat(options);
    }
    case specs::SourceType::kHome:
      return load_home(source, textures).scene;
    case specs::SourceType::kGazebo: {
      worlds::GazeboImportOptions options = source.gazebo.options;
      options.corrected_class = corrections(source.gazebo.class_map);
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

worlds::Home load_home(const specs::SourceSpec& source,
                       const worlds::TextureReader& textures) {
  worlds::HomeOptions options;
  options.seed = source.seed;
  options.plan = source.home.plan;
  options.rooms = source.home.rooms;
  options.pool = source.home.pool;
  if (const auto folder = specs::furniture_folder(source.home)) {
    options.models = worlds::read_furniture_folder(*folder);
  } else if (!source.home.own_furniture) {
    std::fprintf(stderr,
                 "note: %s is not there (Debian's package sweethome3d-furniture): the home is "
                 "furnished with shapes of our own\n",
                 worlds::kFurnitureFolder);
  }
  return worlds::make_home(options, textures);
}

}  // namespace segsim::experiments::scenes
