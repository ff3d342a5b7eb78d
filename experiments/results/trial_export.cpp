#include "experiments/results/trial_export.h"

#include <concepts>
#include <cstdint>
#include <optional>
#include <string>

#include <nlohmann/json.hpp>

#include "core/formatted.h"
#include "experiments/records/row_words.h"

namespace segsim::experiments::results {
namespace {

using Json = nlohmann::ordered_json;

Json optional(const std::optional<double>& value) { return value ? Json(*value) : Json(); }

Json json_value(const records::Column& /*column*/, const std::string& text) { return text; }
template <records::StoredAsWord W>
Json json_value(const records::Column& /*column*/, const W& value) {
  return records::word_of(value);
}
Json json_value(const records::Column& /*column*/, double value) { return value; }
Json json_value(const records::Column& /*column*/, const std::optional<double>& value) {
  return optional(value);
}
template <std::integral Integer>
Json json_value(const records::Column& column, Integer value) {
  if (column.hexadecimal) return core::hex(static_cast<std::uint64_t>(value));
  if (column.unknown_below_zero && static_cast<std::int64_t>(value) < 0) return nullptr;
  return value;
}

/// The columns of one part.
template <class Row>
Json json_columns(const Row& row, bool of_why = false) {
  Json json = Json::object();
  records::visit_columns(row, [&](const records::Column& column, const auto& value) {
    if ((column.part == records::Part::kWhy) == of_why)
      json[column.name] = json_value(column, value);
  });
  return json;
}

Json json_arm(const records::ArmRow& arm) {
  Json json{
      {"name", arm.name},
      {"detector", arm.detector},
      {"weights_sha256", arm.weights_sha256},
      {"tuned_on", arm.tuned_on},
      {"leakage", arm.exposure ? Json(records::exposure_text(*arm.exposure)) : Json()},
      {"score_threshold", arm.score_threshold < 0.0 ? Json() : Json(arm.score_threshold)},
      {"held_out", nullptr},
      {"tuning_views", nullptr},
      {"family", records::family_of(arm)},
      {"reconstruction", arm.reconstruction},
      {"finetune_seed", arm.finetune_seed ? Json(*arm.finetune_seed) : Json()}};
  if (arm.held_out) {
    const records::HeldOutPrecision& p = *arm.held_out;
    json["held_out"] = {{"views", p.views},
                        {"ap50", p.ap50},
                        {"ap", p.ap},
                        {"score_threshold", p.score_threshold},
                        {"precision", p.precision},
                        {"recall", p.recall},
                        {"source_ap50", optional(p.source_ap50)},
                        {"unseen_ap50", optional(p.unseen_ap50)}};
  }
  if (arm.start_leak) {
    json["tuning_views"] = {{"views", arm.start_leak->views},
                            {"near_starts", arm.start_leak->near_starts},
                            {"radius_m", arm.start_leak->radius_m}};
  }
  return json;
}

Json json_run(const StoredRun& stored) {
  const records::RunRow& run = stored.run;
  Json json{{"schema", "segsim.trials/1"}};
  json["run"] = json_columns(run);
  json["run"]["provenance"] = run.provenance;
  json["scenes"] = Json::array();
  for (records::SceneRow scene : stored.scenes) {
    scene.family = records::family_of(scene);
    json["scenes"].push_back(json_columns(scene));
  }
  json["arms"] = Json::array();
  for (const records::ArmRow& arm : stored.arms) json["arms"].push_back(json_arm(arm));
  return json;
}

Json json_trial(const records::TrialRow& trial) {
  Json json = json_columns(trial);
  json["why"] = trial.why.known() ? json_columns(trial, true) : Json();
  return json;
}

}  // namespace

void write_trials_jsonl(std::ostream& out, const StoredRun& stored) {
  // Bytes of foreign names that are no UTF-8 become U+FFFD instead of an exception.
  const auto line = [&](const Json& json) {
    out << json.dump(-1, ' ', false, Json::error_handler_t::replace) << '\n';
  };
  line(json_run(stored));
  for (const records::TrialRow& trial : stored.trials) line(json_trial(trial));
}

}  // namespace segsim::experiments::results
