#pragma once

#include <string>

namespace segsim::renderer {

/// Name of the instruction set that the CPU renderer uses on this machine, in Highway's words:
/// "AVX3" (AVX-512), "AVX2", "SSE4", "NEON", "EMU128" (scalar), ...
/// All those with fused multiply-add draw the same bits.
[[nodiscard]] std::string simd_target();

}  // namespace segsim::renderer
