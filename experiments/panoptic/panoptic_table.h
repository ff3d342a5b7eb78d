#pragma once

/// @file
/// The paper's Table 1 (quality of panoptic segmentation), filled with what was reached here,
/// beside the paper's own rows.

#include <span>
#include <string>
#include <vector>

#include "core/process/measurement_record.h"
#include "experiments/panoptic/panoptic_scenes.h"
#include "experiments/panoptic/scene_figures.h"
#include "experiments/results/table.h"

namespace segsim::experiments::panoptic {

/// A row of the paper for one data set, in percent: Fast-SegSim (arXiv 2604.10951), table
/// "Panoptic Segmentation quality using different methods".
struct PaperRow {
  const char* method;
  const char* data;  ///< "ScanNet" or "ScanNet++".
  const char* head;  ///< Ours that learns in this way; "" if there is none.
  double pq, sq, rq, mean_iou, mean_accuracy, coverage, weighted_coverage;
};

/// All rows, method by method in the paper's order.
[[nodiscard]] std::span<const PaperRow> paper_table1();

struct PanopticTable {
  std::vector<SceneFigures> results;  ///< In the order of heads, then scenes.
  std::vector<std::string> rules;     ///< Of panoptic_rule_names().
  std::vector<MissingScene> missing;
  bool quick = false;  ///< Trained for seconds (make_quick()): the table says so.
  int planned = 0;     ///< Pairs of scene and head; fewer results: not finished.
};

/// @throws core::InputError for an unknown name; "all" stands for every set.
[[nodiscard]] std::vector<std::string> parse_rules(const std::string& text);
/// @throws core::InputError for a head that is unknown or comes twice.
[[nodiscard]] std::vector<std::string> parse_heads(const std::string& text);

/// Every figure in percent. For each head the scenes, the mean of each data set with more than
/// one, and the paper's rows of that method; under zju all of the paper's rows.
[[nodiscard]] std::string format_panoptic_table(const PanopticTable& table,
                                                support::TableFormat format);

/// Our rows of it, scenes and means, in percent.
/// @param on_gpu  Whether training ran there. @pre At least one result.
[[nodiscard]] core::MeasurementRecord panoptic_record(const PanopticTable& table, bool on_gpu);

}  // namespace segsim::experiments::panoptic
