#pragma once

/// @file
/// The table `attribution` of a results database: why trials failed, one row per trial. It
/// came with schema version 3; trials of older runs have no row there.

#include <cstdint>

#include "experiments/records/internal/sqlite_statement.h"
#include "experiments/records/store.h"

namespace segsim::experiments {

inline constexpr int kBeforeAttribution = 2;  ///< The schema version without it.

inline constexpr const char* kAttributionSchema = R"sql(
CREATE TABLE attribution (
  trial_id INTEGER PRIMARY KEY REFERENCES trial, cause TEXT NOT NULL,
  inevitable_tick INTEGER NOT NULL, decisive_tick INTEGER NOT NULL,
  visible_frames INTEGER NOT NULL, detected_frames INTEGER NOT NULL,
  true_detections INTEGER NOT NULL, false_detections INTEGER NOT NULL,
  first_true_tick INTEGER NOT NULL, true_clouds INTEGER NOT NULL,
  false_clouds INTEGER NOT NULL, stopped INTEGER NOT NULL, final_visible_px INTEGER NOT NULL,
  object_m REAL, planar_m REAL, shortest_object_m REAL, collision_ticks INTEGER NOT NULL,
  off_navmesh_ticks INTEGER NOT NULL, reached_instance INTEGER NOT NULL, log TEXT NOT NULL);
)sql";

/// From version 2 to 3, after kAttributionSchema.
inline constexpr const char* kAttributionMigration = R"sql(
ALTER TABLE scene ADD COLUMN oracle_successes INTEGER NOT NULL DEFAULT -1;
ALTER TABLE scene ADD COLUMN oracle_episodes INTEGER NOT NULL DEFAULT -1;
UPDATE meta SET schema_version = 3;
)sql";

/// From version 4 to 5, and after kAttributionSchema in a new file: over how many images
/// perception was counted.
inline constexpr int kBeforeImages = 4;
inline constexpr const char* kImagesColumn = R"sql(
ALTER TABLE attribution ADD COLUMN images INTEGER NOT NULL DEFAULT -1;
)sql";

/// From version 6 to 7, and after kImagesColumn in a new file: objects of the policy's map
/// that true detections put elsewhere, apart from those of false ones.
inline constexpr const char* kMisplacedColumn = R"sql(
ALTER TABLE attribution ADD COLUMN misplaced_clouds INTEGER NOT NULL DEFAULT -1;
)sql";

/// The columns that read_attribution() reads, in its order.
inline constexpr const char* kAttributionColumns =
    "cause, inevitable_tick, decisive_tick, visible_frames, detected_frames, "
    "true_detections, false_detections, first_true_tick, true_clouds, false_clouds, stopped, "
    "final_visible_px, object_m, planar_m, shortest_object_m, collision_ticks, "
    "off_navmesh_ticks, reached_instance, log, images, misplaced_clouds";

/// Before the failed trial itself is removed.
inline constexpr const char* kRemoveAttributionOfFailed =
    "DELETE FROM attribution WHERE trial_id IN (SELECT trial_id FROM trial WHERE run_id = ? "
    "AND arm = ? AND episode = ? AND repetition = ? AND outcome = 'error')";
inline constexpr const char* kInsertAttribution =
    "INSERT INTO attribution VALUES "
    "(?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)";

/// Runs kInsertAttribution.
void insert_attribution(Statement& insert, std::int64_t trial_id, const TrialRow& trial);
/// Fills in `why` and `log` of the row; all of it is NULL for trials without an attribution.
void read_attribution(Statement& row, TrialRow& trial);

}  // namespace segsim::experiments
