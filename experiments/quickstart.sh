#!/usr/bin/env bash
# Installs what is missing, builds, and runs the main job on the embedded procedural flats:
# a robot searches two furnished flats with a detector before and after fine-tuning.
#
# With a detector that was trained on photographs in models/ (tools/fetch_models.sh models), it is that
# detector, and one of the flats.
#
#   experiments/quickstart.sh [--help] [any option of `segsim run`]
#
# Finished parts are kept: run it again and it goes on where it was.
set -euo pipefail
if [[ ${1:-} == --help || ${1:-} == -h ]]; then
  sed -n '2,11s/^# \{0,1\}//p' "$0"
  exit 0
fi
source "$(dirname "${BASH_SOURCE[0]}")/../tools/setup.sh"
cd "$root"

took() { echo "$(($1 / 60)) min $(($1 % 60)) s"; }

install_packages debian_packages.txt
installed=$SECONDS
build release segsim
built=$SECONDS

segsim=build/release/experiments/segsim
name=flat
if [[ -e models/centernet.json && ! -e models/centernet.weights ]]; then
  "$segsim" detector import models/centernet.json --out models/centernet.weights || fail "models/centernet.json was not read"
fi
[[ -e models/centernet.weights ]] && name=flat_centernet
work=out/$name
say "Running the main job (results in $work)"
"$segsim" run "experiments/specs/$name.yaml" --work "$work" "$@" \
  || fail "segsim run ended with code $?; what was finished is kept in $work: run this script again"

ran=$SECONDS
say "Writing the report"
"$segsim" report "$work" \
  || fail "segsim report ended with code $?; the results themselves are in $work"

digests=experiments/specs/digests/$name.json
if [[ -e $digests ]]; then
  say "Are these the numbers of other machines?"
  "$segsim" doctor --digests "$work" --against "$digests" || (($? == 1)) || fail "the digests could not be compared"
fi

say "Done: build $(took $((built - installed))), run $(took $((ran - built))), report $(took $((SECONDS - ran))). Where to look:"
cat <<TEXT
  table      $work/table.md            success rate before and after, with intervals
  pictures   $work/pictures/           one top-down picture for each trial: path, frontiers, goal, detections
  video      $work/videos/             camera, panoptic image and map side by side; the whole run in 80 s:
                                  $segsim video $work --demo
  database   $work/results.sqlite      one row a trial: sqlite3 $work/results.sqlite 'select * from trial limit 3'
  tracks     $work/tracks/             GeoJSON and KML for any map program

Did it get better, how sure are we, why did it fail? Open in a browser:
  file://$root/$work/report/index.html
TEXT
