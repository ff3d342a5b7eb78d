#!/usr/bin/env bash
# Fails when clang-format would change a file, and names the places. `clang-format -i FILE...` mends them.
#
#   tools/check_format.sh [clang-format of another name]
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."
find core renderer reconstruction perception nav sim ros peers worlds experiments examples python tests tools \
  \( -name '*.h' -o -name '*.cpp' -o -name '*.cu' -o -name '*.cuh' \) -print0 \
  | xargs -0 -n 40 -P "$(nproc)" "${1:-clang-format}" --dry-run --Werror
