# Sourced by experiments/quickstart.sh and tests/run.sh: installs what is missing and builds.
# Defines: say, fail, install_packages <list...>, build <preset>.

say() { printf '\n== %s\n' "$*"; }
fail() { printf 'error: %s\n' "$*" >&2; exit 3; }

root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)

install_packages() {  # install_packages <file below tools/>...
  command -v dpkg-query >/dev/null || fail "this script installs Debian packages; on another system install the equivalents of $* in tools/ and run cmake --preset release"
  local missing=() package
  while read -r package; do
    [[ -z $package || $package == \#* ]] && continue
    dpkg-query -W -f='${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing+=("$package")
  done < <(cd "$root/tools" && cat "$@")
  if ((${#missing[@]} == 0)); then
    say "Debian packages: all installed"
    return
  fi
  local as_root=()
  if ((EUID != 0)); then
    command -v sudo >/dev/null || fail "need root or sudo to install: ${missing[*]}"
    as_root=(sudo)
  fi
  say "Installing ${#missing[@]} Debian packages: ${missing[*]}"
  "${as_root[@]}" apt-get update -q || fail "apt-get update did not work"
  "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends "${missing[@]}" \
    || fail "apt-get install did not work"
}

# One compiler process needs up to 1.2 GB (libtorch headers): no more jobs than memory allows.
build_jobs() {
  local cores memory_gb
  cores=$(nproc)
  memory_gb=$(awk '/MemAvailable/ {print int($2 / 1048576)}' /proc/meminfo)
  local jobs=$((memory_gb * 10 / 12))
  ((jobs < 1)) && jobs=1
  ((jobs > cores)) && jobs=$cores
  echo "$jobs"
}

build() {  # build <preset> [target...]
  local preset=$1
  shift
  say "Configuring and building (preset $preset, $(build_jobs) jobs)"
  (cd "$root" && cmake --preset "$preset") || fail "cmake could not configure; see above"
  (cd "$root" && cmake --build --preset "$preset" -j "$(build_jobs)" ${@:+--target "$@"}) \
    || fail "the build did not succeed; see above"
}

# libtorch: OpenMP threads are set by the program; OpenBLAS must not add its own.
export OPENBLAS_NUM_THREADS=${OPENBLAS_NUM_THREADS:-1}
export GOMP_SPINCOUNT=${GOMP_SPINCOUNT:-1000}
