#include "experiments/support/stage_times.h"

#include <algorithm>
#include <cstdlib>
#include <utility>

#include "core/formatted.h"
#include "experiments/support/text_grid.h"

namespace segsim::experiments::support {

StageTimes::Timer::Timer(StageTimes& times, std::string stage)
    : times_(times), stage_(std::move(stage)) {
  const std::lock_guard<std::mutex> lock(times_.mutex_);
  Stage& timed = times_.stage(stage_);
  if (timed.timers++ == 0) timed.start = Clock::now();
}

StageTimes::Timer::~Timer() {
  const std::lock_guard<std::mutex> lock(times_.mutex_);
  Stage& timed = times_.stage(stage_);
  if (--timed.timers > 0 || !timed.time.made) return;
  timed.time.wall_s += std::chrono::duration<double>(Clock::now() - timed.start).count();
}

void StageTimes::Timer::working() {
  const std::lock_guard<std::mutex> lock(times_.mutex_);
  times_.stage(stage_).time.made = true;
}

StageTimes::Stage& StageTimes::stage(const std::string& name) {
  const auto found = std::find_if(stages_.begin(), stages_.end(), [&](const Stage& known) {
    return known.time.stage == name;
  });
  if (found != stages_.end()) return *found;
  stages_.push_back({{name}, 0, {}});
  return stages_.back();
}

std::vector<StageTime> StageTimes::all() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  std::vector<StageTime> times;
  for (const Stage& known : stages_) times.push_back(known.time);
  return times;
}

std::string in_words(const StageTime& time) {
  return time.made ? core::print("%.1f s", time.wall_s) : "0 s (was there)";
}

std::string stage_times_text(const std::vector<StageTime>& times, double total_s) {
  internal::TextGrid grid{{"Stage", "Wall time"}, {}};
  for (const StageTime& time : times) grid.rows.push_back({time.stage, in_words(time)});
  grid.rows.push_back({"all", core::print("%.1f s", total_s)});
  return internal::text_of(grid);
}

std::map<std::string, std::string> stage_time_rows(
    const std::vector<StageTime>& times, const std::map<std::string, std::string>& known) {
  std::map<std::string, std::string> rows;
  for (const StageTime& time : times) {
    const std::string name = "time/" + time.stage;
    const auto found = known.find(name);
    if (found == known.end()) {
      rows[name] = in_words(time);
    } else if (time.made) {
      StageTime sum = time;
      sum.wall_s += std::strtod(found->second.c_str(), nullptr);
      rows[name] = in_words(sum);
    }
  }
  return rows;
}

}  // namespace segsim::experiments::support
