#include "reconstruction/evaluation/view_quality.h"

#include <algorithm>
#include <tuple>

#include "reconstruction/evaluation/instance_coverage.h"
#include "reconstruction/evaluation/internal/segments.h"
#include "reconstruction/evaluation/semantic_quality.h"

namespace segsim::reconstruction {
namespace {

using internal::Segment;
using internal::Segmentation;
using internal::SegmentOverlap;

struct ViewCounts {
  double true_segments = 0.0, predicted_segments = 0.0, matches = 0.0;
  double ignored = 0.0;  ///< Unmatched predictions that lie on void.
  double iou_sum = 0.0;

  [[nodiscard]] double false_positives() const {
    return predicted_segments - matches - ignored;
  }
};

/// Area below which a segment is overlooked, in pixels of the table's images.
struct SmallestSegments {
  double truth_px = 0.0, predicted_px = 0.0;
};

ViewCounts count_view(std::span<const Overlap> overlaps,
                      std::span<const core::SceneClass> classes, double min_iou,
                      const SmallestSegments& smallest) {
  using internal::segments_by_label;
  Segmentation truth = segments_by_label(internal::truth_pixels(overlaps), classes);
  Segmentation predicted = segments_by_label(internal::predicted_pixels(overlaps), classes);
  const auto exists = [](const Segment& segment, double smallest_px) {
    return static_cast<double>(segment.pixels) >= smallest_px;
  };

  std::vector<std::tuple<double, int, int>> pairs;  // (-IoU, truth, predicted)
  const std::vector<SegmentOverlap> common = cross(overlaps, truth, predicted);
  for (const SegmentOverlap& pair : common) {  // True segments that do not exist are void.
    if (!exists(truth.segments[static_cast<std::size_t>(pair.truth)], smallest.truth_px)) {
      predicted.segments[static_cast<std::size_t>(pair.predicted)].void_pixels += pair.pixels;
    }
  }
  for (const SegmentOverlap& pair : common) {
    const Segment& g = truth.segments[static_cast<std::size_t>(pair.truth)];
    const Segment& p = predicted.segments[static_cast<std::size_t>(pair.predicted)];
    if (g.class_id != p.class_id || !exists(g, smallest.truth_px) ||
        !exists(p, smallest.predicted_px)) {
      continue;
    }
    const double iou = static_cast<double>(pair.pixels) /
                       static_cast<double>(g.pixels + p.pixels - pair.pixels - p.void_pixels);
    if (iou > min_iou) pairs.emplace_back(-iou, pair.truth, pair.predicted);
  }
  std::sort(pairs.begin(), pairs.end());

  ViewCounts counts;
  std::vector<bool> found(truth.segments.size()), used(predicted.segments.size());
  for (const auto& [negative_iou, g, p] : pairs) {
    if (found[static_cast<std::size_t>(g)] || used[static_cast<std::size_t>(p)]) continue;
    found[static_cast<std::size_t>(g)] = used[static_cast<std::size_t>(p)] = true;
    counts.matches += 1.0;
    counts.iou_sum -= negative_iou;
  }
  for (const Segment& g : truth.segments) {
    counts.true_segments += exists(g, smallest.truth_px) ? 1.0 : 0.0;
  }
  for (std::size_t p = 0; p < used.size(); ++p) {
    const Segment& segment = predicted.segments[p];
    if (!exists(segment, smallest.predicted_px)) continue;
    counts.predicted_segments += 1.0;
    if (!used[p] && 2 * segment.void_pixels > segment.pixels) counts.ignored += 1.0;
  }
  return counts;
}

double labelled_share(std::span<const Overlap> overlaps) {
  double all = 0.0, labelled = 0.0;
  for (const Overlap& cell : overlaps) {
    all += static_cast<double>(cell.pixels);
    if (cell.predicted.class_id != 0) labelled += static_cast<double>(cell.pixels);
  }
  return all > 0.0 ? labelled / all : 0.0;
}

double coverage_of_view(std::span<const Overlap> overlaps,
                        std::span<const core::SceneClass> classes, double& views) {
  ContingencyTable one;
  one.add_overlaps(overlaps);
  const CoverageQuality coverage = instance_coverage(one, classes);
  views += coverage.instances.empty() ? 0.0 : 1.0;
  return coverage.mean;
}

}  // namespace

ViewQuality view_quality(const ContingencyTable& table,
                         std::span<const core::SceneClass> classes, const ViewRules& rules) {
  const double scale = rules.width_px * rules.width_px / (320.0 * 320.0);
  const SmallestSegments smallest{scale * rules.min_truth_px, scale * rules.min_predicted_px};
  ViewQuality mean;
  double found_on_truth = 0.0, views_with_objects = 0.0;
  for (std::size_t i = 0; i < table.frame_count(); ++i) {
    const ViewCounts counts = count_view(table.frame(i), classes, rules.min_iou, smallest);
    if (counts.true_segments + counts.predicted_segments == 0.0) continue;
    ++mean.views;
    mean.true_segments += counts.true_segments;
    mean.predicted_segments += counts.predicted_segments;
    mean.matches += counts.matches;
    found_on_truth += counts.matches + counts.false_positives();
    mean.labelled_share += labelled_share(table.frame(i));
    mean.mean_coverage += coverage_of_view(table.frame(i), classes, views_with_objects);
    if (counts.matches == 0.0) continue;
    const double sq = counts.iou_sum / counts.matches;
    const double rq = 2.0 * counts.matches /
                      (counts.matches + counts.false_positives() + counts.true_segments);
    mean.sq += sq, mean.rq += rq, mean.pq += sq * rq;
  }
  if (mean.views == 0) return mean;
  mean.recall = mean.true_segments > 0.0 ? mean.matches / mean.true_segments : 0.0;
  mean.precision = found_on_truth > 0.0 ? mean.matches / found_on_truth : 0.0;
  for (double* sum : {&mean.pq, &mean.sq, &mean.rq, &mean.true_segments,
                      &mean.predicted_segments, &mean.matches, &mean.labelled_share}) {
    *sum /= static_cast<double>(mean.views);
  }
  mean.mean_coverage /= std::max(views_with_objects, 1.0);
  const SemanticQuality semantic =
      semantic_quality(table, classes, SemanticRules::averaged_per_frame());
  mean.mean_iou = semantic.mean_iou;
  mean.mean_accuracy = semantic.mean_accuracy;
  return mean;
}

}  // namespace segsim::reconstruction
