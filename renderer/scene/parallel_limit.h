#pragma once

/// @file
/// How many threads the loops of this process may use, over all that run side by side.

#include <memory>

namespace segsim::renderer {

/// While it lives, oneTBB (renderer, simulator, reconstruction) has at most `threads` - 1
/// threads of its own beside those that call it. Of several limits the lowest holds. Results
/// do not depend on it.
class ParallelLimit {
 public:
  explicit ParallelLimit(int threads);
  ~ParallelLimit();
  ParallelLimit(const ParallelLimit&) = delete;
  ParallelLimit& operator=(const ParallelLimit&) = delete;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace segsim::renderer
