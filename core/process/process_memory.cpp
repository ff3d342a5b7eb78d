#include "core/process/process_memory.h"

#include <cstdlib>  // Says which C library this is.

#ifdef __GLIBC__
#include <malloc.h>
#endif

namespace segsim::core {

void keep_freed_memory() {
#ifdef __GLIBC__
  mallopt(M_MMAP_THRESHOLD, 32 << 20);
  mallopt(M_TRIM_THRESHOLD, 128 << 20);
#endif
}

}  // namespace segsim::core
