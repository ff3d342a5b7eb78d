#pragma once

/// @file
/// How good an arm's detector is on views that nothing was tuned on, and what may flatter it.

#include <optional>

namespace segsim::experiments::records {

/// Detection on the held-out views of an experiment's scenes.
struct HeldOutPrecision {
  int views = 0;
  double ap50 = 0.0,
         ap = 0.0;  ///< COCO, [0, 1]; see perception/evaluation/average_precision.h.
  double score_threshold = 0.0;
  double precision = 0.0, recall = 0.0;  ///< At that threshold, IoU 0.5, all classes together.
  /// What tuning costs elsewhere: AP50 in rooms of the source domain and in homes that no step
  /// has seen; none if that was not measured.
  std::optional<double> source_ap50{}, unseen_ap50{};
};

/// How many of the views that a detector was tuned on lie near the start of an evaluation
/// episode.
struct StartLeak {
  int views = 0, near_starts = 0;
  double radius_m = 0.0;
};

}  // namespace segsim::experiments::records
