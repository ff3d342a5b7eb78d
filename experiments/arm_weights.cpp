#include "experiments/arm_weights.h"

#include <optional>
#include <ostream>
#include <string>

#include <nlohmann/json.hpp>

#include "core/file_io.h"
#include "perception/dataset.h"
#include "perception/evaluate.h"
#include "perception/weights_file.h"

namespace segsim::experiments {
namespace {

namespace fs = std::filesystem;

std::string describe_inputs(const fs::path& weights, const fs::path& validation,
                            const fs::path& test) {
  return "best F1 v1; weights " + core::sha256_of_file(weights) + " validation " +
         core::sha256_of_file(validation) + " test " + core::sha256_of_file(test);
}

/// Nothing if the file is missing, unreadable or of other inputs: it is only a shortcut.
std::optional<HeldOutPrecision> read_measurement(const fs::path& file,
                                                 const std::string& inputs) {
  if (!fs::exists(file)) return std::nullopt;
  const auto json = nlohmann::json::parse(core::read_file(file), nullptr, false);
  if (json.is_discarded() || json.value("inputs", "") != inputs) return std::nullopt;
  HeldOutPrecision result;
  result.views = json.value("views", 0);
  result.ap50 = json.value("ap50", 0.0);
  result.ap = json.value("ap", 0.0);
  result.score_threshold = json.value("score_threshold", 0.0);
  result.precision = json.value("precision", 0.0);
  result.recall = json.value("recall", 0.0);
  return result;
}

void write_measurement(const fs::path& file, const std::string& inputs,
                       const HeldOutPrecision& result) {
  const nlohmann::ordered_json json{{"inputs", inputs},
                                    {"views", result.views},
                                    {"ap50", result.ap50},
                                    {"ap", result.ap},
                                    {"score_threshold", result.score_threshold},
                                    {"precision", result.precision},
                                    {"recall", result.recall}};
  core::write_file_atomically(file, [&](std::ostream& out) { out << json.dump(2) << '\n'; });
}

void choose_threshold(const fs::path& weights_file, const fs::path& validation,
                      const fs::path& output) {
  perception::DetectorWeights weights = perception::read_weights(weights_file);
  perception::CocoDataset dataset = perception::read_coco(validation);
  perception::match_classes(dataset, weights.class_names, {});
  const auto results = perception::detect_all(weights_file, dataset);
  weights.score_threshold =
      perception::best_f1(results, static_cast<int>(weights.class_names.size()))
          .score_threshold;
  perception::write_weights(output, weights);
}

}  // namespace

HeldOutPrecision prepare_arm_weights(const fs::path& weights, const fs::path& validation,
                                     const fs::path& test, const fs::path& output) {
  const fs::path record = output.string() + ".precision.json";
  const std::string inputs = describe_inputs(weights, validation, test);
  if (fs::exists(output)) {
    if (const auto known = read_measurement(record, inputs)) return *known;
  }
  choose_threshold(weights, validation, output);
  const perception::EvaluationReport report = perception::evaluate(output, test);
  const perception::OperatingPoint& point = report.precision.operating;
  const HeldOutPrecision result{
      report.images,       report.precision.ap50,
      report.precision.ap, static_cast<double>(point.score_threshold),
      point.precision(),   point.recall()};
  write_measurement(record, inputs, result);
  return result;
}

}  // namespace segsim::experiments
