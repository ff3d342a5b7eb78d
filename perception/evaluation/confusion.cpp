#include "perception/evaluation/confusion.h"

#include <algorithm>

#include "core/check.h"

namespace segsim::perception {
namespace {

struct Pair {
  int truth = 0, detection = 0;
  bool same_class = false;
  double overlap = 0.0;
};

std::vector<Pair> possible_pairs(const ImageResult& image, double score_threshold,
                                 double min_iou) {
  std::vector<Pair> pairs;
  for (std::size_t t = 0; t < image.truth.size(); ++t) {
    const LabeledBox& truth = image.truth[t];
    for (std::size_t d = 0; d < image.detections.size(); ++d) {
      const core::Detection& detection = image.detections[d];
      if (double{detection.score} < score_threshold) continue;
      const double overlap =
          region_overlap(region_of(detection.box), region_of(truth.box), truth.crowd);
      if (overlap < min_iou) continue;
      pairs.push_back({static_cast<int>(t), static_cast<int>(d),
                       truth.class_index == detection.class_index, overlap});
    }
  }
  std::stable_sort(pairs.begin(), pairs.end(), [&](const Pair& a, const Pair& b) {
    const bool a_ignored = image.truth[static_cast<std::size_t>(a.truth)].not_scored();
    const bool b_ignored = image.truth[static_cast<std::size_t>(b.truth)].not_scored();
    if (a_ignored != b_ignored) return b_ignored;
    if (a.same_class != b.same_class) return a.same_class;
    return a.overlap > b.overlap;
  });
  return pairs;
}

class Counter {
 public:
  Counter(ConfusionMatrix& matrix, double score_threshold, double min_iou)
      : matrix_(matrix), score_threshold_(score_threshold), min_iou_(min_iou) {}

  void add(const ImageResult& image, int index) {
    std::vector<int> found_by(image.truth.size(), -1), finds(image.detections.size(), -1);
    for (const Pair& pair : possible_pairs(image, score_threshold_, min_iou_)) {
      const auto t = static_cast<std::size_t>(pair.truth);
      const auto d = static_cast<std::size_t>(pair.detection);
      if (finds[d] >= 0 || (found_by[t] >= 0 && !image.truth[t].not_scored())) continue;
      found_by[t] = pair.detection;
      finds[d] = pair.truth;
    }
    const int nothing = matrix_.class_count;
    for (std::size_t t = 0; t < image.truth.size(); ++t) {
      const LabeledBox& truth = image.truth[t];
      if (truth.not_scored()) continue;
      const int d = found_by[t];
      if (d < 0) {
        count(truth.class_index, nothing);
        matrix_.misses.push_back({MissKind::kMissed, index, static_cast<int>(t), -1});
        continue;
      }
      const int detected = image.detections[static_cast<std::size_t>(d)].class_index;
      count(truth.class_index, detected);
      if (detected != truth.class_index) {
        matrix_.misses.push_back({MissKind::kWrongClass, index, static_cast<int>(t), d});
      }
    }
    for (std::size_t d = 0; d < image.detections.size(); ++d) {
      if (finds[d] >= 0 || double{image.detections[d].score} < score_threshold_) continue;
      count(nothing, image.detections[d].class_index);
      matrix_.misses.push_back({MissKind::kBackground, index, -1, static_cast<int>(d)});
    }
  }

 private:
  void count(int truth, int detected) {
    SEGSIM_CHECK(truth >= 0 && truth <= matrix_.class_count && detected >= 0 &&
                     detected <= matrix_.class_count,
                 "class index");
    ++matrix_.counts[static_cast<std::size_t>(truth * (matrix_.class_count + 1) + detected)];
  }

  ConfusionMatrix& matrix_;
  double score_threshold_, min_iou_;
};

}  // namespace

const char* to_string(MissKind kind) {
  switch (kind) {
    case MissKind::kMissed:
      return "missed";
    case MissKind::kWrongClass:
      return "wrong class";
    case MissKind::kBackground:
      return "nothing there";
  }
  return "?";
}

ConfusionMatrix confusion_matrix(std::span<const ImageResult> images, int class_count,
                                 double score_threshold, double min_iou) {
  ConfusionMatrix matrix;
  matrix.class_count = class_count;
  matrix.counts.assign(static_cast<std::size_t>((class_count + 1) * (class_count + 1)), 0);
  Counter counter(matrix, score_threshold, min_iou);
  for (std::size_t i = 0; i < images.size(); ++i) counter.add(images[i], static_cast<int>(i));
  return matrix;
}

}  // namespace segsim::perception
