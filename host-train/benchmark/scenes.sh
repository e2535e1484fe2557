#!/usr/bin/env bash
# Makes the scenes and compares them with scenes.csv, which must be those of any processor. A minute. Needs what score.py needs.
#
#   host-train/benchmark/scenes.sh OUT        PROGRAM: host-train (default: built by cargo)
set -euo pipefail
[ $# = 1 ] || { sed -n '2,4s/^# \{0,1\}//p' "$0"; exit 64; }
here="$(cd "$(dirname "$0")" && pwd)" out="$1"
run() {
    if [ -n "${PROGRAM:-}" ]; then $PROGRAM "$@"; return; fi
    cargo run --release --quiet --package host-train --manifest-path "$here/../../Cargo.toml" -- "$@"
}
for list in held-out landforms; do run suite --scenes-only --suite "$here/../suites/$list.toml" --out "$out/$list"; done
python3 "$here/score.py" "$out" --check
