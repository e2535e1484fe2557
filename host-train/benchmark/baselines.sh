#!/usr/bin/env bash
# Makes the scenes and baselines.csv: the interpolated coarse DTM, the pipeline without training, shape from shading, the bound of linear filters and
# the shipped models. Half an hour on two cores. Needs what score.py needs.
#
#   host-train/benchmark/baselines.sh OUT        PROGRAM: host-train (default: built by cargo)
set -euo pipefail
[ $# = 1 ] || { sed -n '2,5s/^# \{0,1\}//p' "$0"; exit 1; }
here="$(cd "$(dirname "$0")" && pwd)" out="$1"
run() {
    if [ -n "${PROGRAM:-}" ]; then "$PROGRAM" "$@"; return; fi
    cargo run --quiet --package host-train --manifest-path "$here/../../Cargo.toml" -- "$@"
}
"$here/../suites/sfs.sh" "$out/sfs"
run suite --out "$out/suite" --linear-bound --against "sfs=$out/sfs/sfs"
python3 "$here/baselines.py" "$out/suite" >"$here/baselines.csv"
