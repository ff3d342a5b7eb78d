// JSON form of a ResultTable.
#include <nlohmann/json.hpp>

#include "experiments/results/insight_grids.h"
#include "experiments/results/leakage.h"
#include "experiments/results/table.h"
#include "experiments/results/table_grids.h"
#include "experiments/results/table_notes.h"
#include "experiments/results/training_grids.h"

namespace segsim::experiments::results::internal {
namespace {

nlohmann::ordered_json json_interval(const Interval& interval) {
  return nlohmann::ordered_json::array({interval.low, interval.high});
}

void add_insights(nlohmann::ordered_json& a, const ArmSummary& arm) {
  const TrialInsights& in = arm.insights;
  a["excluded_trials"] = arm.excluded_trials;
  if (in.trials == 0) return;
  for (const auto& [cause, count] : in.causes) a["causes"][cause] = count;
  nlohmann::ordered_json& p = a["perception"];
  p = {{"frames", in.frames},
       {"visible_frames", in.visible_frames},
       {"detected_frames", in.detected_frames},
       {"saw_goal", in.saw_goal},
       {"never_detected", in.never_detected},
       {"false_detections", in.false_detections},
       {"false_objects_per_trial", in.false_clouds}};
  if (in.misplaced_clouds) p["misplaced_objects_per_trial"] = *in.misplaced_clouds;
  if (in.delay_ticks) p["median_delay_ticks"] = *in.delay_ticks;
  a["collision_ticks"] = in.collision_ticks;
  for (const ProfileRate& rate : in.profiles) {
    a["profiles"][rate.profile] = {{"sr", static_cast<double>(rate.successes) / in.trials},
                                   {"spl", rate.spl}};
  }
}

/// @param scene  Family that the group's trials are in; empty: all.
nlohmann::ordered_json json_group(const ResultTable& table, const GroupSummary& group,
                                  const std::string& scene) {
  nlohmann::ordered_json json;
  json["name"] = group.name;
  json["title"] = group.title;
  json["leakage"] = compared_leakage_word(table, scene);
  for (const ArmSummary& arm : group.arms) {
    nlohmann::ordered_json& a = json["arms"][arm.arm];
    a["successes"] = arm.success.successes;
    a["episodes"] = arm.success.trials;
    a["sr"] = arm.success.value();
    a["trainings"] = arm.members;
    if (arm.pooled_interval) {
      a["hierarchical95"] = json_interval(*arm.pooled_interval);
    } else {
      a["wilson95"] = json_interval(wilson_interval(arm.success));
      a["clopper_pearson95"] = json_interval(clopper_pearson_interval(arm.success));
    }
    a["spl"] = arm.spl;
    a["soft_spl"] = arm.soft_spl;
    a["sim_s"] = arm.sim_s;
    a["path_m"] = arm.path_m;
    a["contacts"] = arm.contacts;
    a["invalid_pixels"] = arm.invalid_pixels;
    a["failed_trials"] = arm.failed_trials;
    a["leakage"] = leakage_word(table, arm.arm, scene);
    for (const auto& [outcome, count] : arm.outcomes) a["outcomes"][outcome] = count;
    add_insights(a, arm);
  }
  if (compares(table)) {
    nlohmann::ordered_json& c = json["comparison"];
    c["both"] = group.pairs.both;
    c["only_after"] = group.pairs.only_after;
    c["only_before"] = group.pairs.only_before;
    c["neither"] = group.pairs.neither;
    c["dropped_pairs"] = group.dropped_pairs;
    c["difference"] = group.difference.difference;
    c["p"] = group.p;
    if (group.training) {
      c["hierarchical95"] = json_interval(group.difference.interval);
      c["p_trainings"] = group.p;
      c["degrees_of_freedom"] = group.training->degrees_of_freedom;
      c["training_sd"] = group.training->training_sd;
      c["episode_sd"] = group.training->episode_sd;
    } else {
      c["newcombe95"] = json_interval(group.difference.interval);
      c["p_mcnemar_exact"] = group.p;
      c["p_mcnemar_mid"] = group.p_mid;
    }
    c["p_holm"] = group.p_holm;
    const bool several = group.training.has_value();
    if (!several) c["p_spl_sign_flip"] = group.spl.p;
    const auto paired = [&](const char* name, const PairedMean& mean) {
      c["paired"][name] = {{"mean", mean.difference.mean},
                           {several ? "hierarchical95" : "bootstrap95",
                            json_interval(mean.difference.interval)},
                           {several ? "p_trainings" : "p_sign_flip", mean.p}};
    };
    paired("spl", group.spl);
    paired("sim_s", group.sim_s);
    paired("path_m", group.path_m);
    if (group.over_scenes) {
      c["over_scenes"] = {{"difference", group.over_scenes->mean},
                          {"cluster_bootstrap95", json_interval(group.over_scenes->interval)}};
    }
    c["verdict"] = group.verdict;
  }
  return json;
}

}  // namespace

/// One line for each pair of rows that is compared.
nlohmann::ordered_json json_trainings(const ResultTable& table) {
  auto list = nlohmann::ordered_json::array();
  for (const TrainingSummary& training : table.trainings) {
    const records::ArmRow& arm = *find_arm(table.arm_rows, training.arm);
    nlohmann::ordered_json json{{"arm", training.arm},
                                {"before", training.before},
                                {"seed", nullptr},
                                {"reconstruction", arm.reconstruction},
                                {"weights_sha256", arm.weights_sha256},
                                {"leakage", leakage_word(table, arm)},
                                {"successes", training.success.successes},
                                {"episodes", training.success.trials},
                                {"sr", training.success.value()},
                                {"only_after", training.pairs.only_after},
                                {"only_before", training.pairs.only_before},
                                {"pairs", training.pairs.total()}};
    if (arm.finetune_seed) json["seed"] = *arm.finetune_seed;
    list.push_back(std::move(json));
  }
  return list;
}

std::string as_json(const ResultTable& table) {
  nlohmann::ordered_json json;
  json["schema"] = "segsim.table/1";
  json["title"] = table.run.title;
  json["before"] = table.before;
  json["after"] = table.after;
  json["oracle"] = table.oracle;
  json["finished_trials"] = table.finished_trials;
  json["planned_trials"] = table.run.planned_trials;
  json["one_training"] = table.trainings.size() == 1 && table.compares_trainings;
  json["trainings"] = json_trainings(table);
  json["training_rate_sd"] = training_rate_sd(table.trainings);
  json["success_rule"] = profile_name(table);
  if (const auto& region = table.stop_region) {
    json["stop_region"] = {{"radius_m", records::kStopRegion_m},
                           {"successes", region->successes},
                           {"near_views", region->near_views},
                           {"mean_views", region->mean_views}};
  }
  json["scenes"] = nlohmann::ordered_json::array();
  for (const GroupSummary& group : table.scenes) {
    json["scenes"].push_back(json_group(table, group, group.name));
  }
  if (table.all) json["all"] = json_group(table, *table.all, "");
  for (const GroupSummary& group : table.pools) {
    json["pools"].push_back(json_group(table, group, ""));
    json["pools"].back()["leakage"] = leakage_word(table, table.after, group.scenes);
    json["pools"].back()["scenes"] = group.scenes;
    for (const ArmSummary& arm : group.arms) {
      json["pools"].back()["arms"][arm.arm]["leakage"] =
          leakage_word(table, arm.arm, group.scenes);
    }
  }
  for (const Generalisation& row : table.generalisation) {
    json["generalisation"].push_back({{"group", row.group},
                                      {"arm", row.arm},
                                      {"scenes", row.scenes},
                                      {"successes", row.summary.success.successes},
                                      {"episodes", row.summary.success.trials},
                                      {"trainings", row.summary.members},
                                      {"leakage", row.leakage}});
    if (!row.difference) continue;
    json["generalisation"].back()["difference"] = row.difference->mean;
    json["generalisation"].back()["interval95"] = json_interval(row.difference->interval);
  }
  json["classes"] = nlohmann::ordered_json::array();
  for (const GroupSummary& group : table.classes) {
    json["classes"].push_back(json_group(table, group, ""));
  }
  nlohmann::ordered_json& provenance = json["provenance"];
  provenance["run"] = table.run.run_id;
  provenance["name"] = table.run.name;
  provenance["seed"] = table.run.seed;
  provenance["planned_n"] = table.run.planned_n;
  provenance["success_profile"] = table.run.success_profile;
  provenance["code_version"] = table.run.code_version;
  provenance["spec_sha256"] = table.run.spec_sha256;
  const auto kernels = table.run.provenance.find("kernels");
  if (kernels != table.run.provenance.end()) provenance["kernels"] = kernels->second;
  provenance["host"] = table.run.host;
  provenance["libraries"] = table.run.libraries;
  provenance["started"] = table.run.started;
  provenance["ended"] = table.run.ended;
  for (const records::SceneRow& scene : table.scene_rows) {
    provenance["scenes"][scene.name] = {{"scene_sha256", scene.scene_sha256},
                                        {"episodes_sha256", scene.episodes_sha256},
                                        {"episodes", scene.episodes},
                                        {"family", records::family_of(scene)},
                                        {"reconstruction", scene.reconstruction}};
  }
  for (const records::ArmRow& arm : table.arm_rows) {
    nlohmann::ordered_json& a = provenance["arms"][arm.name];
    a = {{"detector", arm.detector},
         {"weights_sha256", arm.weights_sha256},
         {"tuned_on", arm.tuned_on},
         {"family", records::family_of(arm)},
         {"reconstruction", arm.reconstruction}};
    if (arm.finetune_seed) a["finetune_seed"] = *arm.finetune_seed;
    if (arm.exposure) a["leakage"] = records::exposure_text(*arm.exposure);
    if (arm.start_leak) {
      a["tuning_views"] = {{"views", arm.start_leak->views},
                           {"near_starts", arm.start_leak->near_starts},
                           {"radius_m", arm.start_leak->radius_m}};
    }
    if (!arm.held_out) continue;
    const records::HeldOutPrecision& p = *arm.held_out;
    a["held_out"] = {{"views", p.views},
                     {"ap50", p.ap50},
                     {"ap", p.ap},
                     {"score_threshold", p.score_threshold},
                     {"precision", p.precision},
                     {"recall", p.recall}};
    if (p.source_ap50) a["held_out"]["source_ap50"] = *p.source_ap50;
    if (p.unseen_ap50) a["held_out"]["unseen_ap50"] = *p.unseen_ap50;
  }
  json["notes"] = table.notes;
  return json.dump(2) + "\n";
}

}  // namespace segsim::experiments::results::internal
