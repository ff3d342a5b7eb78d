#include <benchmark/benchmark.h>

#include <filesystem>

#include "core/random.h"
#include "perception/data/coco_names.h"
#include "perception/data/dataset.h"
#include "perception/data/image_file.h"
#include "perception/detector/detector.h"
#include "perception/training/training_config.h"
#include "perception/yolov13/model.h"

// One camera image of 640 x 480 -> detections, on one thread. The weights come from one
// training step: speed does not depend on how good they are.

namespace segsim::perception {
namespace {

core::Image<core::Rgb8> noise_image() {
  core::Image<core::Rgb8> image(640, 480);
  core::RandomStream random(1, "pixels");
  for (core::Rgb8& pixel : image.pixels()) {
    pixel = {static_cast<std::uint8_t>(random.index(256)),
             static_cast<std::uint8_t>(random.index(256)),
             static_cast<std::uint8_t>(random.index(256))};
  }
  return image;
}

/// @param options  Of the network; the rest is filled in.
void detect_with(benchmark::State& state, TrainOptions options,
                 const std::vector<std::string>& class_names,
                 const DetectorOptions& detection = {}) {
  const auto folder = std::filesystem::temp_directory_path() / "segsim_detector_bench";
  const auto image = noise_image();
  write_image(folder / "a.png", image);
  CocoDataset dataset;
  dataset.class_names = class_names;
  LabeledBox box;
  box.box = {100, 100, 300, 300};
  dataset.images = {{1, "a.png", 640, 480, {box}}};
  write_coco(folder / "d.json", dataset);
  options.train_json = folder / "d.json";
  options.output = folder / "weights.bin";
  options.steps = 1;
  options.batch = 1;
  options.input_px = static_cast<int>(state.range(0));
  options.show_progress = false;
  const TrainReport report = train(options);
  const auto detector = load_detector(options.output, detection);
  core::Observation observation;
  observation.rgb = &image;
  (void)detector->detect(observation);
  for (auto _ : state) benchmark::DoNotOptimize(detector->detect(observation));
  state.counters["parameters"] = static_cast<double>(report.parameters);
  std::filesystem::remove_all(folder);
}

void detect(benchmark::State& state) {
  TrainOptions options;
  options.width = static_cast<double>(state.range(1)) / 100.0;
  detect_with(state, options, {"a", "b", "c", "d", "e", "f"});
}
BENCHMARK(detect)
    ->ArgNames({"", "width_percent"})
    ->Args({128, 50})
    ->Args({256, 50})
    ->Args({256, 100})
    ->Unit(benchmark::kMillisecond);

/// The same with a CenterNet of 80 classes.
void center_net(benchmark::State& state) {
  detect_with(state, default_train_options("centernet"), coco_names(),
              {.score_threshold = 0.25F});
}
BENCHMARK(center_net)
    ->Name("centernet")
    ->Arg(256)
    ->Arg(320)
    ->Arg(512)
    ->Unit(benchmark::kMillisecond);

/// The same with a YOLOv13-n of 80 classes and random weights.
void yolov13_n(benchmark::State& state) {
  const auto file = std::filesystem::temp_directory_path() / "segsim_yolov13_bench.weights";
  const yolov13::Model model(yolov13::Scale::kN, 80);
  DetectorWeights weights;
  weights.architecture = yolov13::architecture_of(model.scale());
  weights.width = yolov13::table_of(model.scale()).width;
  weights.input_px = static_cast<int>(state.range(0));
  weights.class_names = coco_names();
  weights.tensors = model.tensors();
  write_weights(file, weights);
  const auto detector = load_detector(file);
  const auto image = noise_image();
  core::Observation observation;
  observation.rgb = &image;
  (void)detector->detect(observation);
  for (auto _ : state) benchmark::DoNotOptimize(detector->detect(observation));
  std::filesystem::remove(file);
}
BENCHMARK(yolov13_n)->Name("yolov13")->Arg(64)->Arg(320)->Arg(416)->Arg(640)->Unit(
    benchmark::kMillisecond);

}  // namespace
}  // namespace segsim::perception
