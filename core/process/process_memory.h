#pragma once

namespace segsim::core {

/// Lets freed blocks of up to 32 MB stay with the process (and 128 MB at the heap's end), for
/// programs to call first. Every tick allocates images of the same sizes again, and a fresh
/// page of the system costs more than most of what is done with it. Where the C library has no
/// such setting nothing happens.
void keep_freed_memory();

}  // namespace segsim::core
