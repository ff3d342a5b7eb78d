#pragma once

/// @file
/// What a head reached in a scene, and the file that keeps it.

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "core/scene_bundle.h"
#include "reconstruction/evaluation/contingency.h"

namespace segsim::experiments::panoptic {

/// Columns of the paper's Table 1 under one set of rules. All in [0, 1].
struct RuleFigures {
  std::string rules;  ///< One of panoptic_rule_names().
  int views = 0;
  double pq = 0.0, sq = 0.0, rq = 0.0, pq_things = 0.0, pq_stuff = 0.0;
  double pooled_iou = 0.0, pooled_accuracy = 0.0;        ///< Means over classes.
  double per_frame_iou = 0.0, per_frame_accuracy = 0.0;  ///< The same, averaged per frame.
  double coverage = 0.0, weighted_coverage = 0.0;        ///< mCov, mW-Cov.

  /// mIoU and mAcc in the convention of the papers that use these rules: averaged per frame
  /// for zju and coco, else pooled.
  [[nodiscard]] double mean_iou() const;
  [[nodiscard]] double mean_accuracy() const;
};

/// "strict", "trajectory", "zju", "lifting", "coco": docs/metrics.md.
[[nodiscard]] const std::vector<std::string>& panoptic_rule_names();
/// What a rule set compares, in a few words.
[[nodiscard]] std::string describe_rules(const std::string& rules);

/// All rule sets. @param classes  Those evaluated.
[[nodiscard]] std::vector<RuleFigures> all_rule_figures(
    const reconstruction::ContingencyTable& held_out,
    const reconstruction::ContingencyTable& trajectory,
    const std::vector<core::SceneClass>& classes, double zju_min_iou);

/// One scene, one head.
struct SceneFigures {
  std::string scene, title, data, head;
  std::string masks;    ///< That were learnt from, in words.
  std::string recipe;   ///< All that decides the figures, in words.
  std::string version;  ///< Of the program.
  std::vector<RuleFigures> rules;
  /// Name, value: of the held-out views and of training; of the masks.
  std::vector<std::pair<std::string, double>> statistics, mask_quality;

  /// nullptr if it was not computed.
  [[nodiscard]] const RuleFigures* find(const std::string& rules_name) const;
  /// NaN if there is none.
  [[nodiscard]] double statistic(const std::string& name) const;
  [[nodiscard]] double mask_figure(const std::string& name) const;
};

/// JSON, written atomically.
void write_scene_figures(const std::filesystem::path& file, const SceneFigures& result);
/// @throws core::InputError for a damaged file or one of another schema.
[[nodiscard]] SceneFigures read_scene_figures(const std::filesystem::path& file);

}  // namespace segsim::experiments::panoptic
