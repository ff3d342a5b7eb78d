#!/bin/bash
# A copy of the targets of libFuzzer that runs where nothing is installed but bash and python3:
#
#     tests/fuzz/pack.sh FOLDER [LIBRARIES]
#
# FOLDER gets the programs that build/fuzz has, their libraries, the inputs that were found so far, and fuzz_all.sh,
# which says how it is called. LIBRARIES is a folder that the other machine has beside FOLDER, with ld-linux.so:
# what is there is left out.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."
if (($# < 1)); then
  sed -n 's/^# \{0,1\}//p' "$0" | head -8
  exit 2
fi
mkdir -p "$1"
folder=$(realpath -s "$1")
there=${2:+$(realpath -s "$2")}
built=build/fuzz/tests/fuzz
rm -rf "${folder:?}"/{bin,lib,corpus,dictionaries,source}
mkdir -p "$folder"/{bin,lib,corpus,dictionaries,source}

build_id() { readelf -n "$1" 2>/dev/null | sed -n 's/.*Build ID: //p'; }

: >"$folder/targets.txt"
while read -r name program dictionary; do
  [[ -x $program ]] || { echo "pack.sh: $name is not built" >&2; exit 2; }
  strip --strip-debug -o "$folder/bin/fuzz_$name" "$program"
  if [[ -n $dictionary ]]; then cp "$dictionary" "$folder/dictionaries/"; fi
  echo "$name bin/fuzz_$name ${dictionary:+dictionaries/$(basename "$dictionary")}" >>"$folder/targets.txt"
  mkdir -p "$folder/corpus/$name"
  if [[ -d build/fuzz/fuzz/corpus/$name ]]; then cp -r "build/fuzz/fuzz/corpus/$name" "$folder/corpus/"; fi
done <$built/targets.txt

ldd "$folder"/bin/* | sed -n 's/^\t\(lib[^ ]*\) => \(\/[^ ]*\).*/\1 \2/p' | sort -u | while read -r name file; do
  if [[ -n $there && -f $there/$name && $(build_id "$there/$name") == "$(build_id "$file")" ]]; then continue; fi
  strip --strip-unneeded -o "$folder/lib/$name" "$file"
done
if [[ -z $there ]]; then cp -L /lib64/ld-linux-x86-64.so.2 "$folder/lib/ld-linux.so"; fi

# What targets read besides their inputs.
cp --parents experiments/budgets/*.yaml experiments/specs/*.yaml experiments/suites/*.yaml experiments/trials/*.yaml \
  experiments/trials/paths/* sim/robots/*.yaml "$folder/source/"
cp tests/fuzz/run_targets.py tests/fuzz/campaign.py "$folder/"
git rev-parse HEAD >"$folder/commit"
cat >"$folder/fuzz_all.sh" <<END
#!/bin/bash
# fuzz_all.sh JOBS SECONDS OUT [TARGET...]: 1 100 000 executions of every target (EXECUTIONS), as far as the time goes;
# called again with the same OUT it counts on.
# OUT/record.jsonl: a line for each process that has ended, the last one of a target counts. OUT/findings: inputs, and
# what was said about them: addresses in ld-linux.so are those of the target (addr2line -e build/fuzz/tests/fuzz/...).
set -euo pipefail
here=\$(cd "\$(dirname "\${BASH_SOURCE[0]}")" && pwd)
there=\$(python3 -c 'import os, sys; print(os.path.normpath(os.path.join(*sys.argv[1:])))' "\$here" \
  "${there:+$(realpath -s --relative-to="$folder" "$there")}" "\${LIBRARIES:-}")
[[ -e \$there/ld-linux.so ]] || there=\$here/lib
jobs=\$1 seconds=\$2 out=\$3
shift 3
mkdir -p "\$out/corpus"
cp -rn "\$here/corpus/." "\$out/corpus/"
export SEGSIM_SOURCE=\$here/source SEGSIM_COMMIT=\$(cat "\$here/commit")
minutes=\$(python3 -c "print(\$seconds / 60)")
exec python3 "\$here/run_targets.py" --resume --executions "\${EXECUTIONS:-1100000}" --jobs "\$jobs" \\
  --loader "\$there/ld-linux.so" --library-path "\$here/lib:\$there" "\$here/targets.txt" "\$out" "\$minutes" "\$@"
END
chmod +x "$folder/fuzz_all.sh" "$folder/run_targets.py"
du -sh "$folder"
