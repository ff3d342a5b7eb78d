#include "experiments/runs/prepare.h"

#include <algorithm>
#include <cstdio>
#include <optional>
#include <sstream>
#include <utility>

#include "core/error.h"
#include "core/file_io.h"
#include "core/random.h"
#include "core/scene_bundle.h"
#include "experiments/detection/arm_weights.h"
#include "experiments/detection/label_report.h"
#include "experiments/detection/source_dataset.h"
#include "experiments/detection/view_labels.h"
#include "experiments/runs/step_record.h"
#include "experiments/scenes/reconstruct.h"
#include "experiments/scenes/scene_source.h"
#include "perception/dataset.h"
#include "perception/training.h"
#include "perception/weights_file.h"
#include "sim/procedural_furniture.h"
#include "sim/robot.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;

constexpr int kValidationShare =
    5;  ///< One view in five as many again for each of the other sets.
/// Rooms and homes by seed; pre-training uses seeds from 1 (docs/results.md).
constexpr std::uint64_t kMixSeed = 500'000, kSourceSeed = 900'000, kUnseenSeed = 700'000;
constexpr int kSourceRooms = 20, kViewsPerRoom = 8;
constexpr double kStartRegion_m = 0.5;  ///< At least, that the table counts leaks in.

/// A scene with what its views must keep away from.
struct LabelScene {
  const SceneSpec* spec;
  fs::path bundle;
  Starts starts_m;
};

core::CameraIntrinsics view_camera(const ExperimentSpec& spec) {
  const FinetuneSpec& finetune = *spec.detectors.finetune;
  if (finetune.width_px == 0) return spec.camera.intrinsics();
  return spec.camera.intrinsics().resized(finetune.width_px, finetune.height_px);
}

bool takes_part(const FinetuneSpec& finetune, const SceneSpec& scene) {
  return finetune.scenes.empty() || std::find(finetune.scenes.begin(), finetune.scenes.end(),
                                              scene.name) != finetune.scenes.end();
}

std::vector<LabelScene> label_scenes_of(const ExperimentSpec& spec,
                                        std::span<const fs::path> bundles,
                                        std::span<const Starts> starts) {
  std::vector<LabelScene> scenes;
  for (std::size_t i = 0; i < spec.scenes.size(); ++i) {
    if (!takes_part(*spec.detectors.finetune, spec.scenes[i])) continue;
    scenes.push_back({&spec.scenes[i], bundles[i], starts[i]});
  }
  return scenes;
}

std::string describe_views(const ExperimentSpec& spec, const std::vector<LabelScene>& scenes,
                           const std::string& purpose, int views) {
  const core::CameraIntrinsics camera = view_camera(spec);
  const FinetuneSpec& finetune = *spec.detectors.finetune;
  std::ostringstream text;
  text << "views v2, " << purpose << ", " << views << " per scene, seed " << finetune.seed
       << ", robot " << spec.robot << ", " << camera.width_px << "x" << camera.height_px
       << " f " << camera.fx_px << ", pitch " << spec.camera.pitch_down_deg;
  for (const LabelScene& scene : scenes) {
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

fs::path label_scenes(const ExperimentSpec& spec, const std::vector<LabelScene>& scenes,
                      const std::vector<std::string>& class_names, const std::string& purpose,
                      int views, const fs::path& folder) {
  const fs::path json = folder / (purpose + ".json");
  const StepRecord record(folder / (purpose + ".step"),
                          describe_views(spec, scenes, purpose, views));
  if (fs::exists(json) && record.is_current()) return json;

  perception::CocoDataset all;
  for (const LabelScene& scene : scenes) {
    ViewLabelOptions options;
    options.seed =
        core::hash64(scene.spec->name + "/" + purpose, spec.detectors.finetune->seed);
    options.views = views;
    options.camera = view_camera(spec);
    options.camera_height_m = scene.spec->camera_height_m;
    options.camera_pitch_down_rad = spec.camera.pitch_down_rad();
    options.class_names = class_names;
    options.prefix = purpose + "-" + scene.spec->name + "-";
    if (spec.detectors.finetune->start_clearance_m > 0.0) {
      options.avoid_m = scene.starts_m;
      options.avoid_radius_m = spec.detectors.finetune->start_clearance_m;
    }
    append_dataset(all, label_views(core::load_bundle(scene.bundle),
                                    sim::RobotModel::by_name(spec.robot), options, folder)
                            .dataset);
  }
  perception::write_coco(json, all);
  record.mark_done();
  return json;
}

StartLeak start_leak(const fs::path& train_json, const std::vector<LabelScene>& scenes,
                     double clearance_m) {
  const perception::CocoDataset train = perception::read_coco(train_json);
  StartLeak leak{static_cast<int>(train.images.size()), 0,
                 std::max(kStartRegion_m, clearance_m)};
  for (const LabelScene& scene : scenes) {
    const std::string name = core::load_bundle(scene.bundle).manifest.name;
    leak.near_starts += views_near(train, name, scene.starts_m, leak.radius_m);
  }
  return leak;
}

/// Procedural rooms and homes can judge a detector that knows every class they have.
bool shares_classes_of_procedural_homes(const std::vector<std::string>& class_names) {
  return std::all_of(sim::goal_class_names().begin(), sim::goal_class_names().end(),
                     [&](const std::string& name) {
                       return std::find(class_names.begin(), class_names.end(), name) !=
                              class_names.end();
                     });
}

/// What tuning costs elsewhere is measured on these.
void render_foreign_sets(const ExperimentSpec& spec, const fs::path& work, HeldOutSets& sets) {
  SourceDatasetOptions source;
  source.seed = kSourceSeed;
  source.rooms = kSourceRooms;
  source.views_per_room = kViewsPerRoom;
  sets.source = render_source_dataset(source, work / "source_test");
  UnseenHomesOptions unseen;
  unseen.seed = kUnseenSeed;
  unseen.camera = view_camera(spec);
  unseen.camera_height_m = spec.scenes.front().camera_height_m;
  unseen.camera_pitch_down_rad = spec.camera.pitch_down_rad();
  sets.unseen = render_unseen_homes(unseen, work / "unseen_homes");
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
                       const fs::path& train_views, const fs::path& validation_views,
                       const fs::path& work) {
  const DetectorSpec& detectors = spec.detectors;
  const FinetuneSpec& finetune = *detectors.finetune;
  std::ostringstream recipe;
  recipe << "finetune v1 from " << core::sha256_of_file(before) << " on "
         << core::sha256_of_file(train_views) << ", " << finetune.steps << " steps, rate "
         << finetune.learning_rate << ", seed " << finetune.seed;
  if (finetune.mix_share > 0.0) {
    recipe << ", mixed " << finetune.mix_share << " of " << finetune.mix_rooms << " rooms";
  }
  const StepRecord record(work / "detector-after.step", recipe.str());
  if (fs::exists(detectors.after) && record.is_current()) return detectors.after;

  perception::TrainOptions train;
  train.initial_weights = before;
  train.train_json = train_views;
  train.validation_json = validation_views;
  train.output = detectors.after;
  train.steps = finetune.steps;
  train.seed = finetune.seed;
  if (finetune.learning_rate > 0.0) train.learning_rate = finetune.learning_rate;
  if (finetune.mix_share > 0.0) {
    SourceDatasetOptions source;
    source.seed = kMixSeed;
    source.rooms = finetune.mix_rooms;
    source.views_per_room = kViewsPerRoom;
    train.mix_json = render_source_dataset(source, work / "source_mix");
    train.mix_share = finetune.mix_share;
  }
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
  if (p.source_ap50 && p.unseen_ap50) {
    std::printf("%-8s AP50 %5.1f  in rooms of the source domain, %.1f in homes never seen\n",
                "", 100.0 * *p.source_ap50, 100.0 * *p.unseen_ap50);
  }
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
                                    std::span<const fs::path> bundles,
                                    std::span<const Starts> starts, const fs::path& work) {
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
  const std::vector<LabelScene> scenes = label_scenes_of(spec, bundles, starts);
  const auto views_for = [&](const char* purpose, int count) {
    return label_scenes(spec, scenes, class_names, purpose, count, folder);
  };
  const fs::path train = views_for("train", views);
  HeldOutSets sets;
  sets.validation = views_for("validation", held_out);
  sets.test = views_for("test", held_out);
  const fs::path after = prepare_after(spec, before, train, sets.validation, work);
  prepared.start_leak = start_leak(train, scenes, spec.detectors.finetune->start_clearance_m);
  if (shares_classes_of_procedural_homes(class_names)) render_foreign_sets(spec, work, sets);
  const auto finish = [&](const char* name, const fs::path& weights) {
    PreparedWeights arm{work / ("arm-" + std::string(name) + ".weights"), std::nullopt};
    arm.held_out = prepare_arm_weights(weights, sets, arm.file);
    print_precision(name, *arm.held_out);
    return arm;
  };
  prepared.before = finish("before", before);
  prepared.after = finish("after", after);
  return prepared;
}

}  // namespace segsim::experiments
