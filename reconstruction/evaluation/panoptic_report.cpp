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

}  // namespace segsim::reconstruction
