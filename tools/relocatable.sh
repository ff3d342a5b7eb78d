#!/usr/bin/env bash
# Makes a folder that runs on another x86-64 Linux machine, with nothing of Debian installed there:
# the program, the libraries that it is linked with, their loader, and what it reads.
#
#   tools/relocatable.sh BUILD_FOLDER OUT [--part-mb 55]
#
# OUT/segsim/bin/segsim starts the program from any place. OUT/part-*.tar.xz hold the same, each below the given
# size, for machines that files reach piece by piece: unpack all of them into one folder.
set -euo pipefail
if [[ $# -lt 2 || ${1:-} == --help ]]; then
  sed -n '2,8s/^# \{0,1\}//p' "$0"
  exit $(($# < 2 ? 2 : 0))
fi
build=$1 out=$2 part_mb=55
[[ ${3:-} == --part-mb ]] && part_mb=$4
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
program=$build/experiments/segsim-main
[[ -x $program ]] || { echo "relocatable.sh: $program: expected the built program, found none" >&2; exit 2; }

target=$out/segsim
rm -rf "$target" && mkdir -p "$target/bin" "$target/lib"
cp "$build/experiments/segsim" "$target/bin/segsim-launcher"
cp "$program" "$target/lib/segsim-main"
ldd "$program" | awk '/=> \//{print $3}' | while read -r library; do
  cp -Lf "$library" "$target/lib/$(basename "$library")"
done
loader=$(ldd "$program" | awk '/ld-linux/{print $1}')
cp -L "$loader" "$target/lib/ld-linux.so"

# The launcher sets the environment, then becomes segsim-main: a script that brings its own loader, so that
# C library and mathematics are those that the program was built with. The launcher itself needs them, too.
cat >"$target/bin/segsim-main" <<'TXT'
#!/bin/sh
here=$(dirname "$(readlink -f "$0")")
exec "$here/../lib/ld-linux.so" --library-path "$here/../lib" --argv0 segsim "$here/../lib/segsim-main" "$@"
TXT
cp "$target/bin/segsim-launcher" "$target/bin/segsim" && rm "$target/bin/segsim-launcher"
chmod +x "$target"/bin/*
# What specs of the program refer to.
mkdir -p "$target/experiments" "$target/perception"
cp -r "$root/experiments/specs" "$root/experiments/budgets" "$root/experiments/class_maps" "$target/experiments/"
cp -r "$root/perception/weights" "$root/perception/training_defaults.yaml" "$target/perception/"

# Parts: the largest files first, each into the first part that has room for it when packed by half.
(cd "$out" && rm -f part-*.tar.xz part-*.list && find segsim -type f -printf '%s %p\n' | sort -rn |
  awk -v limit="$((part_mb * 1000000 * 3))" '
    { for (k = 1; ; ++k) if (size[k] + $1 <= limit || size[k] == 0) break
      size[k] += $1; print $2 > ("part-" k ".list") }')
for list in "$out"/part-*.list; do
  tar -C "$out" -cf - -T "$list" | xz -T0 -2 >"${list%.list}.tar.xz"
  rm "$list"
done
du -sh "$target" "$out"/part-*.tar.xz
