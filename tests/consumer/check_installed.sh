#!/usr/bin/env bash
# Installs into an empty folder and uses what came there: the program from a folder of its own, the
# libraries from a project of their own (beside this script).
#
#   check_installed.sh prefix BUILD_FOLDER WORK   by `cmake --install`
#   check_installed.sh deb BUILD_FOLDER WORK      by CPack's Debian packages, which dpkg installs into an
#                                               empty root (their dependencies are those of this machine)
set -euo pipefail
if [[ $# -ne 3 || ! $1 =~ ^(prefix|deb)$ ]]; then
  sed -n '2,7s/^# \{0,1\}//p' "$0" >&2
  exit 2
fi
way=$1 build=$(cd "$2" && pwd) here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
rm -rf "$3" && mkdir -p "$3"
work=$(cd "$3" && pwd)
fail() { echo "check_installed.sh: $1" >&2; exit 1; }

if [[ $way == prefix ]]; then
  prefix=$work/prefix
  for component in program development; do
    cmake --install "$build" --prefix "$prefix" --component $component >"$work/install.log"
  done
else
  prefix=$work/root/usr database=$work/root/var/lib/dpkg
  mkdir -p "$database"/{info,triggers,updates} && touch "$database"/{available,status}
  in_root() { dpkg --root="$work/root" --log=/dev/null --force-not-root --force-script-chrootless "$@"; }
  (cd "$work" && cpack -G DEB --config "$build/CPackConfig.cmake" -B "$work" >cpack.log) || { cat "$work/cpack.log"; fail "cpack failed"; }
  for package in segsim libsegsim-dev; do
    deb=$(echo "$work/$package"_*.deb)
    [[ -f $deb ]] || fail "expected a package $package, found none"
    dpkg-deb --info "$deb" | grep -E '^ (Package|Version|Depends):'
    in_root --force-depends -i "$deb" >"$work/dpkg.log" 2>&1 || { cat "$work/dpkg.log"; fail "dpkg does not install $deb"; }
    [[ -z $(in_root --verify "$package") ]] || fail "dpkg --verify $package: what is installed is not what was packed"
  done
fi

# The program: from another folder, without the tree it was built in.
mkdir "$work/elsewhere" && cd "$work/elsewhere"
"$prefix/bin/segsim" --version
"$prefix/bin/segsim" run --help >/dev/null
"$prefix/bin/segsim" trial check experiments/trials/drive.yaml  # Of $prefix/share/segsim.
for file in perception/weights/source_rooms.weights experiments/budgets/example-edge.yaml; do
  [[ -f $prefix/share/segsim/$file ]] || fail "expected share/segsim/$file, found none"
done
grep -rlE "^#include .*(internal/|tbb/|hwy/)" "$prefix/include/segsim" && fail "installed headers include what is not installed"

# The libraries.
cmake -S "$here" -B "$work/consumer" -DCMAKE_PREFIX_PATH="$prefix" -DCMAKE_BUILD_TYPE=Release \
  -DCMAKE_FIND_USE_PACKAGE_REGISTRY=OFF >"$work/configure.log" || { cat "$work/configure.log"; fail "the consumer does not configure"; }
cmake --build "$work/consumer" >"$work/build.log" || { cat "$work/build.log"; fail "the consumer does not build"; }
"$work/consumer/consumer"
readelf -d "$work/consumer/consumer" | sed -n 's/.*(NEEDED).*\[\(.*\)\]/\1/p' >"$work/needed"
others=$(grep -vE '^(libhwy|libhwy_contrib|libtbb|libstdc\+\+|libm|libgcc_s|libc|ld-linux-x86-64)\.so' "$work/needed" || true)
[[ -z $others ]] || fail "expected Highway and oneTBB alone, found $others"
echo "installed by $way: ok"
