#include "experiments/prepare.h"

#include <algorithm>
#include <cstdio>
#include <numbers>
#include <optional>
#include <sstream>
#include <utility>

#include "core/error.h"
#include "core/file_io.h"
#include "core/random.h"
#include "core/scene_bundle.h"
#include "experiments/arm_weights.h"
#include "experiments/reconstruct.h"
#include "experiments/scene_source.h"
#include "experiments/source_dataset.h"
#include "experiments/step_record.h"
#include "experiments/view_labels.h"
#include "perception/dataset.h"
#include "perception/training.h"
#include "perception/weights_file.h"
#include "sim/robot.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;

/// Views of the fine-tuning scenes: for training, for choosing thresholds, for reporting. No
/// view serves two purposes.
struct ViewSets {
  fs::path train, validation, test;
};

constexpr int kValidationShare =
    5;  ///< One view in five as many again for each of the other sets.

core::CameraIntrinsics view_camera(const ExperimentSpec& spec) {
  const FinetuneSpec& finetune = *spec.detectors.finetune;
  if (finetune.width_px == 0) return spec.camera.intrinsics();
  return spec.camera.intrinsics().resized(finetune.width_px, finetune.height_px);
}

bool takes_part(const FinetuneSpec& finetune, const SceneSpec& scene) {
  return finetune.scenes.empty() || std::find(finetune.scenes.begin(), finetune.scenes.end(),
                                              scene.name) != finetune.scenes.end();
}

std::string describe_views(const ExperimentSpec& spec, std::span<const fs::path> bundles,
                           const std::string& purpose, int views) {
  const core::CameraIntrinsics camera = view_camera(spec);
  std::ostringstream text;
  text << "views v1, " << purpose << ", " << views << " per scene, seed "
       << spec.detectors.finetune->seed << ", robot " << spec.robot << ", " << camera.width_px
       << "x" << camera.height_px << " f " << camera.fx_px << ", pitch "
       << spec.camera.pitch_down_deg;
  for (std::size_t i = 0; i < spec.scenes.size(); ++i) {
    if (!takes_part(*spec.detectors.finetune, spec.scenes[i])) continue;
    text << "; " << spec.scenes[i].name << " at " << spec.scenes[i].camera_height_m << " m "
         << core::sha256_of_file(bundles[i] / "scene.yaml");
  }
  return text.str();
}

fs::path label_scenes(const ExperimentSpec& spec, std::span<const fs::path> bundles,
                      const std::vector<std::string>& class_names, const std::string& purpose,
                      int views, const fs::path& folder) {
  const fs::path json = folder / (purpose + ".json");
  const StepRecord record(folder / (purpose + ".step"),
                          describe_views(spec, bundles, purpose, views));
  if (fs::exists(json) && record.is_current()) return json;

  perception::CocoDataset all;
  for (std::size_t i = 0; i < spec.scenes.size(); ++i) {
    const SceneSpec& scene = spec.scenes[i];
    if (!takes_part(*spec.detectors.finetune, scene)) continue;
    ViewLabelOptions options;
    options.seed = core::hash64(scene.name + "/" + purpose, spec.detectors.finetune->seed);
    options.views = views;
    options.camera = view_camera(spec);
    options.camera_height_m = scene.camera_height_m;
    options.camera_pitch_down_rad = spec.camera.pitch_down_deg * std::numbers::pi / 180.0;
    options.class_names = class_names;
    options.prefix = purpose + "-" + scene.name + "-";
    append_dataset(all, label_views(core::load_bundle(bundles[i]),
                                    sim::RobotModel::by_name(spec.robot), options, folder)
                            .dataset);
  }
  perception::write_coco(json, all);
  record.mark_done();
  return json;
}

/// The 'before' weights: those given, or pre-trained here.
fs::path prepare_before(const ExperimentSpec& spec, const fs::path& work) {
  const DetectorSpec& detectors = spec.detectors;
  if (fs::exists(detectors.before)) return detectors.before;
  if (!detectors.pretrain) {
    throw core::InputError::expected(
        detectors.before.string(), "weights, or a detectors.pretrain section that makes them",
        "none");
  }
  const PretrainSpec& pretrain = *detectors.pretrain;
  SourceDatasetOptions source;
  source.seed = pretrain.seed;
  source.rooms = pretrain.rooms;
  source.views_per_room = pretrain.views_per_room;
  perception::TrainOptions train;
  train.train_json = render_source_dataset(source, work / "source_views");
  train.output = detectors.before;
  train.steps = pretrain.steps;
  train.seed = pretrain.seed;
  perception::train(train);
  return detectors.before;
}

fs::path prepare_after(const ExperimentSpec& spec, const fs::path& before,
                       const ViewSets& views, const fs::path& work) {
  const DetectorSpec& detectors = spec.detectors;
  const FinetuneSpec& finetune = *detectors.finetune;
  std::ostringstream recipe;
  recipe << "finetune v1 from " << core::sha256_of_file(before) << " on "
         << core::sha256_of_file(views.train) << ", " << finetune.steps << " steps, rate "
         << finetune.learning_rate << ", seed " << finetune.seed;
  const StepRecord record(work / "detector-after.step", recipe.str());
  if (fs::exists(detectors.after) && record.is_current()) return detectors.after;

  perception::TrainOptions train;
  train.initial_weights = before;
  train.train_json = views.train;
  train.validation_json = views.validation;
  train.output = detectors.after;
  train.steps = finetune.steps;
  train.seed = finetune.seed;
  if (finetune.learning_rate > 0.0) train.learning_rate = finetune.learning_rate;
  std::printf("fine-tuning the detector: %d steps\n", finetune.steps);
  perception::train(train);
  record.mark_done();
  return detectors.after;
}

void print_precision(const char* name, const HeldOutPrecision& p) {
  std::printf(
      "%-8s AP50 %5.1f  AP %5.1f  on %d held-out views; at score >= %.3f: precision %.2f, "
      "recall %.2f\n",
      name, 100.0 * p.ap50, 100.0 * p.ap, p.views, p.score_threshold, p.precision, p.recall);
}

}  // namespace

namespace {

TrainingOptions training_of(const ReconstructSpec& spec, const SourceSpec& source) {
  TrainingOptions training;
  if (!spec.config.empty()) training.config = renderer::read_training_config(spec.config);
  if (spec.iterations >= 0) training.config.geometry.iterations = spec.iterations;
  if (spec.label_iterations >= 0) training.config.panoptic.iterations = spec.label_iterations;
  training.head = spec.head;
  training.seed = spec.seed;
  training.set.frame_step = source.frame_step;
  training.resume = true;  // As everything that `segsim run` prepares.
  return training;
}

}  // namespace

fs::path prepare_scene(const ExperimentSpec& spec, const SceneSpec& scene,
                       const fs::path& work) {
  if (!scene.source) {
    (void)core::load_bundle(scene.bundle);  // Names what is missing.
    return scene.bundle;
  }
  const SourceSpec& source = *scene.source;
  std::ostringstream recipe;
  recipe << "bundle v1: " << describe_capture(source) << "; voxel " << source.voxel_m
         << " m, robot " << spec.robot << ", camera " << scene.camera_height_m << " m";
  std::optional<TrainingOptions> training;
  if (source.reconstruct) {
    training = training_of(*source.reconstruct, source);
    recipe << "; trained, mesh of rendered depth, " << training->head << ", seed "
           << training->seed << ", "
           << core::sha256_hex(renderer::training_config_text(training->config));
  }
  const StepRecord record(scene.bundle.string() + ".step", recipe.str());
  if (fs::exists(scene.bundle / "scene.yaml") && record.is_current()) return scene.bundle;

  std::printf("preparing scene %s: %s\n", scene.name.c_str(),
              describe_capture(source).c_str());
  fs::path recording = source.folder;
  if (source.type != SourceType::kRgbd) {
    recording = work / "captures" / scene.name;
    capture_mesh_source(source, recording);
  }
  renderer::SequenceOptions sequence_options;
  sequence_options.on_bad_frame = renderer::OnBadFrame::kSkip;
  if (source.type == SourceType::kRgbd)
    sequence_options.floor_height_m = source.floor_height_m;
  const auto sequence = open_recording(recording, source.boxes, sequence_options);

  ReconstructOptions options;
  options.name = scene.name;
  options.source = describe_capture(source);
  options.source_sha256 = record.recipe_sha256();
  options.lift.voxel_m = source.voxel_m;
  options.lift.frame_step = source.frame_step;
  options.robot = sim::RobotModel::by_name(spec.robot);
  options.camera_height_m = scene.camera_height_m;
  options.training = std::move(training);
  if (options.training) {  // A state of other settings is left alone.
    options.training->work =
        scene.bundle.string() + ".training-" + record.recipe_sha256().substr(0, 8);
  }
  reconstruct_bundle(*sequence, options, scene.bundle);
  record.mark_done();
  return scene.bundle;
}

PreparedDetectors prepare_detectors(const ExperimentSpec& spec,
                                    std::span<const fs::path> bundles, const fs::path& work) {
  const auto needs = [&](ArmDetector wanted) {
    return std::any_of(spec.arms.begin(), spec.arms.end(),
                       [&](const ArmSpec& arm) { return arm.detector == wanted; });
  };
  PreparedDetectors prepared;
  if (!needs(ArmDetector::kBefore) && !needs(ArmDetector::kAfter)) return prepared;
  if (needs(ArmDetector::kAfter) && !spec.detectors.finetune) {
    if (!fs::exists(spec.detectors.after)) {
      throw core::InputError::expected(
          spec.detectors.after.string(),
          "weights, or a detectors.finetune section that makes them", "none");
    }
  }
  const fs::path before = prepare_before(spec, work);
  if (!spec.detectors.finetune) {
    prepared.before.file = before;
    prepared.after.file = spec.detectors.after;
    return prepared;
  }

  const std::vector<std::string> class_names = perception::read_weights(before).class_names;
  const int views = spec.detectors.finetune->views_per_scene;
  const int held_out = std::max(10, views / kValidationShare);
  const fs::path folder = work / "views";
  const ViewSets sets{label_scenes(spec, bundles, class_names, "train", views, folder),
                      label_scenes(spec, bundles, class_names, "validation", held_out, folder),
                      label_scenes(spec, bundles, class_names, "test", held_out, folder)};
  const fs::path after = prepare_after(spec, before, sets, work);
  const auto finish = [&](const char* name, const fs::path& weights) {
    PreparedWeights arm{work / ("arm-" + std::string(name) + ".weights"), std::nullopt};
    arm.held_out = prepare_arm_weights(weights, sets.validation, sets.test, arm.file);
    print_precision(name, *arm.held_out);
    return arm;
  };
  prepared.before = finish("before", before);
  prepared.after = finish("after", after);
  return prepared;
}

}  // namespace segsim::experiments
