#!/usr/bin/env bash
# Makes a folder that runs on another x86-64 Linux machine, with nothing of Debian installed there:
# the program, the libraries that it is linked with, their loader, and what it reads.
#
#   tools/relocatable.sh BUILD_FOLDER OUT [--part-mb 55]
#
# OUT/segsim/bin/segsim starts the program from any place; specs that came with it are found by their names
# (experiments/specs/flat.yaml). OUT/part-*.tar.xz hold the same, each below the given size, for machines that files
# reach piece by piece: unpack all of them into one folder.
#
# Of a build with the libtorch of a Python package, libtorch and CUDA's libraries stay behind: the launcher takes those
# of the package `torch` that python3 finds there (or of the folder SEGSIM_TORCH).
set -euo pipefail
if [[ $# -lt 2 || ${1:-} == --help ]]; then
  sed -n '2,12s/^# \{0,1\}//p' "$0"
  exit $(($# < 2 ? 2 : 0))
fi
build=$1 out=$2 part_mb=55
[[ ${3:-} == --part-mb ]] && part_mb=$4
[[ -x $build/experiments/segsim-main ]] || { echo "relocatable.sh: $build/experiments/segsim-main: expected the built program, found none" >&2; exit 2; }

target=$out/segsim
rm -rf "$target" && mkdir -p "$target/lib"
cmake --install "$build" --component program --prefix "$target" >/dev/null

torch_path=""
if ldd "$build/experiments/segsim-main" | grep -q libtorch_cuda; then
  torch_path=':${SEGSIM_TORCH:-$(python3 -c "import importlib.util as u
print(u.find_spec(\"torch\").submodule_search_locations[0])")}/lib:${LD_LIBRARY_PATH:-}'
  torch_path+=':/usr/local/cuda/lib64:/usr/local/nvidia/lib64'
fi
of_cuda='/torch/lib/|/cuda[^/]*/|/lib(cuda|cublas|cudnn|cufft|cufile|cupti|curand|cusolver|cusparse|nccl|nv)[A-Za-z_]*[.-]'

# The launcher sets the environment, then becomes a program beside it: here a script that brings its own loader, so
# that C library and mathematics are those that the program was built with.
for name in segsim-main segsim-light; do
  mv "$target/bin/$name" "$target/lib/$name"
  ldd "$build/experiments/$name" | awk '/=> \//{print $3}' | while read -r library; do
    [[ $torch_path && $library =~ $of_cuda ]] && continue
    cp -Lf "$library" "$target/lib/$(basename "$library")"
  done
  cat >"$target/bin/$name" <<TXT
#!/bin/sh
here=\$(dirname "\$(readlink -f "\$0")")
exec "\$here/../lib/ld-linux.so" --library-path "\$here/../lib$torch_path" --argv0 segsim "\$here/../lib/$name" "\$@"
TXT
  chmod +x "$target/bin/$name"
done
cp -L "$(ldd "$target/lib/segsim-main" | awk '/ld-linux/{print $1}')" "$target/lib/ld-linux.so"

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
