#!/usr/bin/env bash
# Installs what is missing, builds everything and runs all tests.
#
#   tests/run.sh [--help] [preset, default release] [ctest options]
set -euo pipefail
if [[ ${1:-} == --help || ${1:-} == -h ]]; then
  sed -n '2,5s/^# \{0,1\}//p' "$0"
  exit 0
fi
source "$(dirname "${BASH_SOURCE[0]}")/../tools/setup.sh"
cd "$root"
preset=release
if [[ ${1:-} =~ ^[a-z]+$ ]]; then
  preset=$1
  shift
fi

# Tests on real recordings run where the data lies beside the checkout; others do without.
if [[ -z ${SEGSIM_DATA:-} && -d $root/../shared/data ]]; then
  SEGSIM_DATA=$(cd "$root/../shared/data" && pwd)
  export SEGSIM_DATA
fi

install_packages debian_packages.txt debian_test_packages.txt
build "$preset"

# The GPU renderer compiles wherever there is a CUDA compiler; it is run where there is a GPU.
# Machine code for compute capability 8.0 and 9.0, PTX for later ones.
nvcc=$(command -v nvcc || echo /usr/local/cuda/bin/nvcc)
if [[ $preset == release && -x $nvcc ]]; then
  say "Compiling the GPU renderer ($nvcc)"
  cmake --preset cuda-minimal -DCMAKE_CUDA_COMPILER="$nvcc" \
    "-DCMAKE_CUDA_ARCHITECTURES=80-real;90" >/dev/null || fail "cmake could not configure; see above"
  cmake --build --preset cuda-minimal -j "$(build_jobs)" || fail "the build did not succeed; see above"
  build/cuda-minimal/tests/renderer/cuda_minimal/cuda_check || (($? == 2)) \
    || fail "the GPU renderer differs from the reference; see above"
  build/cuda-minimal/tests/renderer/cuda_minimal/training_check || (($? == 2)) \
    || fail "the GPU's gradients differ from the reference; see above"
else
  say "The GPU renderer is not compiled: no CUDA compiler, or another preset"
fi

say "Running the tests"
ctest --preset "$preset" -j "$(nproc)" "$@"
