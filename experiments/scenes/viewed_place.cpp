#include "experiments/scenes/viewed_place.h"

#include <memory>

#include "core/bundle_parts.h"
#include "core/error.h"
#include "experiments/training/training_folder.h"
#include "renderer/files/ply_io.h"

namespace segsim::experiments::scenes {
namespace {

namespace fs = std::filesystem;

std::shared_ptr<const renderer::SurfelCloud> read_surfels(const fs::path& file) {
  return std::make_shared<const renderer::SurfelCloud>(renderer::read_surfels_ply(file));
}

}  // namespace

ViewedPlace open_viewed_place(const fs::path& place) {
  ViewedPlace viewed;
  if (place.extension() == ".ply") {
    viewed.scene.surfels = read_surfels(place);
  } else if (training::is_training_folder(place)) {
    viewed.scene.surfels = read_surfels(place / training::kSurfelsSoFar);
    viewed.cameras = training::cameras_so_far(place);
  } else {
    viewed.bundle = core::load_bundle(place);
    viewed.scene = load_scene_surfels(*viewed.bundle);
    const core::BundleFile cameras = core::load_bundle_parts(place).cameras;
    if (!cameras.name.empty()) viewed.cameras = core::read_camera_path(place / cameras.name);
  }
  return viewed;
}

const core::CameraPath::View& recorded_view(const ViewedPlace& viewed, const fs::path& place,
                                            std::size_t view) {
  const std::size_t count = viewed.cameras ? viewed.cameras->views.size() : 0;
  if (view >= count) {
    throw core::InputError::expected(
        "--view",
        count == 0 ? "a place with the recording's cameras"
                   : "0 to " + std::to_string(count - 1) + ", a camera of " + place.string(),
        count == 0 ? place.string() : std::to_string(view));
  }
  return viewed.cameras->views[view];
}

}  // namespace segsim::experiments::scenes
