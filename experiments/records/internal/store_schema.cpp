#include "experiments/records/internal/store_schema.h"

#include <iterator>

#include "experiments/records/internal/arm_columns.h"
#include "experiments/records/internal/sql_columns.h"
#include "experiments/records/store.h"

namespace segsim::experiments::records {
namespace {

// A migration is never edited once files of its version exist; the next one is added below,
// with the new columns in visit_columns of their row.

/// How good an arm's detector is on held-out views.
constexpr const char* kHeldOut = R"sql(
ALTER TABLE arm ADD COLUMN held_out_views INTEGER NOT NULL DEFAULT 0;
ALTER TABLE arm ADD COLUMN ap50 REAL NOT NULL DEFAULT 0;
ALTER TABLE arm ADD COLUMN ap REAL NOT NULL DEFAULT 0;
ALTER TABLE arm ADD COLUMN held_out_threshold REAL NOT NULL DEFAULT 0;
ALTER TABLE arm ADD COLUMN precision REAL NOT NULL DEFAULT 0;
ALTER TABLE arm ADD COLUMN recall REAL NOT NULL DEFAULT 0;
)sql";

/// Why trials failed, one row per trial; trials of older runs have no row there.
constexpr const char* kAttribution = R"sql(
CREATE TABLE attribution (
  trial_id INTEGER PRIMARY KEY REFERENCES trial, cause TEXT NOT NULL,
  inevitable_tick INTEGER NOT NULL, decisive_tick INTEGER NOT NULL,
  visible_frames INTEGER NOT NULL, detected_frames INTEGER NOT NULL,
  true_detections INTEGER NOT NULL, false_detections INTEGER NOT NULL,
  first_true_tick INTEGER NOT NULL, true_clouds INTEGER NOT NULL,
  false_clouds INTEGER NOT NULL, stopped INTEGER NOT NULL, final_visible_px INTEGER NOT NULL,
  object_m REAL, planar_m REAL, shortest_object_m REAL, collision_ticks INTEGER NOT NULL,
  off_navmesh_ticks INTEGER NOT NULL, reached_instance INTEGER NOT NULL, log TEXT NOT NULL);
ALTER TABLE scene ADD COLUMN oracle_successes INTEGER NOT NULL DEFAULT -1;
ALTER TABLE scene ADD COLUMN oracle_episodes INTEGER NOT NULL DEFAULT -1;
)sql";

/// What tuning an arm's detector cost elsewhere, and where its views lie.
constexpr const char* kTuningCost = R"sql(
ALTER TABLE arm ADD COLUMN source_ap50 REAL NOT NULL DEFAULT -1;
ALTER TABLE arm ADD COLUMN unseen_ap50 REAL NOT NULL DEFAULT -1;
ALTER TABLE arm ADD COLUMN tuning_views INTEGER NOT NULL DEFAULT 0;
ALTER TABLE arm ADD COLUMN tuning_views_near_starts INTEGER NOT NULL DEFAULT 0;
ALTER TABLE arm ADD COLUMN start_radius_m REAL NOT NULL DEFAULT 0;
)sql";

/// Over how many images perception was counted.
constexpr const char* kImages = R"sql(
ALTER TABLE attribution ADD COLUMN images INTEGER NOT NULL DEFAULT -1;
)sql";

/// What else a run's results depend on.
constexpr const char* kProvenance = R"sql(
CREATE TABLE provenance (
  run_id INTEGER NOT NULL REFERENCES run, name TEXT NOT NULL, value TEXT NOT NULL,
  PRIMARY KEY (run_id, name)) WITHOUT ROWID;
)sql";

/// Which scenes are reconstructions of one, and which arms trainings of one: an empty family
/// is the name, a seed of -1 none. Objects of the policy's map that true detections put
/// elsewhere, apart from those of false ones.
constexpr const char* kFamilies = R"sql(
ALTER TABLE scene ADD COLUMN family TEXT NOT NULL DEFAULT '';
ALTER TABLE scene ADD COLUMN reconstruction INTEGER NOT NULL DEFAULT 1;
ALTER TABLE arm ADD COLUMN family TEXT NOT NULL DEFAULT '';
ALTER TABLE arm ADD COLUMN reconstruction INTEGER NOT NULL DEFAULT 1;
ALTER TABLE arm ADD COLUMN finetune_seed INTEGER NOT NULL DEFAULT -1;
ALTER TABLE attribution ADD COLUMN misplaced_clouds INTEGER NOT NULL DEFAULT -1;
)sql";

/// Views that a detector was tuned on where its trials end.
constexpr const char* kStopViews = R"sql(
ALTER TABLE attribution ADD COLUMN stop_views INTEGER NOT NULL DEFAULT -1;
)sql";

constexpr Migration kMigrations[] = {
    {2, kHeldOut},    {3, kAttribution}, {4, kTuningCost}, {5, kImages},
    {6, kProvenance}, {7, kFamilies},    {8, kStopViews},
};
static_assert(std::rbegin(kMigrations)->to == Store::kSchemaVersion);

std::string table(const std::string& name, const std::string& definitions) {
  return "CREATE TABLE " + name + " (" + definitions + ");\n";
}

}  // namespace

std::string present_schema() {
  const std::string of_run = "run_id INTEGER NOT NULL REFERENCES run, ";
  const std::string in_order = of_run + "position INTEGER NOT NULL, ";
  return table("meta", "schema_version INTEGER NOT NULL, created TEXT NOT NULL") +
         table("run", column_definitions<RunRow>()) + kProvenance +
         table("scene",
               in_order + column_definitions<SceneRow>() + ", UNIQUE (run_id, name)") +
         table("arm",
               in_order + column_definitions<ArmColumns>() + ", UNIQUE (run_id, name)") +
         table("trial", of_run + column_definitions<TrialRow>() +
                            ", UNIQUE (run_id, arm, episode, repetition)") +
         table("attribution", "trial_id INTEGER PRIMARY KEY REFERENCES trial, " +
                                  column_definitions<TrialRow>(SqlTable::kAttribution));
}

std::span<const Migration> migrations() { return kMigrations; }

}  // namespace segsim::experiments::records
