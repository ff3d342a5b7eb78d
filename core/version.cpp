#include "core/version.h"

#include "core_version.h"

namespace segsim::core {

const char* version() { return SEGSIM_VERSION; }

}  // namespace segsim::core
