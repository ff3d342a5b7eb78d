#pragma once

#include <cstddef>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

namespace segsim::renderer::internal {

template <class Body>
void run_ranges(std::size_t count, std::size_t grain, const Body& body) {
  tbb::parallel_for(
      tbb::blocked_range<std::size_t>(0, count, grain),
      [&](const tbb::blocked_range<std::size_t>& range) { body(range.begin(), range.end()); },
      tbb::simple_partitioner());
}

class TbbThreadArena {
 public:
  explicit TbbThreadArena(int threads)
      : arena_(threads == 0 ? static_cast<int>(tbb::task_arena::automatic) : threads) {}
  [[nodiscard]] int size() const { return arena_.max_concurrency(); }
  [[nodiscard]] static int thread_index() {
    return tbb::this_task_arena::current_thread_index();
  }
  template <class Body>
  void execute(const Body& body) {
    arena_.execute(body);
  }

 private:
  tbb::task_arena arena_;
};

}  // namespace segsim::renderer::internal
