#!/usr/bin/env bash
# Runs the quickstart's experiment with several fine-tunings and writes the record that the README's table is made from.
#
#   tools/record_quickstart.sh [SEEDS, default 10] [--work DIR, default out/flat-SEEDS]
#
# Writes results/object_search/quickstart.json (what ran where, and what came out) and makes README.md's table and the
# pages of docs/ anew. What is there is not run again.
set -euo pipefail
if [[ ${1:-} == --help || ${1:-} == -h ]]; then
  sed -n '2,7s/^# \{0,1\}//p' "$0"
  exit 0
fi
source "$(dirname "${BASH_SOURCE[0]}")/setup.sh"
cd "$root"
seeds=10
if [[ ${1:-} =~ ^[0-9]+$ ]]; then
  seeds=$1
  shift
fi
work=out/flat-$seeds
if [[ ${1:-} == --work ]]; then
  work=$2
fi
segsim=build/release/experiments/segsim
[[ -x $segsim ]] || build release segsim

# The shipped spec with more seeds and without pictures.
mkdir -p "$work"
spec=$work/flat-$seeds.yaml
sed -e "s#\${spec}#$root/experiments/specs#" -e "s/finetune_seeds: [0-9]*/finetune_seeds: $seeds/" \
  -e 's/^videos: first/pictures: false/' experiments/specs/flat.yaml >"$spec"
grep -q "finetune_seeds: $seeds" "$spec" || fail "experiments/specs/flat.yaml names no finetune_seeds"
"$segsim" run "$spec" --work "$work" --workers "$(nproc)" || fail "segsim run ended with code $?; run this again to go on"

python3 tools/results run "$work" results/object_search/quickstart.json "tools/record_quickstart.sh $seeds"
python3 tools/results write .
