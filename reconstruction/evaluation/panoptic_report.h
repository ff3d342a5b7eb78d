#pragma once

/// @file
/// All figures of labels under one rule set: a row of the paper's table 1.

#include <string>
#include <vector>

#include "reconstruction/evaluation/instance_coverage.h"
#include "reconstruction/evaluation/panoptic_quality.h"
#include "reconstruction/evaluation/semantic_quality.h"

namespace segsim::reconstruction {

/// One row of a table: the paper's columns under one set of rules.
struct PanopticReport {
  std::string rules;  ///< PanopticRules::name.
  PanopticQuality panoptic;
  SemanticQuality per_frame, pooled;  ///< mIoU and mAcc in both conventions.
  CoverageQuality coverage;           ///< mCov, mW-Cov.
  std::size_t views = 0;
};

/// @param classes  Those evaluated.
[[nodiscard]] PanopticReport panoptic_report(const ContingencyTable& table,
                                             std::span<const core::SceneClass> classes,
                                             const PanopticRules& rules);

}  // namespace segsim::reconstruction
