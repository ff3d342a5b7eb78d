#include "experiments/records/internal/store_attribution.h"

#include <optional>

namespace segsim::experiments {

void insert_attribution(Statement& insert, std::int64_t trial_id, const TrialRow& trial) {
  const Attribution& why = trial.why;
  insert.bind(trial_id).bind(why.cause).bind(why.inevitable_tick).bind(why.decisive_tick);
  insert.bind(why.visible_frames).bind(why.detected_frames).bind(why.true_detections);
  insert.bind(why.false_detections).bind(why.first_true_tick).bind(why.true_clouds);
  insert.bind(why.false_clouds).bind(why.stopped ? 1 : 0).bind(why.final_visible_px);
  insert.bind(why.object_m).bind(why.planar_m).bind(why.shortest_object_m);
  insert.bind(why.collision_ticks).bind(why.off_navmesh_ticks).bind(why.reached_instance);
  insert.bind(trial.log).bind(why.images).bind(why.misplaced_clouds).step();
}

void read_attribution(Statement& row, TrialRow& trial) {
  Attribution& why = trial.why;
  why.cause = row.text();
  if (!why.known()) return;
  for (int* column : {&why.inevitable_tick, &why.decisive_tick, &why.visible_frames,
                      &why.detected_frames, &why.true_detections, &why.false_detections,
                      &why.first_true_tick, &why.true_clouds, &why.false_clouds}) {
    *column = row.small_integer();
  }
  why.stopped = row.integer() != 0;
  why.final_visible_px = row.small_integer();
  for (std::optional<double>* column :
       {&why.object_m, &why.planar_m, &why.shortest_object_m}) {
    *column = row.optional_number();
  }
  for (int* column : {&why.collision_ticks, &why.off_navmesh_ticks, &why.reached_instance}) {
    *column = row.small_integer();
  }
  trial.log = row.text();
  why.images = row.small_integer();
  why.misplaced_clouds = row.small_integer();
}

}  // namespace segsim::experiments
