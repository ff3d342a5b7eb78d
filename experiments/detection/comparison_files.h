#pragma once

/// @file
/// A comparison of detectors as text, Markdown, CSV and JSON, and its pictures.

#include <filesystem>
#include <string>
#include <vector>

#include "core/image.h"
#include "core/process/measurement_record.h"
#include "experiments/detection/detector_comparison.h"

namespace segsim::experiments::detection {

struct ComparisonReport {
  ComparisonOptions options;
  std::vector<SetComparison> sets;
  std::vector<std::string> notes;  ///< What a reader must know, for example about leaks.
};

[[nodiscard]] std::string comparison_text(const ComparisonReport& report);
[[nodiscard]] std::string comparison_markdown(const ComparisonReport& report);
/// One line for each set, row and score.
[[nodiscard]] std::string comparison_csv(const ComparisonReport& report);
/// All of it, with curves and confusion matrices.
[[nodiscard]] std::string comparison_json(const ComparisonReport& report);

/// Every number of every set in percent, those of no object left out.
[[nodiscard]] core::MeasurementRecord comparison_record(const ComparisonReport& report);

/// Precision over recall at IoU 0.5: the mean large, classes small. 'Before' grey, 'after'
/// blue.
[[nodiscard]] core::Image<core::Rgb8> draw_precision_curves(const SetComparison& set);

/// Rows are what is there, columns what the detector says; before left, after right.
[[nodiscard]] core::Image<core::Rgb8> draw_confusion(const SetComparison& set);

/// The images that go most wrong after tuning, each error weighed by how sure the detector was
/// or how large the missed object is; at most `count`. Empty if nothing goes wrong.
[[nodiscard]] core::Image<core::Rgb8> draw_worst_misses(const SetComparison& set, int count);

/// compare.txt, .md, .csv, .json; for each set precision-NAME.png, confusion-NAME.png and
/// misses-NAME.png.
void write_comparison(const std::filesystem::path& folder, const ComparisonReport& report);

}  // namespace segsim::experiments::detection
