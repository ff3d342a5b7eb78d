#include "renderer/scene/simd_target.h"

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

std::string simd_target() { return HWY_DYNAMIC_DISPATCH(name_of_target)(); }

}  // namespace segsim::renderer
#endif  // HWY_ONCE
