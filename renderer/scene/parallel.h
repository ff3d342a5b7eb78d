#pragma once

/// @file
/// The threads of one renderer.

#include <cstddef>
#include <memory>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include "core/task_order.h"

namespace segsim::renderer::internal {

/// Calls body(i) for each i < count, in any order, in the present arena; at least `grain`
/// calls a task. The body must write to places of its own.
template <class Body>
void parallel_for_each(std::size_t count, std::size_t grain, const Body& body) {
  core::TaskOrder order;
  tbb::parallel_for(
      tbb::blocked_range<std::size_t>(0, count, grain),
      [&](const tbb::blocked_range<std::size_t>& range) {
        const core::TaskOrder::Task task(order);
        for (std::size_t i = range.begin(); i != range.end(); ++i) body(i);
      },
      tbb::simple_partitioner());
  order.wait();
}

class Workers {
 public:
  /// @param threads  0 = all processors; 1 = the calling thread only.
  explicit Workers(int threads) {
    constexpr int kAll = tbb::task_arena::automatic;
    if (threads != 1)
      arena_ = std::make_unique<tbb::task_arena>(threads == 0 ? kAll : threads);
  }

  [[nodiscard]] int thread_count() const { return arena_ ? arena_->max_concurrency() : 1; }

  /// Of the calling thread, below thread_count(); in a body of for_each().
  [[nodiscard]] int thread_index() const {
    return arena_ ? tbb::this_task_arena::current_thread_index() : 0;
  }

  /// Calls body(i) for each i < count, in any order. The body must write to places of its own,
  /// so that results do not depend on the number of threads.
  template <class Body>
  void for_each(std::size_t count, const Body& body) {
    if (!arena_) {
      for (std::size_t i = 0; i < count; ++i) body(i);
      return;
    }
    arena_->execute([&] { parallel_for_each(count, 1, body); });
  }

 private:
  std::unique_ptr<tbb::task_arena> arena_;
};

}  // namespace segsim::renderer::internal
