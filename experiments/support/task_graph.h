#pragma once

/// @file
/// Pieces of work of which some need what others make, on several threads of this process.

#include <cstddef>
#include <functional>
#include <vector>

namespace segsim::experiments::support {

/// A task begins when those that it needs have ended.
class TaskGraph {
 public:
  using Id = std::size_t;

  /// @param needs  Ids of tasks that were added before.
  Id add(std::function<void()> work, const std::vector<Id>& needs = {});

  /// Runs every task once, at most `at_once` of them at a time, each on a thread that is not
  /// used for another meanwhile; of those that can begin, the one that was added first. While
  /// several are at work, loops of oneTBB below them have the processors that are left; one
  /// after another, nothing is limited.
  ///
  /// An exception lets those under way end, begins no other, and is then thrown here: that of
  /// the task that was added first. A signal to stop (stop_signal.h) likewise, as
  /// core::Interrupted, unless all tasks have ended.
  void run(int at_once);

 private:
  struct Task {
    std::function<void()> work;
    std::vector<Id> needed_by;
    std::size_t missing = 0;  ///< Tasks that it needs and that have not ended.
  };
  class Workers;

  std::vector<Task> tasks_;
};

}  // namespace segsim::experiments::support
