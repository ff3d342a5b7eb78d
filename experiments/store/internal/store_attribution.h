#pragma once

/// @file
/// The table `attribution` of a results database: why trials failed, one row per trial. It
/// came with schema version 3; trials of older runs have no row there.

#include <cstdint>
#include <filesystem>
#include <vector>

#include <sqlite3.h>

#include "experiments/store/store.h"

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

/// Before the failed trial itself is removed.
void remove_attribution_of_failed(sqlite3* db, const std::filesystem::path& file,
                                  std::int64_t run_id, const TrialRow& trial);
void insert_attribution(sqlite3* db, const std::filesystem::path& file, std::int64_t trial_id,
                        const TrialRow& trial);
/// Fills in `why` and `log` of the rows.
void read_attributions(sqlite3* db, const std::filesystem::path& file, std::int64_t run_id,
                       std::vector<TrialRow>& rows);

}  // namespace segsim::experiments
