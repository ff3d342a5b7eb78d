#include <cstdio>
#include <filesystem>
#include <memory>

#include <CLI/CLI.hpp>

#include "experiments/commands/commands.h"
#include "perception/evaluate.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;

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
  add_detector_training(*detector);
  add_evaluate(*detector);
  add_detector_compare(*detector);
  add_detector_import(*detector);
  add_detector_forward(*detector);
}

}  // namespace segsim::experiments
