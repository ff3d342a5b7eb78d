#include "experiments/scenes/scene_surfels.h"

#include "core/bundle_parts.h"
#include "renderer/files/panoptic_field_file.h"
#include "renderer/files/ply_io.h"

namespace segsim::experiments::scenes {

std::shared_ptr<const renderer::PanopticField> load_scene_labels(
    const core::SceneBundle& bundle, const renderer::SurfelCloud& surfels) {
  const core::BundleParts parts = core::load_bundle_parts(bundle.folder);
  if (parts.labels.name.empty()) return nullptr;
  return std::make_shared<const renderer::PanopticField>(
      renderer::read_panoptic_field(bundle.folder / parts.labels.name, surfels.size()));
}

SceneSurfels load_scene_surfels(const core::SceneBundle& bundle) {
  SceneSurfels scene;
  scene.surfels = std::make_shared<const renderer::SurfelCloud>(
      renderer::read_surfels_ply(bundle.surfels_file()));
  scene.labels = load_scene_labels(bundle, *scene.surfels);
  return scene;
}

}  // namespace segsim::experiments::scenes
