#include "experiments/runs/internal/scene_step.h"

#include <cstdio>
#include <sstream>

#include "core/bundle_parts.h"
#include "core/file_io.h"
#include "core/progress.h"
#include "core/scene_bundle.h"
#include "experiments/scenes/reconstruct.h"
#include "experiments/scenes/recording_rig.h"
#include "experiments/scenes/scene_source.h"

namespace segsim::experiments::runs::internal {
namespace {

namespace fs = std::filesystem;

training::TrainingOptions training_of(const specs::ReconstructSpec& spec,
                                      const specs::SourceSpec& source,
                                      renderer::Backend backend) {
  training::TrainingOptions training;
  training.device.backend = backend;
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

}  // namespace

void check_bundle(const fs::path& folder) {
  core::require_drivable(core::load_bundle(folder));
}

SceneStep::SceneStep(const specs::ExperimentSpec& spec, const specs::SceneSpec& scene,
                     const fs::path& work)
    : spec_(spec),
      scene_(scene),
      recording_(scene.source->type == specs::SourceType::kRgbd
                     ? scene.source->folder
                     : work / "captures" / scene.family),
      record_(scene.bundle.string() + ".step", recipe()) {}

bool SceneStep::is_current() const {
  return fs::exists(scene_.bundle / "scene.yaml") && record_.is_current();
}

bool SceneStep::needs_capture() const {
  return scene_.source->type != specs::SourceType::kRgbd && !is_current();
}

void SceneStep::capture() const {
  std::printf("capturing scene %s: %s\n", scene_.family.c_str(),
              scenes::describe_capture(*scene_.source).c_str());
  const core::ProgressPrefix prefix(scene_.family + ": ");
  scenes::capture_mesh_source(*scene_.source, recording_);
}

void SceneStep::reconstruct() const {
  std::printf("reconstructing scene %s\n", scene_.name.c_str());
  const core::ProgressPrefix prefix(scene_.name + ": ");
  const specs::SourceSpec& source = *scene_.source;
  const auto sequence = open_recording();
  scenes::ReconstructOptions options;
  options.name = scene_.name;
  options.source = scenes::describe_capture(source);
  options.credits = scenes::read_credits(recording_);
  options.source_sha256 = record_.recipe_sha256();
  options.collision.floor_is_known = reading().floor_height_m.has_value();
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

reconstruction::SequenceOptions SceneStep::reading() const {
  const specs::SourceSpec& source = *scene_.source;
  reconstruction::SequenceOptions options;
  options.on_bad_frame = reconstruction::OnBadFrame::kSkip;
  if (source.type == specs::SourceType::kRgbd) options.floor_height_m = source.floor_height_m;
  return scenes::with_rig(recording_, options, source.rig);
}

std::unique_ptr<reconstruction::RgbdSequence> SceneStep::open_recording() const {
  return scenes::open_recording(recording_, scene_.source->boxes, reading());
}

std::optional<training::TrainingOptions> SceneStep::training() const {
  const specs::SourceSpec& source = *scene_.source;
  if (!source.reconstruct) return std::nullopt;
  return training_of(*source.reconstruct, source, spec_.backend);
}

std::string SceneStep::recipe() const {
  const specs::SourceSpec& source = *scene_.source;
  std::ostringstream text;
  text << "bundle v1: " << scenes::describe_capture(source) << "; voxel " << source.voxel_m
       << " m, robot " << spec_.robot.name << ", camera " << scene_.camera_height_m << " m";
  if (const std::optional<training::TrainingOptions> trained = training()) {
    text << "; trained, mesh of rendered depth, " << trained->head << ", seed "
         << trained->seed << ", "
         << core::sha256_hex(reconstruction::training_config_text(trained->config));
    if (spec_.backend != renderer::Backend::kCpu) {
      text << ", on " << renderer::backend_name(spec_.backend);
    }
  }
  return text.str();
}

}  // namespace segsim::experiments::runs::internal
