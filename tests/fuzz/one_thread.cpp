// Where the library of detectors is not linked as a whole: libtorch keeps to the thread that
// OMP_NUM_THREADS gives it.
#include "perception/internal/network/thread_count.h"

namespace segsim::perception {

void apply_thread_count() {}

}  // namespace segsim::perception
