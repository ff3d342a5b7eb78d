#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <exception>
#include <mutex>
#include <thread>
#include <vector>

namespace segsim::renderer::internal {

/// What a thread knows about the loop that it works in.
struct LoopThread {
  int index = 0;         ///< Below the size of the arena.
  int arena_size = 0;    ///< 0: outside of all arenas.
  bool in_loop = false;  ///< A loop inside a loop stays on its thread.
};
inline thread_local LoopThread this_loop_thread;

inline int processors() {
  return static_cast<int>(std::max(1U, std::thread::hardware_concurrency()));
}

/// Threads are made for each loop: for loops that are long, on machines without oneTBB.
template <class Body>
void run_ranges(std::size_t count, std::size_t grain, const Body& body) {
  const std::size_t ranges = (count + grain - 1) / grain;
  const LoopThread caller = this_loop_thread;
  const int allowed = caller.arena_size > 0 ? caller.arena_size : processors();
  const int threads =
      caller.in_loop ? 1 : static_cast<int>(std::min<std::size_t>(ranges, allowed));
  std::atomic<std::size_t> next{0};
  std::exception_ptr error;
  std::mutex error_mutex;
  const auto work = [&](int index) {
    this_loop_thread = {caller.in_loop ? caller.index : index, allowed, true};
    try {
      for (std::size_t k = next++; k < ranges; k = next++) {
        body(k * grain, std::min(count, (k + 1) * grain));
      }
    } catch (...) {
      const std::lock_guard<std::mutex> lock(error_mutex);
      if (!error) error = std::current_exception();
      next = ranges;
    }
  };
  std::vector<std::thread> helpers;
  for (int index = 1; index < threads; ++index) helpers.emplace_back(work, index);
  work(0);
  for (std::thread& helper : helpers) helper.join();
  this_loop_thread = caller;
  if (error) std::rethrow_exception(error);
}

class StdThreadArena {
 public:
  explicit StdThreadArena(int threads) : size_(threads == 0 ? processors() : threads) {}
  [[nodiscard]] int size() const { return size_; }
  [[nodiscard]] static int thread_index() { return this_loop_thread.index; }
  template <class Body>
  void execute(const Body& body) {
    const LoopThread caller = this_loop_thread;
    if (!caller.in_loop) this_loop_thread = {0, size_, false};
    try {
      body();
    } catch (...) {
      this_loop_thread = caller;
      throw;
    }
    this_loop_thread = caller;
  }

 private:
  int size_;
};

}  // namespace segsim::renderer::internal
