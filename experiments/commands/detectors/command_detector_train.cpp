#include <cstdio>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>

#include "core/file_io.h"
#include "experiments/commands/detectors/detector_commands.h"
#include "experiments/detection/source_dataset.h"
#include "experiments/support/stop_signal.h"
#include "perception/checkpoint/weights_file.h"
#include "perception/training/training.h"
#include "perception/training/training_config.h"

namespace segsim::experiments::commands::detectors {
namespace {

namespace fs = std::filesystem;
using perception::TrainOptions;

/// Defaults depend on the network, which may be known only by the weights to start from, so
/// flags are gathered first: defaults, then --config, then what was given.
class TrainingFlags {
 public:
  explicit TrainingFlags(CLI::App& command) : command_(command) {
    add("--out", &TrainOptions::output, "Weights file to write")->required();
    add("--steps", &TrainOptions::steps, "Optimiser steps; turns epochs off")
        ->check(CLI::Range(1, 10'000'000));
    add("--epochs", &TrainOptions::epochs, "Passes through the training set instead of steps");
    add("--batch", &TrainOptions::batch, "Images per forward pass");
    add("--rate", &TrainOptions::learning_rate, "Learning rate; turns `optimizer: auto` off");
    add("--seed", &TrainOptions::seed, "Of initial weights and augmentation");
    add("--threads", &TrainOptions::threads, "CPU threads");
    add("--validation", &TrainOptions::validation_json,
        "COCO JSON on which the score threshold, and with validate_every the step is chosen");
    add("--freeze", &TrainOptions::frozen,
        "Layers that do not move: begins of parameter names, or backbone");
    add("--validate-every", &TrainOptions::validate_every,
        "Steps between evaluations on --validation; the best is kept");
    add("--patience", &TrainOptions::patience,
        "Evaluations without a better one after which training stops");
    command.add_option("--config", config_,
                       "YAML with any option of perception/training_defaults.yaml");
    command
        .add_option_function<std::string>(
            "--device",
            [this](const std::string& name) {
              values_.device = name == "cuda" ? perception::TrainDevice::kCuda
                                              : perception::TrainDevice::kCpu;
            },
            "cpu or cuda; default cpu")
        ->check(CLI::IsMember({"cpu", "cuda"}));
    command.add_flag("--mixed-precision", values_.mixed_precision,
                     "float16 where it is safe; cuda only");
  }

  CLI::Option* add_model() {
    return add("--model", &TrainOptions::model,
               "Network: small, yolov13n, s, l or x, centernet")
        ->check(CLI::IsMember(perception::train_models()));
  }
  CLI::Option* add_width() {
    return add("--width", &TrainOptions::width,
               "Channel multiplier of the small network: 0.5 = 0.45 M parameters");
  }
  CLI::Option* add_input_px() {
    return add("--input-px", &TrainOptions::input_px, "Side of the square input");
  }
  /// What a training on files needs, beside the flags of all.
  void add_data() {
    add("--train", &TrainOptions::train_json, "COCO JSON, for example of `segsim label`")
        ->required();
    add("--classes", &TrainOptions::class_names,
        "Classes of the detector; default: those of --from, else of --train. Rows of classes "
        "that --from knows by name are kept");
    add("--mix", &TrainOptions::mix_json,
        "COCO JSON of which a share is mixed in, against forgetting");
    add("--mix-share", &TrainOptions::mix_share, "That share, [0, 1); default 0.25");
  }
  CLI::Option* add_initial() {
    return add("--from", &TrainOptions::initial_weights, "Weights to start from");
  }

  /// @param change  Applied to the defaults of the network.
  [[nodiscard]] TrainOptions options(
      const std::function<void(TrainOptions&)>& change = {}) const {
    std::string model = values_.model;
    if (!values_.initial_weights.empty()) {
      model = perception::model_of_architecture(
          perception::read_weights(values_.initial_weights).architecture,
          values_.initial_weights.string());
    }
    TrainOptions result = perception::default_train_options(model);
    if (change) change(result);
    std::vector<std::string> named;
    if (!config_.empty()) named = perception::read_train_config(config_, result);
    for (const auto& copy : copies_) copy(result);
    if (command_.count("--steps") > 0) result.epochs = 0;
    if (command_.count("--rate") > 0 && result.optimizer == perception::Optimizer::kAuto) {
      result.optimizer = perception::Optimizer::kAdamW;
    }
    perception::fit_to_adamw(result, named);
    result.model = model;
    result.device = values_.device;
    result.mixed_precision = values_.mixed_precision;
    return result;
  }

 private:
  template <class Value>
  CLI::Option* add(const std::string& name, Value TrainOptions::*member,
                   const std::string& help) {
    CLI::Option* option = command_.add_option(name, values_.*member, help);
    copies_.push_back([this, option, member](TrainOptions& target) {
      if (option->count() > 0) target.*member = values_.*member;
    });
    return option;
  }

  CLI::App& command_;
  TrainOptions values_;
  fs::path config_;
  std::vector<std::function<void(TrainOptions&)>> copies_;
};

void run_training(TrainOptions options) {
  const support::StopOnSignal signals;
  options.on_step = [](int, double) { return !support::StopOnSignal::requested(); };
  const perception::TrainReport report = perception::train(options);
  if (!report.finished) {
    support::StopOnSignal::check("step " + std::to_string(report.steps_done) + " is kept in " +
                                 options.output.string() +
                                 ".state, where the same command goes on");
  }
  for (const std::string& name : report.classes_without_boxes) {
    std::fprintf(stderr, "warning: %s has no box of class '%s'\n",
                 options.train_json.string().c_str(), name.c_str());
  }
  std::printf("%s: %lld parameters, %d steps, %.0f ms a step\n",
              options.output.string().c_str(), static_cast<long long>(report.parameters),
              report.steps_done, report.mean_step_ms);
  if (report.best_step > 0) {
    std::printf("best of validation at step %d: 0.1 AP50 + 0.9 AP = %.1f%s\n",
                report.best_step, 100.0 * report.best_fitness,
                report.stopped_early ? "; stopped early" : "");
  }
  std::printf("score threshold %.3f: precision %.3f, recall %.3f\n",
              report.operating.score_threshold, report.operating.precision(),
              report.operating.recall());
  std::printf("sha256 %s\n", core::sha256_of_file(options.output).c_str());
}

void add_train(CLI::App& detector) {
  CLI::App* command = detector.add_subcommand("train", "Train on labelled views from scratch");
  auto flags = std::make_shared<TrainingFlags>(*command);
  flags->add_model();
  flags->add_width();
  flags->add_input_px();
  flags->add_data();
  command->callback([flags] { run_training(flags->options()); });
}

void add_finetune(CLI::App& detector) {
  CLI::App* command = detector.add_subcommand(
      "finetune", "Train on: the 'after' weights, from `segsim label` views");
  auto flags = std::make_shared<TrainingFlags>(*command);
  flags->add_initial()->required();
  flags->add_data();
  command->callback([flags] { run_training(flags->options()); });
}

void add_pretrain(CLI::App& detector) {
  struct Flags {
    explicit Flags(CLI::App& command) : train(command) {}
    TrainingFlags train;
    detection::SourceDatasetOptions source;
    fs::path dataset;
  };
  CLI::App* command = detector.add_subcommand(
      "pretrain", "Train the 'before' weights on plain procedural rooms, rendered on the way");
  auto flags = std::make_shared<Flags>(*command);
  flags->train.add_model();
  flags->train.add_width();
  command->add_option("--rooms", flags->source.rooms, "Rooms to render")
      ->capture_default_str();
  command->add_option("--views", flags->source.views_per_room, "Views of each room")
      ->capture_default_str();
  command->add_option("--dataset", flags->dataset, "Folder for the rendered views")
      ->required();
  command->callback([flags] {
    constexpr int kPretrainSteps = 2000;
    TrainOptions options =
        flags->train.options([](TrainOptions& defaults) { defaults.steps = kPretrainSteps; });
    options.train_json = detection::render_source_dataset(flags->source, flags->dataset);
    run_training(options);
  });
}

}  // namespace

void add_detector_training(CLI::App& detector) {
  add_train(detector);
  add_pretrain(detector);
  add_finetune(detector);
}

}  // namespace segsim::experiments::commands::detectors
