#include "perception/evaluation/coco_evaluation.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "core/check.h"

namespace segsim::perception {
namespace {

/// As numpy.linspace(0, 1, 101): k * 0.01, which is not k / 100.
double recall_point(int k) { return k == kRecallPoints - 1 ? 1.0 : k * 0.01; }

bool outside_area(double area_px2, const ObjectRange& range) {
  return area_px2 < range.min_area_px2 || area_px2 > range.max_area_px2;
}

bool is_ignored(const TruthRegion& truth, const ObjectRange& range) {
  if (truth.ignore || truth.crowd || outside_area(truth.area_px2, range)) return true;
  if (range.any_distance()) return false;
  return !(truth.distance_m >= range.min_distance_m &&
           truth.distance_m < range.max_distance_m);
}

/// Objects of one class in one image: those that count first.
struct Candidates {
  std::vector<int> truth;  ///< Indices into the image's truth.
  std::vector<bool> ignored, taken;
};

Candidates candidates_of(const EvaluationImage& image, int class_index,
                         const ObjectRange& range) {
  Candidates found;
  for (const bool ignored : {false, true}) {
    for (std::size_t t = 0; t < image.truth.size(); ++t) {
      if (image.truth[t].class_index != class_index) continue;
      if (is_ignored(image.truth[t], range) != ignored) continue;
      found.truth.push_back(static_cast<int>(t));
      found.ignored.push_back(ignored);
    }
  }
  found.taken.assign(found.truth.size(), false);
  return found;
}

/// The candidate that a detection takes, -1 if none: an object that counts is not given up for
/// an ignored one; of equal overlaps the later one wins, as in the reference.
int best_candidate(const EvaluationImage& image, const RegionPx& detection,
                   const Candidates& candidates, double min_iou) {
  double best = std::min(min_iou, 1.0 - 1e-10);
  int match = -1;
  for (std::size_t c = 0; c < candidates.truth.size(); ++c) {
    const TruthRegion& truth = image.truth[static_cast<std::size_t>(candidates.truth[c])];
    if (candidates.taken[c] && !truth.crowd) continue;
    if (match >= 0 && !candidates.ignored[static_cast<std::size_t>(match)] &&
        candidates.ignored[c]) {
      break;
    }
    const double shared = region_overlap(detection, truth.region, truth.crowd);
    if (shared < best) continue;
    best = shared;
    match = static_cast<int>(c);
  }
  return match;
}

/// Indices of the detections of one class, in descending score.
std::vector<int> ranked_detections(const EvaluationImage& image, int class_index,
                                   int max_detections) {
  std::vector<int> order;
  for (std::size_t d = 0; d < image.detections.size(); ++d) {
    if (image.detections[d].class_index == class_index) order.push_back(static_cast<int>(d));
  }
  std::stable_sort(order.begin(), order.end(), [&](int a, int b) {
    return image.detections[static_cast<std::size_t>(a)].score >
           image.detections[static_cast<std::size_t>(b)].score;
  });
  if (order.size() > static_cast<std::size_t>(max_detections)) {
    order.resize(static_cast<std::size_t>(max_detections));
  }
  return order;
}

void judge_image(const EvaluationImage& image, int image_index, int class_index,
                 double min_iou, int max_detections, const ObjectRange& range,
                 JudgedClass& judged) {
  Candidates candidates = candidates_of(image, class_index, range);
  judged.objects_of_image.push_back(static_cast<int>(
      std::count(candidates.ignored.begin(), candidates.ignored.end(), false)));
  for (const int d : ranked_detections(image, class_index, max_detections)) {
    const ScoredRegion& detection = image.detections[static_cast<std::size_t>(d)];
    JudgedDetection row{detection.score, Verdict::kFalse, image_index, d, -1};
    const int match = best_candidate(image, detection.region, candidates, min_iou);
    if (match >= 0) {
      const auto c = static_cast<std::size_t>(match);
      candidates.taken[c] = true;
      row.truth = candidates.truth[c];
      row.verdict = candidates.ignored[c] ? Verdict::kIgnored : Verdict::kTrue;
    } else if (outside_area(detection.region.area_px2(), range)) {
      row.verdict = Verdict::kIgnored;
    }
    judged.detections.push_back(row);
  }
}

int copies_of(std::span<const int> copies, int image) {
  return copies.empty() ? 1 : copies[static_cast<std::size_t>(image)];
}

double count_objects(const JudgedClass& judged, std::span<const int> copies) {
  double count = 0.0;
  for (std::size_t i = 0; i < judged.objects_of_image.size(); ++i) {
    count += judged.objects_of_image[i] * copies_of(copies, static_cast<int>(i));
  }
  return count;
}

/// Mean of the values that are there (>= 0); -1 if none is.
class Mean {
 public:
  void add(double value) {
    if (value < 0.0) return;
    sum_ += value;
    ++count_;
  }
  [[nodiscard]] double value() const { return count_ == 0 ? -1.0 : sum_ / count_; }

 private:
  double sum_ = 0.0;
  int count_ = 0;
};

struct RangeMeans {
  Mean ap, ar;
};

RangeMeans means_of_range(std::span<const EvaluationImage> images, int class_count,
                          int max_detections, const ObjectRange& range) {
  RangeMeans means;
  for (int c = 0; c < class_count; ++c) {
    for (int k = 0; k < kIouThresholds; ++k) {
      const JudgedClass judged =
          judge_class(images, c, iou_threshold(k), max_detections, range);
      means.ap.add(mean_precision(judged));
      means.ar.add(greatest_recall(judged));
    }
  }
  return means;
}

double mean_precision_at(std::span<const EvaluationImage> images, int class_count, int k) {
  Mean mean;
  for (int c = 0; c < class_count; ++c) {
    mean.add(mean_precision(judge_class(images, c, iou_threshold(k))));
  }
  return mean.value();
}

}  // namespace

double region_overlap(const RegionPx& detection, const RegionPx& truth, bool crowd) {
  const double w = std::min(detection.x + detection.width, truth.x + truth.width) -
                   std::max(detection.x, truth.x);
  const double h = std::min(detection.y + detection.height, truth.y + truth.height) -
                   std::max(detection.y, truth.y);
  if (!(w > 0.0) || !(h > 0.0)) return 0.0;
  const double shared = w * h;
  return shared /
         (crowd ? detection.area_px2() : detection.area_px2() + truth.area_px2() - shared);
}

bool ObjectRange::any_distance() const {
  return min_distance_m <= 0.0 && std::isinf(max_distance_m);
}

ObjectRange all_sizes() { return {}; }
ObjectRange small_objects() { return {.min_area_px2 = 0.0, .max_area_px2 = 32.0 * 32.0}; }
ObjectRange medium_objects() {
  return {.min_area_px2 = 32.0 * 32.0, .max_area_px2 = 96.0 * 96.0};
}
ObjectRange large_objects() { return {.min_area_px2 = 96.0 * 96.0, .max_area_px2 = 1e10}; }

double iou_threshold(int k) {
  SEGSIM_CHECK(k >= 0 && k < kIouThresholds, std::to_string(k));
  return k == kIouThresholds - 1 ? 0.95 : k * ((0.95 - 0.5) / 9.0) + 0.5;
}

int JudgedClass::objects() const {
  return std::accumulate(objects_of_image.begin(), objects_of_image.end(), 0);
}

JudgedClass judge_class(std::span<const EvaluationImage> images, int class_index,
                        double min_iou, int max_detections, const ObjectRange& range) {
  JudgedClass judged;
  judged.objects_of_image.reserve(images.size());
  for (std::size_t i = 0; i < images.size(); ++i) {
    judge_image(images[i], static_cast<int>(i), class_index, min_iou, max_detections, range,
                judged);
  }
  std::stable_sort(judged.detections.begin(), judged.detections.end(),
                   [](const auto& a, const auto& b) { return a.score > b.score; });
  return judged;
}

std::array<double, kRecallPoints> precision_at_recall(const JudgedClass& judged,
                                                      std::span<const int> copies) {
  SEGSIM_CHECK(copies.empty() || copies.size() == judged.objects_of_image.size(),
               "one number of copies for each image");
  std::array<double, kRecallPoints> result;
  const double objects = count_objects(judged, copies);
  result.fill(objects > 0.0 ? 0.0 : -1.0);
  if (objects <= 0.0) return result;

  // Ignored rows keep both sums, and with them recall and precision: they change no sample.
  std::vector<double> precision, recall;
  double found = 0.0, wrong = 0.0;
  for (const JudgedDetection& row : judged.detections) {
    const int count = copies_of(copies, row.image);
    if (count == 0 || row.verdict == Verdict::kIgnored) continue;
    (row.verdict == Verdict::kTrue ? found : wrong) += count;
    recall.push_back(found / objects);
    precision.push_back(found / (found + wrong + std::numeric_limits<double>::epsilon()));
  }
  for (std::size_t i = precision.size(); i-- > 1;) {
    precision[i - 1] = std::max(precision[i - 1], precision[i]);
  }
  for (int k = 0; k < kRecallPoints; ++k) {
    const auto at = std::lower_bound(recall.begin(), recall.end(), recall_point(k));
    if (at == recall.end()) break;
    result[static_cast<std::size_t>(k)] =
        precision[static_cast<std::size_t>(at - recall.begin())];
  }
  return result;
}

double mean_precision(const JudgedClass& judged, std::span<const int> copies) {
  const auto precision = precision_at_recall(judged, copies);
  return std::accumulate(precision.begin(), precision.end(), 0.0) / kRecallPoints;
}

double greatest_recall(const JudgedClass& judged, std::span<const int> copies) {
  const double objects = count_objects(judged, copies);
  if (objects <= 0.0) return -1.0;
  double found = 0.0;
  for (const JudgedDetection& row : judged.detections) {
    if (row.verdict == Verdict::kTrue) found += copies_of(copies, row.image);
  }
  return found / objects;
}

ResampledClass::ResampledClass(const JudgedClass& judged)
    : objects_(judged.objects()), images_(judged.objects_of_image.size()) {
  std::vector<int> found(images_, 0);
  std::size_t last = 0;
  for (const JudgedDetection& detection : judged.detections) {
    if (detection.verdict == Verdict::kIgnored) continue;
    const bool right = detection.verdict == Verdict::kTrue;
    rows_.push_back({detection.image, right});
    if (!right) continue;
    ++found[static_cast<std::size_t>(detection.image)];
    last = rows_.size();
  }
  rows_.resize(last);
  for (std::size_t i = 0; i < images_; ++i) {
    const int objects = judged.objects_of_image[i];
    if (objects > 0 || found[i] > 0)
      counts_.push_back({static_cast<int>(i), objects, found[i]});
  }
}

double ResampledClass::count_objects(std::span<const int> copies) const {
  SEGSIM_CHECK(copies.size() == images_, "one number of copies for each image");
  double objects = 0.0;
  for (const ImageCount& count : counts_) {
    objects +=
        static_cast<double>(count.objects) * copies[static_cast<std::size_t>(count.image)];
  }
  return objects;
}

double ResampledClass::mean_precision(std::span<const int> copies) const {
  const double objects = count_objects(copies);
  if (objects <= 0.0) return -1.0;
  // Precision and recall where an object is found: between, precision only falls.
  std::vector<double> precision, recall;
  double found = 0.0, wrong = 0.0;
  for (const Row& row : rows_) {
    const int count = copies[static_cast<std::size_t>(row.image)];
    if (!row.right) {
      wrong += count;
      continue;
    }
    if (count == 0) continue;
    found += count;
    recall.push_back(found / objects);
    precision.push_back(found / (found + wrong + std::numeric_limits<double>::epsilon()));
  }
  for (std::size_t i = precision.size(); i-- > 1;) {
    precision[i - 1] = std::max(precision[i - 1], precision[i]);
  }
  double sum = 0.0;
  std::size_t at = 0;
  for (int k = 0; k < kRecallPoints; ++k) {
    while (at < recall.size() && recall[at] < recall_point(k)) ++at;
    if (at == recall.size()) break;
    sum += precision[at];
  }
  return sum / kRecallPoints;
}

double ResampledClass::greatest_recall(std::span<const int> copies) const {
  const double objects = count_objects(copies);
  if (objects <= 0.0) return -1.0;
  double found = 0.0;
  for (const ImageCount& count : counts_) {
    found += static_cast<double>(count.found) * copies[static_cast<std::size_t>(count.image)];
  }
  return found / objects;
}

CocoSummary coco_summary(std::span<const EvaluationImage> images, int class_count) {
  CocoSummary summary;
  const RangeMeans all = means_of_range(images, class_count, kMaxDetections, all_sizes());
  const RangeMeans small =
      means_of_range(images, class_count, kMaxDetections, small_objects());
  const RangeMeans medium =
      means_of_range(images, class_count, kMaxDetections, medium_objects());
  const RangeMeans large =
      means_of_range(images, class_count, kMaxDetections, large_objects());
  summary.ap = all.ap.value();
  summary.ap50 = mean_precision_at(images, class_count, 0);
  summary.ap75 = mean_precision_at(images, class_count, 5);
  summary.ap_small = small.ap.value();
  summary.ap_medium = medium.ap.value();
  summary.ap_large = large.ap.value();
  summary.ar_1 = means_of_range(images, class_count, 1, all_sizes()).ar.value();
  summary.ar_10 = means_of_range(images, class_count, 10, all_sizes()).ar.value();
  summary.ar_100 = all.ar.value();
  summary.ar_small = small.ar.value();
  summary.ar_medium = medium.ar.value();
  summary.ar_large = large.ar.value();
  return summary;
}

}  // namespace segsim::perception
