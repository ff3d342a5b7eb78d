#include "experiments/runs/internal/detector_preparation.h"

#include <algorithm>
#include <cstdio>
#include <optional>
#include <utility>

#include "core/error.h"
#include "experiments/detection/arm_weights.h"
#include "experiments/detection/source_dataset.h"
#include "experiments/support/side_by_side.h"
#include "experiments/trials/arm_detector.h"
#include "perception/checkpoint/weights_file.h"
#include "perception/detector/detector.h"
#include "perception/training/training.h"
#include "worlds/procedural/procedural_furniture.h"

namespace segsim::experiments::runs::internal {
namespace {

namespace fs = std::filesystem;
using support::TaskGraph;

/// Rooms and homes by seed; pre-training uses seeds from 1 (docs/results/detectors.md).
constexpr std::uint64_t kSourceSeed = 900'000, kUnseenSeed = 700'000;
constexpr int kSourceRooms = 20;

/// Procedural rooms and homes can judge a detector that knows every class they have.
bool shares_classes_of_procedural_homes(const std::vector<std::string>& class_names) {
  return std::all_of(worlds::goal_class_names().begin(), worlds::goal_class_names().end(),
                     [&](const std::string& name) {
                       return std::find(class_names.begin(), class_names.end(), name) !=
                              class_names.end();
                     });
}

/// What tuning costs elsewhere is measured on these.
void render_foreign_sets(const specs::ExperimentSpec& spec, const fs::path& work,
                         detection::HeldOutSets& sets) {
  detection::SourceDatasetOptions source;
  source.seed = kSourceSeed;
  source.rooms = kSourceRooms;
  source.views_per_room = kViewsPerRoom;
  sets.source = detection::render_source_dataset(source, work / "source_test");
  detection::UnseenHomesOptions unseen;
  unseen.seed = kUnseenSeed;
  unseen.camera = view_camera(spec);
  unseen.camera_height_m = spec.scenes.front().camera_height_m;
  unseen.camera_pitch_down_rad = spec.camera.pitch_down_rad();
  sets.unseen = detection::render_unseen_homes(unseen, work / "unseen_homes");
}

void print_precision(const std::string& name, const records::HeldOutPrecision& p) {
  std::printf(
      "%-9s AP50 %5.1f  AP %5.1f  on %d held-out views; at score >= %.3f: precision %.2f, "
      "recall %.2f\n",
      name.c_str(), 100.0 * p.ap50, 100.0 * p.ap, p.views, p.score_threshold, p.precision,
      p.recall);
  if (p.source_ap50 && p.unseen_ap50) {
    std::printf("%-9s AP50 %5.1f  in rooms of the source domain, %.1f in homes never seen\n",
                "", 100.0 * *p.source_ap50, 100.0 * *p.unseen_ap50);
  }
}

/// Weights that become an arm's: with a threshold, and measured.
struct ArmWeights {
  std::string name;  ///< "before", "after.s3".
  fs::path weights;
  detection::HeldOutSets sets;
  bool judged_elsewhere = true;  ///< If the spec measures that.
  trials::PreparedWeights prepared{};
};

void choose_thresholds(std::vector<ArmWeights>& arms, const specs::ExperimentSpec& spec,
                       const std::vector<std::string>& class_names, const fs::path& work,
                       int workers, support::StageTimes& times) {
  support::StageTimes::Timer timer(times, "thresholds");
  if (spec.detectors.finetune->measure_elsewhere &&
      shares_classes_of_procedural_homes(class_names)) {
    detection::HeldOutSets foreign;
    render_foreign_sets(spec, work, foreign);
    for (ArmWeights& arm : arms) {
      if (!arm.judged_elsewhere) continue;
      arm.sets.source = foreign.source;
      arm.sets.unseen = foreign.unseen;
    }
  }
  support::side_by_side(arms.size(), workers, [&](std::size_t k) {
    const perception::ThreadCountScope one(1);  // Scores depend on the count.
    ArmWeights& arm = arms[k];
    arm.prepared.file = work / ("arm-" + arm.name + ".weights");
    arm.prepared.held_out = detection::prepare_arm_weights(
        arm.weights, arm.sets, spec.detectors.finetune->precision_target,
        trials::compute_device(spec), arm.prepared.file, [&] { timer.working(); });
  });
  for (const ArmWeights& arm : arms) print_precision(arm.name, *arm.prepared.held_out);
}

}  // namespace

DetectorPreparation::DetectorPreparation(const specs::ExperimentSpec& spec,
                                         const std::deque<SceneTask>& scenes, fs::path work,
                                         support::StageTimes& times)
    : spec_(spec),
      scenes_(scenes),
      work_(std::move(work)),
      times_(times),
      scene_views_(spec, scenes, work_) {
  const specs::DetectorSpec& detectors = spec.detectors;
  const bool needs_after = needs(specs::ArmDetector::kAfter);
  wanted_ = std::any_of(spec.arms.begin(), spec.arms.end(), [](const specs::ArmSpec& arm) {
    return arm.detector == specs::ArmDetector::kBefore || specs::is_fine_tuned(arm.detector);
  });
  if (!wanted_) return;
  if (needs_after && !detectors.finetune && !fs::exists(detectors.after)) {
    throw core::InputError::expected(
        detectors.after.string(), "weights, or a detectors.finetune section that makes them",
        "none");
  }
  if (!fs::exists(detectors.before) && !detectors.pretrain) {
    throw core::InputError::expected(
        detectors.before.string(), "weights, or a detectors.pretrain section that makes them",
        "none");
  }
  if (!detectors.finetune) return;
  trainings_ = trainings_of(spec);
  const int reconstructions = spec.repetitions.reconstruct_seeds;
  for (int r = 1; r <= reconstructions; ++r) {
    held_out_.push_back({label_scenes_of(spec, r, scenes), {}, {}});
  }
  for (const Training& training : trainings_) {
    training_views_.emplace_back();
    const bool exact = training.set.exact_labels;
    if (training.set.name.empty() || exact) {
      training_views_.back() =
          add_set(training.reconstruction, "train", training.seed, training.suffix,
                  exact ? LabelsOf::kTruth : LabelsOf::kMasks);
    } else {
      scene_views_.want(training, sets_);
    }
  }
  for (int r = 1; r <= reconstructions; ++r) {
    HeldOutViews& views = held_out_[static_cast<std::size_t>(r - 1)];
    const std::string suffix = specs::repetition_suffix(spec, r, std::nullopt);
    views.validation = add_set(r, "validation", detectors.finetune->seed, suffix);
    views.test = add_set(r, "test", detectors.finetune->seed, suffix);
    if (needs(specs::ArmDetector::kAfterExact)) {
      views.exact_validation = add_set(r, "validation", detectors.finetune->seed,
                                       ".exact" + suffix, LabelsOf::kTruth);
    }
  }
}

bool DetectorPreparation::needs(specs::ArmDetector detector) const {
  return std::any_of(spec_.arms.begin(), spec_.arms.end(),
                     [&](const specs::ArmSpec& arm) { return arm.detector == detector; });
}

std::vector<const SceneTask*> DetectorPreparation::learnt_scenes() const {
  if (!needs(specs::ArmDetector::kAfterHere)) return held_out(1).scenes;
  std::vector<const SceneTask*> all;
  for (const SceneTask& scene : scenes_) {
    if (scene.spec->reconstruction == 1) all.push_back(&scene);
  }
  return all;
}

fs::path DetectorPreparation::add_set(int reconstruction, const char* purpose,
                                      std::uint64_t seed, const std::string& suffix,
                                      LabelsOf labels) {
  sets_.emplace_back(spec_, held_out(reconstruction).scenes, purpose, seed,
                     work_ / ("views" + suffix), labels);
  return sets_.back().json();
}

const DetectorPreparation::HeldOutViews& DetectorPreparation::held_out(
    int reconstruction) const {
  return held_out_[static_cast<std::size_t>(reconstruction - 1)];
}

void DetectorPreparation::add_to(TaskGraph& graph) {
  const bool pretrains = wanted_ && !fs::exists(spec_.detectors.before);
  if (!pretrains && sets_.empty()) return;
  std::vector<TaskGraph::Id> all_scenes;
  // No hour of training for a scene that is refused; and episodes tell which goals there are.
  if (pretrains || !knows_all_goals()) {
    for (const SceneTask& scene : scenes_) all_scenes.push_back(scene.task);
  }
  const TaskGraph::Id before = graph.add(
      [this, pretrains] {
        if (pretrains) pretrain();
        // Only what is tuned must be weights of ours; else any model file will do.
        if (!sets_.empty()) choose_classes();
      },
      all_scenes);
  label_work_.emplace(LabelWork{class_names_, new_classes_, before, progress_, times_});
  for (LabelSet& set : sets_) set.add_to(graph, *label_work_);
}

bool DetectorPreparation::knows_all_goals() const {
  const std::vector<std::string> known =
      perception::read_weights(spec_.detectors.before).class_names;
  const std::vector<const SceneTask*> tuned = learnt_scenes();
  return std::all_of(tuned.begin(), tuned.end(), [&](const SceneTask* scene) {
    // Which class a phrase is about is known when its scene is loaded.
    return !scene->spec->goals.empty() && scene->spec->phrases.empty() &&
           trials::unknown_goals(scene->spec->goals, known).empty();
  });
}

void DetectorPreparation::choose_classes() {
  class_names_ = perception::read_weights(spec_.detectors.before).class_names;
  if (knows_all_goals()) return;
  for (const SceneTask* scene : learnt_scenes()) {
    for (const std::string& name :
         trials::unknown_goals(trials::searched_classes(*scene->loaded), class_names_)) {
      class_names_.push_back(name);
      new_classes_.push_back(name);
    }
  }
}

void DetectorPreparation::pretrain() {
  support::StageTimes::Timer timer(times_, "pre-training");
  timer.working();
  const specs::PretrainSpec& pretrain = *spec_.detectors.pretrain;
  detection::SourceDatasetOptions source;
  source.seed = pretrain.seed;
  source.rooms = pretrain.rooms;
  source.views_per_room = pretrain.views_per_room;
  perception::TrainOptions train;  // Of the small network.
  train.train_json = detection::render_source_dataset(source, work_ / "source_views");
  train.output = spec_.detectors.before;
  train.steps = pretrain.steps;
  train.seed = pretrain.seed;
  train.device = trials::compute_device(spec_);
  perception::train(train);
}

trials::PreparedDetectors DetectorPreparation::finish(int workers) {
  if (!sets_.empty()) return tuned(workers);
  trials::PreparedDetectors prepared;
  for (const specs::ArmSpec& arm : spec_.arms) {
    if (arm.detector == specs::ArmDetector::kBefore)
      prepared[arm.name].file = spec_.detectors.before;
    if (arm.detector == specs::ArmDetector::kAfter)
      prepared[arm.name].file = spec_.detectors.after;
  }
  return prepared;
}

trials::PreparedDetectors DetectorPreparation::tuned(int workers) {
  const fs::path& before = spec_.detectors.before;
  std::vector<FineTuning> steps;
  std::vector<TrainingViews> views;
  for (std::size_t k = 0; k < trainings_.size(); ++k) {
    if (training_views_[k].empty()) {
      views.push_back(scene_views_.of(trainings_[k]));
    } else {
      const HeldOutViews& of_all = held_out(trainings_[k].reconstruction);
      views.push_back(
          {of_all.scenes, training_views_[k],
           trainings_[k].set.exact_labels ? of_all.exact_validation : of_all.validation,
           of_all.test});
    }
    steps.emplace_back(spec_, before, new_classes_, views[k].train, views[k].validation,
                       trainings_[k], work_);
  }
  fine_tune(spec_, steps, work_, workers, times_);

  std::vector<ArmWeights> arms;
  for (int r = 1; r <= spec_.repetitions.reconstruct_seeds; ++r) {
    arms.push_back({"before" + specs::repetition_suffix(spec_, r, std::nullopt),
                    before,
                    {held_out(r).validation, held_out(r).test, {}, {}, new_classes_}});
  }
  for (std::size_t k = 0; k < trainings_.size(); ++k) {
    arms.push_back({"after" + trainings_[k].suffix,
                    steps[k].output(),
                    {views[k].validation, views[k].test, {}, {}, {}}});
    arms.back().judged_elsewhere = trainings_[k].set.name.empty();  // Of many it takes hours.
    trials::PreparedWeights& prepared = arms.back().prepared;
    prepared.tuned_on =
        std::make_shared<const perception::CocoDataset>(perception::read_coco(views[k].train));
    prepared.start_leak = start_leak(*prepared.tuned_on, views[k].run_in,
                                     spec_.detectors.finetune->start_clearance_m);
  }
  choose_thresholds(arms, spec_, class_names_, work_, workers, times_);

  trials::PreparedDetectors prepared;
  for (const specs::ArmSpec& arm : spec_.arms) {
    const bool is_before = arm.detector == specs::ArmDetector::kBefore;
    if (!is_before && !specs::is_fine_tuned(arm.detector)) continue;
    for (const specs::SceneSpec& scene : spec_.scenes) {
      if (scene.reconstruction != arm.reconstruction) continue;
      const std::string name =
          is_before
              ? "before" + specs::repetition_suffix(spec_, arm.reconstruction, std::nullopt)
              : "after" + training_in(spec_, arm, scene).suffix;
      const auto found = std::find_if(arms.begin(), arms.end(),
                                      [&](const ArmWeights& a) { return a.name == name; });
      prepared[trials::prepared_key(arm, scene.name)] = found->prepared;
    }
  }
  return prepared;
}

}  // namespace segsim::experiments::runs::internal
