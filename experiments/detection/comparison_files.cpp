#include "experiments/detection/comparison_files.h"

#include <algorithm>
#include <cstdio>
#include <ostream>

#include <nlohmann/json.hpp>

#include "core/file_io.h"
#include "core/formatted.h"
#include "experiments/support/text_grid.h"
#include "perception/data/image_file.h"

namespace segsim::experiments::detection {
namespace {

using core::print;
using support::internal::TextGrid;
using Json = nlohmann::ordered_json;

std::string percent(double value) { return value < 0.0 ? "-" : print("%.1f", 100.0 * value); }

/// "12.3 [10.1, 14.2]"
std::string estimate_text(const Estimate& estimate) {
  if (estimate.value < 0.0) return "-";
  return percent(estimate.value) + " [" + percent(estimate.interval.low) + ", " +
         percent(estimate.interval.high) + "]";
}

std::string difference_text(const ComparisonRow& row, std::size_t score) {
  if (row.before[score].value < 0.0) return "-";
  const Estimate& d = row.difference[score];
  return print("%+.1f", 100.0 * d.value) + " [" + print("%+.1f", 100.0 * d.interval.low) +
         ", " + print("%+.1f", 100.0 * d.interval.high) + "]";
}

std::string times_text(const ComparisonRow& row, std::size_t score) {
  const double before = row.before[score].value;
  return before > 0.0 ? print("%.1f x", row.after[score].value / before) : "-";
}

std::string row_name(const ComparisonRow& row) {
  return row.group == "class" ? row.name
                              : row.group + (row.name.empty() ? "" : " ") + row.name;
}

TextGrid score_grid(const SetComparison& set) {
  constexpr std::size_t kAp50 = 1;
  TextGrid grid;
  grid.header = {"objects of", "n", "AP50 before", "AP50 after", "difference", "times"};
  for (const ComparisonRow& row : set.rows) {
    grid.rows.push_back({row_name(row), std::to_string(row.objects),
                         estimate_text(row.before[kAp50]), estimate_text(row.after[kAp50]),
                         difference_text(row, kAp50), times_text(row, kAp50)});
  }
  return grid;
}

TextGrid recall_grid(const SetComparison& set) {
  TextGrid grid;
  grid.header = {"objects of"};
  constexpr std::array kShown{Score::kAp, Score::kAr1, Score::kAr10, Score::kAr100};
  for (const Score score : kShown) {
    grid.header.push_back(std::string(to_string(score)) + " before");
    grid.header.emplace_back("after");
  }
  for (const ComparisonRow& row : set.rows) {
    std::vector<std::string> cells{row_name(row)};
    for (const Score score : kShown) {
      const auto s = static_cast<std::size_t>(score);
      cells.push_back(percent(row.before[s].value));
      cells.push_back(percent(row.after[s].value));
    }
    grid.rows.push_back(std::move(cells));
  }
  return grid;
}

std::string operating_text(const char* arm, const DetectorErrors& errors) {
  return std::string(arm) + " at score >= " + print("%.3f", errors.score_threshold) +
         ": precision " + print("%.2f", errors.precision) + ", recall " +
         print("%.2f", errors.recall);
}

std::string heading(const SetComparison& set) {
  return set.name + ": " + std::to_string(set.dataset.images.size()) + " images (" +
         set.json.filename().string() + ")";
}

std::string method_note(const ComparisonOptions& options) {
  return "In per cent; [" + print("%.0f", 100.0 * options.confidence) +
         " % bootstrap interval over images, " + std::to_string(options.rounds) +
         " draws, seed " + std::to_string(options.seed) + "]";
}

Json json_of(const Estimate& estimate) {
  return {{"value", estimate.value},
          {"low", estimate.interval.low},
          {"high", estimate.interval.high}};
}

Json json_of(const ComparisonRow& row) {
  Json json{{"group", row.group}, {"name", row.name}, {"objects", row.objects}};
  for (std::size_t s = 0; s < kScores; ++s) {
    json[to_string(static_cast<Score>(s))] = {{"before", json_of(row.before[s])},
                                              {"after", json_of(row.after[s])},
                                              {"difference", json_of(row.difference[s])}};
  }
  return json;
}

Json json_of(const DetectorErrors& errors) {
  return {{"score_threshold", errors.score_threshold},
          {"precision", errors.precision},
          {"recall", errors.recall},
          {"confusion", errors.confusion.counts}};
}

void add_estimate(const ComparisonOptions& options, const std::string& case_name,
                  const std::string& name, const Estimate& estimate,
                  core::MeasurementRecord& record) {
  core::MeasuredValue value{case_name, name, "%", 100.0 * estimate.value};
  if (options.rounds > 0 && options.confidence == 0.95) {
    value.interval95 = {100.0 * estimate.interval.low, 100.0 * estimate.interval.high};
  }
  record.values.push_back(std::move(value));
}

}  // namespace

std::string comparison_text(const ComparisonReport& report) {
  std::string text = method_note(report.options) + "\n";
  for (const std::string& note : report.notes) text += note + "\n";
  for (const SetComparison& set : report.sets) {
    text += "\n" + heading(set) + "\n\n" + text_of(score_grid(set)) + "\n" +
            text_of(recall_grid(set)) + "\n" + operating_text("before", set.before) + "\n" +
            operating_text("after ", set.after) + "\n";
  }
  return text;
}

std::string comparison_markdown(const ComparisonReport& report) {
  std::string text = "# Detector before and after\n\n" + method_note(report.options) + "\n\n";
  for (const std::string& note : report.notes) text += "- " + note + "\n";
  for (const SetComparison& set : report.sets) {
    text += "\n## " + heading(set) + "\n\n" + markdown_of(score_grid(set)) + "\n" +
            markdown_of(recall_grid(set)) + "\n- " + operating_text("before", set.before) +
            "\n- " + operating_text("after", set.after) + "\n\n![precision](precision-" +
            set.name + ".png) ![confusion](confusion-" + set.name + ".png)\n";
  }
  return text;
}

std::string comparison_csv(const ComparisonReport& report) {
  std::string text =
      "set,group,name,objects,score,before,before_low,before_high,after,after_low,"
      "after_high,difference,difference_low,difference_high\n";
  for (const SetComparison& set : report.sets) {
    for (const ComparisonRow& row : set.rows) {
      for (std::size_t s = 0; s < kScores; ++s) {
        text += set.name + "," + row.group + "," + row.name + "," +
                std::to_string(row.objects) + "," + to_string(static_cast<Score>(s));
        for (const Estimate& e : {row.before[s], row.after[s], row.difference[s]}) {
          for (const double value : {e.value, e.interval.low, e.interval.high}) {
            text += "," + print("%.6f", value);
          }
        }
        text += "\n";
      }
    }
  }
  return text;
}

std::string comparison_json(const ComparisonReport& report) {
  Json json{{"schema", "segsim.detector_comparison/1"},
            {"before_sha256", core::sha256_of_file(report.options.before)},
            {"after_sha256", core::sha256_of_file(report.options.after)},
            {"rounds", report.options.rounds},
            {"confidence", report.options.confidence},
            {"seed", report.options.seed},
            {"notes", report.notes},
            {"sets", Json::array()}};
  for (const SetComparison& set : report.sets) {
    Json entry{{"name", set.name},
               {"images", set.dataset.images.size()},
               {"labels_sha256", set.dataset.sha256},
               {"classes", set.dataset.class_names},
               {"rows", Json::array()},
               {"curves", Json::array()},
               {"before", json_of(set.before)},
               {"after", json_of(set.after)}};
    for (const ComparisonRow& row : set.rows) entry["rows"].push_back(json_of(row));
    for (const PrecisionCurve& curve : set.curves) {
      entry["curves"].push_back(
          {{"name", curve.name}, {"before", curve.before}, {"after", curve.after}});
    }
    json["sets"].push_back(std::move(entry));
  }
  return json.dump(1) + "\n";
}

core::MeasurementRecord comparison_record(const ComparisonReport& report) {
  core::MeasurementRecord record{"Detectors before and after", false, {}};
  for (const SetComparison& set : report.sets) {
    record.values.push_back(
        {set.name, "images", "", static_cast<double>(set.dataset.images.size())});
    for (const ComparisonRow& row : set.rows) {
      const std::string name = set.name + ", " + row_name(row);
      record.values.push_back({name, "objects", "", static_cast<double>(row.objects)});
      for (std::size_t s = 0; s < kScores; ++s) {
        if (row.before[s].value < 0.0) continue;
        const std::string score = to_string(static_cast<Score>(s));
        add_estimate(report.options, name, score + " before", row.before[s], record);
        add_estimate(report.options, name, score + " after", row.after[s], record);
        add_estimate(report.options, name, score + " difference", row.difference[s], record);
      }
    }
  }
  return record;
}

void write_comparison(const std::filesystem::path& folder, const ComparisonReport& report) {
  const auto write = [&](const char* name, const std::string& text) {
    core::write_file_atomically(folder / name, [&](std::ostream& out) { out << text; });
  };
  write("compare.txt", comparison_text(report));
  write("compare.md", comparison_markdown(report));
  write("compare.csv", comparison_csv(report));
  write("compare.json", comparison_json(report));
  for (const SetComparison& set : report.sets) {
    perception::write_image(folder / ("precision-" + set.name + ".png"),
                            draw_precision_curves(set));
    perception::write_image(folder / ("confusion-" + set.name + ".png"), draw_confusion(set));
    const core::Image<core::Rgb8> misses = draw_worst_misses(set, 12);
    if (!misses.empty()) {
      perception::write_image(folder / ("misses-" + set.name + ".png"), misses);
    }
  }
}

}  // namespace segsim::experiments::detection
