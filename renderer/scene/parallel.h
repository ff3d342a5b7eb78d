#pragma once

/// @file
/// The threads of one renderer: oneTBB's or, where a build has no oneTBB (SEGSIM_STD_THREADS),
/// the standard library's.
///
/// Either brings run_ranges(count, grain, body), which calls body(begin, end) for ranges that
/// cover [0, count), and a ThreadArena of so many threads (0 = all processors), which what its
/// execute() runs has for itself.

#include <cstddef>
#include <memory>

#include "core/task_order.h"
#ifdef SEGSIM_STD_THREADS
#include "renderer/scene/internal/std_threads.h"
#else
#include "renderer/scene/internal/tbb_threads.h"
#endif

namespace segsim::renderer::internal {

#ifdef SEGSIM_STD_THREADS
using ThreadArena = StdThreadArena;
#else
using ThreadArena = TbbThreadArena;
#endif

/// Calls body(i) for each i < count, in any order, in the present arena; at least `grain`
/// calls a task. The body must write to places of its own.
template <class Body>
void parallel_for_each(std::size_t count, std::size_t grain, const Body& body) {
  core::TaskOrder order;
  run_ranges(count, grain, [&](std::size_t begin, std::size_t end) {
    const core::TaskOrder::Task task(order);
    for (std::size_t i = begin; i != end; ++i) body(i);
  });
  order.wait();
}

class Workers {
 public:
  /// @param threads  0 = all processors; 1 = the calling thread only.
  explicit Workers(int threads) {
    if (threads != 1) arena_ = std::make_unique<ThreadArena>(threads);
  }

  [[nodiscard]] int thread_count() const { return arena_ ? arena_->size() : 1; }

  /// Of the calling thread, below thread_count(); in a body of for_each().
  [[nodiscard]] int thread_index() const { return arena_ ? ThreadArena::thread_index() : 0; }

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
  std::unique_ptr<ThreadArena> arena_;
};

}  // namespace segsim::renderer::internal
