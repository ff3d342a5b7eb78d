#pragma once

/// @file
/// Databases as earlier versions of the store made them: the SQL of that time.

namespace segsim::experiments {

/// A file as version 1 of the store made it: one run, one arm, one trial.
inline constexpr const char* kVersion1 = R"sql(
CREATE TABLE meta (schema_version INTEGER NOT NULL, created TEXT NOT NULL);
CREATE TABLE run (
  run_id INTEGER PRIMARY KEY, name TEXT NOT NULL, title TEXT NOT NULL,
  spec_sha256 TEXT NOT NULL, spec_text TEXT NOT NULL, code_version TEXT NOT NULL,
  host TEXT NOT NULL, libraries TEXT NOT NULL, success_profile TEXT NOT NULL,
  seed INTEGER NOT NULL, planned_n INTEGER NOT NULL, planned_trials INTEGER NOT NULL,
  started TEXT NOT NULL, ended TEXT NOT NULL);
CREATE TABLE scene (
  run_id INTEGER NOT NULL REFERENCES run, position INTEGER NOT NULL, name TEXT NOT NULL,
  title TEXT NOT NULL, scene_sha256 TEXT NOT NULL, episodes_sha256 TEXT NOT NULL,
  episodes INTEGER NOT NULL, UNIQUE (run_id, name));
CREATE TABLE arm (
  run_id INTEGER NOT NULL REFERENCES run, position INTEGER NOT NULL, name TEXT NOT NULL,
  detector TEXT NOT NULL, weights_sha256 TEXT NOT NULL, tuned_on TEXT NOT NULL,
  score_threshold REAL NOT NULL, UNIQUE (run_id, name));
CREATE TABLE trial (
  trial_id INTEGER PRIMARY KEY, run_id INTEGER NOT NULL REFERENCES run,
  arm TEXT NOT NULL, scene TEXT NOT NULL, episode TEXT NOT NULL, goal_class TEXT NOT NULL,
  repetition INTEGER NOT NULL, outcome TEXT NOT NULL, success INTEGER NOT NULL,
  stop_reason TEXT NOT NULL, spl REAL NOT NULL, soft_spl REAL NOT NULL, path_m REAL NOT NULL,
  shortest_path_m REAL NOT NULL, distance_to_goal_m REAL, sim_s REAL NOT NULL,
  wall_s REAL NOT NULL, ticks INTEGER NOT NULL, contacts INTEGER NOT NULL,
  contact_s REAL NOT NULL, first_visible_tick INTEGER NOT NULL,
  first_detected_tick INTEGER NOT NULL, invalid_pixel_fraction REAL NOT NULL,
  state_hash TEXT NOT NULL, render_ms REAL NOT NULL, detect_ms REAL NOT NULL,
  policy_ms REAL NOT NULL, error TEXT NOT NULL, picture TEXT NOT NULL, video TEXT NOT NULL,
  track TEXT NOT NULL, finished TEXT NOT NULL,
  UNIQUE (run_id, arm, episode, repetition));
INSERT INTO meta VALUES (1, '2025-01-01T00:00:00Z');
INSERT INTO run VALUES (1, 'old', 'Old', 'aa', 'name: old', '0.0.1', 'h', 'l', 'p', 5, 0, 1,
  '2025-01-01T00:00:00Z', '');
INSERT INTO scene VALUES (1, 0, 'b', 'Scene B', 's', 'e', 1);
INSERT INTO arm VALUES (1, 0, 'before', 'w.bin', 'ff', 'b', 0.25);
INSERT INTO trial VALUES (1, 1, 'before', 'b', 'b/chair/00', 'chair', 0, 'success', 1, 'goal_reached',
  0.5, 0.5, 3.25, 2.0, NULL, 10, 1, 40, 0, 0, 3, 4, 0.01, 'fedcba9876543210', 1, 2, 3, '', '',
  '', '', '2025-01-01T00:01:00Z');
)sql";

/// A file as the first programs of version 7 made it, with a value in every column.
inline constexpr const char* kVersion7 = R"sql(
CREATE TABLE meta (schema_version INTEGER NOT NULL, created TEXT NOT NULL);
CREATE TABLE run (
  run_id INTEGER PRIMARY KEY, name TEXT NOT NULL, title TEXT NOT NULL,
  spec_sha256 TEXT NOT NULL, spec_text TEXT NOT NULL, code_version TEXT NOT NULL,
  host TEXT NOT NULL, libraries TEXT NOT NULL, success_profile TEXT NOT NULL,
  seed INTEGER NOT NULL, planned_n INTEGER NOT NULL, planned_trials INTEGER NOT NULL,
  started TEXT NOT NULL, ended TEXT NOT NULL);
CREATE TABLE scene (
  run_id INTEGER NOT NULL REFERENCES run, position INTEGER NOT NULL, name TEXT NOT NULL,
  title TEXT NOT NULL, scene_sha256 TEXT NOT NULL, episodes_sha256 TEXT NOT NULL,
  episodes INTEGER NOT NULL, oracle_successes INTEGER NOT NULL DEFAULT -1,
  oracle_episodes INTEGER NOT NULL DEFAULT -1, UNIQUE (run_id, name));
CREATE TABLE arm (
  run_id INTEGER NOT NULL REFERENCES run, position INTEGER NOT NULL, name TEXT NOT NULL,
  detector TEXT NOT NULL, weights_sha256 TEXT NOT NULL, tuned_on TEXT NOT NULL,
  score_threshold REAL NOT NULL, held_out_views INTEGER NOT NULL, ap50 REAL NOT NULL,
  ap REAL NOT NULL, held_out_threshold REAL NOT NULL, precision REAL NOT NULL, recall REAL NOT NULL,
  source_ap50 REAL NOT NULL, unseen_ap50 REAL NOT NULL, tuning_views INTEGER NOT NULL,
  tuning_views_near_starts INTEGER NOT NULL, start_radius_m REAL NOT NULL, UNIQUE (run_id, name));
CREATE TABLE trial (
  trial_id INTEGER PRIMARY KEY, run_id INTEGER NOT NULL REFERENCES run,
  arm TEXT NOT NULL, scene TEXT NOT NULL, episode TEXT NOT NULL, goal_class TEXT NOT NULL,
  repetition INTEGER NOT NULL, outcome TEXT NOT NULL, success INTEGER NOT NULL,
  stop_reason TEXT NOT NULL, spl REAL NOT NULL, soft_spl REAL NOT NULL, path_m REAL NOT NULL,
  shortest_path_m REAL NOT NULL, distance_to_goal_m REAL, sim_s REAL NOT NULL,
  wall_s REAL NOT NULL, ticks INTEGER NOT NULL, contacts INTEGER NOT NULL,
  contact_s REAL NOT NULL, first_visible_tick INTEGER NOT NULL,
  first_detected_tick INTEGER NOT NULL, invalid_pixel_fraction REAL NOT NULL,
  state_hash TEXT NOT NULL, render_ms REAL NOT NULL, detect_ms REAL NOT NULL,
  policy_ms REAL NOT NULL, error TEXT NOT NULL, picture TEXT NOT NULL, video TEXT NOT NULL,
  track TEXT NOT NULL, finished TEXT NOT NULL,
  UNIQUE (run_id, arm, episode, repetition));
CREATE TABLE attribution (
  trial_id INTEGER PRIMARY KEY REFERENCES trial, cause TEXT NOT NULL,
  inevitable_tick INTEGER NOT NULL, decisive_tick INTEGER NOT NULL,
  visible_frames INTEGER NOT NULL, detected_frames INTEGER NOT NULL,
  true_detections INTEGER NOT NULL, false_detections INTEGER NOT NULL,
  first_true_tick INTEGER NOT NULL, true_clouds INTEGER NOT NULL,
  false_clouds INTEGER NOT NULL, stopped INTEGER NOT NULL, final_visible_px INTEGER NOT NULL,
  object_m REAL, planar_m REAL, shortest_object_m REAL, collision_ticks INTEGER NOT NULL,
  off_navmesh_ticks INTEGER NOT NULL, reached_instance INTEGER NOT NULL, log TEXT NOT NULL);
ALTER TABLE attribution ADD COLUMN images INTEGER NOT NULL DEFAULT -1;
CREATE TABLE provenance (
  run_id INTEGER NOT NULL REFERENCES run, name TEXT NOT NULL, value TEXT NOT NULL,
  PRIMARY KEY (run_id, name)) WITHOUT ROWID;
ALTER TABLE scene ADD COLUMN family TEXT NOT NULL DEFAULT '';
ALTER TABLE scene ADD COLUMN reconstruction INTEGER NOT NULL DEFAULT 1;
ALTER TABLE arm ADD COLUMN family TEXT NOT NULL DEFAULT '';
ALTER TABLE arm ADD COLUMN reconstruction INTEGER NOT NULL DEFAULT 1;
ALTER TABLE arm ADD COLUMN finetune_seed INTEGER NOT NULL DEFAULT -1;
ALTER TABLE attribution ADD COLUMN misplaced_clouds INTEGER NOT NULL DEFAULT -1;
INSERT INTO meta VALUES (7, '2026-01-01T00:00:00Z');
INSERT INTO run VALUES (1, 'demo', 'Demo', 'aa', 'name: demo', '0.1.0', 'h', 'l', 'p', -59, 2, 4,
  '2026-01-01T00:00:00Z', '2026-01-01T02:00:00Z');
INSERT INTO scene VALUES (1, 0, 'b.r2', 'Scene B', 's', 'e', 2, 9, 10, 'b', 2);
INSERT INTO arm VALUES (1, 0, 'after', 'v.bin', 'fe', 'b', 0.5, 60, 0.5, 0.25, 0.2, 0.75, 0.625,
  0.375, -1, 400, 3, 1.0, 'tuned', 2, 11);
INSERT INTO provenance VALUES (1, 'clock', 'lockstep');
INSERT INTO trial (run_id, arm, scene, episode, goal_class, repetition, outcome, success,
  stop_reason, spl, soft_spl, path_m, shortest_path_m, distance_to_goal_m, sim_s, wall_s, ticks,
  contacts, contact_s, first_visible_tick, first_detected_tick, invalid_pixel_fraction,
  state_hash, render_ms, detect_ms, policy_ms, error, picture, video, track, finished) VALUES
  (1, 'after', 'b.r2', 'b/chair/00', 'chair', 1, 'success', 1, 'goal_reached', 0.5, 0.625, 3.25,
  2.0, 0.125, 10.5, 1.5, 40, 2, 0.25, 3, 4, 0.015625, 'fedcba9876543210', 1.25, 2.25, 3.5,
  'none', 'p.png', 'v.mp4', 't', '2026-01-01T01:00:00Z');
INSERT INTO attribution VALUES (1, 'did_not_fail', 36, 35, 21, 20, 22, 5, 23, 6, 7, 1, 1234, 0.75,
  NULL, 3.5, 8, 9, 10, 'logs/x', 150, 12);
)sql";

}  // namespace segsim::experiments
