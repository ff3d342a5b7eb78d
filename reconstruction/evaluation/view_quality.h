#pragma once

/// @file
/// Quality of the masks of single views, to judge a 2-D segmenter: ids need not mean anything
/// beyond their view.
///
/// In each view the segments of all classes are pooled; the pairs of one class are taken
/// greedily by descending IoU, one to one, above `min_iou`; PQ = SQ * RQ of the view; then the
/// mean over views. These are the rules under which the quality of Grounded-SAM masks was
/// published (IoU > 0.3), so that numbers can be compared.

#include <span>

#include "core/scene_bundle.h"
#include "reconstruction/evaluation/contingency.h"

namespace segsim::reconstruction {

struct ViewRules {
  double min_iou = 0.3;
  /// Segments with fewer pixels do not exist, on either side: nobody masks three pixels. True
  /// ones are void instead. At an image width of 320; other widths scale the area.
  double min_truth_px = 25.0, min_predicted_px = 8.0;
  int width_px = 320;  ///< Of the images in the table.
};

/// Means over views; shares in [0, 1].
struct ViewQuality {
  double pq = 0.0, sq = 0.0, rq = 0.0;  ///< A view without any match has PQ = SQ = RQ = 0.
  double mean_iou = 0.0, mean_accuracy = 0.0;  ///< Averaged per frame (semantic_quality.h).
  double mean_coverage = 0.0;                  ///< mCov of each view.
  double recall = 0.0, precision = 0.0;        ///< Of all segments of all views.
  double true_segments = 0.0, predicted_segments = 0.0, matches = 0.0;  ///< A view.
  double labelled_share = 0.0;                                          ///< Not void.
  std::size_t views = 0;
};

/// Views without any true or predicted segment are left out.
[[nodiscard]] ViewQuality view_quality(const ContingencyTable& table,
                                       std::span<const core::SceneClass> classes,
                                       const ViewRules& rules = {});

}  // namespace segsim::reconstruction
