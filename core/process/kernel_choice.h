#pragma once

/// @file
/// Which machine code libraries take for this processor, and so the last bits of every result.
///
/// Reproducible: libraries that pick their code by the processor are held to AVX2 with FMA
/// (x86-64-v3), OpenBLAS to its Haswell kernels, and libtorch to one thread per caller. Our
/// own renderer draws the same bits with every instruction set that has FMA. Processors of
/// different makers then compute equal bits. Fast: whatever each library likes.
///
/// Libraries read their settings from the environment, some of them while they are loaded,
/// before main(): the launcher (experiments/launcher.cpp) sets them and then becomes the
/// program. A process that was started otherwise counts as fast.

#include <span>
#include <string>

namespace segsim::core {

enum class KernelChoice { kReproducible, kFast };

/// "reproducible" or "fast".
[[nodiscard]] const char* to_string(KernelChoice choice);

/// One variable of the environment, and who reads it when.
struct LibrarySetting {
  const char* variable;
  const char* value;
  bool at_load;  ///< Read before main(), so a running program cannot change it.
};

/// What holds the libraries to the same code on every x86-64-v3 processor.
[[nodiscard]] std::span<const LibrarySetting> reproducible_settings();

/// Whether this processor has AVX2, FMA and what else x86-64-v3 asks for.
[[nodiscard]] bool can_be_reproducible();

/// Sets the environment for the choice, for a program that is about to be started.
void set_environment(KernelChoice choice);

/// How this process was started. Reproducible only if each of reproducible_settings() has its
/// value: a shell that overrides one of them makes the process a fast one.
[[nodiscard]] KernelChoice kernel_choice();

}  // namespace segsim::core
