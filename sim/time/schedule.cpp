#include "sim/time/schedule.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "core/check.h"

namespace segsim::sim {
namespace {

constexpr std::size_t kNone = std::numeric_limits<std::size_t>::max();

}  // namespace

Schedule::Schedule(LatencyBudget budget, Work work)
    : budget_(std::move(budget)), work_(std::move(work)) {
  SEGSIM_CHECK(budget_.problem().empty(), budget_.problem());
  std::vector<StageBudget>& stages = budget_.stages;
  std::erase_if(stages, [](const StageBudget& s) { return s.charge == Charge::kSim; });
  capture_ = stage_index(StageRole::kCapture);
  policy_ = stage_index(StageRole::kPolicy);
  actuate_ = stage_index(StageRole::kActuate);
  next_.resize(stages.size());
  predecessors_.resize(stages.size(), 0);
  waiting_.resize(stages.size());
  for (std::size_t k = 0; k < stages.size(); ++k) {
    timings_.emplace_back();
    timings_[k].name = stages[k].name;
    timings_[k].deadline_ns = stages[k].deadline_ns;
    if (k == capture_ || k == policy_ || k == actuate_) continue;
    ++image_stages_;
    for (const std::string& before : stages[k].after) {
      if (stage_role(before) == StageRole::kCapture) continue;
      next_[stage_index(before)].push_back(k);
      ++predecessors_[k];
    }
    if (predecessors_[k] == 0) first_.push_back(k);
  }
  for (const auto& [name, count] : budget_.resources) {
    servers_[name].count = count;
    usage_[name].servers = count;
  }
}

std::size_t Schedule::stage_index(const std::string& name) const {
  for (std::size_t k = 0; k < budget_.stages.size(); ++k) {
    if (budget_.stages[k].name == name) return k;
  }
  return kNone;
}

void Schedule::push(core::TimeNs time_ns, Event::Kind kind, const Job& job) {
  events_.push({time_ns, events_made_++, kind, job});
}

void Schedule::capture(core::TimeNs time_ns, std::uint64_t index) {
  SEGSIM_CHECK(time_ns >= now_ns_ && !images_.contains(index), std::to_string(index));
  images_[index] = {time_ns, predecessors_, image_stages_};
  const Job job{time_ns, Line::kImage, capture_, index, time_ns};
  if (capture_ == kNone) {
    push(time_ns, Event::Kind::kEnd, job);
  } else {
    start(job, time_ns);
  }
}

void Schedule::decide(core::TimeNs time_ns, std::uint64_t tick) {
  SEGSIM_CHECK(time_ns >= now_ns_ && !deciding_, std::to_string(tick));
  deciding_ = true;
  push(time_ns, policy_ == kNone ? Event::Kind::kEnd : Event::Kind::kRelease,
       {time_ns, Line::kTick, policy_, tick, time_ns});
}

void Schedule::advance_to(core::TimeNs time_ns) {
  while (!events_.empty() && events_.top().time_ns <= time_ns) {
    now_ns_ = events_.top().time_ns;
    while (!events_.empty() && events_.top().time_ns == now_ns_) {
      const Event event = events_.top();
      events_.pop();
      if (event.kind == Event::Kind::kRelease) {
        release(event.job, now_ns_);
      } else {
        end(event.job, now_ns_);
      }
    }
    dispatch(now_ns_);
  }
  now_ns_ = std::max(now_ns_, time_ns);
}

void Schedule::release(const Job& job, core::TimeNs now_ns) {
  if (budget_.stages[job.stage].on.empty()) {
    start(job, now_ns);
  } else {
    enqueue(job);
  }
}

void Schedule::enqueue(const Job& job) {
  std::vector<Job>& queue = waiting_[job.stage];
  const StageBudget& stage = budget_.stages[job.stage];
  queue.push_back(job);
  if (static_cast<int>(queue.size()) <= stage.queue_depth) return;
  const Job loser = stage.queue == QueueRule::kNewest ? queue.front() : queue.back();
  // A tick waits alone: decide() is not called again before its policy is done.
  SEGSIM_CHECK(loser.line == Line::kImage, stage.name);
  ++timings_[job.stage].drops;
  give_up(loser);
}

void Schedule::give_up(const Job& job) {
  images_.erase(job.index);
  dropped_.push_back(job.index);
  for (std::vector<Job>& queue : waiting_) {
    std::erase_if(queue, [&](const Job& other) {
      return other.line == Line::kImage && other.index == job.index;
    });
  }
}

void Schedule::start(const Job& job, core::TimeNs now_ns) {
  const StageBudget& stage = budget_.stages[job.stage];
  job_begins_ns_ = now_ns;
  const core::TimeNs duration_ns = work_(stage, job.index);
  SEGSIM_CHECK(duration_ns >= 0, stage.name);
  if (!stage.on.empty()) usage_[stage.on].busy_ns += duration_ns;
  push(now_ns + duration_ns, Event::Kind::kEnd, job);
}

void Schedule::dispatch(core::TimeNs now_ns) {
  for (auto& [name, server] : servers_) {
    while (server.busy < server.count) {
      const Job* best = nullptr;
      for (std::size_t k = 0; k < waiting_.size(); ++k) {
        if (budget_.stages[k].on != name) continue;
        for (const Job& job : waiting_[k]) {
          if (best == nullptr || job < *best) best = &job;
        }
      }
      if (best == nullptr) break;
      const Job job = *best;
      std::erase(waiting_[job.stage], job);
      ++server.busy;
      start(job, now_ns);
    }
  }
}

void Schedule::end(const Job& job, core::TimeNs now_ns) {
  if (job.stage != kNone) {
    const std::string& resource = budget_.stages[job.stage].on;
    if (!resource.empty()) --servers_[resource].busy;
    timings_[job.stage].add(now_ns - job.release_ns);
  }
  if (job.line == Line::kTick) {
    end_of_tick_stage(job, now_ns);
  } else if (images_.contains(job.index)) {  // Not given up meanwhile.
    end_of_image_stage(job, now_ns);
  }
}

void Schedule::end_of_image_stage(const Job& job, core::TimeNs now_ns) {
  Image& image = images_[job.index];
  const auto release_next = [&](std::size_t stage) {
    release({image.capture_ns, Line::kImage, stage, job.index, now_ns}, now_ns);
  };
  if (job.stage == capture_) {
    if (image.stages_left == 0) return image_ready(job.index, now_ns);
    // A full queue may give this very image up while the others are released.
    for (const std::size_t stage : first_) {
      if (!images_.contains(job.index)) return;
      release_next(stage);
    }
    return;
  }
  if (--image.stages_left == 0) return image_ready(job.index, now_ns);
  for (const std::size_t stage : next_[job.stage]) {
    if (!images_.contains(job.index)) return;
    if (--image.waits_for[stage] == 0) release_next(stage);
  }
}

void Schedule::image_ready(std::uint64_t index, core::TimeNs now_ns) {
  results_.push_back({index, images_[index].capture_ns, now_ns});
  images_.erase(index);
}

void Schedule::end_of_tick_stage(const Job& job, core::TimeNs now_ns) {
  if (job.stage == policy_) {
    deciding_ = false;
    if (actuate_ != kNone) {
      release({job.origin_ns, Line::kTick, actuate_, job.index, now_ns}, now_ns);
      return;
    }
  }
  effects_.push_back({job.index, now_ns});
}

void Schedule::report(TimingReport& report) const {
  report.stages = timings_;
  report.resources = usage_;
  report.span_ns = now_ns_;
}

}  // namespace segsim::sim
