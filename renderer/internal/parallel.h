#pragma once

/// @file
/// The threads of one renderer.

#include <cstddef>
#include <memory>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

namespace segsim::renderer::internal {

class Workers {
 public:
  /// @param threads  0 = all processors; 1 = the calling thread only.
  explicit Workers(int threads) {
    constexpr int kAll = tbb::task_arena::automatic;
    if (threads != 1)
      arena_ = std::make_unique<tbb::task_arena>(threads == 0 ? kAll : threads);
  }

  /// Calls body(i) for each i < count, in any order. The body must write to places of its own,
  /// so that results do not depend on the number of threads.
  template <class Body>
  void for_each(std::size_t count, const Body& body) {
    if (!arena_ || count < 2) {
      for (std::size_t i = 0; i < count; ++i) body(i);
      return;
    }
    arena_->execute([&] {
      tbb::parallel_for(
          tbb::blocked_range<std::size_t>(0, count, 1),
          [&](const tbb::blocked_range<std::size_t>& range) {
            for (std::size_t i = range.begin(); i != range.end(); ++i) body(i);
          },
          tbb::simple_partitioner());
    });
  }

 private:
  std::unique_ptr<tbb::task_arena> arena_;
};

}  // namespace segsim::renderer::internal
