#include "experiments/results/trial_export.h"

#include <nlohmann/json.hpp>

#include "experiments/support/formatted.h"

namespace segsim::experiments {
namespace {

using Json = nlohmann::ordered_json;

Json optional(const std::optional<double>& value) { return value ? Json(*value) : Json(); }

Json json_arm(const ArmRow& arm) {
  Json json{
      {"name", arm.name},
      {"detector", arm.detector},
      {"weights_sha256", arm.weights_sha256},
      {"tuned_on", arm.tuned_on},
      {"leakage", arm.exposure ? Json(exposure_text(*arm.exposure)) : Json()},
      {"score_threshold", arm.score_threshold < 0.0 ? Json() : Json(arm.score_threshold)},
      {"held_out", nullptr},
      {"tuning_views", nullptr},
      {"family", family_of(arm)},
      {"reconstruction", arm.reconstruction},
      {"finetune_seed", arm.finetune_seed ? Json(*arm.finetune_seed) : Json()}};
  if (arm.held_out) {
    const HeldOutPrecision& p = *arm.held_out;
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
  const RunRow& run = stored.run;
  Json json{{"schema", "segsim.trials/1"}};
  json["run"] = {{"run_id", run.run_id},
                 {"name", run.name},
                 {"title", run.title},
                 {"spec_sha256", run.spec_sha256},
                 {"spec_text", run.spec_text},
                 {"code_version", run.code_version},
                 {"host", run.host},
                 {"libraries", run.libraries},
                 {"success_profile", run.success_profile},
                 {"seed", run.seed},
                 {"planned_n", run.planned_n},
                 {"planned_trials", run.planned_trials},
                 {"started", run.started},
                 {"ended", run.ended},
                 {"provenance", run.provenance}};
  json["scenes"] = Json::array();
  for (const SceneRow& scene : stored.scenes) {
    json["scenes"].push_back({{"name", scene.name},
                              {"title", scene.title},
                              {"scene_sha256", scene.scene_sha256},
                              {"episodes_sha256", scene.episodes_sha256},
                              {"episodes", scene.episodes},
                              {"oracle_successes", scene.oracle_successes},
                              {"oracle_episodes", scene.oracle_episodes},
                              {"family", family_of(scene)},
                              {"reconstruction", scene.reconstruction}});
  }
  json["arms"] = Json::array();
  for (const ArmRow& arm : stored.arms) json["arms"].push_back(json_arm(arm));
  return json;
}

Json json_why(const Attribution& why) {
  if (!why.known()) return nullptr;
  return {{"cause", why.cause},
          {"inevitable_tick", why.inevitable_tick},
          {"decisive_tick", why.decisive_tick},
          {"images", why.images < 0 ? Json() : Json(why.images)},
          {"visible_frames", why.visible_frames},
          {"detected_frames", why.detected_frames},
          {"true_detections", why.true_detections},
          {"false_detections", why.false_detections},
          {"first_true_tick", why.first_true_tick},
          {"true_clouds", why.true_clouds},
          {"false_clouds", why.false_clouds},
          {"misplaced_clouds", why.misplaced_clouds < 0 ? Json() : Json(why.misplaced_clouds)},
          {"stopped", why.stopped},
          {"final_visible_px", why.final_visible_px},
          {"object_m", optional(why.object_m)},
          {"planar_m", optional(why.planar_m)},
          {"shortest_object_m", optional(why.shortest_object_m)},
          {"collision_ticks", why.collision_ticks},
          {"off_navmesh_ticks", why.off_navmesh_ticks},
          {"reached_instance", why.reached_instance}};
}

Json json_trial(const TrialRow& t) {
  return {{"trial_id", t.trial_id},
          {"scene", t.scene},
          {"episode", t.episode},
          {"goal_class", t.goal_class},
          {"repetition", t.repetition},
          {"arm", t.arm},
          {"outcome", t.outcome},
          {"success", t.success},
          {"stop_reason", t.stop_reason},
          {"spl", t.spl},
          {"soft_spl", t.soft_spl},
          {"path_m", t.path_m},
          {"shortest_path_m", t.shortest_path_m},
          {"distance_to_goal_m", optional(t.distance_to_goal_m)},
          {"sim_s", t.sim_s},
          {"wall_s", t.wall_s},
          {"ticks", t.ticks},
          {"contacts", t.contacts},
          {"contact_s", t.contact_s},
          {"first_visible_tick", t.first_visible_tick},
          {"first_detected_tick", t.first_detected_tick},
          {"invalid_pixel_fraction", t.invalid_pixel_fraction},
          {"state_hash", hex(t.state_hash)},
          {"render_ms", t.render_ms},
          {"detect_ms", t.detect_ms},
          {"policy_ms", t.policy_ms},
          {"error", t.error},
          {"picture", t.picture},
          {"video", t.video},
          {"track", t.track},
          {"log", t.log},
          {"why", json_why(t.why)}};
}

}  // namespace

void write_trials_jsonl(std::ostream& out, const StoredRun& stored) {
  // Bytes of foreign names that are no UTF-8 become U+FFFD instead of an exception.
  const auto line = [&](const Json& json) {
    out << json.dump(-1, ' ', false, Json::error_handler_t::replace) << '\n';
  };
  line(json_run(stored));
  for (const TrialRow& trial : stored.trials) line(json_trial(trial));
}

}  // namespace segsim::experiments
