#include "renderer/scene/simd_target.h"

#include <cstdint>

#include "core/kernel_choice.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "renderer/scene/simd_target.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace segsim::renderer {
namespace HWY_NAMESPACE {

const char* name_of_target() { return hwy::TargetName(HWY_TARGET); }

}  // namespace HWY_NAMESPACE
}  // namespace segsim::renderer
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace segsim::renderer {
namespace {
HWY_EXPORT(name_of_target);
}  // namespace

// hwy::SupportedTargets() would tell, too, but on the way it chooses anew for all functions,
// without regard to what is disabled.
std::string simd_target() { return HWY_DYNAMIC_DISPATCH(name_of_target)(); }

void apply_kernel_choice() {
  if (core::kernel_choice() != core::KernelChoice::kReproducible) return;
  hwy::DisableTargets(~static_cast<std::int64_t>(HWY_AVX2));
  // For a moment of its first call Highway's choice has no regard to what is disabled. So that
  // call is made here, before there are other threads.
  (void)simd_target();
}

}  // namespace segsim::renderer
#endif  // HWY_ONCE
