#include "experiments/results/explanation.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <map>
#include <numbers>

#include "core/frames.h"
#include "experiments/records/failure_cause.h"
#include "sim/trial/goal_objects.h"

namespace segsim::experiments::results {
namespace {

std::string print(const char* format, double value) {
  char text[48];
  std::snprintf(text, sizeof text, format, value);
  return text;
}

std::string time_of(const records::TrialLog& log, int tick) {
  return print("%7.1f s", core::seconds(log.track[static_cast<std::size_t>(tick)].time_ns));
}

/// "12.4 s  tick 62     text"
std::string event_line(const records::TrialLog& log, int tick, const std::string& text) {
  char head[48];
  std::snprintf(head, sizeof head, "  %s  tick %-5d", time_of(log, tick).c_str(), tick);
  return head + text;
}

std::string metres_to_goal(const records::TrialLog& log, int tick) {
  const double distance_m = log.distance_m[static_cast<std::size_t>(tick)];
  return std::isfinite(distance_m) ? print("%.1f m from a view point", distance_m)
                                   : std::string("off the floor that leads to the goal");
}

const char* mode_words(core::PolicyMode mode) {
  switch (mode) {
    case core::PolicyMode::kInitialize:
      return "looks around";
    case core::PolicyMode::kExplore:
      return "explores";
    case core::PolicyMode::kNavigate:
      return "drives to what it takes for the goal";
    case core::PolicyMode::kRecover:
      return "tries to get free";
    case core::PolicyMode::kStop:
      return "stops";
  }
  return "?";
}

int first_visible(const records::TrialLog& log) {
  for (std::size_t k = 0; k < log.evidence.size(); ++k) {
    if (log.evidence[k].largest_px >= log.visible_px) return static_cast<int>(k);
  }
  return -1;
}

int first_false_detection(const records::TrialLog& log) {
  for (const records::JudgedDetection& d : log.detections) {
    if (!d.is_goal) return d.tick;
  }
  return -1;
}

bool valid_tick(const records::TrialLog& log, int tick) {
  return tick >= 0 && static_cast<std::size_t>(tick) < log.track.size();
}

/// What happened, by tick; several lines of one tick keep their order.
class Timeline {
 public:
  explicit Timeline(const records::TrialLog& log) : log_(log) {}
  void add(int tick, const std::string& text) {
    if (valid_tick(log_, tick)) lines_[tick].push_back(text);
  }
  [[nodiscard]] std::vector<std::string> lines() const {
    std::vector<std::string> all;
    for (const auto& [tick, texts] : lines_) {
      for (const std::string& text : texts) all.push_back(event_line(log_, tick, text));
    }
    return all;
  }

 private:
  const records::TrialLog& log_;
  std::map<int, std::vector<std::string>> lines_;
};

/// Changes of what the policy does; at most so many are told, the first and the last ones.
void add_modes(const records::TrialLog& log, Timeline& timeline) {
  constexpr std::size_t kMostTold = 12;
  std::vector<int> changes;
  for (std::size_t k = 0; k < log.track.size(); ++k) {
    if (log.track[k].mode == core::PolicyMode::kStop) continue;
    if (k == 0 || log.track[k].mode != log.track[k - 1].mode) {
      changes.push_back(static_cast<int>(k));
    }
  }
  for (std::size_t i = 0; i < changes.size(); ++i) {
    const int tick = changes[i];
    if (changes.size() > kMostTold && i >= kMostTold / 2 &&
        i + kMostTold / 2 < changes.size()) {
      if (i == kMostTold / 2) {
        timeline.add(tick, "(" + std::to_string(changes.size() - kMostTold) +
                               " more changes between driving, exploring and recovering)");
      }
      continue;
    }
    const auto at = static_cast<std::size_t>(tick);
    timeline.add(
        tick, std::string(mode_words(log.track[at].mode)) + ", " + metres_to_goal(log, tick));
  }
}

void add_contacts(const records::TrialLog& log, Timeline& timeline) {
  bool before = false;
  for (std::size_t k = 0; k < log.track.size(); ++k) {
    if (log.track[k].in_contact && !before)
      timeline.add(static_cast<int>(k), "touches something");
    before = log.track[k].in_contact;
  }
}

void add_sightings(const records::TrialRow& trial, const records::TrialLog& log,
                   Timeline& timeline) {
  const int visible = first_visible(log);
  const std::string& goal = log.episode.goal_name();
  if (visible >= 0) {
    const records::TickEvidence& e = log.evidence[static_cast<std::size_t>(visible)];
    timeline.add(visible, goal + " first in view (" + std::to_string(e.largest_px) +
                              " px of instance " + std::to_string(e.instance) + ")");
  }
  for (const bool is_goal : {true, false}) {
    const auto found =
        std::find_if(log.detections.begin(), log.detections.end(),
                     [&](const records::JudgedDetection& d) { return d.is_goal == is_goal; });
    if (found == log.detections.end()) continue;
    timeline.add(found->tick, (is_goal ? goal + " first detected (score "
                                       : "something else reported as " + goal + " (score ") +
                                  print("%.2f", static_cast<double>(found->score)) + ")");
  }
  // A STOP makes it inevitable by itself; time does so before it is over.
  if (!trial.success && trial.outcome == records::TrialOutcome::kTimeout) {
    timeline.add(trial.why.inevitable_tick, "from here on even a straight drive is too late");
  }
}

std::string end_words(const records::TrialRow& trial, const records::TrialLog& log) {
  const int last = static_cast<int>(log.track.size()) - 1;
  if (trial.why.stopped) {
    return std::string("STOP (") + core::to_string(trial.stop_reason) + "), " +
           metres_to_goal(log, last) + ", " + std::to_string(trial.why.final_visible_px) +
           " px of the goal in view";
  }
  return std::string(to_string(trial.outcome)) + ", " + metres_to_goal(log, last);
}

std::string perception_words(const records::TrialRow& trial) {
  const records::Attribution& why = trial.why;
  std::string text = "in view in " + std::to_string(why.visible_frames) + " of " +
                     std::to_string(why.images >= 0 ? why.images : trial.ticks) +
                     " images, detected in " + std::to_string(why.detected_frames);
  if (why.visible_frames > 0) {
    text += " (recall " +
            print("%.2f", static_cast<double>(why.detected_frames) / why.visible_frames) + ")";
  }
  if (trial.first_visible_tick >= 0 && why.first_true_tick >= 0) {
    text += ", first " + std::to_string(why.first_true_tick - trial.first_visible_tick) +
            " ticks after it came into view";
  }
  return text + "; " + std::to_string(why.false_detections) + " false detections, " +
         std::to_string(why.false_clouds) +
         (why.misplaced_clouds < 0
              ? " false or misplaced"
              : " false, " + std::to_string(why.misplaced_clouds) + " misplaced") +
         " and " + std::to_string(why.true_clouds) + " true objects in its map at the end";
}

std::string profile_words(const records::TrialRow& trial) {
  const sim::TrialEnd end = records::trial_end(trial);
  std::string text;
  for (const sim::SuccessProfile& profile : sim::success_profiles()) {
    text += (text.empty() ? "" : ", ") + profile.name +
            (sim::succeeded(profile, end) ? " yes" : " no");
  }
  return text;
}

}  // namespace

std::vector<KeyMoment> key_moments(const records::TrialRow& trial,
                                   const records::TrialLog& log) {
  std::map<int, std::string> moments;
  const auto add = [&](int tick, const char* what) {
    if (!valid_tick(log, tick)) return;
    std::string& words = moments[tick];
    words += (words.empty() ? "" : ", ") + std::string(what);
  };
  add(first_visible(log), "first in view");
  add(trial.why.first_true_tick, "first detected");
  add(first_false_detection(log), "first false detection");
  if (!trial.success) add(trial.why.decisive_tick, "turning point");
  if (!trial.success && trial.outcome == records::TrialOutcome::kTimeout)
    add(trial.why.inevitable_tick, "too late");
  add(static_cast<int>(log.track.size()) - 1, trial.why.stopped ? "stop" : "end");
  std::vector<KeyMoment> list;
  list.reserve(moments.size());
  for (const auto& [tick, what] : moments) list.push_back({tick, what});
  return list;
}

std::vector<std::string> tell_story(const records::TrialRow& trial,
                                    const records::TrialLog& log) {
  const core::Pose2& start = log.episode.start;
  std::vector<std::string> lines;
  lines.push_back(
      "Trial " + std::to_string(trial.trial_id) + ": " + trial.episode + ", arm " + trial.arm +
      ": " +
      (trial.success ? "SUCCESS" : std::string("FAILED (") + to_string(trial.outcome) + ")"));
  lines.push_back("  task        find " + sim::with_article(log.episode.goal_name()) + " in " +
                  log.scene_title + " from (" + print("%.2f", start.x_m) + ", " +
                  print("%.2f", start.y_m) + ") m, heading " +
                  print("%.0f", start.yaw_rad * 180.0 / std::numbers::pi) +
                  " deg; the shortest way to a view point is " +
                  print("%.1f", trial.shortest_path_m) + " m");
  if (!trial.success && trial.why.cause) {
    lines.push_back(std::string("  cause       ") + to_string(*trial.why.cause) + ": " +
                    in_words(*trial.why.cause));
  }
  Timeline timeline(log);
  add_modes(log, timeline);
  add_sightings(trial, log, timeline);
  add_contacts(log, timeline);
  timeline.add(static_cast<int>(log.track.size()) - 1, end_words(trial, log));
  for (std::string& line : timeline.lines()) lines.push_back(std::move(line));
  lines.push_back("  perception  " + perception_words(trial));
  lines.push_back("  figures     SPL " + print("%.3f", trial.spl) + ", SoftSPL " +
                  print("%.3f", trial.soft_spl) + ", path " + print("%.1f", trial.path_m) +
                  " m, " + print("%.1f", trial.sim_s) + " s, contacts " +
                  std::to_string(trial.contacts));
  lines.push_back("  other rules " + profile_words(trial));
  if (trial.why.off_navmesh_ticks > 0) {
    lines.push_back(
        "  flag        off_navmesh: " + std::to_string(trial.why.off_navmesh_ticks) +
        " ticks without a finite distance to the goal");
  }
  return lines;
}

}  // namespace segsim::experiments::results
