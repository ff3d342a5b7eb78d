#pragma once

/// @file
/// What a result's last bits may depend on besides the program: processor, libraries, and
/// which machine code these have chosen.

#include <map>
#include <string>

#include "core/process/kernel_choice.h"

namespace segsim::experiments::reproducibility {

struct MachineRecord {
  core::KernelChoice kernels = core::KernelChoice::kFast;
  std::string processor;  ///< "AMD EPYC ...".
  /// Instruction sets of the processor that libraries choose by: "avx2" -> "yes" or "no".
  std::map<std::string, std::string> features;
  /// "libtorch" -> "1.13.1", "C library" -> "glibc 2.36", "SIMD" -> "AVX2", ...
  std::map<std::string, std::string> libraries;
  /// SHA-256 of what each library makes of fixed inputs: equal on two machines if that library
  /// computes the same bits there. "matrix product (BLAS)" -> "0f3a...".
  std::map<std::string, std::string> fingerprints;
};

/// Of this machine and process. Takes about a second: it computes the fingerprints.
[[nodiscard]] MachineRecord describe_machine();

/// The processor as records of digests name it: virtual machines call many generations by one
/// name, and libraries choose by the widest vectors. "AMD EPYC (AVX-512)"
[[nodiscard]] std::string processor_in_words(const MachineRecord& machine);

}  // namespace segsim::experiments::reproducibility
