#include "perception/evaluation/average_precision.h"

#include <algorithm>

namespace segsim::perception {
namespace {

EvaluationImage evaluation_image(const ImageResult& image) {
  EvaluationImage result;
  for (const LabeledBox& box : image.truth) result.truth.push_back(truth_region(box));
  for (const core::Detection& detection : image.detections) {
    result.detections.push_back(
        {detection.class_index, region_of(detection.box), double{detection.score}});
  }
  return result;
}

OperatingPoint operate(const std::vector<JudgedDetection>& judged, int objects,
                       float score_threshold) {
  OperatingPoint point;
  point.score_threshold = score_threshold;
  for (const JudgedDetection& detection : judged) {
    if (detection.score < double{score_threshold}) continue;
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

RegionPx region_of(const core::BoxPx& box) {
  return {box.x0, box.y0, double{box.x1} - double{box.x0}, double{box.y1} - double{box.y0}};
}

TruthRegion truth_region(const LabeledBox& box) {
  TruthRegion region{box.class_index, region_of(box.box), box.area_px2, box.ignore, box.crowd};
  if (box.distance_m) region.distance_m = *box.distance_m;
  return region;
}

std::vector<EvaluationImage> evaluation_images(std::span<const ImageResult> images) {
  std::vector<EvaluationImage> result;
  result.reserve(images.size());
  for (const ImageResult& image : images) result.push_back(evaluation_image(image));
  return result;
}

PrecisionReport average_precision(std::span<const ImageResult> images, int class_count,
                                  float score_threshold) {
  const std::vector<EvaluationImage> evaluated = evaluation_images(images);
  PrecisionReport report;
  report.operating.score_threshold = score_threshold;
  double sum = 0.0, sum50 = 0.0;
  int with_objects = 0;
  for (int c = 0; c < class_count; ++c) {
    ClassPrecision result;
    const JudgedClass judged50 = judge_class(evaluated, c, iou_threshold(0));
    result.objects = judged50.objects();
    result.operating = operate(judged50.detections, result.objects, score_threshold);
    if (result.objects > 0) {
      result.ap50 = mean_precision(judged50);
      result.ap = result.ap50;
      for (int k = 1; k < kIouThresholds; ++k) {
        result.ap += mean_precision(judge_class(evaluated, c, iou_threshold(k)));
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

std::vector<OperatingPoint> operating_points(std::span<const ImageResult> images,
                                             int class_count) {
  const std::vector<EvaluationImage> evaluated = evaluation_images(images);
  std::vector<JudgedDetection> all;
  int objects = 0;
  for (int c = 0; c < class_count; ++c) {
    const JudgedClass judged = judge_class(evaluated, c, iou_threshold(0));
    all.insert(all.end(), judged.detections.begin(), judged.detections.end());
    objects += judged.objects();
  }
  std::stable_sort(all.begin(), all.end(),
                   [](const auto& a, const auto& b) { return a.score > b.score; });
  // Greedy matching never looks at lower scores, so one pass serves every threshold.
  std::vector<OperatingPoint> points;
  OperatingPoint current;
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (all[i].verdict == Verdict::kTrue) ++current.true_positives;
    if (all[i].verdict == Verdict::kFalse) ++current.false_positives;
    current.missed = objects - current.true_positives;
    const double next = i + 1 < all.size() ? all[i + 1].score : 0.0;
    if (next == all[i].score) continue;
    current.score_threshold = static_cast<float>(0.5 * (all[i].score + next));
    points.push_back(current);
  }
  return points;
}

OperatingPoint best_f1(std::span<const OperatingPoint> points) {
  OperatingPoint best;
  best.score_threshold = 0.5F;
  if (!points.empty()) {  // Nothing reaches the threshold: every object is missed.
    best.missed = points.front().true_positives + points.front().missed;
  }
  for (const OperatingPoint& point : points) {
    if (point.f1() > best.f1()) best = point;
  }
  return best;
}

OperatingPoint most_recall(std::span<const OperatingPoint> points, double least_precision) {
  const OperatingPoint* best = nullptr;
  for (const OperatingPoint& point : points) {
    if (point.true_positives == 0 || point.precision() < least_precision) continue;
    if (best == nullptr || point.true_positives > best->true_positives) best = &point;
  }
  return best != nullptr ? *best : best_f1(points);
}

}  // namespace segsim::perception
