#!/usr/bin/env bash
# Runs the whole program on a machine with an NVIDIA GPU and says which of its bars it keeps.
#
#   tools/gpu_acceptance.sh SEGSIM OUT [--data FOLDER] [--workers N]
#
# SEGSIM is the program, built with the preset `cuda` or unpacked from tools/relocatable.sh. With --data, the small
# house and the break room of that folder are run, too, and the whole method if it has models/centernet.weights. OUT
# gets a log of each step, records for results/, and summary.txt; steps that are done are not repeated. Exit code 0:
# every bar is kept; 1: some is not, or there is no GPU.
set -uo pipefail
if [[ $# -lt 2 || ${1:-} == --help || ${1:-} == -h ]]; then
  sed -n '2,10s/^# \{0,1\}//p' "$0"
  exit $(($# < 2 ? 2 : 0))
fi
segsim=$(readlink -f "$1") out=$2 data="" workers=$(nproc)
shift 2
while (($#)); do
  case $1 in
    --data) data=$(readlink -f "$2"); shift 2 ;;
    --workers) workers=$2; shift 2 ;;
    *) echo "gpu_acceptance.sh: expected --data or --workers, found $1" >&2; exit 2 ;;
  esac
done
[[ -x $segsim ]] || { echo "gpu_acceptance.sh: $segsim: expected the program, found none" >&2; exit 2; }
mkdir -p "$out/records" && out=$(readlink -f "$out")
cd "$out" || exit 2
failures=0

# Notes a line of the summary. "kept" or "MISSED", then what.
note() {
  printf '%-6s  %s\n' "$1" "$2" | tee -a summary.txt
  [[ $1 == MISSED ]] && failures=$((failures + 1))
  return 0
}

# step NAME EXPECTED_EXIT COMMAND...: runs it into NAME.log unless it is done, and notes how it ended.
step() {
  local name=$1 expected=$2 begin found
  shift 2
  [[ -e $name.done ]] && { note kept "$(cat "$name.done"), earlier"; return 0; }
  begin=$(date +%s%N)
  "$@" >"$name.log" 2>&1
  found=$?
  if ((found == expected)); then
    echo "$name: exit code $found after $((($(date +%s%N) - begin) / 1000000)) ms" >"$name.done"
    note kept "$(cat "$name.done")"
  else
    note MISSED "$name: exit code $found, expected $expected: $(tail -n 1 "$name.log")"
    return 1
  fi
}

# says NAME TEXT: whether the log of a step that was to fail holds it.
says() {
  if grep -q -- "$2" "$1.log"; then note kept "$1 says: $(grep -m 1 -- "$2" "$1.log")"
  else note MISSED "$1: expected a line with \"$2\", found: $(tail -n 1 "$1.log")"; fi
}

same() {  # What FIRST SECOND
  if [[ -n $2 && $2 == "$3" ]]; then note kept "$1: $2"; else note MISSED "$1: \"$2\" and \"$3\""; fi
}

results_of() { grep -o 'SHA-256 [0-9a-f]*' "$1.log" | tail -n 1; }

: >summary.txt
# 1. Frames, and that they need the GPU.
step frames 0 "$segsim" bench render --backend cuda --size 1296x968 1280x720 640x480 256x192 --top-k 4 24 \
  --repeat 10 --record records/frames_segsim_gpu.json || exit 1
CUDA_VISIBLE_DEVICES="" step no_gpu 2 "$segsim" bench render --backend cuda --surfels 1000 --size 64x48
says no_gpu "GPU"
CUDA_VISIBLE_DEVICES="" step no_gpu_run 2 "$segsim" run experiments/specs/flat.yaml --backend cuda --work no_gpu_run
says no_gpu_run "CUDA"

# 2. A flat: one recording, trained twice.
step capture 0 "$segsim" capture --flat 3 --frames 240 --width 320 --height 240 --out recording
for name in gpu gpu_again; do
  step "reconstruct_$name" 0 "$segsim" reconstruct recording --backend cuda --iterations 3000 \
    --label-iterations 1000 --out "scene_$name"
done
same "the same surfels twice" "$(sha256sum <scene_gpu/surfels.ply)" "$(sha256sum <scene_gpu_again/surfels.ply)"

# 3. The quickstart's run, twice.
for name in flat flat_again; do
  step "$name" 0 "$segsim" run experiments/specs/flat.yaml --backend cuda --workers "$workers" --work "run_$name"
done
same "the same rows twice" "$(results_of flat)" "$(results_of flat_again)"

# 4. Labels and a detector.
step label 0 "$segsim" label scene_gpu --views 400 --out labels
step finetune 0 "$segsim" detector finetune --from run_flat/arm-before.weights \
  --train labels/labels.json --steps 800 --device cuda --out after.weights

# 5. Places of others.
run_place() {
  step "$1" 0 "$segsim" run "experiments/specs/$1.yaml" --backend cuda --workers "$workers" --data "$data" \
    --work "run_$1"
}
if [[ -n $data ]]; then
  [[ -e $data/models/centernet.weights ]] && run_place chain_house && run_place chain_breakroom
  run_place house
  step house_trained 0 "$segsim" reconstruct run_house/captures/house --backend cuda --iterations 7000 \
    --label-iterations 3000 --out scene_house --record records/house_segsim_gpu.json
  step breakroom 0 "$segsim" reconstruct "$data/hololens_breakroom" --backend cuda --iterations 7000 \
    --label-iterations 3000 --boxes "$data/hololens_breakroom/annotation/breakroom_boxes.json" \
    --floor-height -1.53 --out scene_breakroom --record records/breakroom_segsim_gpu.json
fi
# 6. What the CPU needs for the same.
step reconstruct_cpu 0 "$segsim" reconstruct recording --backend cpu --iterations 3000 --label-iterations 1000 \
  --out scene_cpu

echo
cat summary.txt
((failures == 0)) || { echo "$failures bars are missed" >&2; exit 1; }
