#include "experiments/store/internal/store_attribution.h"

#include <map>
#include <optional>

#include "experiments/store/internal/sqlite_statement.h"

namespace segsim::experiments {
namespace {

void bind_optional(Statement& statement, const std::optional<double>& value) {
  if (value) {
    statement.bind(*value);
  } else {
    statement.bind_null();
  }
}

}  // namespace

void remove_attribution_of_failed(sqlite3* db, const std::filesystem::path& file,
                                  std::int64_t run_id, const TrialRow& trial) {
  Statement remove(db, file,
                   "DELETE FROM attribution WHERE trial_id IN (SELECT trial_id FROM trial "
                   "WHERE run_id = ? AND arm = ? AND episode = ? AND repetition = ? AND "
                   "outcome = 'error')");
  remove.bind(run_id).bind(trial.arm).bind(trial.episode).bind(trial.repetition).step();
}

void insert_attribution(sqlite3* db, const std::filesystem::path& file, std::int64_t trial_id,
                        const TrialRow& trial) {
  const Attribution& why = trial.why;
  if (!why.known()) return;
  Statement insert(db, file,
                   "INSERT INTO attribution VALUES "
                   "(?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)");
  insert.bind(trial_id).bind(why.cause).bind(why.inevitable_tick).bind(why.decisive_tick);
  insert.bind(why.visible_frames).bind(why.detected_frames).bind(why.true_detections);
  insert.bind(why.false_detections).bind(why.first_true_tick).bind(why.true_clouds);
  insert.bind(why.false_clouds).bind(why.stopped ? 1 : 0).bind(why.final_visible_px);
  bind_optional(insert, why.object_m);
  bind_optional(insert, why.planar_m);
  bind_optional(insert, why.shortest_object_m);
  insert.bind(why.collision_ticks).bind(why.off_navmesh_ticks).bind(why.reached_instance);
  insert.bind(trial.log).bind(why.images).step();
}

void read_attributions(sqlite3* db, const std::filesystem::path& file, std::int64_t run_id,
                       std::vector<TrialRow>& rows) {
  std::map<std::int64_t, TrialRow*> by_id;
  for (TrialRow& row : rows) by_id[row.trial_id] = &row;
  Statement select(db, file,
                   "SELECT attribution.* FROM attribution JOIN trial USING (trial_id) "
                   "WHERE trial.run_id = ?");
  select.bind(run_id);
  while (select.step()) {
    const auto found = by_id.find(select.integer());
    if (found == by_id.end()) continue;
    Attribution& why = found->second->why;
    why.cause = select.text();
    for (int* column : {&why.inevitable_tick, &why.decisive_tick, &why.visible_frames,
                        &why.detected_frames, &why.true_detections, &why.false_detections,
                        &why.first_true_tick, &why.true_clouds, &why.false_clouds}) {
      *column = select.small_integer();
    }
    why.stopped = select.integer() != 0;
    why.final_visible_px = select.small_integer();
    for (std::optional<double>* column :
         {&why.object_m, &why.planar_m, &why.shortest_object_m}) {
      *column = select.optional_number();
    }
    for (int* column : {&why.collision_ticks, &why.off_navmesh_ticks, &why.reached_instance}) {
      *column = select.small_integer();
    }
    found->second->log = select.text();
    why.images = select.small_integer();
  }
}

}  // namespace segsim::experiments
