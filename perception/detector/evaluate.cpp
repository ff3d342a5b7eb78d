#include "perception/detector/evaluate.h"

#include <algorithm>
#include <chrono>

#include "core/error.h"
#include "perception/checkpoint/weights_file.h"
#include "perception/data/image_file.h"
#include "perception/detector/detector.h"

namespace segsim::perception {
namespace {

constexpr float kLowestScore = 0.001F;  // As the reference evaluations of YOLO detectors use.

std::vector<ImageResult> detect_all_timed(core::Detector& detector, const CocoDataset& dataset,
                                          double& total_ms) {
  using Clock = std::chrono::steady_clock;
  std::vector<ImageResult> results;
  results.reserve(dataset.images.size());
  for (const LabeledImage& entry : dataset.images) {
    const auto image = read_image(dataset.image_file(entry));
    core::Observation observation;
    observation.rgb = &image;
    const auto begin = Clock::now();
    results.push_back({entry.boxes, detector.detect(observation)});
    total_ms += std::chrono::duration<double, std::milli>(Clock::now() - begin).count();
  }
  return results;
}

}  // namespace

std::vector<ImageResult> detect_all(const std::filesystem::path& weights,
                                    const CocoDataset& dataset, ComputeDevice device) {
  const auto detector =
      load_detector(weights, {.score_threshold = kLowestScore, .device = device});
  double total_ms = 0.0;
  return detect_all_timed(*detector, dataset, total_ms);
}

EvaluationReport evaluate(const std::filesystem::path& weights,
                          const std::filesystem::path& coco_json,
                          const EvaluateOptions& options) {
  const float threshold = options.score_threshold ? *options.score_threshold
                                                  : read_weights(weights).score_threshold;
  const auto detector =
      load_detector(weights, {.score_threshold = kLowestScore, .device = options.device});
  CocoDataset dataset = read_coco(coco_json);
  match_classes(dataset, detector->class_names(), options.rename);

  EvaluationReport report;
  report.class_names = detector->class_names();
  report.images = static_cast<int>(dataset.images.size());
  double total_ms = 0.0;
  const auto results = detect_all_timed(*detector, dataset, total_ms);
  report.precision =
      average_precision(results, static_cast<int>(report.class_names.size()), threshold);
  report.mean_detect_ms = total_ms / std::max(1, report.images);
  return report;
}

void match_classes(CocoDataset& dataset, const std::vector<std::string>& class_names,
                   const std::map<std::string, std::string>& rename) {
  constexpr int kDropped = -1, kUnknown = -2;
  std::vector<int> new_index;
  for (const std::string& name : dataset.class_names) {
    const auto renamed = rename.find(name);
    const std::string& target = renamed == rename.end() ? name : renamed->second;
    const auto found = std::find(class_names.begin(), class_names.end(), target);
    new_index.push_back(target.empty() ? kDropped
                        : found == class_names.end()
                            ? kUnknown
                            : static_cast<int>(found - class_names.begin()));
  }
  for (LabeledImage& image : dataset.images) {
    std::vector<LabeledBox> kept;
    for (LabeledBox box : image.boxes) {
      const auto old_index = static_cast<std::size_t>(box.class_index);
      box.class_index = new_index.at(old_index);
      if (box.class_index == kUnknown) {
        std::string known;
        for (const std::string& name : class_names)
          known += (known.empty() ? "" : ", ") + name;
        throw core::InputError::expected(dataset.folder.string() + ": class",
                                         "one of " + known + " (or a rename)",
                                         dataset.class_names[old_index]);
      }
      if (box.class_index != kDropped) kept.push_back(box);
    }
    image.boxes = std::move(kept);
  }
  dataset.class_names = class_names;
}

}  // namespace segsim::perception
