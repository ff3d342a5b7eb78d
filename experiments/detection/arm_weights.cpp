#include "experiments/detection/arm_weights.h"

#include <map>
#include <optional>
#include <ostream>
#include <string>

#include <nlohmann/json.hpp>

#include "core/file_io.h"
#include "perception/checkpoint/lineage.h"
#include "perception/checkpoint/weights_file.h"
#include "perception/data/checked_json.h"
#include "perception/data/dataset.h"
#include "perception/detector/evaluate.h"

namespace segsim::experiments::detection {
namespace {

namespace fs = std::filesystem;

std::string describe_inputs(const fs::path& weights, const HeldOutSets& sets,
                            double precision_target) {
  std::string text = precision_target > 0.0
                         ? "precision " + std::to_string(precision_target) + " v1"
                         : std::string("best F1 v2");
  text += "; weights " + core::sha256_of_file(weights);
  for (const fs::path& file : {sets.validation, sets.test, sets.source, sets.unseen}) {
    text += "; " + (file.empty() ? std::string("none") : core::sha256_of_file(file));
  }
  for (const std::string& name : sets.unknown_classes) text += "; without " + name;
  return text;
}

/// Nothing if the file is missing, unreadable or of other inputs: it is only a shortcut.
std::optional<records::HeldOutPrecision> read_measurement(const fs::path& file,
                                                          const std::string& inputs) {
  if (!fs::exists(file)) return std::nullopt;
  const auto json = perception::CheckedJson::parse(core::read_file(file), nullptr, false);
  if (json.is_discarded() || json.value("inputs", "") != inputs) return std::nullopt;
  records::HeldOutPrecision result;
  result.views = json.value("views", 0);
  result.ap50 = json.value("ap50", 0.0);
  result.ap = json.value("ap", 0.0);
  result.score_threshold = json.value("score_threshold", 0.0);
  result.precision = json.value("precision", 0.0);
  result.recall = json.value("recall", 0.0);
  if (json.contains("source_ap50")) result.source_ap50 = json.value("source_ap50", 0.0);
  if (json.contains("unseen_ap50")) result.unseen_ap50 = json.value("unseen_ap50", 0.0);
  return result;
}

void write_measurement(const fs::path& file, const std::string& inputs,
                       const records::HeldOutPrecision& result) {
  nlohmann::ordered_json json{{"inputs", inputs},
                              {"views", result.views},
                              {"ap50", result.ap50},
                              {"ap", result.ap},
                              {"score_threshold", result.score_threshold},
                              {"precision", result.precision},
                              {"recall", result.recall}};
  if (result.source_ap50) json["source_ap50"] = *result.source_ap50;
  if (result.unseen_ap50) json["unseen_ap50"] = *result.unseen_ap50;
  core::write_file_atomically(file, [&](std::ostream& out) { out << json.dump(2) << '\n'; });
}

using Rename = std::map<std::string, std::string>;

void choose_threshold(const fs::path& weights_file, const fs::path& validation,
                      const Rename& rename, double precision_target,
                      perception::ComputeDevice device, const fs::path& output) {
  perception::DetectorWeights weights = perception::read_weights(weights_file);
  perception::CocoDataset dataset = perception::read_coco(validation);
  perception::add_data(weights, weights_file,
                       data_use(perception::DataPurpose::kValidation, dataset));
  perception::match_classes(dataset, weights.class_names, rename);
  const auto results = perception::detect_all(weights_file, dataset, device);
  const auto points =
      perception::operating_points(results, static_cast<int>(weights.class_names.size()));
  weights.score_threshold =
      (precision_target > 0.0 ? perception::most_recall(points, precision_target)
                              : perception::best_f1(points))
          .score_threshold;
  perception::write_weights(output, weights);
}

}  // namespace

records::HeldOutPrecision prepare_arm_weights(const fs::path& weights, const HeldOutSets& sets,
                                              double precision_target,
                                              perception::ComputeDevice device,
                                              const fs::path& output,
                                              const std::function<void()>& on_measure) {
  const fs::path record = output.string() + ".precision.json";
  const std::string inputs = describe_inputs(weights, sets, precision_target) +
                             (device == perception::ComputeDevice::kCuda ? "; on cuda" : "");
  if (fs::exists(output)) {
    if (const auto known = read_measurement(record, inputs)) return *known;
  }
  if (on_measure) on_measure();
  Rename rename;
  for (const std::string& name : sets.unknown_classes) rename[name] = "";
  perception::EvaluateOptions evaluation;
  evaluation.rename = rename;
  evaluation.device = device;
  choose_threshold(weights, sets.validation, rename, precision_target, device, output);
  const perception::EvaluationReport report =
      perception::evaluate(output, sets.test, evaluation);
  const perception::OperatingPoint& point = report.precision.operating;
  records::HeldOutPrecision result;
  result.views = report.images;
  result.ap50 = report.precision.ap50;
  result.ap = report.precision.ap;
  result.score_threshold = static_cast<double>(point.score_threshold);
  result.precision = point.precision();
  result.recall = point.recall();
  const auto ap50_on = [&](const fs::path& set) -> std::optional<double> {
    if (set.empty()) return std::nullopt;
    return perception::evaluate(output, set, evaluation).precision.ap50;
  };
  result.source_ap50 = ap50_on(sets.source);
  result.unseen_ap50 = ap50_on(sets.unseen);
  write_measurement(record, inputs, result);
  return result;
}

}  // namespace segsim::experiments::detection
