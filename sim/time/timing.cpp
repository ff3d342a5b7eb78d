#include "sim/time/timing.h"

#include <algorithm>
#include <cmath>

#include "core/check.h"

namespace segsim::sim {

void DurationSamples::append(const DurationSamples& other) {
  values_ns_.insert(values_ns_.end(), other.values_ns_.begin(), other.values_ns_.end());
}

core::TimeNs DurationSamples::percentile(double share) const {
  SEGSIM_CHECK(share >= 0.0 && share <= 1.0, std::to_string(share));
  if (values_ns_.empty()) return 0;
  std::vector<core::TimeNs> sorted = values_ns_;
  const double rank = std::ceil(share * static_cast<double>(sorted.size()));
  const auto at = static_cast<std::ptrdiff_t>(std::max(1.0, rank)) - 1;
  std::nth_element(sorted.begin(), sorted.begin() + at, sorted.end());
  return sorted[static_cast<std::size_t>(at)];
}

bool StageTiming::add(core::TimeNs response_ns) {
  response.add(response_ns);
  const bool missed = deadline_ns > 0 && response_ns > deadline_ns;
  run_ = missed ? run_ + 1 : 0;
  misses += missed ? 1 : 0;
  longest_miss_run = std::max(longest_miss_run, run_);
  return missed;
}

void StageTiming::append(const StageTiming& other) {
  response.append(other.response);
  misses += other.misses;
  drops += other.drops;
  // A run of misses ends with its trial.
  longest_miss_run = std::max(longest_miss_run, other.longest_miss_run);
  run_ = 0;
}

const StageTiming* TimingReport::find(const std::string& stage) const {
  const auto found = std::find_if(stages.begin(), stages.end(),
                                  [&](const StageTiming& s) { return s.name == stage; });
  return found == stages.end() ? nullptr : &*found;
}

double TimingReport::utilisation(const std::string& resource) const {
  const auto found = resources.find(resource);
  if (found == resources.end() || span_ns <= 0) return 0.0;
  return static_cast<double>(found->second.busy_ns) /
         (static_cast<double>(span_ns) * found->second.servers);
}

void TimingReport::append(const TimingReport& other) {
  for (const StageTiming& stage : other.stages) {
    const auto mine = std::find_if(stages.begin(), stages.end(),
                                   [&](const StageTiming& s) { return s.name == stage.name; });
    if (mine == stages.end()) {
      stages.push_back(stage);
    } else {
      mine->append(stage);
    }
  }
  if (end_to_end.name.empty()) {
    end_to_end = other.end_to_end;
  } else {
    end_to_end.append(other.end_to_end);
  }
  age.append(other.age);
  for (const auto& [name, resource] : other.resources) {
    resources[name].servers = resource.servers;
    resources[name].busy_ns += resource.busy_ns;
  }
  span_ns += other.span_ns;
  ticks_without_image += other.ticks_without_image;
  ticks_without_news += other.ticks_without_news;
  overruns += other.overruns;
}

}  // namespace segsim::sim
