#pragma once

/// @file
/// The five rule sets side by side, from two tables: views held out of training, and views of
/// the training trajectory.

#include <string>
#include <vector>

#include "reconstruction/evaluation/instance_coverage.h"
#include "reconstruction/evaluation/panoptic_quality.h"
#include "reconstruction/evaluation/semantic_quality.h"

namespace segsim::reconstruction {

/// One row of a table: the paper's columns under one set of rules.
struct PanopticReport {
  std::string rules;  ///< For example "strict, held-out views".
  PanopticQuality panoptic;
  SemanticQuality per_frame, pooled;  ///< mIoU and mAcc in both conventions.
  CoverageQuality coverage;           ///< mCov, mW-Cov.
  std::size_t views = 0;
};

/// @param classes  Those evaluated.
[[nodiscard]] PanopticReport panoptic_report(const ContingencyTable& table,
                                             std::span<const core::SceneClass> classes,
                                             const PanopticRules& rules);

/// strict (held-out), strict (training trajectory), zju (training trajectory),
/// panoptic-lifting (held-out), coco-per-frame (held-out), in this order. A table without
/// frames leaves its rows out.
/// @param zju_min_iou  0.1 for ScanNet, 0.3 otherwise.
[[nodiscard]] std::vector<PanopticReport> all_panoptic_reports(
    const ContingencyTable& held_out, const ContingencyTable& training,
    std::span<const core::SceneClass> classes, double zju_min_iou);

}  // namespace segsim::reconstruction
