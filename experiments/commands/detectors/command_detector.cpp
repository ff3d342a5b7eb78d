#include <cstdio>
#include <filesystem>
#include <memory>

#include <CLI/CLI.hpp>

#include "core/file_io.h"
#include "experiments/commands/detectors/detector_commands.h"
#include "experiments/detection/seen_data.h"
#include "experiments/support/text_grid.h"
#include "perception/data/dataset.h"
#include "perception/detector/evaluate.h"

namespace segsim::experiments::commands::detectors {
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

void warn_of_seen_data(const detection::SeenData& seen) {
  for (const std::string& line : seen.warnings) {
    std::fprintf(stderr, "warning: %s\n", line.c_str());
  }
  for (const std::string& line : seen.unknown)
    std::fprintf(stderr, "note: %s\n", line.c_str());
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
    const perception::DataUse tested = perception::data_use(
        perception::DataPurpose::kValidation, perception::read_coco(flags->dataset));
    for (const fs::path& weights : flags->weights) {
      warn_of_seen_data(detection::seen_data(weights, tested));
      std::printf("%s on %s\n", weights.string().c_str(), flags->dataset.string().c_str());
      print_evaluation(perception::evaluate(weights, flags->dataset));
    }
  });
}

std::string short_hash(const std::string& sha256) {
  return sha256.empty() ? "-" : sha256.substr(0, 12);
}

std::string scenes_text(const perception::DataUse& use) {
  if (!use.scenes) return "unknown";
  std::string text;
  for (const perception::ImagedScene& scene : *use.scenes) {
    text += (text.empty() ? "" : "; ") + detection::scene_text(scene);
    if (scene.generator.empty()) text += " (" + short_hash(scene.surfels_sha256) + ")";
  }
  return text;
}

void print_lineage(const fs::path& file) {
  const std::vector<perception::DataUse> data =
      perception::data_of(perception::read_weights(file), file);
  support::internal::TextGrid grid;
  grid.header = {"what", "images", "scenes (surfels)", "labels", "views"};
  bool known = true;
  for (const perception::DataUse& use : data) {
    const bool foreign = use.purpose == perception::DataPurpose::kForeign;
    known = known && use.scenes.has_value();
    grid.rows.push_back({foreign ? use.file : perception::to_string(use.purpose),
                         foreign ? "unknown" : std::to_string(use.images), scenes_text(use),
                         short_hash(use.labels_sha256), short_hash(use.views_sha256)});
  }
  std::printf("%s, sha256 %s\n\n%s\n%s\n", file.string().c_str(),
              core::sha256_of_file(file).c_str(), support::internal::text_of(grid).c_str(),
              known ? "Every data set is known with its scenes."
                    : "Unknown: the file does not say all that it was trained on.");
}

void add_lineage(CLI::App& detector) {
  auto files = std::make_shared<std::vector<fs::path>>();
  CLI::App* command = detector.add_subcommand(
      "lineage", "What weights were trained on, as their file says it, oldest first");
  command->add_option("weights", *files, "Weights files")->required();
  command->callback([files] {
    for (const fs::path& file : *files) print_lineage(file);
  });
}

}  // namespace

void add_detector_command(CLI::App& app) {
  CLI::App* detector = light::add_listed(app, light::kCommands, "detector");
  detector->require_subcommand(1);
  add_detector_training(*detector);
  add_evaluate(*detector);
  add_detector_compare(*detector);
  add_lineage(*detector);
  add_detector_import(*detector);
  add_detector_forward(*detector);
}

}  // namespace segsim::experiments::commands::detectors
