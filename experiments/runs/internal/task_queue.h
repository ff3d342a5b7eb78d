#pragma once

/// @file
/// Which trials a worker runs next.

#include <cstddef>
#include <mutex>
#include <span>

#include "experiments/trials/trial_runner.h"

namespace segsim::experiments::runs::internal {

/// Of one unit: an episode in one repetition, with all arms that run in its scene.
[[nodiscard]] inline bool same_unit(const trials::TrialTask& a, const trials::TrialTask& b) {
  return a.episode == b.episode && a.repetition == b.repetition;
}

/// Hands tasks to workers: whole units, whose trials share their views, as long as there are
/// enough for all; the last ones trial by trial, so that no worker is left alone with many.
class TaskQueue {
 public:
  /// @param tasks  Those of a unit one after another; must outlive this object.
  TaskQueue(std::span<const trials::TrialTask> tasks, int workers)
      : tasks_(tasks), workers_(static_cast<std::size_t>(workers)) {
    for (std::size_t k = 0; k < tasks.size(); ++k) {
      if (k == 0 || !same_unit(tasks[k - 1], tasks[k])) ++units_left_;
    }
  }

  /// Empty if there are no more. By any thread.
  [[nodiscard]] std::span<const trials::TrialTask> next() {
    const std::lock_guard<std::mutex> lock(mutex_);
    const std::size_t begin = next_;
    if (begin == tasks_.size()) return {};
    const bool whole = units_left_ > workers_;
    do {
      ++next_;
    } while (whole && next_ < tasks_.size() && same_unit(tasks_[begin], tasks_[next_]));
    const bool unit_done = next_ == tasks_.size() || !same_unit(tasks_[begin], tasks_[next_]);
    if (unit_done) --units_left_;
    return tasks_.subspan(begin, next_ - begin);
  }

 private:
  std::mutex mutex_;
  std::span<const trials::TrialTask> tasks_;
  std::size_t workers_, units_left_ = 0, next_ = 0;
};

}  // namespace segsim::experiments::runs::internal
