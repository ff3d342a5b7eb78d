#include "experiments/runs/internal/label_sets.h"

#include <algorithm>
#include <sstream>
#include <utility>

#include "core/file_io.h"
#include "core/random.h"
#include "core/scene_bundle.h"
#include "experiments/detection/view_labels.h"
#include "sim/ground/robot.h"

namespace segsim::experiments::runs::internal {
namespace {

namespace fs = std::filesystem;

constexpr int kValidationShare =
    5;  ///< One view in five as many again for each of the other sets.
constexpr double kStartRegion_m = 0.5;  ///< At least, that the table counts leaks in.

bool takes_part(const specs::FinetuneSpec& finetune, const specs::SceneSpec& scene) {
  return finetune.scenes.empty() || std::find(finetune.scenes.begin(), finetune.scenes.end(),
                                              scene.family) != finetune.scenes.end();
}

ViewRule view_rule(const specs::FinetuneSpec& finetune, const std::string& purpose) {
  if (purpose == "train") return {purpose, finetune.views_per_scene, finetune.facing_share};
  const int views = finetune.validation_views_per_scene > 0
                        ? finetune.validation_views_per_scene
                        : std::max(10, finetune.views_per_scene / kValidationShare);
  return {purpose, views, finetune.validation_facing_share};
}

}  // namespace

core::CameraIntrinsics view_camera(const specs::ExperimentSpec& spec) {
  const specs::FinetuneSpec& finetune = *spec.detectors.finetune;
  if (finetune.width_px == 0) return spec.camera.intrinsics();
  return spec.camera.intrinsics().resized(finetune.width_px, finetune.height_px);
}

std::vector<const SceneTask*> label_scenes_of(const specs::ExperimentSpec& spec,
                                              int reconstruction,
                                              const std::deque<SceneTask>& scenes) {
  std::vector<const SceneTask*> chosen;
  for (const SceneTask& scene : scenes) {
    if (scene.spec->reconstruction != reconstruction) continue;
    if (takes_part(*spec.detectors.finetune, *scene.spec)) chosen.push_back(&scene);
  }
  return chosen;
}

void ViewProgress::drawn() {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (!line_) line_.emplace("label views", total_);
  line_->update(++done_);
}

void ViewProgress::were_there(int views) {
  const std::lock_guard<std::mutex> lock(mutex_);
  done_ += views;
}

LabelSet::LabelSet(const specs::ExperimentSpec& spec, std::vector<const SceneTask*> scenes,
                   const std::string& purpose, std::uint64_t seed, fs::path folder,
                   LabelsOf labels)
    : spec_(spec),
      scenes_(std::move(scenes)),
      rule_(view_rule(*spec.detectors.finetune, purpose)),
      seed_(seed),
      folder_(std::move(folder)),
      labels_(purpose == "test" ? LabelsOf::kTruth : labels),
      drawn_(scenes_.size()) {}

const LearntLabels* LabelSet::learnt_of(const SceneTask& scene) const {
  return labels_ == LabelsOf::kMasks && scene.learnt ? &*scene.learnt : nullptr;
}

fs::path LabelSet::json() const { return folder_ / (rule_.purpose + ".json"); }

void LabelSet::add_to(support::TaskGraph& graph, const LabelWork& work) {
  std::vector<support::TaskGraph::Id> needs{work.classes_known};
  if (fs::exists(json())) {  // Whether it is this set, all scenes tell.
    for (const SceneTask* scene : scenes_) needs.push_back(scene->task);
    needs = {graph.add([this, &work] { is_current_ = record(work).is_current(); }, needs)};
  }
  std::vector<support::TaskGraph::Id> parts;
  for (std::size_t k = 0; k < scenes_.size(); ++k) {
    work.progress.expect(rule_.per_scene);
    std::vector<support::TaskGraph::Id> of_part = needs;
    of_part.push_back(scenes_[k]->task);
    parts.push_back(graph.add([this, k, &work] { draw(k, work); }, of_part));
  }
  graph.add([this, &work] { write(work); }, parts);
}

void LabelSet::draw(std::size_t k, const LabelWork& work) {
  support::StageTimes::Timer timer(work.times, "label views");
  if (is_current_) {
    work.progress.were_there(rule_.per_scene);
    return;
  }
  timer.working();
  const specs::SceneSpec& scene = *scenes_[k]->spec;
  detection::ViewLabelOptions options;
  options.seed = core::hash64(scene.name + "/" + rule_.purpose, seed_);
  options.views = rule_.per_scene;
  options.share_facing_object = rule_.facing_share;
  options.camera = view_camera(spec_);
  options.camera_height_m = scene.camera_height_m;
  options.camera_pitch_down_rad = spec_.camera.pitch_down_rad();
  options.class_names = work.class_names;
  options.prefix = rule_.purpose + "-" + scene.name + "-";
  options.show_progress = false;
  options.on_view = [&] { work.progress.drawn(); };
  if (spec_.detectors.finetune->start_clearance_m > 0.0) {
    options.avoid_m = trials::starts_of(*scenes_[k]->loaded);
    options.avoid_radius_m = spec_.detectors.finetune->start_clearance_m;
  }
  const trials::LoadedScene& loaded = *scenes_[k]->loaded;
  const LearntLabels* learnt = learnt_of(*scenes_[k]);
  const detection::LabelledScene labelled =
      learnt != nullptr
          ? detection::LabelledScene{learnt->bundle, loaded.world, learnt->surfels}
          : detection::LabelledScene{
                loaded.bundle, loaded.world, {loaded.surfels, loaded.labels}};
  drawn_[k] = detection::label_views(labelled, options, folder_).dataset;
}

void LabelSet::write(const LabelWork& work) const {
  if (is_current_) return;
  perception::CocoDataset all;
  for (const perception::CocoDataset& of_scene : drawn_) {
    detection::append_dataset(all, of_scene);
  }
  perception::write_coco(json(), all);
  record(work).mark_done();
}

support::StepRecord LabelSet::record(const LabelWork& work) const {
  const core::CameraIntrinsics camera = view_camera(spec_);
  const specs::FinetuneSpec& finetune = *spec_.detectors.finetune;
  std::ostringstream text;
  text << "views v3, " << rule_.purpose << ", " << rule_.per_scene << " per scene, "
       << rule_.facing_share << " facing, seed " << seed_ << ", robot " << spec_.robot.name
       << ", " << camera.width_px << "x" << camera.height_px << " f " << camera.fx_px
       << ", pitch " << spec_.camera.pitch_down_deg;
  for (const std::string& name : work.new_classes) text << ", new " << name;
  for (const SceneTask* scene : scenes_) {
    text << "; " << scene->spec->name << " at " << scene->spec->camera_height_m << " m "
         << core::sha256_of_file(scene->spec->bundle / "scene.yaml");
    if (const LearntLabels* learnt = learnt_of(*scene)) {
      text << ", learnt " << core::sha256_of_file(learnt->bundle.folder / "scene.yaml");
    }
    if (finetune.start_clearance_m <= 0.0) continue;
    text << ", " << finetune.start_clearance_m << " m from";
    for (const glm::dvec2& start_m : trials::starts_of(*scene->loaded)) {
      text << " (" << start_m.x << " " << start_m.y << ")";
    }
  }
  return {folder_ / (rule_.purpose + ".step"), text.str()};
}

records::StartLeak start_leak(const perception::CocoDataset& train,
                              const std::vector<const SceneTask*>& scenes,
                              double clearance_m) {
  records::StartLeak leak{static_cast<int>(train.images.size()), 0,
                          std::max(kStartRegion_m, clearance_m)};
  for (const SceneTask* scene : scenes) {
    leak.near_starts +=
        perception::views_near(train, scene->loaded->bundle.manifest.name,
                               trials::starts_of(*scene->loaded), leak.radius_m);
  }
  return leak;
}

}  // namespace segsim::experiments::runs::internal
