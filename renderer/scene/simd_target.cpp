#include "renderer/scene/simd_target.h"

#include <cstdint>

#include <hwy/highway.h>

#include "core/kernel_choice.h"

namespace segsim::renderer {

std::string simd_target() {
  // Highway numbers better targets lower: the lowest bit that is both compiled and supported.
  const auto usable = hwy::SupportedTargets() & HWY_TARGETS;
  return hwy::TargetName(usable & -usable);
}

void apply_kernel_choice() {
  if (core::kernel_choice() != core::KernelChoice::kReproducible) return;
  hwy::DisableTargets(~static_cast<std::int64_t>(HWY_AVX2));
}

}  // namespace segsim::renderer
