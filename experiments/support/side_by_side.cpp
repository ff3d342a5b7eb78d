#include "experiments/support/side_by_side.h"

#include <algorithm>
#include <exception>
#include <limits>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "renderer/scene/parallel_limit.h"

namespace segsim::experiments::support {
namespace {

/// Which piece is next, and what the loops below those at work may use.
class Pieces {
 public:
  Pieces(std::size_t count, int threads) : count_(count), at_work_(threads) { share(); }

  std::optional<std::size_t> next() {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (next_ < count_ && !failure_) return next_++;
    --at_work_;
    share();
    return std::nullopt;
  }

  void failed(std::size_t index, std::exception_ptr failure) {
    const std::lock_guard<std::mutex> lock(mutex_);
    if (failure_ && index > failed_index_) return;
    failure_ = std::move(failure);
    failed_index_ = index;
  }

  void rethrow() const {
    if (failure_) std::rethrow_exception(failure_);
  }

 private:
  void share() {
    limit_.reset();  // Of two the lower one would hold.
    if (at_work_ > 1) limit_.emplace(std::max(1, processor_count() - at_work_ + 1));
  }

  std::mutex mutex_;
  std::size_t count_, next_ = 0;
  int at_work_;
  std::optional<renderer::ParallelLimit> limit_;
  std::exception_ptr failure_;
  std::size_t failed_index_ = std::numeric_limits<std::size_t>::max();
};

}  // namespace

int processor_count() {
  return std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
}

void side_by_side(std::size_t count, int at_once,
                  const std::function<void(std::size_t index)>& work) {
  const int threads = std::min(at_once, static_cast<int>(count));
  if (threads <= 1) {
    for (std::size_t index = 0; index < count; ++index) work(index);
    return;
  }
  Pieces pieces(count, threads);
  const auto run = [&] {
    while (const std::optional<std::size_t> index = pieces.next()) {
      try {
        work(*index);
      } catch (...) {
        pieces.failed(*index, std::current_exception());
      }
    }
  };
  std::vector<std::thread> others;
  for (int k = 1; k < threads; ++k) others.emplace_back(run);
  run();
  for (std::thread& thread : others) thread.join();
  pieces.rethrow();
}

}  // namespace segsim::experiments::support
