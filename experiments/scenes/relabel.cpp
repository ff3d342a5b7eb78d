#include "experiments/scenes/relabel.h"

#include <algorithm>
#include <cstdio>
#include <map>
#include <utility>

#include "core/bundle_parts.h"
#include "core/camera_path.h"
#include "core/error.h"
#include "core/version.h"
#include "experiments/scenes/bundle_folder.h"
#include "experiments/scenes/scene_surfels.h"
#include "renderer/files/panoptic_field_file.h"
#include "renderer/files/ply_io.h"

namespace segsim::experiments::scenes {
namespace {

namespace fs = std::filesystem;

/// The views of the recording where the bundle has its cameras: those that it was made from at
/// the poses that training left them, the others moved with the world.
reconstruction::TrainingSet views_in_world(const core::SceneBundle& bundle,
                                           const core::BundleParts& parts,
                                           const reconstruction::RgbdSequence& recording,
                                           const training::TrainingOptions& options) {
  if (parts.cameras.name.empty()) {
    throw core::InputError::expected(bundle.folder.string(), "a bundle that has its cameras",
                                     "none: an older program made it");
  }
  const core::CameraPath cameras = core::read_camera_path(bundle.folder / parts.cameras.name);
  std::map<std::string, core::CameraPose> pose_of;
  for (const core::CameraPath::View& view : cameras.views) {
    pose_of.emplace(view.frame, view.T_world_camera);
  }
  reconstruction::TrainingSet set = training::load_set(recording, options);
  for (reconstruction::TrainingView& view : set.training) {
    const auto found = pose_of.find(view.name);
    if (found == pose_of.end()) {
      throw core::InputError::expected(bundle.folder.string(),
                                       "the recording that the bundle was made from",
                                       "one with another view, " + view.name);
    }
    view.T_world_camera = found->second;
  }
  const core::Transform<core::frame::World, core::frame::World> T_world_source(
      parts.levelling.R_world_source, parts.levelling.p_world_source_m);
  for (reconstruction::TrainingView& view : set.held_out) {
    view.T_world_camera = T_world_source * view.T_world_camera;
  }
  return set;
}

/// Those of the labels become the newly learnt ones'; how the shape was trained stays told.
void take_label_statistics(const std::vector<std::pair<std::string, double>>& learnt,
                           std::vector<std::pair<std::string, double>>& statistics) {
  for (const auto& figure : learnt) {
    if (figure.first.starts_with("geometry_")) continue;
    std::erase_if(statistics, [&](const auto& old) { return old.first == figure.first; });
    statistics.push_back(figure);
  }
}

}  // namespace

core::SceneBundle relabel_bundle(const core::SceneBundle& bundle,
                                 const reconstruction::RgbdSequence& recording,
                                 const RelabelOptions& options, const fs::path& folder) {
  core::BundleParts parts = core::load_bundle_parts(bundle.folder);
  training::TrainingOptions training = options.training;
  training.config.geometry.iterations = 0;
  const reconstruction::TrainingSet set = views_in_world(bundle, parts, recording, training);
  renderer::SurfelCloud surfels = renderer::read_surfels_ply(bundle.surfels_file());
  int& sh_degree = training.config.geometry.sh_degree;
  sh_degree = std::max(sh_degree, surfels.sh_degree);
  training::TrainedScene learnt = training::train_scene(set, surfels, training);
  std::printf("%s\n", learnt.quality.text().c_str());
  // Of the surfels only the labels: nothing of the shape may change, not even a last bit.
  surfels.semantic_id = std::move(learnt.surfels.semantic_id);
  surfels.instance_id = std::move(learnt.surfels.instance_id);
  surfels.semantic_feature = std::move(learnt.surfels.semantic_feature);
  surfels.instance_feature = std::move(learnt.surfels.instance_feature);

  core::SceneManifest manifest = bundle.manifest;
  manifest.created_by = std::string("segsim ") + core::version();
  manifest.source += "; labels learnt from masks: " + options.masks;
  manifest.classes = std::move(learnt.classes);
  manifest.instances = std::move(learnt.instances);
  take_label_statistics(learnt.statistics, manifest.statistics);
  write_bundle_folder(folder, [&](const fs::path& temporary) {
    fs::copy(bundle.folder, temporary, fs::copy_options::recursive);
    for (const std::string& old : {parts.labels.name, parts.label_edits.name,
                                   std::string(renderer::kPanopticFileName)}) {
      if (!old.empty()) fs::remove(temporary / old);
    }
    parts.label_edits = {};
    renderer::write_surfels_ply(temporary / manifest.surfels.name, surfels);
    parts.labels = {};
    parts.labels.name = write_label_files(temporary, learnt.model, learnt.field);
    core::write_bundle_manifest(temporary, manifest, parts);
  });
  training::remove_training_state(training.work);
  return core::load_bundle(folder);
}

}  // namespace segsim::experiments::scenes
