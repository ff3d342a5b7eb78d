#!/usr/bin/env bash
# Runs clang-tidy (.clang-tidy says which checks) over library modules; every finding is an error.
#
#   tools/clang_tidy.sh [--help] [folder or file...]      default: core renderer nav
#
# It needs the Debian packages clang and clang-tidy. A file takes about ten seconds of one core.
set -euo pipefail
if [[ ${1:-} == --help || ${1:-} == -h ]]; then
  sed -n '2,6s/^# \{0,1\}//p' "$0"
  exit 0
fi
source "$(dirname "${BASH_SOURCE[0]}")/setup.sh"
cd "$root"
command -v clang-tidy >/dev/null || fail "clang-tidy is not installed (Debian: clang, clang-tidy)"
(($#)) || set -- core renderer nav

cmake --preset tidy >/dev/null || fail "cmake could not configure; see above"
cmake --build --preset tidy --target segsim_version >/dev/null || fail "the build did not succeed; see above"
mapfile -t files < <(python3 - "$@" <<'PY'
import json, os, sys
wanted = [os.path.abspath(path) for path in sys.argv[1:]]
for entry in json.load(open("build/tidy/compile_commands.json")):
    file = entry["file"]
    if file.endswith(".cpp") and any(file == path or file.startswith(path + os.sep) for path in wanted):
        print(file)
PY
)
((${#files[@]})) || fail "no source file of this build lies in: $*"
say "clang-tidy on ${#files[@]} files"
printf '%s\0' "${files[@]}" | xargs -0 -n 1 -P "$(build_jobs)" clang-tidy -p build/tidy --quiet \
  2> >(grep -v ' warnings\? generated\.$' >&2) || fail "clang-tidy has findings; see above"
