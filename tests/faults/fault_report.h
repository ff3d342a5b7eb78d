#pragma once

/// @file
/// What the preloaded library of faults and who runs a program under it tell each other. The
/// library reads these variables of the environment:
///
///     SEGSIM_FAULT_CALLS    kinds of calls that are counted, with commas:
///                           write, sync, rename, open (for writing), map (of files),
///                           memory (large blocks)
///     SEGSIM_FAULT_AT       the number of the call that fails, from 1; 0: none does
///     SEGSIM_FAULT_LASTING  set: so do all that follow
///     SEGSIM_FAULT_ERROR    ENOSPC, EIO or ENOMEM
///     SEGSIM_FAULT_FOLDER   calls on files elsewhere are not counted
///     SEGSIM_FAULT_PROGRAM  only in a process of this name
///     SEGSIM_FAULT_REPORT   a file of a FaultReport, which all processes share

#include <atomic>
#include <cstdint>

namespace segsim::tests {

/// Memory larger than this is counted, in bytes.
constexpr std::uint64_t kLargeBlock = std::uint64_t{1} << 18;

struct FaultReport {
  std::atomic<std::uint64_t> calls;     ///< Counted ones.
  std::atomic<std::uint64_t> failures;  ///< Of them.
  char what[240];                       ///< The first that failed: "write results.sqlite-wal".
};
static_assert(std::atomic<std::uint64_t>::is_always_lock_free);

}  // namespace segsim::tests
