#include <cstdio>
#include <filesystem>
#include <memory>

#include <CLI/CLI.hpp>

#include "core/file_io.h"
#include "experiments/commands/detectors/detector_commands.h"
#include "perception/yolov13/import.h"
#include "perception/yolov13/tensor_run.h"

namespace segsim::experiments::commands::detectors {
namespace {

namespace fs = std::filesystem;
namespace yolov13 = perception::yolov13;

struct ImportFlags {
  yolov13::ImportOptions options;
  std::string scale, names;
  fs::path output;
};

std::vector<std::string> split(const std::string& list) {
  std::vector<std::string> parts;
  std::size_t begin = 0;
  while (begin < list.size()) {
    const std::size_t end = std::min(list.find(',', begin), list.size());
    parts.push_back(list.substr(begin, end - begin));
    begin = end + 1;
  }
  return parts;
}

void print_differences(const yolov13::TensorDifferences& differences) {
  for (const auto& [what, names] : {std::pair("missing", &differences.missing),
                                    {"unexpected", &differences.unexpected},
                                    {"shape", &differences.reshaped}}) {
    for (const std::string& name : *names)
      std::fprintf(stderr, "%-10s %s\n", what, name.c_str());
  }
}

void run_import(ImportFlags& flags) {
  flags.options.class_names = split(flags.names);
  for (const yolov13::Scale scale : yolov13::kAllScales) {
    if (flags.scale == std::string(1, yolov13::table_of(scale).letter)) {
      flags.options.scale = scale;
    }
  }
  const perception::DetectorWeights weights =
      yolov13::import_weights(flags.options, flags.output, print_differences);
  std::printf("%s: %s, %zu classes, %zu tensors\n", flags.output.string().c_str(),
              weights.architecture.c_str(), weights.class_names.size(),
              weights.tensors.size());
  std::printf("sha256 %s\n", core::sha256_of_file(flags.output).c_str());
}

}  // namespace

void add_detector_import(CLI::App& detector) {
  auto flags = std::make_shared<ImportFlags>();
  CLI::App* command = detector.add_subcommand(
      "import",
      "Read official YOLOv13 weights: .pt, torch archive or safetensors; runs nothing");
  command->add_option("file", flags->options.source, "File to read")->required();
  command->add_option("--out", flags->output, "Weights file to write")->required();
  command->add_option("--scale", flags->scale, "Refuse any other than this one")
      ->check(CLI::IsMember({"n", "s", "l", "x"}));
  command->add_option("--classes", flags->names,
                      "Class names, separated by commas; default: those in the file");
  command->add_option("--input-px", flags->options.input_px, "Side of the square input")
      ->capture_default_str();
  command->add_option("--threshold", flags->options.score_threshold, "Score threshold stored")
      ->check(CLI::Range(0.0, 1.0))
      ->capture_default_str();
  command->callback([flags] { run_import(*flags); });
}

void add_detector_forward(CLI::App& detector) {
  struct Flags {
    fs::path weights, input, output;
  };
  auto flags = std::make_shared<Flags>();
  CLI::App* command = detector.add_subcommand(
      "forward", "Run a YOLOv13 on tensors in a file, to compare it with another program");
  command->add_option("--weights", flags->weights, "Of `segsim detector import`")->required();
  command
      ->add_option("--in", flags->input,
                   "safetensors or .pt: images [batch, 3, h, w] in [0, 1]; truth [objects, 6] "
                   "(image, class, x0, y0, x1, y1) if the loss is wanted")
      ->required();
  command
      ->add_option("--out", flags->output,
                   "safetensors: predictions [batch, 4 + classes, anchors] and the logits")
      ->required();
  command->callback([flags] {
    const auto loss = yolov13::run_on_tensors(flags->weights, flags->input, flags->output);
    if (!loss) return;
    std::printf("loss: box %.9g, classes %.9g, bins %.9g, total %.9g\n", loss->box,
                loss->classes, loss->bins, loss->total);
  });
}

}  // namespace segsim::experiments::commands::detectors
