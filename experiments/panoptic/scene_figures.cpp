#include "experiments/panoptic/scene_figures.h"

#include <algorithm>
#include <limits>

#include <nlohmann/json.hpp>

#include "core/check.h"
#include "core/error.h"
#include "core/file_io.h"
#include "perception/data/checked_json.h"
#include "reconstruction/evaluation/panoptic_report.h"

namespace segsim::experiments::panoptic {
namespace {

using Json = perception::OrderedCheckedJson;
using Figures = std::vector<std::pair<std::string, double>>;

constexpr const char* kSchema = "segsim.table1.scene/1";

/// Names and members, in the order of the file.
constexpr std::pair<const char*, double RuleFigures::*> kMembers[] = {
    {"pq", &RuleFigures::pq},
    {"sq", &RuleFigures::sq},
    {"rq", &RuleFigures::rq},
    {"pq_things", &RuleFigures::pq_things},
    {"pq_stuff", &RuleFigures::pq_stuff},
    {"pooled_iou", &RuleFigures::pooled_iou},
    {"pooled_accuracy", &RuleFigures::pooled_accuracy},
    {"per_frame_iou", &RuleFigures::per_frame_iou},
    {"per_frame_accuracy", &RuleFigures::per_frame_accuracy},
    {"coverage", &RuleFigures::coverage},
    {"weighted_coverage", &RuleFigures::weighted_coverage}};

RuleFigures figures_of(const reconstruction::PanopticReport& report,
                       const std::string& rules) {
  RuleFigures figures;
  figures.rules = rules;
  figures.views = static_cast<int>(report.views);
  figures.pq = report.panoptic.pq;
  figures.sq = report.panoptic.sq;
  figures.rq = report.panoptic.rq;
  figures.pq_things = report.panoptic.pq_things;
  figures.pq_stuff = report.panoptic.pq_stuff;
  figures.pooled_iou = report.pooled.mean_iou;
  figures.pooled_accuracy = report.pooled.mean_accuracy;
  figures.per_frame_iou = report.per_frame.mean_iou;
  figures.per_frame_accuracy = report.per_frame.mean_accuracy;
  figures.coverage = report.coverage.mean;
  figures.weighted_coverage = report.coverage.weighted;
  return figures;
}

bool per_frame(const std::string& rules) { return rules == "zju" || rules == "coco"; }

double value_of(const Figures& figures, const std::string& name) {
  for (const auto& [known, value] : figures) {
    if (known == name) return value;
  }
  return std::numeric_limits<double>::quiet_NaN();
}

Json json_of(const Figures& figures) {
  Json json = Json::object();
  for (const auto& [name, value] : figures) json[name] = value;
  return json;
}

/// Infinite figures (the PSNR of equal pictures) are null in JSON.
Figures figures_of(const Json& json) {
  Figures figures;
  for (const auto& [name, value] : json.items()) {
    figures.emplace_back(
        name, value.is_null() ? std::numeric_limits<double>::infinity() : value.get<double>());
  }
  return figures;
}

SceneFigures parse(const Json& json) {
  SceneFigures figures;
  figures.scene = json.at("scene");
  figures.title = json.at("title");
  figures.data = json.at("data");
  figures.head = json.at("head");
  figures.masks = json.at("masks");
  figures.recipe = json.at("recipe");
  figures.version = json.at("version");
  for (const Json& row : json.at("rules")) {
    RuleFigures rules;
    rules.rules = row.at("rules");
    rules.views = row.at("views");
    for (const auto& [name, member] : kMembers) rules.*member = row.at(name);
    figures.rules.push_back(std::move(rules));
  }
  figures.statistics = figures_of(json.at("statistics"));
  figures.mask_quality = figures_of(json.at("mask_quality"));
  return figures;
}

}  // namespace

double RuleFigures::mean_iou() const { return per_frame(rules) ? per_frame_iou : pooled_iou; }
double RuleFigures::mean_accuracy() const {
  return per_frame(rules) ? per_frame_accuracy : pooled_accuracy;
}

const std::vector<std::string>& panoptic_rule_names() {
  static const std::vector<std::string> names{"strict", "trajectory", "zju", "lifting",
                                              "coco"};
  return names;
}

std::string describe_rules(const std::string& rules) {
  if (rules == "strict") return "segments of the scene, IoU > 0.5, held-out views";
  if (rules == "trajectory") return "segments of the scene, IoU > 0.5, training views";
  if (rules == "zju") {
    return "PanopticRecon++'s scripts, presumably the paper's: IoU > 0.1 (ScanNet) or 0.3, "
           "training views";
  }
  if (rules == "lifting") {
    return "Panoptic Lifting's: IoU > 0.5, rare classes left out, predicted void forgiven, "
           "held-out views";
  }
  SEGSIM_CHECK(rules == "coco", "rules " + rules);
  return "COCO's of single views, blind to ids that change, IoU > 0.5, held-out views";
}

std::vector<RuleFigures> all_rule_figures(const reconstruction::ContingencyTable& held_out,
                                          const reconstruction::ContingencyTable& trajectory,
                                          const std::vector<core::SceneClass>& classes,
                                          double zju_min_iou) {
  using reconstruction::PanopticRules;
  const auto row = [&](const char* name, const reconstruction::ContingencyTable& table,
                       const PanopticRules& rules) {
    return figures_of(reconstruction::panoptic_report(table, classes, rules), name);
  };
  return {row("strict", held_out, PanopticRules::strict()),
          row("trajectory", trajectory, PanopticRules::strict()),
          row("zju", trajectory, PanopticRules::zju(zju_min_iou)),
          row("lifting", held_out, PanopticRules::panoptic_lifting()),
          row("coco", held_out, PanopticRules::coco_per_frame())};
}

const RuleFigures* SceneFigures::find(const std::string& rules_name) const {
  const auto at = std::find_if(rules.begin(), rules.end(),
                               [&](const RuleFigures& r) { return r.rules == rules_name; });
  return at == rules.end() ? nullptr : &*at;
}

double SceneFigures::statistic(const std::string& name) const {
  return value_of(statistics, name);
}
double SceneFigures::mask_figure(const std::string& name) const {
  return value_of(mask_quality, name);
}

void write_scene_figures(const std::filesystem::path& file, const SceneFigures& figures) {
  Json json{{"schema", kSchema},
            {"scene", figures.scene},
            {"title", figures.title},
            {"data", figures.data},
            {"head", figures.head},
            {"masks", figures.masks},
            {"recipe", figures.recipe},
            {"version", figures.version},
            {"rules", Json::array()},
            {"statistics", json_of(figures.statistics)},
            {"mask_quality", json_of(figures.mask_quality)}};
  for (const RuleFigures& rules : figures.rules) {
    Json row{{"rules", rules.rules}, {"views", rules.views}};
    for (const auto& [name, member] : kMembers) row[name] = rules.*member;
    json["rules"].push_back(std::move(row));
  }
  core::write_file_atomically(file, [&](std::ostream& out) { out << json.dump(2) << '\n'; });
}

SceneFigures read_scene_figures(const std::filesystem::path& file) {
  const Json json = Json::parse(core::read_file(file), nullptr, false);
  if (!json.is_object() || json.value("schema", "") != kSchema) {
    throw core::InputError::expected(file.string(), std::string("JSON of ") + kSchema,
                                     "something else");
  }
  try {
    return parse(json);
  } catch (const nlohmann::json::exception& error) {
    throw core::InputError::expected(file.string(), "the figures of a scene", error.what());
  }
}

}  // namespace segsim::experiments::panoptic
