#include "perception/average_precision.h"

#include <algorithm>
#include <limits>
#include <numeric>

namespace segsim::perception {
namespace {

constexpr int kIouThresholds = 10;
constexpr int kRecallPoints = 101;
constexpr std::size_t kMaxDetections = 100;

/// As numpy.linspace(0.5, 0.95, 10) computes it: other roundings differ at exact ties.
double iou_threshold(int k) {
  return k == kIouThresholds - 1 ? 0.95 : k * ((0.95 - 0.5) / 9.0) + 0.5;
}

/// As numpy.linspace(0, 1, 101): k * 0.01, which is not k / 100.
double recall_point(int k) { return k == kRecallPoints - 1 ? 1.0 : k * 0.01; }

enum class Verdict { kTrue, kFalse, kIgnored };

struct Judged {
  float score = 0.0F;
  Verdict verdict = Verdict::kFalse;
};

double overlap(const core::BoxPx& detection, const LabeledBox& truth) {
  const double w = std::min(double{detection.x1}, double{truth.box.x1}) -
                   std::max(double{detection.x0}, double{truth.box.x0});
  const double h = std::min(double{detection.y1}, double{truth.box.y1}) -
                   std::max(double{detection.y0}, double{truth.box.y0});
  if (w <= 0.0 || h <= 0.0) return 0.0;
  const auto area = [](const core::BoxPx& box) {
    return (double{box.x1} - box.x0) * (double{box.y1} - box.y0);
  };
  const double whole =
      truth.crowd ? area(detection) : area(detection) + area(truth.box) - w * h;
  return w * h / whole;
}

/// Index of the truth that a detection takes, -1 if none. Scored objects come before the
/// ignored, and one of them is not given up for an ignored one.
int best_match(const core::BoxPx& detection, const std::vector<LabeledBox>& truth,
               const std::vector<bool>& taken, double threshold) {
  double best = std::min(threshold, 1.0 - 1e-10);
  int match = -1;
  for (std::size_t t = 0; t < truth.size(); ++t) {
    if (taken[t] && !truth[t].crowd) continue;
    if (match >= 0 && !truth[static_cast<std::size_t>(match)].not_scored() &&
        truth[t].not_scored()) {
      break;
    }
    const double shared = overlap(detection, truth[t]);
    if (shared < best) continue;
    best = shared;
    match = static_cast<int>(t);
  }
  return match;
}

/// One class of one image, at one IoU threshold; appended to `judged` in descending score.
void judge_image(const ImageResult& image, int class_index, double threshold,
                 std::vector<Judged>& judged) {
  std::vector<LabeledBox> truth;
  for (const LabeledBox& box : image.truth) {
    if (box.class_index == class_index) truth.push_back(box);
  }
  std::stable_sort(truth.begin(), truth.end(), [](const LabeledBox& a, const LabeledBox& b) {
    return a.not_scored() < b.not_scored();
  });
  std::vector<core::Detection> detections;
  for (const core::Detection& detection : image.detections) {
    if (detection.class_index == class_index) detections.push_back(detection);
  }
  std::stable_sort(detections.begin(), detections.end(),
                   [](const auto& a, const auto& b) { return a.score > b.score; });
  if (detections.size() > kMaxDetections) detections.resize(kMaxDetections);

  std::vector<bool> taken(truth.size(), false);
  for (const core::Detection& detection : detections) {
    const int match = best_match(detection.box, truth, taken, threshold);
    Verdict verdict = Verdict::kFalse;
    if (match >= 0) {
      const auto t = static_cast<std::size_t>(match);
      taken[t] = true;
      verdict = truth[t].not_scored() ? Verdict::kIgnored : Verdict::kTrue;
    }
    judged.push_back({detection.score, verdict});
  }
}

/// All images, in descending score; equal scores stay in the order of the images.
std::vector<Judged> judge(std::span<const ImageResult> images, int class_index,
                          double threshold) {
  std::vector<Judged> judged;
  for (const ImageResult& image : images) judge_image(image, class_index, threshold, judged);
  std::stable_sort(judged.begin(), judged.end(),
                   [](const Judged& a, const Judged& b) { return a.score > b.score; });
  return judged;
}

int count_objects(std::span<const ImageResult> images, int class_index) {
  int count = 0;
  for (const ImageResult& image : images) {
    count += static_cast<int>(
        std::count_if(image.truth.begin(), image.truth.end(), [&](const LabeledBox& box) {
          return box.class_index == class_index && !box.not_scored();
        }));
  }
  return count;
}

/// Area under the precision envelope, sampled at the recall points.
double precision_area(const std::vector<Judged>& judged, int objects) {
  std::vector<double> precision, recall;
  double found = 0.0, wrong = 0.0;
  for (const Judged& detection : judged) {
    if (detection.verdict == Verdict::kIgnored) {
      // COCO keeps the row: both sums stay what they are.
    } else if (detection.verdict == Verdict::kTrue) {
      found += 1.0;
    } else {
      wrong += 1.0;
    }
    recall.push_back(found / objects);
    precision.push_back(found / (found + wrong + std::numeric_limits<double>::epsilon()));
  }
  for (std::size_t i = precision.size(); i-- > 1;) {
    precision[i - 1] = std::max(precision[i - 1], precision[i]);
  }
  double sum = 0.0;
  for (int k = 0; k < kRecallPoints; ++k) {
    const auto at = std::lower_bound(recall.begin(), recall.end(), recall_point(k));
    if (at != recall.end()) sum += precision[static_cast<std::size_t>(at - recall.begin())];
  }
  return sum / kRecallPoints;
}

OperatingPoint operate(const std::vector<Judged>& judged, int objects, float score_threshold) {
  OperatingPoint point;
  point.score_threshold = score_threshold;
  for (const Judged& detection : judged) {
    if (detection.score < score_threshold) continue;
    if (detection.verdict == Verdict::kTrue) ++point.true_positives;
    if (detection.verdict == Verdict::kFalse) ++point.false_positives;
  }
  point.missed = objects - point.true_positives;
  return point;
}

}  // namespace

double OperatingPoint::precision() const {
  const int detections = true_positives + false_positives;
  return detections == 0 ? 0.0 : static_cast<double>(true_positives) / detections;
}

double OperatingPoint::recall() const {
  const int objects = true_positives + missed;
  return objects == 0 ? 0.0 : static_cast<double>(true_positives) / objects;
}

double OperatingPoint::f1() const {
  const int sum = 2 * true_positives + false_positives + missed;
  return sum == 0 ? 0.0 : 2.0 * true_positives / sum;
}

PrecisionReport average_precision(std::span<const ImageResult> images, int class_count,
                                  float score_threshold) {
  PrecisionReport report;
  report.operating.score_threshold = score_threshold;
  double sum = 0.0, sum50 = 0.0;
  int with_objects = 0;
  for (int c = 0; c < class_count; ++c) {
    ClassPrecision result;
    result.objects = count_objects(images, c);
    const std::vector<Judged> judged50 = judge(images, c, iou_threshold(0));
    result.operating = operate(judged50, result.objects, score_threshold);
    if (result.objects > 0) {
      result.ap50 = precision_area(judged50, result.objects);
      result.ap = result.ap50;
      for (int k = 1; k < kIouThresholds; ++k) {
        result.ap += precision_area(judge(images, c, iou_threshold(k)), result.objects);
      }
      result.ap /= kIouThresholds;
      sum += result.ap;
      sum50 += result.ap50;
      ++with_objects;
    }
    report.operating.true_positives += result.operating.true_positives;
    report.operating.false_positives += result.operating.false_positives;
    report.operating.missed += result.operating.missed;
    report.classes.push_back(result);
  }
  if (with_objects > 0) {
    report.ap = sum / with_objects;
    report.ap50 = sum50 / with_objects;
  }
  return report;
}

OperatingPoint best_f1(std::span<const ImageResult> images, int class_count) {
  std::vector<Judged> all;
  int objects = 0;
  for (int c = 0; c < class_count; ++c) {
    const auto judged = judge(images, c, iou_threshold(0));
    all.insert(all.end(), judged.begin(), judged.end());
    objects += count_objects(images, c);
  }
  std::stable_sort(all.begin(), all.end(),
                   [](const Judged& a, const Judged& b) { return a.score > b.score; });
  // Greedy matching never looks at lower scores, so one pass serves every threshold.
  OperatingPoint best = operate(all, objects, 0.5F), current;
  if (std::none_of(all.begin(), all.end(),
                   [](const Judged& d) { return d.verdict == Verdict::kTrue; })) {
    return best;
  }
  double best_value = 0.0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (all[i].verdict == Verdict::kTrue) ++current.true_positives;
    if (all[i].verdict == Verdict::kFalse) ++current.false_positives;
    current.missed = objects - current.true_positives;
    const float next = i + 1 < all.size() ? all[i + 1].score : 0.0F;
    if (next == all[i].score || current.f1() <= best_value) continue;
    best_value = current.f1();
    best = current;
    best.score_threshold = 0.5F * (all[i].score + next);
  }
  return best;
}

}  // namespace segsim::perception
