#pragma once

namespace segsim::perception {

/// Gives the calling thread its count: that of a ThreadCountScope, else of set_threads().
/// OpenMP keeps it per thread.
void apply_thread_count();

}  // namespace segsim::perception
