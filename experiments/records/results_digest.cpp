#include "experiments/records/results_digest.h"

#include <cmath>
#include <optional>
#include <sstream>

#include "core/file_io.h"
#include "experiments/support/formatted.h"

namespace segsim::experiments {
namespace {

/// Hexadecimal floating point: every bit.
std::string exact(double value) { return print("%a", value); }

std::string exact(const std::optional<double>& value) {
  return value && std::isfinite(*value) ? exact(*value) : "none";
}

}  // namespace

std::string essence_of(const TrialRow& t) {
  std::ostringstream line;
  for (const std::string* text : {&t.scene, &t.episode, &t.goal_class, &t.arm, &t.outcome,
                                  &t.stop_reason, &t.error, &t.why.cause}) {
    line << *text << '\t';
  }
  line << t.repetition << '\t' << t.success << '\t' << hex(t.state_hash);
  for (const double value : {t.spl, t.soft_spl, t.path_m, t.shortest_path_m, t.sim_s,
                             t.contact_s, t.invalid_pixel_fraction}) {
    line << '\t' << exact(value);
  }
  for (const std::optional<double>& value :
       {t.distance_to_goal_m, t.why.object_m, t.why.planar_m, t.why.shortest_object_m}) {
    line << '\t' << exact(value);
  }
  const Attribution& why = t.why;
  for (const int value :
       {t.ticks, t.contacts, t.first_visible_tick, t.first_detected_tick, why.images,
        why.inevitable_tick, why.decisive_tick, why.visible_frames, why.detected_frames,
        why.true_detections, why.false_detections, why.first_true_tick, why.true_clouds,
        why.false_clouds, why.stopped ? 1 : 0, why.final_visible_px, why.collision_ticks,
        why.off_navmesh_ticks, why.reached_instance}) {
    line << '\t' << value;
  }
  line << '\t' << why.misplaced_clouds;
  return line.str();
}

std::string results_sha256(const std::vector<TrialRow>& trials) {
  std::string text;
  for (const TrialRow& trial : trials) {
    if (!trial.failed()) text += essence_of(trial) + "\n";
  }
  return core::sha256_hex(text);
}

}  // namespace segsim::experiments
