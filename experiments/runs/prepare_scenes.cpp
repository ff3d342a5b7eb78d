// Scene bundles of an experiment: captured, then reconstructed.
#include <algorithm>
#include <cstdio>
#include <optional>
#include <sstream>

#include "core/bundle_parts.h"
#include "core/file_io.h"
#include "core/process/kernel_choice.h"
#include "core/progress.h"
#include "core/scene_bundle.h"
#include "experiments/runs/prepare.h"
#include "experiments/scenes/reconstruct.h"
#include "experiments/scenes/recording_rig.h"
#include "experiments/scenes/scene_source.h"
#include "experiments/support/side_by_side.h"
#include "experiments/support/step_record.h"
#include "perception/detector/detector.h"

namespace segsim::experiments::runs {
namespace {

namespace fs = std::filesystem;

training::TrainingOptions training_of(const specs::ReconstructSpec& spec,
                                      const specs::SourceSpec& source) {
  training::TrainingOptions training;
  if (!spec.config.empty())
    training.config = reconstruction::read_training_config(spec.config);
  if (spec.iterations >= 0) training.config.geometry.iterations = spec.iterations;
  if (spec.label_iterations >= 0) training.config.panoptic.iterations = spec.label_iterations;
  training.head = spec.head;
  training.seed = spec.seed;
  training.set.frame_step = source.frame_step;
  training.resume = true;  // As everything that `segsim run` prepares.
  return training;
}

/// Refuses a bundle that is missing, damaged, or for rendering and labels only: here, before
/// detectors are trained for it.
void check_bundle(const fs::path& folder) {
  core::require_drivable(core::load_bundle(folder));
}

/// How the bundle of one scene with a source is made, and whether it is there.
class SceneStep {
 public:
  SceneStep(const specs::ExperimentSpec& spec, const specs::SceneSpec& scene,
            const fs::path& work)
      : spec_(spec),
        scene_(scene),
        recording_(scene.source->type == specs::SourceType::kRgbd
                       ? scene.source->folder
                       : work / "captures" / scene.family),
        record_(scene.bundle.string() + ".step", recipe()) {}

  [[nodiscard]] bool is_current() const {
    return fs::exists(scene_.bundle / "scene.yaml") && record_.is_current();
  }
  [[nodiscard]] bool needs_capture() const {
    return scene_.source->type != specs::SourceType::kRgbd && !is_current();
  }

  /// What all reconstructions of the scene are made from.
  void capture() const {
    std::printf("capturing scene %s: %s\n", scene_.family.c_str(),
                scenes::describe_capture(*scene_.source).c_str());
    const core::ProgressPrefix prefix(scene_.family + ": ");
    scenes::capture_mesh_source(*scene_.source, recording_);
  }

  void reconstruct() const {
    std::printf("reconstructing scene %s\n", scene_.name.c_str());
    const core::ProgressPrefix prefix(scene_.name + ": ");
    const specs::SourceSpec& source = *scene_.source;
    reconstruction::SequenceOptions sequence_options;
    sequence_options.on_bad_frame = reconstruction::OnBadFrame::kSkip;
    if (source.type == specs::SourceType::kRgbd)
      sequence_options.floor_height_m = source.floor_height_m;
    sequence_options = scenes::with_rig(recording_, sequence_options, source.rig);
    const auto sequence = scenes::open_recording(recording_, source.boxes, sequence_options);

    scenes::ReconstructOptions options;
    options.name = scene_.name;
    options.source = scenes::describe_capture(source);
    options.source_sha256 = record_.recipe_sha256();
    options.collision.floor_is_known = sequence_options.floor_height_m.has_value();
    options.lift.voxel_m = source.voxel_m;
    options.lift.frame_step = source.frame_step;
    options.robot = spec_.robot;
    options.camera_height_m = scene_.camera_height_m;
    options.training = training();
    if (options.training) {  // A state of other settings is left alone.
      options.training->work =
          scene_.bundle.string() + ".training-" + record_.recipe_sha256().substr(0, 8);
    }
    scenes::reconstruct_bundle(*sequence, options, scene_.bundle);
    record_.mark_done();
  }

 private:
  [[nodiscard]] std::optional<training::TrainingOptions> training() const {
    const specs::SourceSpec& source = *scene_.source;
    if (!source.reconstruct) return std::nullopt;
    return training_of(*source.reconstruct, source);
  }

  [[nodiscard]] std::string recipe() const {
    const specs::SourceSpec& source = *scene_.source;
    std::ostringstream text;
    text << "bundle v1: " << scenes::describe_capture(source) << "; voxel " << source.voxel_m
         << " m, robot " << spec_.robot.name << ", camera " << scene_.camera_height_m << " m";
    if (const std::optional<training::TrainingOptions> trained = training()) {
      text << "; trained, mesh of rendered depth, " << trained->head << ", seed "
           << trained->seed << ", "
           << core::sha256_hex(reconstruction::training_config_text(trained->config));
    }
    return text.str();
  }

  const specs::ExperimentSpec& spec_;
  const specs::SceneSpec& scene_;
  fs::path recording_;
  support::StepRecord record_;
};

}  // namespace

fs::path prepare_scene(const specs::ExperimentSpec& spec, const specs::SceneSpec& scene,
                       const fs::path& work) {
  if (!scene.source) {
    check_bundle(scene.bundle);
    return scene.bundle;
  }
  const SceneStep step(spec, scene, work);
  if (step.needs_capture()) step.capture();
  if (!step.is_current()) step.reconstruct();
  check_bundle(scene.bundle);
  return scene.bundle;
}

std::vector<fs::path> prepare_scenes(const specs::ExperimentSpec& spec, const fs::path& work,
                                     int workers, support::StageTimes& times) {
  std::vector<fs::path> bundles;
  std::vector<SceneStep> steps;
  std::vector<std::string> names, families;
  std::vector<const SceneStep*> captures;
  steps.reserve(spec.scenes.size());
  for (const specs::SceneSpec& scene : spec.scenes) {
    bundles.push_back(scene.bundle);
    if (!scene.source) {
      (void)prepare_scene(spec, scene, work);
      continue;
    }
    steps.emplace_back(spec, scene, work);
    names.push_back(scene.name);
    const bool known =
        std::find(families.begin(), families.end(), scene.family) != families.end();
    if (known || !steps.back().needs_capture()) continue;
    families.push_back(scene.family);
    captures.push_back(&steps.back());
  }
  support::side_by_side(captures.size(), workers, [&](std::size_t k) {
    support::StageTimes::Timer timer(times, "capture/" + families[k]);
    timer.working();
    captures[k]->capture();
  });
  const int at_once = std::max(1, std::min(workers, static_cast<int>(steps.size())));
  support::side_by_side(steps.size(), at_once, [&](std::size_t k) {
    support::StageTimes::Timer timer(times, "reconstruction/" + names[k]);
    if (steps[k].is_current()) return;
    timer.working();
    std::optional<perception::ThreadCountScope> part;
    // Sums are split among libtorch's threads: reproducible work leaves them at one.
    if (at_once > 1 && core::kernel_choice() == core::KernelChoice::kFast) {
      part.emplace(std::max(1, support::processor_count() / at_once));
    }
    steps[k].reconstruct();
  });
  for (const fs::path& bundle : bundles) check_bundle(bundle);
  return bundles;
}

}  // namespace segsim::experiments::runs
