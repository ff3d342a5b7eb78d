#pragma once

/// @file
/// Panoptic quality (Kirillov et al., CVPR 2019) of a scene, under the rules that papers use.
///
///     PQ = sum of IoU of matched segments / (TP + FP / 2 + FN / 2) = SQ * RQ      of one
///     class
///
/// and the mean over classes of each of the three; the product no longer holds for the means.
/// Segments are of a whole *scene*: an object whose id changes from view to view falls apart,
/// which no figure of single views can see. docs/metrics.md compares the rules on one example;
/// numbers of different rules must not be compared.

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "core/scene_bundle.h"
#include "reconstruction/evaluation/contingency.h"

namespace segsim::reconstruction {

struct PanopticRules {
  std::string name = "strict";
  /// A true and a predicted segment of one class match if their IoU is *greater*. Below 0.5 a
  /// segment may match several, and every pair counts.
  double min_iou = 0.5;
  /// Segments of single views; TP, FP, FN and IoU add up over the views. Else of the scene.
  bool per_frame = false;
  /// An id is one segment of its majority class, instead of one per class it occurs with.
  bool segments_by_id = false;
  /// A class that occurs neither in the truth nor in the prediction enters the mean as 0.
  bool absent_class_is_zero = false;
  /// Pixels predicted void do not enter the IoU, and a true segment with more than half of its
  /// pixels on them is not missed.
  bool predicted_void_is_neutral = false;
  /// Pixels whose true class is 0 are dropped before anything else.
  bool drop_true_void = false;
  /// A true crowd is no segment: nothing matches it, and nobody misses it. A prediction of its
  /// class with more than half of its pixels on it or on void is no false positive. Else a
  /// crowd is a segment like others.
  bool crowds_are_ignored = false;
  /// Classes with a smaller share of the pixels, in truth or prediction, become void in both.
  double min_class_share = 0.0;

  /// The reference definition: IoU > 0.5 on segments of the scene.
  [[nodiscard]] static PanopticRules strict();
  /// What PanopticRecon++'s scripts compute, and so presumably the paper's table.
  /// @param min_iou  0.1 for ScanNet, 0.3 for ScanNet++ and Replica.
  [[nodiscard]] static PanopticRules zju(double min_iou);
  /// What Panoptic Lifting and Contrastive Lift compute.
  [[nodiscard]] static PanopticRules panoptic_lifting();
  /// COCO's (cocodataset/panopticapi, evaluation.py at 1ad5afa, read for its behaviour), with
  /// its rule for crowds: blind to ids that change between views. A diagnostic.
  [[nodiscard]] static PanopticRules coco_per_frame();
};

struct ClassPanoptic {
  std::uint16_t class_id = 0;
  bool thing = false;
  bool counted = false;  ///< Enters the means.
  double iou_sum = 0.0;
  std::uint64_t true_positives = 0, false_positives = 0, missed = 0;

  [[nodiscard]] double pq() const;  ///< 0 without segments, as the others.
  [[nodiscard]] double sq() const;
  [[nodiscard]] double rq() const;
};

/// All in [0, 1]; means over the counted classes, 0 if there are none.
struct PanopticQuality {
  std::vector<ClassPanoptic> classes;  ///< In the order given.
  double pq = 0.0, sq = 0.0, rq = 0.0;
  double pq_things = 0.0, pq_stuff = 0.0;
};

/// @param classes  Those evaluated. Pixels of any other class are void.
[[nodiscard]] PanopticQuality panoptic_quality(const ContingencyTable& table,
                                               std::span<const core::SceneClass> classes,
                                               const PanopticRules& rules);

}  // namespace segsim::reconstruction
