#pragma once

#include <string>

namespace segsim::renderer {

/// Name of the instruction set that the CPU renderer uses in this process, in Highway's words:
/// "AVX3" (AVX-512), "AVX2", "SSE4", "NEON", "EMU128" (scalar), ...
[[nodiscard]] std::string simd_target();

/// Holds the renderer and the training of surfels to AVX2 if core::kernel_choice() is
/// reproducible. For programs to call before anything is drawn.
void apply_kernel_choice();

}  // namespace segsim::renderer
