#include "renderer/simd_target.h"

#include <hwy/highway.h>

namespace segsim::renderer {

std::string simd_target() {
  // Highway numbers better targets lower: the lowest bit that is both compiled and supported.
  const auto usable = hwy::SupportedTargets() & HWY_TARGETS;
  return hwy::TargetName(usable & -usable);
}

}  // namespace segsim::renderer
