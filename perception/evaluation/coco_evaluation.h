#pragma once

/// @file
/// COCO's evaluation of boxes, in double precision: which detection finds which object, and
/// the averages over classes, IoU thresholds, sizes and numbers of detections. Written from
/// the rules of the reference (cocodataset/cocoapi, PythonAPI/pycocotools/cocoeval.py, commit
/// 8c9bcc3); `docs/detector_comparison.md` lists them.
///
///     one class of one image: detections in descending score, each takes the free object of
///     greatest IoU >= threshold -> true / false / ignored -> all images in descending score
///     -> precision made monotonic from the right -> mean at 101 recall points
///
/// Departures: an annotation's own `ignore` counts (the reference overwrites it with
/// `iscrowd`; `CocoRules::honour_ignore = false` does the same), and objects can be selected
/// by distance.

#include <array>
#include <filesystem>
#include <limits>
#include <span>
#include <string>
#include <vector>

namespace segsim::perception {

/// COCO's `bbox`: corner and size, in pixels, half-open.
struct RegionPx {
  double x = 0.0, y = 0.0, width = 0.0, height = 0.0;
  [[nodiscard]] double area_px2() const { return width * height; }
};

/// Intersection over union; over the detection's own area if the truth is a crowd.
[[nodiscard]] double region_overlap(const RegionPx& detection, const RegionPx& truth,
                                    bool crowd = false);

struct TruthRegion {
  int class_index = 0;
  RegionPx region;
  double area_px2 = 0.0;  ///< The annotation's `area`: decides small, medium or large.
  bool ignore = false, crowd = false;
  double distance_m = std::numeric_limits<double>::quiet_NaN();  ///< NaN = unknown.
};

struct ScoredRegion {
  int class_index = 0;
  RegionPx region;
  double score = 0.0;
};

/// Ties of score count in the order given, within an image and then over images.
struct EvaluationImage {
  std::vector<TruthRegion> truth;
  std::vector<ScoredRegion> detections;
};

/// Objects outside are ignored. So are detections whose area is outside and which find
/// nothing; a detection's distance is not known, so in a range of distance every wrong one
/// counts.
struct ObjectRange {
  double min_area_px2 = 0.0, max_area_px2 = 1e10;  ///< Both inclusive, as COCO has them.
  double min_distance_m = 0.0;
  double max_distance_m = std::numeric_limits<double>::infinity();  ///< Exclusive.
  [[nodiscard]] bool any_distance() const;
};
[[nodiscard]] ObjectRange all_sizes();
[[nodiscard]] ObjectRange small_objects();   ///< Up to 32^2 px^2.
[[nodiscard]] ObjectRange medium_objects();  ///< 32^2 to 96^2.
[[nodiscard]] ObjectRange large_objects();   ///< From 96^2.

inline constexpr int kIouThresholds = 10;   ///< 0.50, 0.55, ... 0.95.
inline constexpr int kRecallPoints = 101;   ///< 0, 0.01, ... 1.
inline constexpr int kMaxDetections = 100;  ///< Of one class in one image.

/// Threshold number k in [0, 10), rounded as numpy.linspace(0.5, 0.95, 10) rounds it: other
/// roundings differ at exact ties.
[[nodiscard]] double iou_threshold(int k);

enum class Verdict : unsigned char { kTrue, kFalse, kIgnored };

struct JudgedDetection {
  double score = 0.0;
  Verdict verdict = Verdict::kFalse;
  int image = 0, detection = 0;  ///< Indices into the images and their detections.
  int truth = -1;                ///< Index into the image's truth; -1 = found nothing.
};

/// One class at one IoU threshold.
struct JudgedClass {
  std::vector<JudgedDetection> detections;  ///< All images, in descending score.
  std::vector<int> objects_of_image;        ///< That count.
  [[nodiscard]] int objects() const;
};

/// @param max_detections  Of each image: those of highest score.
[[nodiscard]] JudgedClass judge_class(std::span<const EvaluationImage> images, int class_index,
                                      double min_iou, int max_detections = kMaxDetections,
                                      const ObjectRange& range = {});

/// Highest precision at recall >= k * 0.01, k = 0 ... 100; 0 where that recall is not reached.
/// All -1 without objects.
/// @param copies  How often each image counts, for resampling; empty = once each.
[[nodiscard]] std::array<double, kRecallPoints> precision_at_recall(
    const JudgedClass& judged, std::span<const int> copies = {});
/// Mean of precision_at_recall: average precision. -1 without objects.
[[nodiscard]] double mean_precision(const JudgedClass& judged,
                                    std::span<const int> copies = {});
/// Share of the objects that any detection finds; -1 without objects.
[[nodiscard]] double greatest_recall(const JudgedClass& judged,
                                     std::span<const int> copies = {});

/// A judged class for many resamples: the same numbers, with work for what can change them
/// only.
class ResampledClass {
 public:
  ResampledClass() = default;
  explicit ResampledClass(const JudgedClass& judged);
  [[nodiscard]] int objects() const { return objects_; }
  /// As mean_precision(). @param copies  One number for each image.
  [[nodiscard]] double mean_precision(std::span<const int> copies) const;
  /// As greatest_recall().
  [[nodiscard]] double greatest_recall(std::span<const int> copies) const;

 private:
  struct Row {
    int image = 0;
    bool right = false;
  };
  /// Images with objects, or with detections that found one.
  struct ImageCount {
    int image = 0, objects = 0, found = 0;
  };
  [[nodiscard]] double count_objects(std::span<const int> copies) const;

  int objects_ = 0;
  std::size_t images_ = 0;
  std::vector<Row> rows_;  ///< Up to the last that found an object: others move no sample.
  std::vector<ImageCount> counts_;
};

/// COCO's twelve numbers; each is the mean over the classes that have such objects, -1 if none
/// has.
struct CocoSummary {
  double ap = -1.0, ap50 = -1.0, ap75 = -1.0;
  double ap_small = -1.0, ap_medium = -1.0, ap_large = -1.0;
  double ar_1 = -1.0, ar_10 = -1.0, ar_100 = -1.0;
  double ar_small = -1.0, ar_medium = -1.0, ar_large = -1.0;
};
[[nodiscard]] CocoSummary coco_summary(std::span<const EvaluationImage> images,
                                       int class_count);

struct CocoRules {
  bool honour_ignore = true;  ///< False: only `iscrowd` is ignored, as the reference does.
};

/// A COCO "instances" file and a COCO "results" file ([{image_id, category_id, bbox, score}]).
struct CocoFiles {
  std::vector<std::string> class_names;  ///< In ascending order of category id.
  std::vector<EvaluationImage> images;   ///< In ascending order of image id.
};
/// Numbers are kept in double precision, so that ties stay ties.
/// @throws core::InputError naming file and key: as read_coco; a result of an unknown image or
/// category, a box without four numbers, a score that is not finite.
[[nodiscard]] CocoFiles read_coco_results(const std::filesystem::path& truth_json,
                                          const std::filesystem::path& results_json,
                                          const CocoRules& rules = {});

}  // namespace segsim::perception
