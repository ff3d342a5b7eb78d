#include "experiments/support/task_graph.h"

#include <algorithm>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <optional>
#include <set>
#include <thread>
#include <utility>

#include "core/check.h"
#include "experiments/support/side_by_side.h"
#include "experiments/support/stop_signal.h"
#include "renderer/scene/parallel_limit.h"

namespace segsim::experiments::support {

/// Which task is next, and what the loops below those at work may use.
class TaskGraph::Workers {
 public:
  explicit Workers(std::vector<Task>& tasks) : tasks_(tasks) {
    for (Id id = 0; id < tasks.size(); ++id) {
      if (tasks[id].missing == 0) ready_.insert(id);
    }
  }

  /// One thread: from task to task, until no more can begin.
  void work() {
    std::unique_lock<std::mutex> lock(mutex_);
    while (const std::optional<Id> id = next(lock)) {
      share(+1);
      lock.unlock();
      std::exception_ptr failure;
      try {
        tasks_[*id].work();
      } catch (...) {
        failure = std::current_exception();
      }
      lock.lock();
      share(-1);
      end(*id, failure);
    }
  }

  void rethrow() const {
    if (failure_) std::rethrow_exception(failure_);
    if (!ready_.empty()) StopOnSignal::check();
  }

 private:
  /// Waits while another thread may yet make a task ready.
  std::optional<Id> next(std::unique_lock<std::mutex>& lock) {
    change_.wait(lock, [&] { return failure_ || !ready_.empty() || at_work_ == 0; });
    if (failure_ || ready_.empty()) return std::nullopt;
    if (StopOnSignal::requested()) return std::nullopt;
    return ready_.extract(ready_.begin()).value();
  }

  void end(Id id, const std::exception_ptr& failure) {
    if (failure && (!failure_ || id < failed_)) {
      failure_ = failure;
      failed_ = id;
    }
    for (const Id other : tasks_[id].needed_by) {
      if (--tasks_[other].missing == 0) ready_.insert(other);
    }
    change_.notify_all();
  }

  void share(int more) {
    at_work_ += more;
    limit_.reset();  // Of two the lower one would hold.
    if (at_work_ > 1) limit_.emplace(std::max(1, processor_count() - at_work_ + 1));
  }

  std::vector<Task>& tasks_;
  std::mutex mutex_;
  std::condition_variable change_;
  std::set<Id> ready_;
  int at_work_ = 0;
  std::optional<renderer::ParallelLimit> limit_;
  std::exception_ptr failure_;
  Id failed_ = 0;
};

TaskGraph::Id TaskGraph::add(std::function<void()> work, const std::vector<Id>& needs) {
  const Id id = tasks_.size();
  tasks_.push_back({std::move(work), {}, needs.size()});
  for (const Id need : needs) {
    SEGSIM_CHECK(need < id, "a task that was not added before");
    tasks_[need].needed_by.push_back(id);
  }
  return id;
}

void TaskGraph::run(int at_once) {
  const int threads = std::min(at_once, static_cast<int>(tasks_.size()));
  Workers workers(tasks_);
  std::vector<std::thread> others;
  for (int k = 1; k < threads; ++k) others.emplace_back([&] { workers.work(); });
  workers.work();
  for (std::thread& thread : others) thread.join();
  workers.rethrow();
  tasks_.clear();
}

}  // namespace segsim::experiments::support
