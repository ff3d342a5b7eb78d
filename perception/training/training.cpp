#include "perception/training/training.h"

#include <algorithm>
#include <chrono>
#include <cstdio>

#include "core/error.h"
#include "core/file_io.h"
#include "core/progress.h"
#include "perception/detector/detector.h"
#include "perception/detector/evaluate.h"
#include "perception/training/internal/trainer.h"
#include "perception/training/internal/training_inputs.h"

namespace segsim::perception {
namespace {

namespace fs = std::filesystem;

fs::path best_file(const TrainOptions& options) { return options.output.string() + ".best"; }

bool patience_ended(const BestSoFar& best, const TrainOptions& options) {
  return options.patience > 0 && best.without_better >= options.patience;
}

/// Evaluates the average; the best so far is kept in a file.
void validate(Trainer& trainer, const TrainOptions& options, const TrainingInputs& inputs) {
  double fitness = 0.0;
  core::write_via_temporary(options.output.string() + ".candidate", [&](const fs::path& file) {
    write_weights(file, trainer.weights());
    const auto results = detect_all(file, *inputs.validation);
    const PrecisionReport precision =
        average_precision(results, static_cast<int>(inputs.class_names.size()), 0.5F);
    fitness = 0.1 * std::max(0.0, precision.ap50) + 0.9 * std::max(0.0, precision.ap);
  });
  const fs::path candidate = options.output.string() + ".candidate";
  BestSoFar& best = trainer.best;
  if (best.step == 0 || fitness > best.fitness) {
    best = {trainer.step(), fitness, 0};
    fs::rename(candidate, best_file(options));
  } else {
    ++best.without_better;
    fs::remove(candidate);
  }
}

/// Keeps what there is and says so.
[[noreturn]] void stop_diverged(const Trainer& trainer, const TrainOptions& options) {
  const fs::path file = options.output.string() + ".last_good";
  std::string kept = "the weights before it are in " + file.string();
  try {
    write_weights(file, trainer.weights());
  } catch (const core::InputError&) {  // The average is no number either.
    kept = "no weights are left";
  }
  throw core::InputError::expected("training: loss at step " + std::to_string(trainer.step()),
                                   "a finite number (try a lower learning rate)",
                                   "none; " + kept);
}

/// The weights that training has chosen: the best by validation, else the last.
DetectorWeights chosen_weights(const Trainer& trainer, const TrainOptions& options) {
  if (trainer.best.step == 0) return trainer.weights();
  return read_weights(best_file(options));
}

}  // namespace

TrainReport train(const TrainOptions& wanted) {
  check_train_options(wanted);
  TrainOptions options = wanted;
  const TrainingInputs inputs = read_training_inputs(options);
  const ThreadCountScope thread_scope(options.threads);
  Trainer trainer(options, inputs);

  TrainReport report;
  report.first_step = static_cast<int>(trainer.step());
  report.parameters = trainer.parameter_count();
  report.classes_without_boxes = inputs.classes_without_boxes;
  report.stopped_early = patience_ended(trainer.best, options);  // Of a state that ended so.
  std::optional<core::Progress> progress;
  if (options.show_progress) progress.emplace("training", options.steps);
  const auto begin = std::chrono::steady_clock::now();
  bool stopped = false;
  while (trainer.step() < options.steps && !stopped && !report.stopped_early) {
    const std::optional<double> loss = trainer.advance();
    if (!loss) stop_diverged(trainer, options);
    report.losses.push_back(*loss);
    const auto done = static_cast<int>(trainer.step());
    if (progress) {
      char note[48];
      std::snprintf(note, sizeof note, "loss %.3f", *loss);
      progress->update(done, note);
    }
    if (options.validate_every > 0 &&
        (done % options.validate_every == 0 || done == options.steps)) {
      validate(trainer, options, inputs);
      report.stopped_early = patience_ended(trainer.best, options);
    }
    stopped = options.on_step && !options.on_step(done, *loss);
    const bool due = options.checkpoint_every > 0 && done % options.checkpoint_every == 0;
    if (stopped || (due && done < options.steps)) trainer.save_state();
  }
  const double wall_ms =
      std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin)
          .count();
  report.steps_done = static_cast<int>(trainer.step());
  report.mean_step_ms =
      wall_ms / static_cast<double>(std::max<std::size_t>(1, report.losses.size()));
  report.best_step = static_cast<int>(trainer.best.step);
  report.best_fitness = trainer.best.fitness;
  if (progress) progress->finish();
  if (stopped) return report;

  report.operating =
      write_with_threshold(options.output, chosen_weights(trainer, options),
                           inputs.validation ? *inputs.validation : inputs.train);
  fs::remove(trainer.state_file());
  fs::remove(best_file(options));
  report.finished = true;
  return report;
}

}  // namespace segsim::perception
