#!/bin/sh
# Fuzzes every parser, or those that are named, for so many minutes in all:
#
#     tests/fuzz/run.sh MINUTES [TARGET...]
#
# Builds the preset `fuzz` (Clang with its fuzzer runtime: Debian's libclang-rt-14-dev), and goes on with the
# inputs that earlier runs have found, in build/fuzz/fuzz. JOBS targets run at a time (2). What is found is kept
# there in findings/; exit code 1 if anything is. The table is written as build/fuzz/fuzz/record.json, too.
# With EXECUTIONS=N each target is run until it has N of them, the quick ones first.
set -eu
cd "$(dirname "$0")/../.."
if [ $# -lt 1 ]; then
  sed -n 's/^# \{0,1\}//p' "$0" | sed -n '2,11p'
  exit 2
fi
minutes=$1
shift
if [ ! -f build/fuzz/build.ninja ]; then
  cmake --preset fuzz
fi
wanted=""
for target in "$@"; do
  wanted="$wanted fuzz_$target"
done
# shellcheck disable=SC2086  # A list.
cmake --build build/fuzz -j "${JOBS:-2}" --target ${wanted:-fuzz_targets}
exec python3 tests/fuzz/run_targets.py ${EXECUTIONS:+--executions "$EXECUTIONS"} build/fuzz/tests/fuzz/targets.txt \
  build/fuzz/fuzz "$minutes" "$@"
