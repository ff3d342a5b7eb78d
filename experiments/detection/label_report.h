#pragma once

/// @file
/// What `segsim label` writes beside the labels: counts, consistency of the objects, a contact
/// sheet, and the text layout of YOLO trainers.

#include <filesystem>
#include <string>
#include <vector>

#include "experiments/detection/label_consistency.h"
#include "experiments/detection/view_split.h"
#include "perception/data/dataset.h"

namespace segsim::experiments::detection {

struct LabelReport {
  perception::CocoDataset dataset;
  ViewSplit split;
  std::vector<InstanceConsistency> instances;
  /// How the views were chosen, in words: what a reader must know before using them.
  std::vector<std::string> notes;
};

/// "consistency.csv", one row an instance.
void write_consistency(const std::filesystem::path& file,
                       const std::vector<InstanceConsistency>& instances);

/// Notes, boxes by class and set, consistency; Markdown.
[[nodiscard]] std::string label_report_markdown(const LabelReport& report);

/// Up to `count` views, evenly through the data set, with their boxes.
void write_contact_sheet(const std::filesystem::path& file,
                         const perception::CocoDataset& dataset, int count,
                         const std::string& title);

/// labels.json, train.json, val_views.json, val_scenes.json (those that are not empty;
/// an older file of an empty one is removed),
/// labels/*.txt with data.yaml, consistency.csv, report.md, contact_sheet.png.
void write_label_files(const std::filesystem::path& folder, const LabelReport& report);

}  // namespace segsim::experiments::detection
