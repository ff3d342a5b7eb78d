#include "experiments/panoptic/panoptic_table.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>

#include <nlohmann/json.hpp>

#include "core/config.h"
#include "core/error.h"
#include "core/formatted.h"
#include "experiments/panoptic/panoptic_run.h"
#include "experiments/support/grid_document.h"
#include "experiments/support/text_grid.h"
#include "reconstruction/labels/panoptic_head.h"

namespace segsim::experiments::panoptic {
namespace {

using core::print;
using Json = nlohmann::ordered_json;

constexpr const char* kSchema = "segsim.table1/1";
constexpr const char* kTitle = "Quality of panoptic segmentation (the paper's Table 1)";
constexpr int kColumns = 7;
constexpr const char* kColumnNames[kColumns] = {"PQ",   "SQ",   "RQ",    "mIoU",
                                                "mAcc", "mCov", "mW-Cov"};
constexpr const char* kColumnKeys[kColumns] = {
    "pq", "sq", "rq", "mean_iou", "mean_accuracy", "coverage", "weighted_coverage"};

/// A line of the table, ours or the paper's.
struct Row {
  std::string method, data, scene;  ///< Scene: a title, or "mean of n"; empty: the paper's.
  int scenes = 0;                   ///< 0: the paper's, whose number is in a note.
  double values[kColumns] = {};     ///< Percent.
};

Row row_of(const SceneFigures& result, const RuleFigures& figures) {
  return {result.head,
          result.data,
          result.title,
          1,
          {100.0 * figures.pq, 100.0 * figures.sq, 100.0 * figures.rq,
           100.0 * figures.mean_iou(), 100.0 * figures.mean_accuracy(),
           100.0 * figures.coverage, 100.0 * figures.weighted_coverage}};
}

Row row_of(const PaperRow& paper) {
  return {std::string("paper: ") + paper.method,
          paper.data,
          "",
          0,
          {paper.pq, paper.sq, paper.rq, paper.mean_iou, paper.mean_accuracy, paper.coverage,
           paper.weighted_coverage}};
}

/// Means over the scenes of a data set, one row for each with several.
void add_means(std::vector<Row>& rows, std::size_t first) {
  std::vector<std::string> data_sets;
  for (std::size_t i = first; i < rows.size(); ++i) {
    if (std::find(data_sets.begin(), data_sets.end(), rows[i].data) == data_sets.end()) {
      data_sets.push_back(rows[i].data);
    }
  }
  const std::size_t last = rows.size();
  for (const std::string& data : data_sets) {
    Row mean{rows[first].method, data, "", 0, {}};
    for (std::size_t i = first; i < last; ++i) {
      if (rows[i].data != data) continue;
      ++mean.scenes;
      for (int k = 0; k < kColumns; ++k) mean.values[k] += rows[i].values[k];
    }
    if (mean.scenes < 2) continue;
    for (double& value : mean.values) value /= mean.scenes;
    mean.scene = "mean of " + std::to_string(mean.scenes);
    rows.push_back(std::move(mean));
  }
}

std::vector<std::string> heads_of(const PanopticTable& table) {
  std::vector<std::string> heads;
  for (const SceneFigures& result : table.results) {
    if (std::find(heads.begin(), heads.end(), result.head) == heads.end()) {
      heads.push_back(result.head);
    }
  }
  return heads;
}

std::vector<Row> rows_of(const PanopticTable& table, const std::string& rules) {
  std::vector<Row> rows;
  const bool all_of_paper = rules == "zju";  // Presumably its rules.
  for (const std::string& head : heads_of(table)) {
    const std::size_t first = rows.size();
    for (const SceneFigures& result : table.results) {
      const RuleFigures* figures = result.find(rules);
      if (result.head == head && figures != nullptr) rows.push_back(row_of(result, *figures));
    }
    if (rows.size() > first) add_means(rows, first);
    for (const PaperRow& paper : paper_table1()) {
      if (!all_of_paper && paper.head == head) rows.push_back(row_of(paper));
    }
  }
  if (all_of_paper) {
    for (const PaperRow& paper : paper_table1()) rows.push_back(row_of(paper));
  }
  return rows;
}

std::string percent(double value) { return std::isfinite(value) ? print("%.2f", value) : "-"; }

support::internal::TextGrid quality_grid(const std::vector<Row>& rows) {
  support::internal::TextGrid grid;
  grid.header = {"Method", "Data", "Scene"};
  grid.header.insert(grid.header.end(), std::begin(kColumnNames), std::end(kColumnNames));
  for (const Row& row : rows) {
    std::vector<std::string> cells{row.method, row.data, row.scene.empty() ? "-" : row.scene};
    for (const double value : row.values) cells.push_back(percent(value));
    grid.rows.push_back(std::move(cells));
  }
  return grid;
}

std::string number(double value, double factor, const char* format) {
  return std::isnan(value) ? "-" : print(format, factor * value);
}

bool is_joint(const SceneFigures& figures) { return figures.head.ends_with(kJointSuffix); }

/// Colour and depth do not depend on the head: one row for each scene, of surfels that no head
/// moved if there are such.
support::internal::TextGrid geometry_grid(const PanopticTable& table) {
  support::internal::TextGrid grid;
  grid.header = {"Scene",
                 "Views",
                 "PSNR [dB]",
                 "with fitted gain",
                 "SSIM",
                 "Depth L1 [cm]",
                 "where the sensor repeats",
                 "sensor's own",
                 "Normals [deg]"};
  std::vector<std::string> done;
  for (const SceneFigures& r : table.results) {
    if (std::find(done.begin(), done.end(), r.scene) != done.end()) continue;
    if (is_joint(r) && std::any_of(table.results.begin(), table.results.end(),
                                   [&](const SceneFigures& other) {
                                     return other.scene == r.scene && !is_joint(other);
                                   })) {
      continue;
    }
    done.push_back(r.scene);
    const auto cell = [&](const char* name, double factor, const char* format) {
      return number(r.statistic(name), factor, format);
    };
    grid.rows.push_back(
        {r.title, cell("held_out_views", 1.0, "%.0f"), cell("held_out_psnr_db", 1.0, "%.2f"),
         cell("held_out_gain_fitted_psnr_db", 1.0, "%.2f"), cell("held_out_ssim", 1.0, "%.3f"),
         cell("held_out_depth_l1_m", 100.0, "%.1f"),
         cell("held_out_depth_l1_at_sensor_m", 100.0, "%.1f"),
         cell("held_out_sensor_depth_l1_m", 100.0, "%.1f"),
         cell("held_out_normal_error_deg", 1.0, "%.1f")});
  }
  return grid;
}

support::internal::TextGrid mask_grid(const PanopticTable& table) {
  support::internal::TextGrid grid;
  grid.header = {"Scene", "Masks", "View PQ", "View SQ", "View RQ", "Scene strict PQ"};
  std::vector<std::string> done;
  for (const SceneFigures& r : table.results) {
    if (std::find(done.begin(), done.end(), r.scene) != done.end()) continue;
    done.push_back(r.scene);
    const auto cell = [&](const char* name) {
      return number(r.mask_figure(name), 100, "%.1f");
    };
    grid.rows.push_back(
        {r.title, r.masks, cell("pq"), cell("sq"), cell("rq"), cell("strict_scene_pq")});
  }
  return grid;
}

std::vector<std::string> notes_of(const PanopticTable& table) {
  std::vector<std::string> notes;
  if (static_cast<int>(table.results.size()) < table.planned) {
    notes.push_back("INTERIM: " + std::to_string(table.results.size()) + " of " +
                    std::to_string(table.planned) + " pairs of scene and method finished.");
  }
  if (table.quick) {
    notes.emplace_back(
        "QUICK: tiny pictures and seconds of training. It shows that everything runs; "
        "its figures mean nothing.");
  }
  for (const MissingScene& scene : table.missing) {
    notes.push_back("Not run: " + scene.title + " (" + scene.why + ").");
  }
  notes.emplace_back(
      "Paper: Fast-SegSim, arXiv 2604.10951, table \"Panoptic Segmentation quality using "
      "different methods\": means of 4 ScanNet and 3 ScanNet++ scenes, Grounded-SAM masks. "
      "Other scenes, classes and masks: its rows say what a method reaches there, not what it "
      "should reach here.");
  notes.emplace_back(
      "The paper names no rules, views or threshold. PQ = SQ with RQ = 100 fits the published "
      "scripts of its group (zju) and hardly IoU > 0.5; figures of different rules must not "
      "be "
      "compared (docs/metrics.md).");
  notes.emplace_back(
      "Methods learn labels on the same frozen surfels from the same masks; every n-th view "
      "is "
      "held out of lifting, training and masks. mIoU and mAcc: averaged per frame under zju "
      "and coco, else pooled.");
  notes.emplace_back(
      "Depth: \"sensor's own\" is the L1 between a held-out depth image and those of the "
      "training frames before and after it, brought there by their poses; \"where the sensor "
      "repeats\" is the reconstruction's on the same pixels.");
  for (const SceneFigures& r : table.results) {
    if (r.data != "HoloLens") continue;
    notes.push_back(
        r.title +
        ": truth is hand-made 3-D boxes asked at the sensor's depth pixels, for training and "
        "test alike: void where the sensor saw nothing (most of the black chairs), wrong by a "
        "few cm at box walls, and not drawn by a segmenter. It tells whether labels agree "
        "between views, not how good masks of that room would be.");
    break;
  }
  std::string versions;
  for (const SceneFigures& r : table.results) {
    if (versions.find(r.version) == std::string::npos) {
      versions += (versions.empty() ? "" : ", ") + r.version;
    }
  }
  if (!versions.empty()) notes.push_back("segsim " + versions + ".");
  return notes;
}

Json json_row(const Row& row) {
  Json json{{"kind", row.scenes == 0   ? "paper"
                     : row.scenes == 1 ? "scene"
                                       : "mean"},
            {"method", row.method},
            {"data", row.data},
            {"scene", row.scene}};
  for (int k = 0; k < kColumns; ++k) json[kColumnKeys[k]] = row.values[k];
  return json;
}

std::string json_text(const PanopticTable& table) {
  Json json{{"schema", kSchema}, {"title", kTitle}, {"unit", "percent"}};
  json["planned"] = table.planned;
  json["finished"] = table.results.size();
  for (const std::string& rules : table.rules) {
    Json part{{"rules", rules}, {"meaning", describe_rules(rules)}, {"rows", Json::array()}};
    for (const Row& row : rows_of(table, rules)) part["rows"].push_back(json_row(row));
    json["tables"].push_back(std::move(part));
  }
  json["results"] = Json::array();
  for (const SceneFigures& r : table.results) {
    Json result{{"scene", r.scene}, {"head", r.head}, {"masks", r.masks}};
    for (const auto& [name, value] : r.statistics) {
      if (name.find("seconds") != std::string::npos) continue;  // Not of the result.
      if (name.find("per_second") == std::string::npos) result["statistics"][name] = value;
    }
    for (const auto& [name, value] : r.mask_quality) result["mask_quality"][name] = value;
    json["results"].push_back(std::move(result));
  }
  json["missing"] = Json::array();
  for (const MissingScene& scene : table.missing) {
    json["missing"].push_back({{"scene", scene.title}, {"why", scene.why}});
  }
  json["notes"] = notes_of(table);
  return json.dump(2) + "\n";
}

std::string csv_text(const PanopticTable& table) {
  std::string text =
      "rules,kind,method,data,scene,pq,sq,rq,mean_iou,mean_accuracy,coverage,"
      "weighted_coverage\n";
  for (const std::string& rules : table.rules) {
    for (const Row& row : rows_of(table, rules)) {
      text += rules + "," +
              (row.scenes == 0   ? "paper"
               : row.scenes == 1 ? "scene"
                                 : "mean") +
              "," + support::csv_cell(row.method) + "," + support::csv_cell(row.data) + "," +
              support::csv_cell(row.scene);
      for (const double value : row.values) text += "," + print("%.6g", value);
      text += "\n";
    }
  }
  return text;
}

/// Names separated by commas; each must be known and may come once.
std::vector<std::string> parse_list(const std::string& text, const std::string& flag,
                                    const std::vector<std::string>& known) {
  std::vector<std::string> names;
  std::istringstream words(text);
  for (std::string word; std::getline(words, word, ',');) {
    const bool is_known = std::find(known.begin(), known.end(), word) != known.end();
    const bool again = std::find(names.begin(), names.end(), word) != names.end();
    if (is_known && !again) {
      names.push_back(word);
      continue;
    }
    std::string list;
    for (const std::string& name : known) list += (list.empty() ? "" : " | ") + name;
    const std::string near = again ? "" : core::nearest_word(word, known);
    throw core::InputError::expected(
        flag, list + ", each once",
        "\"" + word + "\"" + (near.empty() ? "" : " (near: " + near + ")"));
  }
  if (names.empty()) throw core::InputError::expected(flag, "at least one name", "none");
  return names;
}

}  // namespace

std::vector<std::string> parse_rules(const std::string& text) {
  if (text == "all") return panoptic_rule_names();
  return parse_list(text, "--rules", panoptic_rule_names());
}

std::vector<std::string> parse_heads(const std::string& text) {
  std::vector<std::string> known = reconstruction::panoptic_head_names();
  for (const std::string& name : reconstruction::joint_head_names()) {
    known.push_back(name + kJointSuffix);
  }
  return parse_list(text, "--heads", known);
}

std::string format_panoptic_table(const PanopticTable& table, support::TableFormat format) {
  if (format == support::TableFormat::kJson) return json_text(table);
  if (format == support::TableFormat::kCsv) return csv_text(table);
  support::internal::GridDocument document;
  const auto add = [&](const std::string& title, const support::internal::TextGrid& cells) {
    document.grids.push_back({title, cells.header, cells.rows});
  };
  for (const std::string& rules : table.rules) {
    add(rules + ": " + describe_rules(rules), quality_grid(rows_of(table, rules)));
  }
  if (!table.results.empty()) {
    add("Shape and colour on held-out views", geometry_grid(table));
    add("Masks that were learnt from", mask_grid(table));
  }
  document.title = kTitle;
  document.notes = notes_of(table);
  return support::internal::document_text(document, format);
}

core::MeasurementRecord panoptic_record(const PanopticTable& table, bool on_gpu) {
  core::MeasurementRecord record{kTitle, on_gpu, {}};
  if (table.quick) record.title += ", in its quick form";
  for (const std::string& rules : table.rules) {
    for (const Row& row : rows_of(table, rules)) {
      if (row.scenes == 0) continue;  // The paper's.
      const std::string name = row.method + ", " + (row.scenes > 1 ? row.data + ": " : "") +
                               row.scene + ", " + rules;
      for (int k = 0; k < kColumns; ++k) {
        if (std::isfinite(row.values[k])) {
          record.values.push_back({name, kColumnNames[k], "", row.values[k]});
        }
      }
    }
  }
  return record;
}

}  // namespace segsim::experiments::panoptic
