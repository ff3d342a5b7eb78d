#include <cstdio>
#include <filesystem>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "experiments/commands/detectors/detector_commands.h"
#include "perception/centernet/import.h"
#include "perception/data/class_map.h"
#include "perception/yolov13/import.h"
#include "perception/yolov13/tensor_run.h"

namespace segsim::experiments::commands::detectors {
namespace {

namespace fs = std::filesystem;
namespace centernet = perception::centernet;
namespace yolov13 = perception::yolov13;
using perception::DetectorWeights;

struct ImportFlags {
  fs::path source, output, class_map;
  std::string scale, names;
  std::optional<int> input_px;
  float score_threshold = 0.25F;
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

DetectorWeights import_yolov13(const ImportFlags& flags) {
  yolov13::ImportOptions options;
  options.source = flags.source;
  options.class_names = split(flags.names);
  options.score_threshold = flags.score_threshold;
  if (flags.input_px) options.input_px = *flags.input_px;
  for (const yolov13::Scale scale : yolov13::kAllScales) {
    if (flags.scale == std::string(1, yolov13::table_of(scale).letter)) options.scale = scale;
  }
  return yolov13::import_weights(options, flags.output, print_differences);
}

DetectorWeights import_centernet(const perception::TensorFile& file,
                                 const ImportFlags& flags) {
  if (!flags.scale.empty()) {
    throw core::InputError::expected(file.place, "a YOLOv13 of scale " + flags.scale,
                                     "a CenterNet");
  }
  centernet::ImportOptions options;
  options.class_names = split(flags.names);
  options.score_threshold = flags.score_threshold;
  if (flags.input_px) options.input_px = *flags.input_px;
  DetectorWeights weights = centernet::read_published_weights(file, flags.source, options);
  perception::write_weights(flags.output, weights);
  return weights;
}

/// Gives classes the names that scenes have for them; others keep theirs.
void rename_classes(DetectorWeights& weights, const fs::path& class_map,
                    const fs::path& output) {
  const perception::ClassMap map = perception::read_class_map(class_map);
  for (std::string& name : weights.class_names) {
    const auto target = map.find(name);
    if (target && !target->empty()) name = *target;
  }
  std::set<std::string> names;
  for (const std::string& name : weights.class_names) {
    if (names.insert(name).second) continue;
    throw core::InputError::expected(class_map.string(), "another class for each name",
                                     "'" + name + "' for several classes of the detector");
  }
  perception::write_weights(output, weights);
}

void run_import(const ImportFlags& flags) {
  const perception::TensorFile file = perception::read_tensor_file(flags.source);
  DetectorWeights weights =
      centernet::is_published(file) ? import_centernet(file, flags) : import_yolov13(flags);
  if (!flags.class_map.empty()) rename_classes(weights, flags.class_map, flags.output);
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
      "Read weights of others: a YOLOv13 (.pt, torch archive or safetensors) or CenterNet "
      "(TensorFlow.js); runs nothing");
  command->add_option("file", flags->source, "File to read")->required();
  command->add_option("--out", flags->output, "Weights file to write")->required();
  command->add_option("--scale", flags->scale, "Refuse any other YOLOv13 than this one")
      ->check(CLI::IsMember({"n", "s", "l", "x"}));
  command->add_option("--classes", flags->names,
                      "Class names, separated by commas; default: those in the file");
  command->add_option("--class-map", flags->class_map,
                      "YAML with the names that scenes have for classes (class_map.h)");
  command->add_option("--input-px", flags->input_px,
                      "Side of the square input; default 640, 320 for CenterNet");
  command->add_option("--threshold", flags->score_threshold, "Score threshold stored")
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
