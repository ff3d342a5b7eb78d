#include <cstdio>
#include <filesystem>
#include <memory>

#include <CLI/CLI.hpp>

#include "core/file_io.h"
#include "experiments/commands.h"
#include "experiments/source_dataset.h"
#include "perception/evaluate.h"
#include "perception/training.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;

void print_report(const perception::TrainReport& report, const fs::path& weights) {
  std::printf("%s: %lld parameters, %d steps, %.0f ms a step\n", weights.string().c_str(),
              static_cast<long long>(report.parameters), report.steps_done,
              report.mean_step_ms);
  std::printf("score threshold %.3f: precision %.3f, recall %.3f\n",
              report.operating.score_threshold, report.operating.precision(),
              report.operating.recall());
  std::printf("sha256 %s\n", core::sha256_of_file(weights).c_str());
}

void print_evaluation(const perception::EvaluationReport& report) {
  const auto percent = [](double ap) { return ap < 0.0 ? 0.0 : 100.0 * ap; };
  std::printf("%-18s %8s %8s %8s %10s %8s\n", "class", "objects", "AP50", "AP", "precision",
              "recall");
  for (std::size_t i = 0; i < report.class_names.size(); ++i) {
    const perception::ClassPrecision& c = report.precision.classes[i];
    if (c.objects == 0) continue;
    std::printf("%-18s %8d %8.1f %8.1f %10.3f %8.3f\n", report.class_names[i].c_str(),
                c.objects, percent(c.ap50), percent(c.ap), c.operating.precision(),
                c.operating.recall());
  }
  const perception::OperatingPoint& all = report.precision.operating;
  std::printf(
      "%-18s %8s %8.1f %8.1f %10.3f %8.3f   (threshold %.3f, %d images, %.1f ms each)\n",
      "mean", "", percent(report.precision.ap50), percent(report.precision.ap),
      all.precision(), all.recall(), all.score_threshold, report.images,
      report.mean_detect_ms);
}

/// Flags that both kinds of training share.
void add_training_flags(CLI::App& command, perception::TrainOptions& options) {
  command.add_option("--out", options.output, "Weights file to write")->required();
  command.add_option("--steps", options.steps, "Optimiser steps of 8 images")
      ->check(CLI::Range(1, 10'000'000))
      ->capture_default_str();
  command.add_option("--batch", options.batch, "Images per step")->capture_default_str();
  command.add_option("--rate", options.learning_rate, "Learning rate of AdamW")
      ->capture_default_str();
  command.add_option("--seed", options.seed, "Of initial weights and augmentation")
      ->capture_default_str();
  command.add_option("--threads", options.threads, "CPU threads")->capture_default_str();
  command.add_option("--validation", options.validation_json,
                     "COCO JSON on which the score threshold is chosen");
}

void add_pretrain(CLI::App& detector) {
  struct Flags {
    perception::TrainOptions train;
    SourceDatasetOptions source;
    fs::path dataset;
  };
  auto flags = std::make_shared<Flags>();
  flags->train.steps = 2000;
  CLI::App* command = detector.add_subcommand(
      "pretrain", "Train the 'before' weights on plain procedural rooms, rendered on the way");
  add_training_flags(*command, flags->train);
  command
      ->add_option("--width", flags->train.width,
                   "Channel multiplier: 0.5 = 0.45 M parameters")
      ->capture_default_str();
  command->add_option("--rooms", flags->source.rooms, "Rooms to render")
      ->capture_default_str();
  command->add_option("--views", flags->source.views_per_room, "Views of each room")
      ->capture_default_str();
  command->add_option("--dataset", flags->dataset, "Folder for the rendered views")
      ->required();
  command->callback([flags] {
    flags->train.train_json = render_source_dataset(flags->source, flags->dataset);
    print_report(perception::train(flags->train), flags->train.output);
  });
}

void add_finetune(CLI::App& detector) {
  auto options = std::make_shared<perception::TrainOptions>();
  CLI::App* command = detector.add_subcommand(
      "finetune", "Train on: the 'after' weights, from `segsim label` views");
  command->add_option("--from", options->initial_weights, "Weights to start from")->required();
  command
      ->add_option("--train", options->train_json, "COCO JSON, for example of `segsim label`")
      ->required();
  command->add_option("--mix", options->mix_json,
                      "COCO JSON of which a share is mixed in, against forgetting");
  command->add_option("--mix-share", options->mix_share, "That share, [0, 1)")
      ->capture_default_str();
  add_training_flags(*command, *options);
  command->callback([options] { print_report(perception::train(*options), options->output); });
}

void add_evaluate(CLI::App& detector) {
  struct Flags {
    std::vector<fs::path> weights;
    fs::path dataset;
  };
  auto flags = std::make_shared<Flags>();
  CLI::App* command =
      detector.add_subcommand("evaluate", "Average precision of weights on views");
  command
      ->add_option("--weights", flags->weights, "Weights files, for example before and after")
      ->required();
  command->add_option("--on", flags->dataset, "COCO JSON")->required();
  command->callback([flags] {
    for (const fs::path& weights : flags->weights) {
      std::printf("%s on %s\n", weights.string().c_str(), flags->dataset.string().c_str());
      print_evaluation(perception::evaluate(weights, flags->dataset));
    }
  });
}

}  // namespace

void add_detector_command(CLI::App& app) {
  CLI::App* detector =
      app.add_subcommand("detector", "Train and evaluate the object detector");
  detector->require_subcommand(1);
  add_pretrain(*detector);
  add_finetune(*detector);
  add_evaluate(*detector);
  add_detector_compare(*detector);
  add_detector_import(*detector);
  add_detector_forward(*detector);
}

}  // namespace segsim::experiments
