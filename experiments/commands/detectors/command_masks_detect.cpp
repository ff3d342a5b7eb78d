#include <cstdio>
#include <filesystem>
#include <memory>

#include <CLI/CLI.hpp>

#include "core/error.h"
#include "experiments/commands/detectors/detector_commands.h"
#include "experiments/detection/open_vocabulary_masks.h"
#include "reconstruction/datasets/rgbd_sequence.h"

namespace segsim::experiments::commands::detectors {
namespace {

namespace fs = std::filesystem;

struct Flags {
  detection::DetectMasksOptions options;
  fs::path recording, label_map;
  std::string layout = "auto";
  bool overwrite = false;
};

void run(const Flags& flags) {
  if (fs::exists(flags.options.output / "masks.yaml") && !flags.overwrite) {
    throw core::InputError::expected(flags.options.output.string(),
                                     "a new folder, or --overwrite",
                                     "a complete set of masks");
  }
  reconstruction::SequenceOptions options;
  options.layout = reconstruction::parse_sequence_layout(flags.layout, "--layout");
  options.label_map = flags.label_map;
  const auto recording = reconstruction::open_sequence(flags.recording, options);
  const detection::DetectMasksReport report =
      detection::detect_masks(*recording, flags.options);
  std::printf("%s: %zu masks in %zu views\n", flags.options.output.string().c_str(),
              report.masks, report.views);
}

}  // namespace

void add_masks_detect(CLI::App& masks) {
  auto flags = std::make_shared<Flags>();
  CLI::App* command = masks.add_subcommand(
      "detect", "Masks by models of others: a prompted detector, then a box segmenter");
  command->add_option("recording", flags->recording, "Recording (docs/datasets.md)")
      ->required();
  command
      ->add_option(
          "--detector", flags->options.detector,
          "Detector: an .onnx or .torchscript YOLO, or a description (docs/models.md)")
      ->required();
  command
      ->add_option("--segmenter", flags->options.segmenter,
                   "Segmenter: a description with task sam (docs/models.md)")
      ->required();
  command->add_option("--prompt", flags->options.prompt, "Classes: \"chair. office table.\"")
      ->required();
  command->add_option("--stuff", flags->options.stuff,
                      "Those of the prompt that are no things: \"wall. floor.\"");
  command
      ->add_option("--threshold", flags->options.score_threshold,
                   "Least score; default: the model's")
      ->check(CLI::Range(0.0, 1.0));
  command->add_option("--out", flags->options.output, "Folder for the masks")->required();
  command->add_option("--layout", flags->layout, "Layout of the recording")
      ->capture_default_str();
  command->add_option("--label-map", flags->label_map,
                      "Classes of a data set's label images (YAML, docs/datasets.md)");
  command->add_option("--frame-step", flags->options.frame_step, "Use every n-th frame")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  command->add_flag("--overwrite", flags->overwrite, "Replace a complete set");
  command->callback([flags] { run(*flags); });
}

}  // namespace segsim::experiments::commands::detectors
