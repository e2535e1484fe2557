#!/usr/bin/env bash
# Builds a plugin of this folder for a QEMU: build.sh QEMU NAME OUT.so. The plugin interface has no version that old and new releases take.
set -euo pipefail
api=1
[ "$("$1" --version | sed -n '1s/.*version \([0-9]*\).*/\1/p')" -lt 9 ] || api=2
cc -O2 -Wall -Wextra -Werror -shared -fPIC -fvisibility=hidden -DAPI=$api -o "$3" "$(dirname "$0")/$2.c"
