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

install_packages
build "$preset"
say "Running the tests"
ctest --preset "$preset" -j "$(nproc)" "$@"
