#!/usr/bin/env bash
# Runs clang-tidy (.clang-tidy says which checks) over library modules; every finding is an error.
#
#   tools/clang_tidy.sh [--help] [folder or file...]      default: all folders of libraries
#
# It needs the Debian packages clang and clang-tidy. A file takes about ten seconds of one core. Files that include
# libtorch are left out and counted: Clang 14 does not understand libtorch's headers as C++20.
set -euo pipefail
if [[ ${1:-} == --help || ${1:-} == -h ]]; then
  sed -n '2,7s/^# \{0,1\}//p' "$0"
  exit 0
fi
source "$(dirname "${BASH_SOURCE[0]}")/setup.sh"
cd "$root"
command -v clang-tidy >/dev/null || fail "clang-tidy is not installed (Debian: clang, clang-tidy)"
(($#)) || set -- core renderer reconstruction perception nav sim ros peers worlds experiments

cmake --preset tidy >/dev/null || fail "cmake could not configure; see above"
cmake --build --preset tidy --target segsim_version >/dev/null || fail "the build did not succeed; see above"
mapfile -t files < <(python3 - "$@" <<'PY'
import concurrent.futures, json, os, shlex, subprocess, sys
wanted = [os.path.abspath(path) for path in sys.argv[1:]]

def includes_torch(entry):
    words = shlex.split(entry["command"])
    words = words[:words.index("-o")] + ["-M", entry["file"]]
    found = subprocess.run(words, cwd=entry["directory"], capture_output=True, text=True)
    return "/ATen/" in found.stdout

entries = [entry for entry in json.load(open("build/tidy/compile_commands.json"))
           if entry["file"].endswith(".cpp")
           and any(entry["file"] == path or entry["file"].startswith(path + os.sep) for path in wanted)]
with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
    torch = list(pool.map(includes_torch, entries))
print(*(entry["file"] for entry, skip in zip(entries, torch) if not skip), sep="\n")
print(f"clang-tidy: {sum(torch)} files include libtorch and are left out", file=sys.stderr)
PY
)
((${#files[@]})) || fail "no source file of this build lies in: $*"
say "clang-tidy on ${#files[@]} files"
printf '%s\0' "${files[@]}" | xargs -0 -n 1 -P "$(build_jobs)" clang-tidy -p build/tidy --quiet \
  2> >(grep -v ' warnings\? generated\.$' >&2) || fail "clang-tidy has findings; see above"
