#include "experiments/detection/label_report.h"

#include <algorithm>
#include <cstdio>
#include <map>
#include <ostream>

#include "core/file_io.h"
#include "core/formatted.h"
#include "experiments/drawing/box_picture.h"
#include "experiments/support/text_grid.h"
#include "perception/data/image_file.h"
#include "perception/data/yolo_labels.h"

namespace segsim::experiments::detection {
namespace {

namespace fs = std::filesystem;
using core::print;
using perception::CocoDataset;
using perception::LabeledBox;
using perception::LabeledImage;
using support::internal::TextGrid;

constexpr int kSheetPictures = 20, kSheetColumns = 4;

struct BoxCounts {
  int scored = 0, ignored = 0, truncated = 0, occluded = 0;
  void add(const LabeledBox& box) {
    (box.not_scored() ? ignored : scored) += 1;
    if (box.truncated) ++truncated;
    if (box.occluded) ++occluded;
  }
};

std::vector<BoxCounts> counts_of(const CocoDataset& dataset) {
  std::vector<BoxCounts> counts(dataset.class_names.size());
  for (const LabeledImage& image : dataset.images) {
    for (const LabeledBox& box : image.boxes) {
      counts[static_cast<std::size_t>(box.class_index)].add(box);
    }
  }
  return counts;
}

TextGrid class_grid(const LabelReport& report) {
  TextGrid grid;
  grid.header = {"class", "boxes", "ignored", "truncated", "occluded", "in training"};
  const std::vector<BoxCounts> all = counts_of(report.dataset);
  const std::vector<BoxCounts> train = counts_of(report.split.train);
  for (std::size_t i = 0; i < all.size(); ++i) {
    grid.rows.push_back({report.dataset.class_names[i], std::to_string(all[i].scored),
                         std::to_string(all[i].ignored), std::to_string(all[i].truncated),
                         std::to_string(all[i].occluded),
                         i < train.size() ? std::to_string(train[i].scored) : "0"});
  }
  return grid;
}

std::string share_text(double value) { return value < 0.0 ? "-" : print("%.2f", value); }

TextGrid consistency_grid(const std::vector<InstanceConsistency>& instances) {
  TextGrid grid;
  grid.header = {"object",    "class", "views",          "differ",
                 "agreement", "whole", "extent overlap", "size ratio"};
  for (const InstanceConsistency& c : instances) {
    grid.rows.push_back({c.scene + "/" + c.name, c.class_name, std::to_string(c.views),
                         std::to_string(c.differing_views), print("%.3f", c.label_agreement),
                         std::to_string(c.whole_views), share_text(c.extent_overlap),
                         c.size_ratio < 0.0 ? "-"
                                            : print("%.2f", c.size_ratio) + " (spread " +
                                                  print("%.2f", c.size_ratio_spread) + ")"});
  }
  return grid;
}

/// Least consistent first: those are the ones to look at.
std::vector<InstanceConsistency> by_doubt(std::vector<InstanceConsistency> instances) {
  std::stable_sort(instances.begin(), instances.end(), [](const auto& a, const auto& b) {
    return a.label_agreement < b.label_agreement;
  });
  return instances;
}

std::string set_line(const char* name, const CocoDataset& dataset) {
  int boxes = 0;
  for (const BoxCounts& count : counts_of(dataset)) boxes += count.scored;
  return std::string("- ") + name + ": " + std::to_string(dataset.images.size()) + " views, " +
         std::to_string(boxes) + " boxes\n";
}

}  // namespace

void write_consistency(const fs::path& file,
                       const std::vector<InstanceConsistency>& instances) {
  core::write_file_atomically(file, [&](std::ostream& out) {
    out << "scene,instance_id,name,class,views,ignored_views,differing_views,"
           "label_agreement,whole_views,extent_overlap,size_ratio,size_ratio_spread\n";
    for (const InstanceConsistency& c : instances) {
      out << c.scene << ',' << c.instance_id << ',' << c.name << ',' << c.class_name << ','
          << c.views << ',' << c.ignored_views << ',' << c.differing_views << ','
          << print("%.6f", c.label_agreement) << ',' << c.whole_views << ','
          << print("%.6f", c.extent_overlap) << ',' << print("%.6f", c.size_ratio) << ','
          << print("%.6f", c.size_ratio_spread) << '\n';
    }
  });
}

std::string label_report_markdown(const LabelReport& report) {
  std::string text = "# Labels\n\n";
  for (const std::string& note : report.notes) text += "- " + note + "\n";
  text += "\n## Sets\n\n" + set_line("all", report.dataset) +
          set_line("train", report.split.train) +
          set_line("held-out viewpoints", report.split.val_views) +
          set_line("held-out scenes", report.split.val_scenes);
  text +=
      "- in no set, too much like a held-out view: " + std::to_string(report.split.dropped) +
      "\n";
  text += "\n## Boxes\n\n" + markdown_of(class_grid(report));
  text += "\n## Consistency of the objects over their views, the most doubtful first\n\n" +
          markdown_of(consistency_grid(by_doubt(report.instances)));
  return text;
}

void write_contact_sheet(const fs::path& file, const CocoDataset& dataset, int count,
                         const std::string& title) {
  std::vector<drawing::SheetPicture> pictures;
  const std::size_t images = dataset.images.size();
  const std::size_t shown = std::min(images, static_cast<std::size_t>(count));
  for (std::size_t k = 0; k < shown; ++k) {
    const LabeledImage& image = dataset.images[k * images / shown];
    pictures.push_back({drawing::draw_boxes(perception::read_image(dataset.image_file(image)),
                                            image.boxes, {}, dataset.class_names),
                        image.file});
  }
  if (pictures.empty()) return;
  perception::write_image(file, drawing::picture_sheet(pictures, kSheetColumns, title));
}

void write_label_files(const fs::path& folder, const LabelReport& report) {
  perception::write_coco(folder / "labels.json", report.dataset);
  std::map<std::string, CocoDataset> splits;
  for (const auto& [name, part] :
       {std::pair<const char*, const CocoDataset&>{"train", report.split.train},
        {"val_views", report.split.val_views},
        {"val_scenes", report.split.val_scenes}}) {
    const std::string base = name;
    if (part.images.empty()) {  // Nor may those of an earlier run look like this one's.
      fs::remove(folder / (base + ".json"));
      fs::remove(folder / (base + ".txt"));
      continue;
    }
    perception::write_coco(folder / (base + ".json"), part);
    splits.emplace(name, part);
  }
  perception::write_yolo_labels(folder, report.dataset);
  perception::write_yolo_splits(folder, splits);
  write_consistency(folder / "consistency.csv", report.instances);
  core::write_file_atomically(
      folder / "report.md", [&](std::ostream& out) { out << label_report_markdown(report); });
  CocoDataset dataset = report.dataset;
  dataset.folder = folder;
  write_contact_sheet(folder / "contact_sheet.png", dataset, kSheetPictures,
                      std::to_string(dataset.images.size()) +
                          " views; T = truncated, O = occluded, grey = ignored");
}

}  // namespace segsim::experiments::detection
