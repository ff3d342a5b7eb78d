#pragma once

/// @file
/// Independent pieces of work on several threads of this process.

#include <cstddef>
#include <functional>

namespace segsim::experiments::support {

/// Processors of this machine, at least 1.
[[nodiscard]] int processor_count();

/// work(0) ... work(count - 1), each once, at most `at_once` of them at a time, each on a
/// thread that is not used for another meanwhile. While several are at work, loops of oneTBB
/// below them have the processors that are left; one after another, nothing is limited.
///
/// An exception lets those under way end, begins no other, and is then thrown here: that of
/// the smallest index.
void side_by_side(std::size_t count, int at_once,
                  const std::function<void(std::size_t index)>& work);

}  // namespace segsim::experiments::support
