#include "core/process/kernel_choice.h"

#include <cstdlib>
#include <cstring>

namespace segsim::core {
namespace {

constexpr const char* kVariable = "SEGSIM_KERNELS";

/// What OpenCV calls AVX512-SKX. To disable it where it is not there makes OpenCV complain.
bool has_avx512_skx() {
#ifdef __x86_64__
  return __builtin_cpu_supports("avx512f") != 0 && __builtin_cpu_supports("avx512cd") != 0 &&
         __builtin_cpu_supports("avx512bw") != 0 && __builtin_cpu_supports("avx512dq") != 0 &&
         __builtin_cpu_supports("avx512vl") != 0;
#else
  return false;
#endif
}

const LibrarySetting kReproducible[] = {
    {"ATEN_CPU_CAPABILITY", "avx2", false},  // libtorch's own kernels.
    {"ONEDNN_MAX_CPU_ISA", "AVX2", false},
    {"DNNL_MAX_CPU_ISA", "AVX2", false},  // The same for oneDNN inside older libtorch.
    // Sums are split among libtorch's threads, so their number is part of the result.
    {"OMP_NUM_THREADS", "1", true},
    {"MKL_NUM_THREADS", "1", true},  // libtorch prefers it, also when it is built without MKL.
    {"OPENBLAS_CORETYPE", "Haswell", true},
    {"OPENBLAS_NUM_THREADS", "1", true},
    {"OPENCV_CPU_DISABLE", has_avx512_skx() ? "AVX512-SKX" : "", true},
    {"MKL_CBWR", "AVX2", false},  // A libtorch from elsewhere may come with MKL.
};

}  // namespace

const char* to_string(KernelChoice choice) {
  return choice == KernelChoice::kReproducible ? "reproducible" : "fast";
}

std::span<const LibrarySetting> reproducible_settings() { return kReproducible; }

bool can_be_reproducible() {
#ifdef __x86_64__
  return __builtin_cpu_supports("avx2") != 0 && __builtin_cpu_supports("fma") != 0 &&
         __builtin_cpu_supports("bmi2") != 0;
#else
  return false;
#endif
}

void set_environment(KernelChoice choice) {
  setenv(kVariable, to_string(choice), 1);
  // Where cores are shared, a displaced OpenMP thread must not keep the others spinning.
  setenv("GOMP_SPINCOUNT", "1000", 0);
  // With workspaces of their own, cuBLAS's streams do not change each other's sums.
  setenv("CUBLAS_WORKSPACE_CONFIG", ":4096:8", 0);
  if (choice == KernelChoice::kFast) return;
  for (const LibrarySetting& setting : kReproducible) {
    setenv(setting.variable, setting.value, 1);
  }
}

KernelChoice kernel_choice() {
  const auto is = [](const char* variable, const char* value) {
    const char* found = std::getenv(variable);
    return found != nullptr && std::strcmp(found, value) == 0;
  };
  if (!is(kVariable, to_string(KernelChoice::kReproducible))) return KernelChoice::kFast;
  for (const LibrarySetting& setting : kReproducible) {
    if (!is(setting.variable, setting.value)) return KernelChoice::kFast;
  }
  return KernelChoice::kReproducible;
}

}  // namespace segsim::core
