#include "experiments/runs/prepare.h"

#include <algorithm>
#include <cstdio>
#include <optional>

#include "core/error.h"
#include "experiments/detection/arm_weights.h"
#include "experiments/detection/source_dataset.h"
#include "experiments/runs/internal/fine_tuning.h"
#include "experiments/runs/internal/label_sets.h"
#include "experiments/support/side_by_side.h"
#include "perception/checkpoint/weights_file.h"
#include "perception/detector/detector.h"
#include "perception/training/training.h"
#include "worlds/procedural/procedural_furniture.h"

namespace segsim::experiments::runs {
namespace {

namespace fs = std::filesystem;
using internal::FineTuning;
using internal::LabelScene;
using internal::LabelSet;
using internal::Training;

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
  source.views_per_room = internal::kViewsPerRoom;
  sets.source = detection::render_source_dataset(source, work / "source_test");
  detection::UnseenHomesOptions unseen;
  unseen.seed = kUnseenSeed;
  unseen.camera = internal::view_camera(spec);
  unseen.camera_height_m = spec.scenes.front().camera_height_m;
  unseen.camera_pitch_down_rad = spec.camera.pitch_down_rad();
  sets.unseen = detection::render_unseen_homes(unseen, work / "unseen_homes");
}

/// The 'before' weights: those given, or pre-trained here.
fs::path prepare_before(const specs::ExperimentSpec& spec, const fs::path& work,
                        support::StageTimes& times) {
  const specs::DetectorSpec& detectors = spec.detectors;
  if (fs::exists(detectors.before)) return detectors.before;
  if (!detectors.pretrain) {
    throw core::InputError::expected(
        detectors.before.string(), "weights, or a detectors.pretrain section that makes them",
        "none");
  }
  support::StageTimes::Timer timer(times, "pre-training");
  timer.working();
  const specs::PretrainSpec& pretrain = *detectors.pretrain;
  detection::SourceDatasetOptions source;
  source.seed = pretrain.seed;
  source.rooms = pretrain.rooms;
  source.views_per_room = pretrain.views_per_room;
  perception::TrainOptions train;
  train.train_json = detection::render_source_dataset(source, work / "source_views");
  train.output = detectors.before;
  train.steps = pretrain.steps;
  train.seed = pretrain.seed;
  perception::train(train);
  return detectors.before;
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

/// Views of one reconstruction that no training of it sees: they judge all of its detectors.
struct HeldOutViews {
  std::vector<LabelScene> scenes;
  fs::path validation, test;
};

/// Makes the data sets of all reconstructions and trainings.
struct Views {
  std::vector<HeldOutViews> held_out;  ///< By reconstruction, from 1.
  std::vector<fs::path> training;      ///< By training.
};

Views prepare_views(const specs::ExperimentSpec& spec, std::span<const fs::path> bundles,
                    std::span<const trials::Starts> starts,
                    const std::vector<Training>& trainings,
                    const std::vector<std::string>& class_names, const fs::path& work,
                    int workers, support::StageTimes& times) {
  const specs::FinetuneSpec& finetune = *spec.detectors.finetune;
  Views views;
  for (int r = 1; r <= spec.repetitions.reconstruct_seeds; ++r) {
    views.held_out.push_back({internal::label_scenes_of(spec, r, bundles, starts), {}, {}});
  }
  std::vector<LabelSet> sets;
  const auto add = [&](int reconstruction, const char* purpose, std::uint64_t seed,
                       const std::string& suffix) {
    const auto r = static_cast<std::size_t>(reconstruction - 1);
    sets.emplace_back(spec, views.held_out[r].scenes, purpose, seed,
                      work / ("views" + suffix));
    return sets.back().json();
  };
  for (const Training& training : trainings) {
    views.training.push_back(
        add(training.reconstruction, "train", training.seed, training.suffix));
  }
  for (int r = 1; r <= spec.repetitions.reconstruct_seeds; ++r) {
    HeldOutViews& held_out = views.held_out[static_cast<std::size_t>(r - 1)];
    const std::string suffix = specs::repetition_suffix(spec, r, std::nullopt);
    held_out.validation = add(r, "validation", finetune.seed, suffix);
    held_out.test = add(r, "test", finetune.seed, suffix);
  }
  internal::make_label_sets(sets, class_names, workers, times);
  return views;
}

/// Weights that become an arm's: with a threshold, and measured.
struct ArmWeights {
  std::string name;  ///< "before", "after.s3".
  fs::path weights;
  detection::HeldOutSets sets;
  trials::PreparedWeights prepared;
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
      arm.sets.source = foreign.source;
      arm.sets.unseen = foreign.unseen;
    }
  }
  support::side_by_side(arms.size(), workers, [&](std::size_t k) {
    const perception::ThreadCountScope one(1);  // Scores depend on the count.
    ArmWeights& arm = arms[k];
    arm.prepared.file = work / ("arm-" + arm.name + ".weights");
    arm.prepared.held_out = detection::prepare_arm_weights(
        arm.weights, arm.sets, spec.detectors.finetune->precision_target, arm.prepared.file,
        [&] { timer.working(); });
  });
  for (const ArmWeights& arm : arms) print_precision(arm.name, *arm.prepared.held_out);
}

/// Detectors of a spec that fine-tunes.
trials::PreparedDetectors tuned_detectors(const specs::ExperimentSpec& spec,
                                          std::span<const fs::path> bundles,
                                          std::span<const trials::Starts> starts,
                                          const fs::path& before, const fs::path& work,
                                          int workers, support::StageTimes& times) {
  const std::vector<std::string> class_names = perception::read_weights(before).class_names;
  const std::vector<Training> trainings = internal::trainings_of(spec);
  const Views views =
      prepare_views(spec, bundles, starts, trainings, class_names, work, workers, times);
  const auto held_out = [&](int reconstruction) -> const HeldOutViews& {
    return views.held_out[static_cast<std::size_t>(reconstruction - 1)];
  };

  std::vector<FineTuning> steps;
  for (std::size_t k = 0; k < trainings.size(); ++k) {
    steps.emplace_back(spec, before, views.training[k],
                       held_out(trainings[k].reconstruction).validation, trainings[k], work);
  }
  internal::fine_tune(spec, steps, work, workers, times);

  std::vector<ArmWeights> arms;
  const auto add = [&](const std::string& name, int reconstruction, const fs::path& weights) {
    const HeldOutViews& sets = held_out(reconstruction);
    arms.push_back({name, weights, {sets.validation, sets.test, {}, {}}, {}});
  };
  for (int r = 1; r <= spec.repetitions.reconstruct_seeds; ++r) {
    add("before" + specs::repetition_suffix(spec, r, std::nullopt), r, before);
  }
  for (std::size_t k = 0; k < trainings.size(); ++k) {
    add("after" + trainings[k].suffix, trainings[k].reconstruction, steps[k].output());
    arms.back().prepared.start_leak =
        internal::start_leak(views.training[k], held_out(trainings[k].reconstruction).scenes,
                             spec.detectors.finetune->start_clearance_m);
  }
  choose_thresholds(arms, spec, class_names, work, workers, times);

  trials::PreparedDetectors prepared;
  for (const specs::ArmSpec& arm : spec.arms) {
    if (arm.detector != specs::ArmDetector::kBefore &&
        arm.detector != specs::ArmDetector::kAfter)
      continue;
    const std::string name =
        (arm.detector == specs::ArmDetector::kBefore ? "before" : "after") +
        specs::repetition_suffix(spec, arm.reconstruction, arm.finetune_seed);
    const auto found = std::find_if(arms.begin(), arms.end(),
                                    [&](const ArmWeights& a) { return a.name == name; });
    prepared[arm.name] = found->prepared;
  }
  return prepared;
}

}  // namespace

trials::PreparedDetectors prepare_detectors(const specs::ExperimentSpec& spec,
                                            std::span<const fs::path> bundles,
                                            std::span<const trials::Starts> starts,
                                            const fs::path& work, int workers,
                                            support::StageTimes& times) {
  const auto needs = [&](specs::ArmDetector wanted) {
    return std::any_of(spec.arms.begin(), spec.arms.end(),
                       [&](const specs::ArmSpec& arm) { return arm.detector == wanted; });
  };
  if (!needs(specs::ArmDetector::kBefore) && !needs(specs::ArmDetector::kAfter)) return {};
  if (needs(specs::ArmDetector::kAfter) && !spec.detectors.finetune &&
      !fs::exists(spec.detectors.after)) {
    throw core::InputError::expected(
        spec.detectors.after.string(),
        "weights, or a detectors.finetune section that makes them", "none");
  }
  const fs::path before = prepare_before(spec, work, times);
  if (spec.detectors.finetune) {
    return tuned_detectors(spec, bundles, starts, before, work, workers, times);
  }
  trials::PreparedDetectors prepared;
  for (const specs::ArmSpec& arm : spec.arms) {
    if (arm.detector == specs::ArmDetector::kBefore) prepared[arm.name].file = before;
    if (arm.detector == specs::ArmDetector::kAfter)
      prepared[arm.name].file = spec.detectors.after;
  }
  return prepared;
}

}  // namespace segsim::experiments::runs
