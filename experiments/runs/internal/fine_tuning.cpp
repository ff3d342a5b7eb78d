#include "experiments/runs/internal/fine_tuning.h"

#include <algorithm>
#include <cstdio>
#include <mutex>
#include <numeric>
#include <sstream>
#include <utility>

#include "core/file_io.h"
#include "core/formatted.h"
#include "core/progress.h"
#include "experiments/detection/source_dataset.h"
#include "experiments/support/side_by_side.h"
#include "experiments/support/stop_signal.h"
#include "experiments/trials/arm_detector.h"
#include "perception/checkpoint/weights_file.h"
#include "perception/training/training_config.h"

namespace segsim::experiments::runs::internal {
namespace {

namespace fs = std::filesystem;

/// Of the rooms that are mixed in; pre-training uses seeds from 1 (docs/results/detectors.md).
constexpr std::uint64_t kMixSeed = 500'000;

/// "detector-after.bin" -> "detector-after.s3.bin"
fs::path with_suffix(const fs::path& file, const std::string& suffix) {
  return file.parent_path() / (file.stem().string() + suffix + file.extension().string());
}

/// Of the network that `weights` are for.
perception::TrainOptions recipe_of_network(const fs::path& weights) {
  const std::string architecture = perception::read_weights(weights).architecture;
  perception::TrainOptions options = perception::default_train_options(
      perception::model_of_architecture(architecture, weights.string()));
  options.epochs = 0;  // The spec counts steps.
  return options;
}

/// Trainings that share the processors end together. Fewer than two rounds are one: of three
/// on two processors the third would leave one of them idle.
int trainings_at_once(int trainings, int places) {
  return trainings < 2 * places ? trainings : places;
}

}  // namespace

Training training_in(const specs::ExperimentSpec& spec, const specs::ArmSpec& arm,
                     const specs::SceneSpec& scene) {
  specs::TuningSet set = specs::tuning_set(spec, arm.detector, scene);
  const std::string suffix =
      (set.name.empty() ? "" : "." + set.name) +
      specs::repetition_suffix(spec, arm.reconstruction, arm.finetune_seed);
  return {arm.reconstruction, arm.finetune_seed.value_or(0), suffix, std::move(set)};
}

std::vector<Training> trainings_of(const specs::ExperimentSpec& spec) {
  std::vector<Training> trainings;
  for (const specs::ArmSpec& arm : spec.arms) {
    if (!arm.finetune_seed) continue;
    for (const specs::SceneSpec& scene : spec.scenes) {
      if (scene.reconstruction != arm.reconstruction) continue;
      Training training = training_in(spec, arm, scene);
      const auto same = [&](const Training& other) { return other.suffix == training.suffix; };
      if (std::any_of(trainings.begin(), trainings.end(), same)) continue;
      trainings.push_back(std::move(training));
    }
  }
  return trainings;
}

FineTuning::FineTuning(const specs::ExperimentSpec& spec, fs::path before,
                       std::vector<std::string> new_classes, fs::path views,
                       fs::path validation, const Training& training, const fs::path& work)
    : finetune_(*spec.detectors.finetune),
      device_(trials::compute_device(spec)),
      before_(std::move(before)),
      views_(std::move(views)),
      validation_(std::move(validation)),
      new_classes_(std::move(new_classes)),
      seed_(training.seed),
      output_(with_suffix(spec.detectors.after, training.suffix)),
      record_(work / ("detector-after" + training.suffix + ".step"), recipe()) {}

bool FineTuning::is_current() const { return fs::exists(output_) && record_.is_current(); }

void FineTuning::make(const fs::path& mix,
                      const std::function<void(int, double)>& on_step) const {
  perception::TrainOptions train = recipe_of_network(before_);
  train.initial_weights = before_;
  if (!new_classes_.empty()) {
    train.class_names = perception::read_weights(before_).class_names;
    train.class_names.insert(train.class_names.end(), new_classes_.begin(),
                             new_classes_.end());
  }
  train.train_json = views_;
  train.validation_json = validation_;
  train.output = output_;
  train.steps = finetune_.steps;
  train.seed = seed_;
  train.threads = finetune_.threads;
  train.device = device_;
  if (finetune_.learning_rate > 0.0) {
    train.learning_rate = finetune_.learning_rate;
    if (train.optimizer == perception::Optimizer::kAuto) {
      train.optimizer = perception::Optimizer::kAdamW;
    }
  }
  perception::fit_to_adamw(train, {});
  if (!mix.empty()) {
    train.mix_json = mix;
    train.mix_share = finetune_.mix_share;
  }
  train.show_progress = false;
  train.on_step = [&](int steps_done, double loss) {
    on_step(steps_done, loss);
    return !support::StopOnSignal::requested();  // Then the state is written.
  };
  if (!perception::train(train).finished) support::StopOnSignal::check();
  record_.mark_done();
}

std::string FineTuning::recipe() const {
  std::ostringstream text;
  text << "finetune v2 from " << core::sha256_of_file(before_) << " on "
       << core::sha256_of_file(views_) << ", " << finetune_.steps << " steps, rate "
       << finetune_.learning_rate << ", seed " << seed_ << ", " << finetune_.threads
       << " threads";
  const std::string model = recipe_of_network(before_).model;
  if (model != perception::TrainOptions{}.model) text << ", recipe of " << model;
  if (finetune_.mix_share > 0.0) {
    text << ", mixed " << finetune_.mix_share << " of " << finetune_.mix_rooms << " rooms";
  }
  for (const std::string& name : new_classes_) text << ", new " << name;
  if (device_ == perception::ComputeDevice::kCuda) text << ", on cuda";
  return text.str();
}

void fine_tune(const specs::ExperimentSpec& spec, const std::vector<FineTuning>& steps,
               const fs::path& work, int workers, support::StageTimes& times) {
  support::StageTimes::Timer timer(times, "fine-tuning");
  std::vector<const FineTuning*> missing;
  for (const FineTuning& step : steps) {
    if (!step.is_current()) missing.push_back(&step);
  }
  if (missing.empty()) return;
  timer.working();
  const specs::FinetuneSpec& finetune = *spec.detectors.finetune;
  fs::path mix;
  if (finetune.mix_share > 0.0) {
    detection::SourceDatasetOptions source;
    source.seed = kMixSeed;
    source.rooms = finetune.mix_rooms;
    source.views_per_room = kViewsPerRoom;
    mix = detection::render_source_dataset(source, work / "source_mix");
  }
  const int at_once = trainings_at_once(static_cast<int>(missing.size()),
                                        std::max(1, workers / finetune.threads));
  std::printf("fine-tuning the detector: %zu x %d steps, %d side by side\n", missing.size(),
              finetune.steps, at_once);
  core::Progress progress("fine-tuning",
                          static_cast<std::int64_t>(missing.size()) * finetune.steps);
  std::mutex mutex;  // Guards what follows.
  std::vector<int> done(missing.size(), 0);
  support::side_by_side(missing.size(), at_once, [&](std::size_t k) {
    missing[k]->make(mix, [&, k](int steps_done, double loss) {
      const std::lock_guard<std::mutex> lock(mutex);
      done[k] = steps_done;
      progress.update(std::accumulate(done.begin(), done.end(), std::int64_t{0}),
                      core::print("loss %.3f", loss));
    });
  });
}

}  // namespace segsim::experiments::runs::internal
