#pragma once

/// @file
/// Parts of store.cpp: the tables, and how older files are brought up to date. A version is
/// never edited once files of it exist; the next one is added below. The tables of why trials
/// failed are in store_attribution.h.

namespace segsim::experiments {

constexpr const char* kSchema = R"sql(
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
)sql";

/// From version 1 to 2: how good an arm's detector is on held-out views.
constexpr int kBeforeHeldOut = 1;
constexpr const char* kHeldOutMigration = R"sql(
ALTER TABLE arm ADD COLUMN held_out_views INTEGER NOT NULL DEFAULT 0;
ALTER TABLE arm ADD COLUMN ap50 REAL NOT NULL DEFAULT 0;
ALTER TABLE arm ADD COLUMN ap REAL NOT NULL DEFAULT 0;
ALTER TABLE arm ADD COLUMN held_out_threshold REAL NOT NULL DEFAULT 0;
ALTER TABLE arm ADD COLUMN precision REAL NOT NULL DEFAULT 0;
ALTER TABLE arm ADD COLUMN recall REAL NOT NULL DEFAULT 0;
UPDATE meta SET schema_version = 2;
)sql";

/// From version 3 to 4: what tuning an arm's detector cost elsewhere, and where its views lie.
constexpr int kBeforeTuningCost = 3;
constexpr const char* kTuningCostMigration = R"sql(
ALTER TABLE arm ADD COLUMN source_ap50 REAL NOT NULL DEFAULT -1;
ALTER TABLE arm ADD COLUMN unseen_ap50 REAL NOT NULL DEFAULT -1;
ALTER TABLE arm ADD COLUMN tuning_views INTEGER NOT NULL DEFAULT 0;
ALTER TABLE arm ADD COLUMN tuning_views_near_starts INTEGER NOT NULL DEFAULT 0;
ALTER TABLE arm ADD COLUMN start_radius_m REAL NOT NULL DEFAULT 0;
UPDATE meta SET schema_version = 4;
)sql";

/// From version 5 to 6, and after kSchema in a new file: what else a run's results depend on.
constexpr int kBeforeProvenance = 5;
constexpr const char* kProvenanceTable = R"sql(
CREATE TABLE provenance (
  run_id INTEGER NOT NULL REFERENCES run, name TEXT NOT NULL, value TEXT NOT NULL,
  PRIMARY KEY (run_id, name)) WITHOUT ROWID;
)sql";

/// From version 6 to 7, and after kSchema in a new file: which scenes are reconstructions of
/// one, and which arms trainings of one. An empty family is the name, a seed of -1 none.
constexpr int kBeforeFamilies = 6;
constexpr const char* kFamilyColumns = R"sql(
ALTER TABLE scene ADD COLUMN family TEXT NOT NULL DEFAULT '';
ALTER TABLE scene ADD COLUMN reconstruction INTEGER NOT NULL DEFAULT 1;
ALTER TABLE arm ADD COLUMN family TEXT NOT NULL DEFAULT '';
ALTER TABLE arm ADD COLUMN reconstruction INTEGER NOT NULL DEFAULT 1;
ALTER TABLE arm ADD COLUMN finetune_seed INTEGER NOT NULL DEFAULT -1;
)sql";

}  // namespace segsim::experiments
