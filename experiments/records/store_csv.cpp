// CSV form of trial rows.
#include <cmath>
#include <cstdio>

#include "experiments/records/store.h"
#include "experiments/support/formatted.h"

namespace segsim::experiments {
namespace {

/// A quoted CSV field if it needs quotes.
std::string csv_field(const std::string& text) {
  if (text.find_first_of(",\"\n") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char c : text) quoted += c == '"' ? std::string("\"\"") : std::string(1, c);
  return quoted + "\"";
}

std::string csv_number(double value) {
  if (!std::isfinite(value)) return "";
  char text[32];
  std::snprintf(text, sizeof text, "%.6g", value);
  return text;
}

void write_attribution(std::ostream& out, const Attribution& why) {
  if (!why.known()) {
    out << ",,,,,,,,,,,,,,,,,,,,";
    return;
  }
  out << ',' << why.cause;
  for (const int value :
       {why.inevitable_tick, why.decisive_tick, why.visible_frames, why.detected_frames,
        why.true_detections, why.false_detections, why.first_true_tick, why.true_clouds,
        why.false_clouds, why.stopped ? 1 : 0, why.final_visible_px}) {
    out << ',' << value;
  }
  for (const std::optional<double>& value :
       {why.object_m, why.planar_m, why.shortest_object_m}) {
    out << ',' << csv_number(value.value_or(std::nan("")));
  }
  out << ',' << why.collision_ticks << ',' << why.off_navmesh_ticks << ','
      << why.reached_instance << ',' << why.images << ',';
  if (why.misplaced_clouds >= 0) out << why.misplaced_clouds;
}

}  // namespace

void write_trials_csv(std::ostream& out, const std::vector<TrialRow>& trials) {
  out << "scene,episode,goal_class,repetition,arm,outcome,success,stop_reason,spl,soft_spl,"
         "path_m,"
         "shortest_path_m,distance_to_goal_m,sim_s,wall_s,ticks,contacts,contact_s,"
         "first_visible_tick,first_detected_tick,invalid_pixel_fraction,state_hash,render_ms,"
         "detect_ms,policy_ms,error,cause,inevitable_tick,decisive_tick,visible_frames,"
         "detected_frames,true_detections,false_detections,first_true_tick,true_clouds,"
         "false_clouds,stopped,final_visible_px,object_m,planar_m,shortest_object_m,"
         "collision_ticks,off_navmesh_ticks,reached_instance,images,misplaced_clouds,trial_id,"
         "log,picture,video,track\n";
  for (const TrialRow& t : trials) {
    out << csv_field(t.scene) << ',' << csv_field(t.episode) << ',' << csv_field(t.goal_class)
        << ',' << t.repetition << ',' << csv_field(t.arm) << ',' << t.outcome << ','
        << (t.success ? 1 : 0) << ',' << csv_field(t.stop_reason);
    const double distance_m = t.distance_to_goal_m.value_or(std::nan(""));
    for (const double value :
         {t.spl, t.soft_spl, t.path_m, t.shortest_path_m, distance_m, t.sim_s, t.wall_s}) {
      out << ',' << csv_number(value);
    }
    out << ',' << t.ticks << ',' << t.contacts << ',' << csv_number(t.contact_s) << ','
        << t.first_visible_tick << ',' << t.first_detected_tick << ','
        << csv_number(t.invalid_pixel_fraction) << ',' << hex(t.state_hash);
    for (const double value : {t.render_ms, t.detect_ms, t.policy_ms}) {
      out << ',' << csv_number(value);
    }
    out << ',' << csv_field(t.error);
    write_attribution(out, t.why);
    out << ',' << t.trial_id;
    for (const std::string* file : {&t.log, &t.picture, &t.video, &t.track}) {
      out << ',' << csv_field(*file);
    }
    out << '\n';
  }
}

}  // namespace segsim::experiments
