#pragma once

/// @file
/// Independent pieces of work on several threads of this process.

#include <cstddef>
#include <functional>

namespace segsim::experiments::support {

/// Processors of this machine, at least 1.
[[nodiscard]] int processor_count();

/// work(0) ... work(count - 1): a TaskGraph (task_graph.h) of pieces that need nothing of each
/// other, with its rules for threads, loops of oneTBB, and exceptions.
void side_by_side(std::size_t count, int at_once,
                  const std::function<void(std::size_t index)>& work);

}  // namespace segsim::experiments::support
