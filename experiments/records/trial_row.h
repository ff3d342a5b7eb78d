#pragma once

/// @file
/// One finished trial, described once: what is stored of it, exported and digested.

#include <cstdint>
#include <optional>
#include <string>

#include "core/stop_reason.h"
#include "experiments/records/column.h"
#include "experiments/records/trial_outcome.h"
#include "experiments/records/trial_witness.h"

namespace segsim::experiments::records {

/// One finished trial. Columns as in sim::TrialResult; -1 ticks and unset values are "never".
struct TrialRow {
  std::int64_t trial_id = 0;  ///< Given by the store.
  std::string arm, scene, episode, goal_class;
  int repetition = 0;
  TrialOutcome outcome = TrialOutcome::kTimeout;
  bool success = false;
  std::optional<core::StopReason> stop_reason;  ///< None: the policy did not stop.
  double spl = 0, soft_spl = 0;
  double path_m = 0, shortest_path_m = 0;
  std::optional<double> distance_to_goal_m;  ///< None: off the navigable area.
  double sim_s = 0, wall_s = 0;
  int ticks = 0, contacts = 0;
  double contact_s = 0;
  int first_visible_tick = -1, first_detected_tick = -1;
  double invalid_pixel_fraction = 0;
  std::uint64_t state_hash = 0;
  double render_ms = 0, detect_ms = 0, policy_ms = 0;
  std::string error;  ///< Message of a failed harness; such trials run again on resume.
  std::string picture, video, track;  ///< Files, relative to the work folder; empty if none.

  std::string log;  ///< File, relative to the work folder (trial_log.h); empty if none.
  Attribution why;
  std::string finished;  ///< UTC, ISO 8601; empty: when it is added.

  [[nodiscard]] bool failed() const { return outcome == TrialOutcome::kError; }
  /// Whether it enters rates.
  [[nodiscard]] bool counts() const {
    return !failed() && outcome != TrialOutcome::kInfeasible &&
           outcome != TrialOutcome::kTrivial;
  }
};

/// How it ended, for the rules of other profiles.
[[nodiscard]] sim::TrialEnd trial_end(const TrialRow& trial);

template <AnyConst<Attribution> Why, class F>
void visit_columns(Why& why, F&& f) {
  using enum Part;
  f({.name = "cause", .part = kWhy, .digest = 7}, why.cause);
  f({.name = "inevitable_tick", .part = kWhy, .digest = 27}, why.inevitable_tick);
  f({.name = "decisive_tick", .part = kWhy, .digest = 28}, why.decisive_tick);
  f({.name = "visible_frames", .part = kWhy, .digest = 29}, why.visible_frames);
  f({.name = "detected_frames", .part = kWhy, .digest = 30}, why.detected_frames);
  f({.name = "true_detections", .part = kWhy, .digest = 31}, why.true_detections);
  f({.name = "false_detections", .part = kWhy, .digest = 32}, why.false_detections);
  f({.name = "first_true_tick", .part = kWhy, .digest = 33}, why.first_true_tick);
  f({.name = "true_clouds", .part = kWhy, .digest = 34}, why.true_clouds);
  f({.name = "false_clouds", .part = kWhy, .digest = 35}, why.false_clouds);
  f({.name = "stopped", .part = kWhy, .digest = 36}, why.stopped);
  f({.name = "final_visible_px", .part = kWhy, .digest = 37}, why.final_visible_px);
  f({.name = "object_m", .part = kWhy, .digest = 19}, why.object_m);
  f({.name = "planar_m", .part = kWhy, .digest = 20}, why.planar_m);
  f({.name = "shortest_object_m", .part = kWhy, .digest = 21}, why.shortest_object_m);
  f({.name = "collision_ticks", .part = kWhy, .digest = 38}, why.collision_ticks);
  f({.name = "off_navmesh_ticks", .part = kWhy, .digest = 39}, why.off_navmesh_ticks);
  f({.name = "reached_instance", .part = kWhy, .digest = 40}, why.reached_instance);
  f({.name = "images", .part = kWhy, .digest = 26, .unknown_below_zero = true}, why.images);
  f({.name = "misplaced_clouds", .part = kWhy, .digest = 41, .unknown_below_zero = true},
    why.misplaced_clouds);
  // Of the training, not of the trial: in no digest.
  f({.name = "stop_views", .part = kWhy, .unknown_below_zero = true}, why.stop_views);
}

template <AnyConst<TrialRow> Row, class F>
void visit_columns(Row& t, F&& f) {
  f({.name = "scene", .digest = 0}, t.scene);
  f({.name = "episode", .digest = 1}, t.episode);
  f({.name = "goal_class", .digest = 2}, t.goal_class);
  f({.name = "repetition", .digest = 8}, t.repetition);
  f({.name = "arm", .digest = 3}, t.arm);
  f({.name = "outcome", .digest = 4}, t.outcome);
  f({.name = "success", .digest = 9}, t.success);
  f({.name = "stop_reason", .digest = 5}, t.stop_reason);
  f({.name = "spl", .digest = 11}, t.spl);
  f({.name = "soft_spl", .digest = 12}, t.soft_spl);
  f({.name = "path_m", .digest = 13}, t.path_m);
  f({.name = "shortest_path_m", .digest = 14}, t.shortest_path_m);
  f({.name = "distance_to_goal_m", .digest = 18}, t.distance_to_goal_m);
  f({.name = "sim_s", .digest = 15}, t.sim_s);
  f({.name = "wall_s"}, t.wall_s);
  f({.name = "ticks", .digest = 22}, t.ticks);
  f({.name = "contacts", .digest = 23}, t.contacts);
  f({.name = "contact_s", .digest = 16}, t.contact_s);
  f({.name = "first_visible_tick", .digest = 24}, t.first_visible_tick);
  f({.name = "first_detected_tick", .digest = 25}, t.first_detected_tick);
  f({.name = "invalid_pixel_fraction", .digest = 17}, t.invalid_pixel_fraction);
  f({.name = "state_hash", .digest = 10, .hexadecimal = true}, t.state_hash);
  f({.name = "render_ms"}, t.render_ms);
  f({.name = "detect_ms"}, t.detect_ms);
  f({.name = "policy_ms"}, t.policy_ms);
  f({.name = "error", .digest = 6}, t.error);
  visit_columns(t.why, f);
  f({.name = "trial_id", .given_by_store = true}, t.trial_id);
  f({.name = "log", .part = Part::kLog}, t.log);
  f({.name = "picture"}, t.picture);
  f({.name = "video"}, t.video);
  f({.name = "track"}, t.track);
  f({.name = "finished"}, t.finished);
}

}  // namespace segsim::experiments::records
