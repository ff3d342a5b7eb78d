#!/usr/bin/env bash
# Installs what is missing, builds everything and runs all tests.
#
#   tests/run.sh [--help] [preset, default release] [ctest options]
#   tests/run.sh quick [ctest options]     the tests that take below three minutes on two cores, and nothing for GPUs
#
# SEGSIM_REQUIRE_GPU=1: what needs a GPU fails where there is none, instead of being left out.
set -euo pipefail
if [[ ${1:-} == --help || ${1:-} == -h ]]; then
  sed -n '2,7s/^# \{0,1\}//p' "$0"
  exit 0
fi
source "$(dirname "${BASH_SOURCE[0]}")/../tools/setup.sh"
cd "$root"
preset=release
quick=
if [[ ${1:-} == quick ]]; then
  quick=yes
  shift
elif [[ ${1:-} =~ ^[a-z]+$ ]]; then
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
# Machine code for the GPU that is here; where there is none, for compute capability 9.0.
gpu=90
if command -v nvidia-smi >/dev/null && nvidia-smi -L >/dev/null 2>&1; then gpu=native; fi
nvcc=$(command -v nvcc || echo /usr/local/cuda/bin/nvcc)
if [[ -n $quick && -n ${SEGSIM_REQUIRE_GPU:-} && $SEGSIM_REQUIRE_GPU != 0 ]]; then
  fail "SEGSIM_REQUIRE_GPU demands the GPU renderer's checks; the quick tier has none of them"
elif [[ -n $quick ]]; then
  :
elif [[ $preset == release && -x $nvcc ]]; then
  say "Compiling the GPU renderer ($nvcc)"
  cmake --preset cuda-minimal -DCMAKE_CUDA_COMPILER="$nvcc" \
    "-DCMAKE_CUDA_ARCHITECTURES=$gpu" >/dev/null || fail "cmake could not configure; see above"
  cmake --build --preset cuda-minimal -j "$(build_jobs)" || fail "the build did not succeed; see above"
  build/cuda-minimal/tests/renderer/cuda_minimal/cuda_check || (($? == 2)) \
    || fail "the GPU renderer differs from the reference; see above"
  build/cuda-minimal/tests/renderer/cuda_minimal/training_check || (($? == 2)) \
    || fail "the GPU's gradients differ from the reference; see above"
elif [[ -n ${SEGSIM_REQUIRE_GPU:-} && $SEGSIM_REQUIRE_GPU != 0 ]]; then
  fail "SEGSIM_REQUIRE_GPU demands the GPU renderer's checks; they need a CUDA compiler and the preset release"
else
  say "The GPU renderer is not compiled: no CUDA compiler, or another preset"
fi

say "Running the tests"
options=()
if [[ -n $quick ]]; then
  # One regular expression of all lines.
  options=(--exclude-regex "^($(grep -v '^#' tests/slow_tests.txt | paste -sd'|'))\$")
fi
ctest --preset "$preset" -j "$(nproc)" "${options[@]}" "$@"
