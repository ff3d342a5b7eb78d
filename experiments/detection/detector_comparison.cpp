#include "experiments/detection/detector_comparison.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

#include "core/check.h"
#include "core/error.h"
#include "core/progress.h"
#include "core/quantile.h"
#include "core/random.h"
#include "perception/checkpoint/weights_file.h"
#include "perception/detector/evaluate.h"

namespace segsim::experiments::detection {
namespace {

using perception::EvaluationImage;
using perception::JudgedClass;
using perception::kIouThresholds;
using perception::ObjectRange;
using perception::ResampledClass;
using Scores = std::array<double, kScores>;

/// One detector, one class, one range: judged once, summed for many resamples.
class JudgedScores {
 public:
  JudgedScores(const std::vector<EvaluationImage>& images, int class_index,
               const ObjectRange& range) {
    for (int k = 0; k < kIouThresholds; ++k) {
      const auto judged = [&](int most) {
        return perception::judge_class(images, class_index, perception::iou_threshold(k), most,
                                       range);
      };
      const auto at = static_cast<std::size_t>(k);
      JudgedClass hundred = judged(perception::kMaxDetections);
      hundred_[at] = ResampledClass(hundred);
      if (k == 0) at_iou_50_ = std::move(hundred);
      ten_[at] = ResampledClass(judged(10));
      one_[at] = ResampledClass(judged(1));
    }
  }

  [[nodiscard]] int objects() const { return hundred_[0].objects(); }
  [[nodiscard]] const JudgedClass& at_iou_50() const { return at_iou_50_; }

  /// All -1 without objects in the resample.
  [[nodiscard]] Scores scores(std::span<const int> copies) const {
    Scores result{};
    for (std::size_t k = 0; k < hundred_.size(); ++k) {
      const double ap = hundred_[k].mean_precision(copies);
      if (ap < 0.0) return {-1.0, -1.0, -1.0, -1.0, -1.0};
      result[0] += ap / kIouThresholds;
      if (k == 0) result[1] = ap;
      result[2] += one_[k].greatest_recall(copies) / kIouThresholds;
      result[3] += ten_[k].greatest_recall(copies) / kIouThresholds;
      result[4] += hundred_[k].greatest_recall(copies) / kIouThresholds;
    }
    return result;
  }

 private:
  std::array<ResampledClass, kIouThresholds> hundred_, ten_, one_;
  JudgedClass at_iou_50_;  ///< For the curves.
};

/// Both detectors, all classes, one range.
struct JudgedPair {
  std::vector<JudgedScores> before, after;
};

JudgedPair judge(const std::vector<EvaluationImage>& before,
                 const std::vector<EvaluationImage>& after, int class_count,
                 const ObjectRange& range) {
  JudgedPair pair;
  for (int c = 0; c < class_count; ++c) {
    pair.before.emplace_back(before, c, range);
    pair.after.emplace_back(after, c, range);
  }
  return pair;
}

/// Means over the classes that have objects, after one number per class.
Scores mean_of(const std::vector<Scores>& classes) {
  Scores sum{};
  int count = 0;
  for (const Scores& scores : classes) {
    if (scores[0] < 0.0) continue;
    for (std::size_t s = 0; s < sum.size(); ++s) sum[s] += scores[s];
    ++count;
  }
  if (count == 0) return {-1.0, -1.0, -1.0, -1.0, -1.0};
  for (double& value : sum) value /= count;
  return sum;
}

/// The mean, then every class.
std::vector<Scores> all_scores(const std::vector<JudgedScores>& judged,
                               std::span<const int> copies) {
  std::vector<Scores> classes;
  classes.reserve(judged.size() + 1);
  for (const JudgedScores& one : judged) classes.push_back(one.scores(copies));
  classes.insert(classes.begin(), mean_of(classes));
  return classes;
}

results::Interval percentile_interval(const std::vector<double>& samples, double confidence) {
  if (samples.empty()) return {-1.0, -1.0};
  const auto at = [&](double share) {
    return core::quantile(samples, share, core::Between::kNearest);
  };
  return {at(0.5 * (1.0 - confidence)), at(0.5 * (1.0 + confidence))};
}

/// Values of one row over the resamples.
struct Samples {
  std::array<std::vector<double>, kScores> before, after, difference;

  void add(const Scores& b, const Scores& a) {
    if (b[0] < 0.0) return;  // No object was drawn.
    for (std::size_t s = 0; s < b.size(); ++s) {
      before[s].push_back(b[s]);
      after[s].push_back(a[s]);
      difference[s].push_back(a[s] - b[s]);
    }
  }
};

void draw_copies(core::RandomStream& random, std::vector<int>& copies) {
  std::fill(copies.begin(), copies.end(), 0);
  for (std::size_t i = 0; i < copies.size(); ++i) {
    ++copies[random.index(static_cast<std::uint32_t>(copies.size()))];
  }
}

/// Rows for the mean and for every class with objects.
std::vector<ComparisonRow> bootstrap_rows(const JudgedPair& pair, std::size_t images,
                                          const ComparisonOptions& options) {
  std::vector<int> copies(images, 1);
  const std::vector<Scores> before = all_scores(pair.before, copies);
  const std::vector<Scores> after = all_scores(pair.after, copies);
  std::vector<Samples> samples(before.size());
  core::RandomStream random(options.seed, "detector comparison");
  for (int round = 0; round < options.rounds; ++round) {
    draw_copies(random, copies);
    const std::vector<Scores> b = all_scores(pair.before, copies);
    const std::vector<Scores> a = all_scores(pair.after, copies);
    for (std::size_t r = 0; r < samples.size(); ++r) samples[r].add(b[r], a[r]);
  }
  std::vector<ComparisonRow> rows(before.size());
  for (std::size_t r = 0; r < rows.size(); ++r) {
    for (std::size_t s = 0; s < kScores; ++s) {
      const bool there = before[r][s] >= 0.0;
      rows[r].before[s] = {before[r][s],
                           percentile_interval(samples[r].before[s], options.confidence)};
      rows[r].after[s] = {after[r][s],
                          percentile_interval(samples[r].after[s], options.confidence)};
      rows[r].difference[s] = {
          there ? after[r][s] - before[r][s] : 0.0,
          percentile_interval(samples[r].difference[s], options.confidence)};
    }
    if (r > 0) {
      rows[r].objects = pair.before[r - 1].objects();
      rows[0].objects += rows[r].objects;
    }
  }
  return rows;
}

struct NamedRange {
  std::string group, name;
  ObjectRange range;
};

std::vector<NamedRange> ranges_of(const ComparisonOptions& options) {
  std::vector<NamedRange> ranges{{"size", "small", perception::small_objects()},
                                 {"size", "medium", perception::medium_objects()},
                                 {"size", "large", perception::large_objects()}};
  double from_m = 0.0;
  for (std::size_t i = 0; i <= options.distances_m.size(); ++i) {
    ObjectRange range;
    range.min_distance_m = from_m;
    char name[48];
    if (i < options.distances_m.size()) {
      range.max_distance_m = options.distances_m[i];
      std::snprintf(name, sizeof name, "%g to %g m", from_m, options.distances_m[i]);
      from_m = options.distances_m[i];
    } else {
      std::snprintf(name, sizeof name, "from %g m", from_m);
    }
    if (!range.any_distance()) ranges.push_back({"distance", name, range});
  }
  return ranges;
}

std::vector<PrecisionCurve> curves_of(const JudgedPair& pair,
                                      const std::vector<std::string>& class_names) {
  std::vector<PrecisionCurve> curves(1);
  curves[0].name = "mean";
  for (std::size_t c = 0; c < class_names.size(); ++c) {
    if (pair.before[c].objects() == 0) continue;
    curves.push_back({class_names[c],
                      perception::precision_at_recall(pair.before[c].at_iou_50()),
                      perception::precision_at_recall(pair.after[c].at_iou_50())});
  }
  const auto classes = static_cast<double>(std::max<std::size_t>(1, curves.size() - 1));
  for (std::size_t i = 1; i < curves.size(); ++i) {
    for (std::size_t k = 0; k < curves[0].before.size(); ++k) {
      curves[0].before[k] += curves[i].before[k] / classes;
      curves[0].after[k] += curves[i].after[k] / classes;
    }
  }
  return curves;
}

DetectorErrors errors_of(const std::vector<perception::ImageResult>& results, int class_count,
                         float score_threshold) {
  DetectorErrors errors;
  errors.score_threshold = double{score_threshold};
  errors.confusion =
      perception::confusion_matrix(results, class_count, errors.score_threshold);
  const perception::OperatingPoint point =
      perception::average_precision(results, class_count, score_threshold).operating;
  errors.precision = point.precision();
  errors.recall = point.recall();
  return errors;
}

}  // namespace

const char* to_string(Score score) {
  static constexpr std::array<const char*, kScores> kNames{"AP", "AP50", "AR1", "AR10",
                                                           "AR100"};
  return kNames[static_cast<std::size_t>(score)];
}

void compare_results(const ComparisonOptions& options, SetComparison& set) {
  SEGSIM_CHECK(set.before_results.size() == set.after_results.size(), "the same images");
  const int class_count = static_cast<int>(set.dataset.class_names.size());
  const auto before = perception::evaluation_images(set.before_results);
  const auto after = perception::evaluation_images(set.after_results);
  const std::vector<NamedRange> ranges = ranges_of(options);
  core::Progress progress("compare on " + set.name,
                          static_cast<std::int64_t>(ranges.size()) + 1);

  const JudgedPair all = judge(before, after, class_count, perception::all_sizes());
  set.curves = curves_of(all, set.dataset.class_names);
  std::vector<ComparisonRow> rows = bootstrap_rows(all, before.size(), options);
  rows[0].group = "all";
  set.rows.push_back(rows[0]);
  for (std::size_t c = 0; c < set.dataset.class_names.size(); ++c) {
    if (rows[c + 1].objects == 0) continue;
    rows[c + 1].group = "class";
    rows[c + 1].name = set.dataset.class_names[c];
    set.rows.push_back(rows[c + 1]);
  }
  progress.update(1);
  for (std::size_t i = 0; i < ranges.size(); ++i) {
    const JudgedPair judged = judge(before, after, class_count, ranges[i].range);
    ComparisonRow row = bootstrap_rows(judged, before.size(), options)[0];
    row.group = ranges[i].group;
    row.name = ranges[i].name;
    if (row.objects > 0) set.rows.push_back(std::move(row));
    progress.update(static_cast<std::int64_t>(i) + 2);
  }
}

SetComparison compare_on_set(const ComparisonOptions& options, const std::string& name,
                             const std::filesystem::path& coco_json) {
  const perception::DetectorWeights before = perception::read_weights(options.before);
  const perception::DetectorWeights after = perception::read_weights(options.after);
  if (before.class_names != after.class_names) {
    throw core::InputError::expected(options.after.string(),
                                     "the classes of " + options.before.string(), "others");
  }
  SetComparison set;
  set.name = name;
  set.json = coco_json;
  set.dataset = perception::read_coco(coco_json);
  if (set.dataset.images.empty()) {
    throw core::InputError::expected(coco_json.string() + ": images", "at least one", "none");
  }
  perception::match_classes(set.dataset, before.class_names, {});
  // The reference goes through the images by id, which decides between equal scores.
  std::sort(set.dataset.images.begin(), set.dataset.images.end(),
            [](const auto& a, const auto& b) { return a.id < b.id; });
  set.before_results = perception::detect_all(options.before, set.dataset);
  set.after_results = perception::detect_all(options.after, set.dataset);
  const int class_count = static_cast<int>(before.class_names.size());
  set.before = errors_of(set.before_results, class_count, before.score_threshold);
  set.after = errors_of(set.after_results, class_count, after.score_threshold);
  compare_results(options, set);
  return set;
}

}  // namespace segsim::experiments::detection
