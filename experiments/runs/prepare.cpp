#include "experiments/runs/prepare.h"

#include <algorithm>
#include <cstdio>
#include <functional>
#include <mutex>
#include <numeric>
#include <optional>
#include <sstream>
#include <utility>

#include "core/error.h"
#include "core/file_io.h"
#include "core/progress.h"
#include "core/random.h"
#include "core/scene_bundle.h"
#include "experiments/detection/arm_weights.h"
#include "experiments/detection/label_report.h"
#include "experiments/detection/source_dataset.h"
#include "experiments/detection/view_labels.h"
#include "experiments/support/formatted.h"
#include "experiments/support/side_by_side.h"
#include "experiments/support/step_record.h"
#include "perception/checkpoint/weights_file.h"
#include "perception/data/dataset.h"
#include "perception/detector/detector.h"
#include "perception/training/training.h"
#include "sim/ground/robot.h"
#include "worlds/procedural/procedural_furniture.h"

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
                                              scene.family) != finetune.scenes.end();
}

std::vector<LabelScene> label_scenes_of(const ExperimentSpec& spec, int reconstruction,
                                        std::span<const fs::path> bundles,
                                        std::span<const Starts> starts) {
  std::vector<LabelScene> scenes;
  for (std::size_t i = 0; i < spec.scenes.size(); ++i) {
    if (spec.scenes[i].reconstruction != reconstruction) continue;
    if (!takes_part(*spec.detectors.finetune, spec.scenes[i])) continue;
    scenes.push_back({&spec.scenes[i], bundles[i], starts[i]});
  }
  return scenes;
}

/// How the views of a set are drawn.
struct ViewRule {
  std::string purpose;  ///< "train", "validation" or "test".
  int per_scene = 0;
  double facing_share = 0.0;
};

ViewRule view_rule(const FinetuneSpec& finetune, const std::string& purpose) {
  if (purpose == "train") return {purpose, finetune.views_per_scene, finetune.facing_share};
  const int views = finetune.validation_views_per_scene > 0
                        ? finetune.validation_views_per_scene
                        : std::max(10, finetune.views_per_scene / kValidationShare);
  return {purpose, views, finetune.validation_facing_share};
}

/// One data set of views: of a training, or held out from all trainings of a reconstruction.
class LabelSet {
 public:
  /// @param scenes  Outlive this object.
  LabelSet(const ExperimentSpec& spec, const std::vector<LabelScene>& scenes,
           const std::string& purpose, std::uint64_t seed, fs::path folder)
      : spec_(spec),
        scenes_(scenes),
        rule_(view_rule(*spec.detectors.finetune, purpose)),
        seed_(seed),
        folder_(std::move(folder)),
        record_(folder_ / (purpose + ".step"), recipe()) {}

  [[nodiscard]] fs::path json() const { return folder_ / (rule_.purpose + ".json"); }
  [[nodiscard]] bool is_current() const { return fs::exists(json()) && record_.is_current(); }
  /// Views at most, over all scenes.
  [[nodiscard]] int views() const {
    return rule_.per_scene * static_cast<int>(scenes_.size());
  }

  /// @param on_view  Called after each.
  void make(const std::vector<std::string>& class_names,
            const std::function<void()>& on_view) const {
    perception::CocoDataset all;
    for (const LabelScene& scene : scenes_) {
      ViewLabelOptions options;
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
      append_dataset(all, label_views(core::load_bundle(scene.bundle),
                                      sim::RobotModel::by_name(spec_.robot), options, folder_)
                              .dataset);
    }
    perception::write_coco(json(), all);
    record_.mark_done();
  }

 private:
  [[nodiscard]] std::string recipe() const {
    const core::CameraIntrinsics camera = view_camera(spec_);
    const FinetuneSpec& finetune = *spec_.detectors.finetune;
    std::ostringstream text;
    text << "views v3, " << rule_.purpose << ", " << rule_.per_scene << " per scene, "
         << rule_.facing_share << " facing, seed " << seed_ << ", robot " << spec_.robot
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

  const ExperimentSpec& spec_;
  const std::vector<LabelScene>& scenes_;
  ViewRule rule_;
  std::uint64_t seed_;
  fs::path folder_;
  StepRecord record_;
};

/// Makes those that are not there, side by side.
void make_label_sets(const std::vector<LabelSet>& sets,
                     const std::vector<std::string>& class_names, int workers,
                     StageTimes& times) {
  StageTimes::Timer timer(times, "label views");
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
  side_by_side(missing.size(), workers, [&](std::size_t k) {
    missing[k]->make(class_names, [&] {
      const std::lock_guard<std::mutex> lock(mutex);
      progress.update(++done);
    });
  });
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
  return std::all_of(worlds::goal_class_names().begin(), worlds::goal_class_names().end(),
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
fs::path prepare_before(const ExperimentSpec& spec, const fs::path& work, StageTimes& times) {
  const DetectorSpec& detectors = spec.detectors;
  if (fs::exists(detectors.before)) return detectors.before;
  if (!detectors.pretrain) {
    throw core::InputError::expected(
        detectors.before.string(), "weights, or a detectors.pretrain section that makes them",
        "none");
  }
  StageTimes::Timer timer(times, "pre-training");
  timer.working();
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

/// One draw of everything that is random in a fine-tuning: its views and its steps.
struct Training {
  int reconstruction = 1;
  std::uint64_t seed = 0;
  std::string suffix;  ///< Of its files.
};

/// Each once, though several arms may run its detector.
std::vector<Training> trainings_of(const ExperimentSpec& spec) {
  std::vector<Training> trainings;
  for (const ArmSpec& arm : spec.arms) {
    if (!arm.finetune_seed) continue;
    const auto same = [&](const Training& training) {
      return training.reconstruction == arm.reconstruction &&
             training.seed == *arm.finetune_seed;
    };
    if (std::any_of(trainings.begin(), trainings.end(), same)) continue;
    trainings.push_back({arm.reconstruction, *arm.finetune_seed,
                         repetition_suffix(spec, arm.reconstruction, arm.finetune_seed)});
  }
  return trainings;
}

/// "detector-after.bin" -> "detector-after.s3.bin"
fs::path with_suffix(const fs::path& file, const std::string& suffix) {
  return file.parent_path() / (file.stem().string() + suffix + file.extension().string());
}

/// One fine-tuning and whether it was done.
class FineTuning {
 public:
  /// @param views, validation  Data sets.
  FineTuning(const ExperimentSpec& spec, const fs::path& before, const fs::path& views,
             const fs::path& validation, const Training& training, const fs::path& work)
      : finetune_(*spec.detectors.finetune),
        before_(before),
        views_(views),
        validation_(validation),
        seed_(training.seed),
        output_(with_suffix(spec.detectors.after, training.suffix)),
        record_(work / ("detector-after" + training.suffix + ".step"), recipe()) {}

  [[nodiscard]] const fs::path& output() const { return output_; }
  [[nodiscard]] bool is_current() const { return fs::exists(output_) && record_.is_current(); }

  /// @param mix  Data set of the source domain; empty: none is mixed in.
  void make(const fs::path& mix, const std::function<void(int, double)>& on_step) const {
    perception::TrainOptions train;
    train.initial_weights = before_;
    train.train_json = views_;
    train.validation_json = validation_;
    train.output = output_;
    train.steps = finetune_.steps;
    train.seed = seed_;
    train.threads = finetune_.threads;
    if (finetune_.learning_rate > 0.0) train.learning_rate = finetune_.learning_rate;
    if (!mix.empty()) {
      train.mix_json = mix;
      train.mix_share = finetune_.mix_share;
    }
    train.show_progress = false;
    train.on_step = [&](int steps_done, double loss) {
      on_step(steps_done, loss);
      return true;
    };
    perception::train(train);
    record_.mark_done();
  }

 private:
  [[nodiscard]] std::string recipe() const {
    std::ostringstream text;
    text << "finetune v2 from " << core::sha256_of_file(before_) << " on "
         << core::sha256_of_file(views_) << ", " << finetune_.steps << " steps, rate "
         << finetune_.learning_rate << ", seed " << seed_ << ", " << finetune_.threads
         << " threads";
    if (finetune_.mix_share > 0.0) {
      text << ", mixed " << finetune_.mix_share << " of " << finetune_.mix_rooms << " rooms";
    }
    return text.str();
  }

  const FinetuneSpec& finetune_;
  fs::path before_, views_, validation_;
  std::uint64_t seed_;
  fs::path output_;
  StepRecord record_;
};

/// Makes those that are not there: as many side by side as the workers have threads for.
void fine_tune(const ExperimentSpec& spec, const std::vector<FineTuning>& steps,
               const fs::path& work, int workers, StageTimes& times) {
  StageTimes::Timer timer(times, "fine-tuning");
  std::vector<const FineTuning*> missing;
  for (const FineTuning& step : steps) {
    if (!step.is_current()) missing.push_back(&step);
  }
  if (missing.empty()) return;
  timer.working();
  const FinetuneSpec& finetune = *spec.detectors.finetune;
  fs::path mix;
  if (finetune.mix_share > 0.0) {
    SourceDatasetOptions source;
    source.seed = kMixSeed;
    source.rooms = finetune.mix_rooms;
    source.views_per_room = kViewsPerRoom;
    mix = render_source_dataset(source, work / "source_mix");
  }
  const int at_once =
      std::clamp(workers / finetune.threads, 1, static_cast<int>(missing.size()));
  std::printf("fine-tuning the detector: %zu x %d steps, %d side by side\n", missing.size(),
              finetune.steps, at_once);
  core::Progress progress("fine-tuning",
                          static_cast<std::int64_t>(missing.size()) * finetune.steps);
  std::mutex mutex;  // Guards what follows.
  std::vector<int> done(missing.size(), 0);
  side_by_side(missing.size(), at_once, [&](std::size_t k) {
    missing[k]->make(mix, [&, k](int steps_done, double loss) {
      const std::lock_guard<std::mutex> lock(mutex);
      done[k] = steps_done;
      progress.update(std::accumulate(done.begin(), done.end(), std::int64_t{0}),
                      print("loss %.3f", loss));
    });
  });
}

void print_precision(const std::string& name, const HeldOutPrecision& p) {
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

Views prepare_views(const ExperimentSpec& spec, std::span<const fs::path> bundles,
                    std::span<const Starts> starts, const std::vector<Training>& trainings,
                    const std::vector<std::string>& class_names, const fs::path& work,
                    int workers, StageTimes& times) {
  const FinetuneSpec& finetune = *spec.detectors.finetune;
  Views views;
  for (int r = 1; r <= spec.repetitions.reconstruct_seeds; ++r) {
    views.held_out.push_back({label_scenes_of(spec, r, bundles, starts), {}, {}});
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
    const std::string suffix = repetition_suffix(spec, r, std::nullopt);
    held_out.validation = add(r, "validation", finetune.seed, suffix);
    held_out.test = add(r, "test", finetune.seed, suffix);
  }
  make_label_sets(sets, class_names, workers, times);
  return views;
}

/// Weights that become an arm's: with a threshold, and measured.
struct ArmWeights {
  std::string name;  ///< "before", "after.s3".
  fs::path weights;
  HeldOutSets sets;
  PreparedWeights prepared;
};

void choose_thresholds(std::vector<ArmWeights>& arms, const ExperimentSpec& spec,
                       const std::vector<std::string>& class_names, const fs::path& work,
                       int workers, StageTimes& times) {
  StageTimes::Timer timer(times, "thresholds");
  if (spec.detectors.finetune->measure_elsewhere &&
      shares_classes_of_procedural_homes(class_names)) {
    HeldOutSets foreign;
    render_foreign_sets(spec, work, foreign);
    for (ArmWeights& arm : arms) {
      arm.sets.source = foreign.source;
      arm.sets.unseen = foreign.unseen;
    }
  }
  side_by_side(arms.size(), workers, [&](std::size_t k) {
    const perception::ThreadCountScope one(1);  // Scores depend on the count.
    ArmWeights& arm = arms[k];
    arm.prepared.file = work / ("arm-" + arm.name + ".weights");
    arm.prepared.held_out =
        prepare_arm_weights(arm.weights, arm.sets, spec.detectors.finetune->precision_target,
                            arm.prepared.file, [&] { timer.working(); });
  });
  for (const ArmWeights& arm : arms) print_precision(arm.name, *arm.prepared.held_out);
}

/// Detectors of a spec that fine-tunes.
PreparedDetectors tuned_detectors(const ExperimentSpec& spec,
                                  std::span<const fs::path> bundles,
                                  std::span<const Starts> starts, const fs::path& before,
                                  const fs::path& work, int workers, StageTimes& times) {
  const std::vector<std::string> class_names = perception::read_weights(before).class_names;
  const std::vector<Training> trainings = trainings_of(spec);
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
  fine_tune(spec, steps, work, workers, times);

  std::vector<ArmWeights> arms;
  const auto add = [&](const std::string& name, int reconstruction, const fs::path& weights) {
    const HeldOutViews& sets = held_out(reconstruction);
    arms.push_back({name, weights, {sets.validation, sets.test, {}, {}}, {}});
  };
  for (int r = 1; r <= spec.repetitions.reconstruct_seeds; ++r) {
    add("before" + repetition_suffix(spec, r, std::nullopt), r, before);
  }
  for (std::size_t k = 0; k < trainings.size(); ++k) {
    add("after" + trainings[k].suffix, trainings[k].reconstruction, steps[k].output());
    arms.back().prepared.start_leak =
        start_leak(views.training[k], held_out(trainings[k].reconstruction).scenes,
                   spec.detectors.finetune->start_clearance_m);
  }
  choose_thresholds(arms, spec, class_names, work, workers, times);

  PreparedDetectors prepared;
  for (const ArmSpec& arm : spec.arms) {
    if (arm.detector != ArmDetector::kBefore && arm.detector != ArmDetector::kAfter) continue;
    const std::string name = (arm.detector == ArmDetector::kBefore ? "before" : "after") +
                             repetition_suffix(spec, arm.reconstruction, arm.finetune_seed);
    const auto found = std::find_if(arms.begin(), arms.end(),
                                    [&](const ArmWeights& a) { return a.name == name; });
    prepared[arm.name] = found->prepared;
  }
  return prepared;
}

}  // namespace

PreparedDetectors prepare_detectors(const ExperimentSpec& spec,
                                    std::span<const fs::path> bundles,
                                    std::span<const Starts> starts, const fs::path& work,
                                    int workers, StageTimes& times) {
  const auto needs = [&](ArmDetector wanted) {
    return std::any_of(spec.arms.begin(), spec.arms.end(),
                       [&](const ArmSpec& arm) { return arm.detector == wanted; });
  };
  if (!needs(ArmDetector::kBefore) && !needs(ArmDetector::kAfter)) return {};
  if (needs(ArmDetector::kAfter) && !spec.detectors.finetune &&
      !fs::exists(spec.detectors.after)) {
    throw core::InputError::expected(
        spec.detectors.after.string(),
        "weights, or a detectors.finetune section that makes them", "none");
  }
  const fs::path before = prepare_before(spec, work, times);
  if (spec.detectors.finetune) {
    return tuned_detectors(spec, bundles, starts, before, work, workers, times);
  }
  PreparedDetectors prepared;
  for (const ArmSpec& arm : spec.arms) {
    if (arm.detector == ArmDetector::kBefore) prepared[arm.name].file = before;
    if (arm.detector == ArmDetector::kAfter) prepared[arm.name].file = spec.detectors.after;
  }
  return prepared;
}

}  // namespace segsim::experiments
