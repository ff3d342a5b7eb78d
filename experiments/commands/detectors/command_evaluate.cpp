// `segsim evaluate`.
#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <ostream>
#include <string>
#include <vector>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "core/error.h"
#include "core/file_io.h"
#include "core/progress.h"
#include "experiments/commands/detectors/detector_commands.h"
#include "experiments/training/mask_quality.h"
#include "reconstruction/datasets/coco_panoptic.h"
#include "reconstruction/datasets/mask_files.h"
#include "reconstruction/evaluation/panoptic_report.h"

namespace segsim::experiments::commands::detectors {
namespace {

namespace fs = std::filesystem;
using core::InputError;
using reconstruction::MaskSet;
using reconstruction::PanopticRules;

struct Flags {
  fs::path predictions, truth, classes, json;
  std::string rules = "strict";
  double min_iou = 0.3;  ///< Of zju.
};

PanopticRules rules_of(const Flags& flags) {
  if (flags.rules == "coco") return PanopticRules::coco_per_frame();
  if (flags.rules == "zju") return PanopticRules::zju(flags.min_iou);
  if (flags.rules == "panoptic-lifting") return PanopticRules::panoptic_lifting();
  return PanopticRules::strict();
}

/// A folder of masks, or a file in COCO's panoptic format (a folder with such a file beside it
/// is one, too). @param classes  Where the masks bring none of their own.
std::unique_ptr<MaskSet> open_labels(const fs::path& path,
                                     const std::vector<core::SceneClass>& classes,
                                     bool per_frame) {
  const fs::path beside = path.string() + ".json";
  const bool is_file = path.extension() == ".json" && fs::is_regular_file(path);
  const bool has_file = !reconstruction::is_mask_set(path) && fs::is_regular_file(beside);
  if (is_file || has_file) {
    return reconstruction::open_coco_panoptic(
        is_file ? path : beside, classes,
        per_frame ? reconstruction::IdScope::kView : reconstruction::IdScope::kScene);
  }
  return reconstruction::open_masks(
      path, reconstruction::is_mask_set(path) ? std::vector<core::SceneClass>{} : classes);
}

/// Every view of the truth, in one table.
reconstruction::ContingencyTable compare(const MaskSet& truth, const MaskSet& predictions,
                                         const training::ClassTranslation& translation,
                                         const Flags& flags) {
  reconstruction::ContingencyTable table;
  core::Progress progress("evaluate", static_cast<std::int64_t>(truth.names().size()));
  for (const std::string& name : truth.names()) {
    if (!std::binary_search(predictions.names().begin(), predictions.names().end(), name)) {
      throw InputError::expected(flags.predictions.string(),
                                 "a prediction for every view of the truth",
                                 "none for " + name);
    }
    const core::FrameMasks labels = truth.read_as_stored(name);
    core::FrameMasks found =
        predictions.read(name, labels.semantic.width_px(), labels.semantic.height_px());
    translation.apply(found.semantic, found.instance);
    table.add_frame(reconstruction::images_of(labels), {found.semantic, found.instance});
    progress.update(static_cast<std::int64_t>(table.frame_count()));
  }
  progress.finish();
  return table;
}

nlohmann::ordered_json json_of(const reconstruction::PanopticReport& report,
                               const std::vector<training::ClassRow>& rows) {
  nlohmann::ordered_json json{{"schema", "segsim.evaluation/1"},
                              {"rules", report.rules},
                              {"views", report.views},
                              {"pq", report.panoptic.pq},
                              {"sq", report.panoptic.sq},
                              {"rq", report.panoptic.rq},
                              {"pq_things", report.panoptic.pq_things},
                              {"pq_stuff", report.panoptic.pq_stuff},
                              {"miou_pooled", report.pooled.mean_iou},
                              {"macc_pooled", report.pooled.mean_accuracy},
                              {"miou_per_view", report.per_frame.mean_iou},
                              {"macc_per_view", report.per_frame.mean_accuracy},
                              {"mcov", report.coverage.mean},
                              {"mwcov", report.coverage.weighted}};
  for (const training::ClassRow& row : rows) {
    json["classes"][row.name] = {{"pq", row.pq},
                                 {"sq", row.sq},
                                 {"rq", row.rq},
                                 {"found", row.true_positives},
                                 {"false", row.false_positives},
                                 {"missed", row.missed}};
  }
  return json;
}

void evaluate(const Flags& flags) {
  const PanopticRules rules = rules_of(flags);
  std::vector<core::SceneClass> classes;
  if (!flags.classes.empty())
    classes = reconstruction::read_mask_set_info(flags.classes).classes;
  const auto truth = open_labels(flags.truth, classes, rules.per_frame);
  if (truth->names().empty()) {
    throw InputError::expected(flags.truth.string(), "views with labels", "none");
  }
  classes = truth->info().classes;
  const auto predictions = open_labels(flags.predictions, classes, rules.per_frame);
  const training::ClassTranslation translation =
      training::translate_classes(predictions->info().classes, classes);
  if (translation.common.empty()) {
    throw InputError::expected(flags.predictions.string(), "a class of the truth", "none");
  }
  const reconstruction::PanopticReport report = reconstruction::panoptic_report(
      compare(*truth, *predictions, translation, flags), classes, rules);
  std::vector<std::string> names;
  names.reserve(classes.size());
  for (const core::SceneClass& c : classes) names.push_back(c.name);
  const auto rows = training::class_rows(report.panoptic, classes, names);
  std::printf("%zu views, rules %s\n\n%s", report.views, report.rules.c_str(),
              training::class_rows_text("class", rows).c_str());
  std::printf(
      "\nmIoU %.1f, mAcc %.1f (pooled); %.1f, %.1f (mean over views); mCov %.1f, "
      "mW-Cov %.1f\n",
      100.0 * report.pooled.mean_iou, 100.0 * report.pooled.mean_accuracy,
      100.0 * report.per_frame.mean_iou, 100.0 * report.per_frame.mean_accuracy,
      100.0 * report.coverage.mean, 100.0 * report.coverage.weighted);
  if (flags.json.empty()) return;
  core::write_file_atomically(
      flags.json, [&](std::ostream& out) { out << json_of(report, rows).dump(1) << "\n"; });
}

}  // namespace

void add_evaluate_command(CLI::App& app) {
  auto flags = std::make_shared<Flags>();
  CLI::App* command = light::add_listed(app, light::kCommands, "evaluate");
  command
      ->add_option("--predictions", flags->predictions,
                   "Label images: a folder of masks (docs/masks.md), or FILE.json in COCO's "
                   "panoptic format with its folder FILE/")
      ->required();
  command->add_option("--truth", flags->truth, "The same of the truth")->required();
  command
      ->add_option("--rules", flags->rules,
                   "strict: segments of the scene, IoU > 0.5. coco: of single views, with "
                   "COCO's rule for crowds. zju: PanopticRecon++'s scripts. panoptic-lifting")
      ->check(CLI::IsMember({"strict", "coco", "zju", "panoptic-lifting"}))
      ->capture_default_str();
  command->add_option("--min-iou", flags->min_iou, "Of zju: 0.1 for ScanNet")
      ->check(CLI::Range(0.0, 0.99))
      ->capture_default_str();
  command->add_option("--classes", flags->classes,
                      "masks.yaml with the classes of a truth that brings none");
  command->add_option("--json", flags->json, "Also write all figures there");
  command->callback([flags] { evaluate(*flags); });
}

}  // namespace segsim::experiments::commands::detectors
