#include "renderer/files/scene_surfels.h"

#include <utility>

#include "core/bundle_parts.h"
#include "core/error.h"
#include "renderer/files/panoptic_field_file.h"
#include "renderer/files/ply_io.h"

namespace segsim::renderer {
namespace {

SceneSurfels load_unedited(const core::SceneBundle& bundle, const core::BundleParts& parts) {
  SceneSurfels scene;
  scene.surfels = std::make_shared<const SurfelCloud>(read_surfels_ply(bundle.surfels_file()));
  if (!parts.labels.name.empty()) {
    scene.labels = std::make_shared<const PanopticField>(
        read_panoptic_field(bundle.folder / parts.labels.name, scene.surfels->size()));
  }
  return scene;
}

}  // namespace

SceneSurfels load_unedited_surfels(const core::SceneBundle& bundle) {
  return load_unedited(bundle, core::load_bundle_parts(bundle.folder));
}

SceneSurfels load_scene_surfels(const core::SceneBundle& bundle) {
  const core::BundleParts parts = core::load_bundle_parts(bundle.folder);
  SceneSurfels unedited = load_unedited(bundle, parts);
  if (parts.label_edits.name.empty()) return unedited;
  if (!unedited.surfels->has_labels()) {
    throw core::InputError::expected(bundle.surfels_file().string(),
                                     "labelled surfels, as some were labelled by hand",
                                     "no semantic_id property");
  }
  return edited_surfels(unedited, read_label_edits(bundle.folder / parts.label_edits.name,
                                                   unedited.surfels->size()));
}

SceneSurfels edited_surfels(const SceneSurfels& unedited, const LabelEdits& edits) {
  if (edits.empty()) return unedited;
  auto surfels = std::make_shared<SurfelCloud>(*unedited.surfels);
  std::shared_ptr<PanopticField> labels;
  if (unedited.labels) labels = std::make_shared<PanopticField>(*unedited.labels);
  apply_label_edits(edits, *surfels, labels.get());
  return {std::move(surfels), std::move(labels)};
}

}  // namespace segsim::renderer
