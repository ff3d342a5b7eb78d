#pragma once

/// @file
/// The few names of oneTBB that folding a panoptic model uses, on plain threads, so that the
/// minimal build needs no oneTBB.

#include <algorithm>
#include <cstddef>
#include <thread>
#include <vector>

namespace tbb {

template <class Index>
class blocked_range {
 public:
  blocked_range(Index begin, Index end, Index = 1) : begin_(begin), end_(end) {}
  [[nodiscard]] Index begin() const { return begin_; }
  [[nodiscard]] Index end() const { return end_; }

 private:
  Index begin_, end_;
};

struct simple_partitioner {};

template <class Index, class Body>
void parallel_for(const blocked_range<Index>& range, const Body& body, simple_partitioner) {
  const Index count = range.end() - range.begin();
  const Index parts =
      std::min<Index>(count, std::max(1U, std::thread::hardware_concurrency()));
  std::vector<std::thread> threads;
  for (Index part = 0; part < parts; ++part) {
    threads.emplace_back([&, part] {
      body(blocked_range<Index>(range.begin() + count * part / parts,
                                range.begin() + count * (part + 1) / parts));
    });
  }
  for (std::thread& thread : threads) thread.join();
}

namespace this_task_arena {
inline int current_thread_index() { return 0; }
}  // namespace this_task_arena

class task_arena {
 public:
  static constexpr int automatic = -1;
  explicit task_arena(int) {}
  [[nodiscard]] int max_concurrency() const {
    return static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
  }
  template <class Body>
  void execute(const Body& body) {
    body();
  }
};

}  // namespace tbb
