#include "experiments/runs/internal/label_sets.h"

#include <algorithm>
#include <mutex>
#include <sstream>
#include <utility>

#include "core/file_io.h"
#include "core/progress.h"
#include "core/random.h"
#include "core/scene_bundle.h"
#include "experiments/detection/label_report.h"
#include "experiments/detection/view_labels.h"
#include "experiments/support/side_by_side.h"
#include "perception/data/dataset.h"
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

std::vector<LabelScene> label_scenes_of(const specs::ExperimentSpec& spec, int reconstruction,
                                        std::span<const fs::path> bundles,
                                        std::span<const trials::Starts> starts) {
  std::vector<LabelScene> scenes;
  for (std::size_t i = 0; i < spec.scenes.size(); ++i) {
    if (spec.scenes[i].reconstruction != reconstruction) continue;
    if (!takes_part(*spec.detectors.finetune, spec.scenes[i])) continue;
    scenes.push_back({&spec.scenes[i], bundles[i], starts[i]});
  }
  return scenes;
}

LabelSet::LabelSet(const specs::ExperimentSpec& spec, const std::vector<LabelScene>& scenes,
                   const std::string& purpose, std::uint64_t seed, fs::path folder)
    : spec_(spec),
      scenes_(scenes),
      rule_(view_rule(*spec.detectors.finetune, purpose)),
      seed_(seed),
      folder_(std::move(folder)),
      record_(folder_ / (purpose + ".step"), recipe()) {}

fs::path LabelSet::json() const { return folder_ / (rule_.purpose + ".json"); }

bool LabelSet::is_current() const { return fs::exists(json()) && record_.is_current(); }

int LabelSet::views() const { return rule_.per_scene * static_cast<int>(scenes_.size()); }

void LabelSet::make(const std::vector<std::string>& class_names,
                    const std::function<void()>& on_view) const {
  perception::CocoDataset all;
  for (const LabelScene& scene : scenes_) {
    detection::ViewLabelOptions options;
    options.seed = core::hash64(scene.spec->name + "/" + rule_.purpose, seed_);
    options.views = rule_.per_scene;
    options.share_facing_object = rule_.facing_share;
    options.camera = view_camera(spec_);
    options.camera_height_m = scene.spec->camera_height_m;
    options.camera_pitch_down_rad = spec_.camera.pitch_down_rad();
    options.class_names = class_names;
    options.prefix = rule_.purpose + "-" + scene.spec->name + "-";
    options.show_progress = false;
    options.on_view = on_view;
    if (spec_.detectors.finetune->start_clearance_m > 0.0) {
      options.avoid_m = scene.starts_m;
      options.avoid_radius_m = spec_.detectors.finetune->start_clearance_m;
    }
    detection::append_dataset(all, detection::label_views(core::load_bundle(scene.bundle),
                                                          spec_.robot, options, folder_)
                                       .dataset);
  }
  perception::write_coco(json(), all);
  record_.mark_done();
}

std::string LabelSet::recipe() const {
  const core::CameraIntrinsics camera = view_camera(spec_);
  const specs::FinetuneSpec& finetune = *spec_.detectors.finetune;
  std::ostringstream text;
  text << "views v3, " << rule_.purpose << ", " << rule_.per_scene << " per scene, "
       << rule_.facing_share << " facing, seed " << seed_ << ", robot " << spec_.robot.name
       << ", " << camera.width_px << "x" << camera.height_px << " f " << camera.fx_px
       << ", pitch " << spec_.camera.pitch_down_deg;
  for (const LabelScene& scene : scenes_) {
    text << "; " << scene.spec->name << " at " << scene.spec->camera_height_m << " m "
         << core::sha256_of_file(scene.bundle / "scene.yaml");
    if (finetune.start_clearance_m <= 0.0) continue;
    text << ", " << finetune.start_clearance_m << " m from";
    for (const glm::dvec2& start_m : scene.starts_m) {
      text << " (" << start_m.x << " " << start_m.y << ")";
    }
  }
  return text.str();
}

void make_label_sets(const std::vector<LabelSet>& sets,
                     const std::vector<std::string>& class_names, int workers,
                     support::StageTimes& times) {
  support::StageTimes::Timer timer(times, "label views");
  std::vector<const LabelSet*> missing;
  std::int64_t views = 0;
  for (const LabelSet& set : sets) {
    if (set.is_current()) continue;
    missing.push_back(&set);
    views += set.views();
  }
  if (missing.empty()) return;
  timer.working();
  core::Progress progress("label views", views);
  std::mutex mutex;  // Guards what follows.
  std::int64_t done = 0;
  support::side_by_side(missing.size(), workers, [&](std::size_t k) {
    missing[k]->make(class_names, [&] {
      const std::lock_guard<std::mutex> lock(mutex);
      progress.update(++done);
    });
  });
}

records::StartLeak start_leak(const fs::path& train_json,
                              const std::vector<LabelScene>& scenes, double clearance_m) {
  const perception::CocoDataset train = perception::read_coco(train_json);
  records::StartLeak leak{static_cast<int>(train.images.size()), 0,
                          std::max(kStartRegion_m, clearance_m)};
  for (const LabelScene& scene : scenes) {
    const std::string name = core::load_bundle(scene.bundle).manifest.name;
    leak.near_starts += detection::views_near(train, name, scene.starts_m, leak.radius_m);
  }
  return leak;
}

}  // namespace segsim::experiments::runs::internal
