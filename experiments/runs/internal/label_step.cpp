#include "experiments/runs/internal/label_step.h"

#include <cstdio>
#include <utility>

#include "core/error.h"
#include "core/file_io.h"
#include "core/formatted.h"
#include "core/progress.h"
#include "experiments/detection/box_masks.h"
#include "experiments/scenes/relabel.h"
#include "experiments/scenes/scene_source.h"
#include "experiments/training/mask_quality.h"
#include "reconstruction/datasets/mask_files.h"

namespace segsim::experiments::runs::internal {
namespace {

namespace fs = std::filesystem;

training::MaskSimulation simulation_of(const specs::MaskSpec& spec, int frame_step) {
  training::MaskSimulation simulation;
  simulation.level = spec.level;
  simulation.fit = spec.fit;
  simulation.seed = spec.seed;
  simulation.frame_step = frame_step;
  return simulation;
}

/// ", PQ of views 53.1" where `figures` has it.
std::string percent_of(const std::vector<std::pair<std::string, double>>& figures,
                       const char* name, const char* words) {
  for (const auto& [key, value] : figures) {
    if (key == name) return std::string(", ") + words + core::print(" %.1f", 100.0 * value);
  }
  return "";
}

}  // namespace

LabelStep::LabelStep(const SceneStep& scene, const fs::path& work)
    : scene_(scene),
      bundle_(work / "labels" / (scene.scene().name + "-from-masks")),
      masks_(work / "masks") {
  // Here, before a scene is trained for hours.
  if (spec().source == specs::MaskSource::kFolder && !fs::is_directory(spec().folder)) {
    throw core::InputError::expected(spec().folder.string(), "a folder of masks", "none");
  }
  if (spec().source == specs::MaskSource::kDetect && !fs::exists(spec().detector)) {
    throw core::InputError::expected(spec().detector.string(), "a detector", "none");
  }
}

std::string LabelStep::masks_recipe() const {
  const specs::SourceSpec& source = *scene_.scene().source;
  const std::string of = "masks v1 of " + scenes::describe_capture(source) + ": ";
  switch (spec().source) {
    case specs::MaskSource::kSimulate:
      return of + training::describe(simulation_of(spec(), source.frame_step));
    case specs::MaskSource::kFolder:
      break;
    case specs::MaskSource::kDetect: {
      const std::string threshold =
          spec().score_threshold ? core::print("%g", *spec().score_threshold) : "its own";
      return of + "boxes of " + spec().detector.filename().string() + " (" +
             core::sha256_of_file(spec().detector) + "), threshold " + threshold +
             ", classes '" + spec().prompt + "'";
    }
  }
  const fs::path table = spec().folder / "masks.yaml";
  return of + "folder " + spec().folder.string() +
         (fs::exists(table) ? ", " + core::sha256_of_file(table) : "");
}

fs::path LabelStep::masks_folder() const {
  if (spec().source == specs::MaskSource::kFolder) return spec().folder;
  // Of other settings they lie elsewhere, so that none are mixed.
  return masks_ / (scene_.scene().name + "-" + core::sha256_hex(masks_recipe()).substr(0, 8));
}

support::StepRecord LabelStep::record() const {
  const training::TrainingOptions training = *scene_.training();
  return {bundle_.string() + ".step",
          "labels v1: scene " + core::sha256_of_file(scene_.scene().bundle / "scene.yaml") +
              "; " + masks_recipe() + "; " + training.head + ", seed " +
              std::to_string(training.seed) + ", " +
              core::sha256_hex(reconstruction::training_config_text(training.config))};
}

bool LabelStep::is_current() const {
  return fs::exists(bundle_ / "scene.yaml") && record().is_current();
}

void LabelStep::make_masks(const reconstruction::RgbdSequence& recording) const {
  const fs::path folder = masks_folder();
  if (spec().source == specs::MaskSource::kFolder || fs::exists(folder / "masks.yaml")) return;
  const int frame_step = scene_.scene().source->frame_step;
  if (spec().source == specs::MaskSource::kSimulate) {
    (void)training::simulate_masks(recording, simulation_of(spec(), frame_step), folder);
    return;
  }
  detection::BoxMaskOptions options;
  options.detector = spec().detector;
  options.prompt = spec().prompt;
  options.score_threshold = spec().score_threshold;
  options.output = folder;
  options.frame_step = frame_step;
  (void)detection::make_box_masks(recording, options);
}

void LabelStep::make() const {
  const std::string& name = scene_.scene().name;
  std::printf("learning labels of scene %s from masks\n", name.c_str());
  const core::ProgressPrefix prefix(name + ": ");
  const auto recording = scene_.open_recording();
  make_masks(*recording);
  scenes::RelabelOptions options;
  options.training = *scene_.training();
  options.training.masks = masks_folder();
  const support::StepRecord done = record();
  options.training.work = bundle_.string() + ".training-" + done.recipe_sha256().substr(0, 8);
  options.masks =
      reconstruction::open_masks(masks_folder(), recording->classes())->info().source;
  scenes::relabel_bundle(core::load_bundle(scene_.scene().bundle), *recording, options,
                         bundle_);
  done.mark_done();
}

LearntLabels LabelStep::load() const {
  core::SceneBundle bundle = core::load_bundle(bundle_);
  scenes::SceneSurfels surfels = scenes::load_scene_surfels(bundle);
  const reconstruction::MaskSetInfo masks =
      reconstruction::open_masks(masks_folder(), bundle.manifest.classes)->info();
  std::string words =
      masks.source + percent_of(masks.measured, "pq", "PQ of single views") +
      percent_of(bundle.manifest.statistics, "held_out_strict_pq", "PQ of the learnt scene");
  return {std::move(bundle), std::move(surfels), std::move(words)};
}

}  // namespace segsim::experiments::runs::internal
