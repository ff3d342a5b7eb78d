#include "reconstruction/evaluation/panoptic_report.h"

namespace segsim::reconstruction {

PanopticReport panoptic_report(const ContingencyTable& table,
                               std::span<const core::SceneClass> classes,
                               const PanopticRules& rules) {
  PanopticReport report;
  report.rules = rules.name;
  report.views = table.frame_count();
  report.panoptic = panoptic_quality(table, classes, rules);
  SemanticRules per_frame = SemanticRules::averaged_per_frame();
  SemanticRules pooled = SemanticRules::pooled();
  // Absent classes and predicted void count in the semantic means as they do in the papers
  // whose panoptic rules these are.
  if (rules.absent_class_is_zero && rules.segments_by_id) per_frame = SemanticRules::zju();
  if (rules.predicted_void_is_neutral) pooled = SemanticRules::panoptic_lifting();
  report.per_frame = semantic_quality(table, classes, per_frame);
  report.pooled = semantic_quality(table, classes, pooled);
  report.coverage = instance_coverage(table, classes);
  return report;
}

std::vector<PanopticReport> all_panoptic_reports(const ContingencyTable& held_out,
                                                 const ContingencyTable& training,
                                                 std::span<const core::SceneClass> classes,
                                                 double zju_min_iou) {
  struct Row {
    const ContingencyTable& table;
    const char* views;
    PanopticRules rules;
  };
  const std::vector<Row> rows{
      {held_out, "held-out views", PanopticRules::strict()},
      {training, "training trajectory", PanopticRules::strict()},
      {training, "training trajectory", PanopticRules::zju(zju_min_iou)},
      {held_out, "held-out views", PanopticRules::panoptic_lifting()},
      {held_out, "held-out views", PanopticRules::coco_per_frame()}};
  std::vector<PanopticReport> reports;
  for (const Row& row : rows) {
    if (row.table.frame_count() == 0) continue;
    reports.push_back(panoptic_report(row.table, classes, row.rules));
    reports.back().rules = row.rules.name + ", " + row.views;
  }
  return reports;
}

}  // namespace segsim::reconstruction
