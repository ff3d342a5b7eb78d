#!/usr/bin/env bash
# Fetches the weights of others that this program can read, by your own npm, and checks their SHA-256.
#
#   tools/fetch_models.sh [DIR]     default: models
#
# MobileNetV3-CenterNet comes with the npm package @vladmandic/human 3.3.6 (MIT); the package's licence is put beside it.
# Nothing of it is part of this project, and nothing in it is executed. docs/centernet.md goes on from here.
set -euo pipefail

package=@vladmandic/human version=3.3.6
json_sha256=bfb942eaacc5becf738d536663bc4580a0ae9e560722306e6d4dd7fe4a09de05
bin_sha256=1b635a15009071f506f9f2b3519b31c072c534888989f30d269ffd44734ef7ef

fail() { printf 'fetch_models.sh: %s\n' "$*" >&2; exit 2; }

check() {  # check FILE SHA256
  local found
  found=$(sha256sum "$1" | cut -d' ' -f1)
  [[ $found == "$2" ]] || fail "$1: expected SHA-256 $2, found $found"
}

case ${1:-} in -*) sed -n '2,7s/^# \{0,1\}//p' "$0"; exit 0 ;; esac
target=${1:-models}
command -v npm >/dev/null || fail "expected npm (Debian package npm), found none"

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
(cd "$work" && npm pack --silent "$package@$version" >/dev/null) || fail "npm pack $package@$version did not work"
tar -xzf "$work"/*.tgz -C "$work" package/models/centernet.json package/models/centernet.bin package/LICENSE \
  || fail "$package@$version has not the files that it is known to have"
check "$work/package/models/centernet.json" "$json_sha256"
check "$work/package/models/centernet.bin" "$bin_sha256"

mkdir -p "$target"
cp "$work/package/models/centernet.json" "$work/package/models/centernet.bin" "$target/"
cp "$work/package/LICENSE" "$target/centernet.LICENSE"
printf '%s\n' "$target/centernet.json" "$target/centernet.bin" "$target/centernet.LICENSE"
