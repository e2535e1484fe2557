#!/usr/bin/env bash
# Makes the scenes and baselines.csv: the interpolated coarse DTM, the pipeline without training, shape from shading, the bound of linear filters and
# the shipped models, with the Sun told and not told. Half an hour on two cores. Needs what score.py needs.
#
#   host-train/benchmark/baselines.sh OUT        PROGRAM: host-train (default: built by cargo)
set -euo pipefail
[ $# = 1 ] || { sed -n '2,5s/^# \{0,1\}//p' "$0"; exit 64; }
here="$(cd "$(dirname "$0")" && pwd)" out="$1"
run() {
    if [ -n "${PROGRAM:-}" ]; then "$PROGRAM" "$@"; return; fi
    cargo run --release --quiet --package host-train --manifest-path "$here/../../Cargo.toml" -- "$@"
}
models=(--model "nano=$here/../models/nano.eld" --model "ground=$here/../models/ground.eld")
for list in held-out landforms; do
    suite="$here/../suites/$list.toml"
    "$here/../suites/sfs.sh" "$out/sfs-told/$list" "$suite"
    HIDE_SUN=1 "$here/../suites/sfs.sh" "$out/sfs-untold/$list" "$suite"
    run suite --suite "$suite" --out "$out/told/$list" "${models[@]}" --linear-bound --against "sfs=$out/sfs-told/$list/sfs"
    run suite --suite "$suite" --out "$out/untold/$list" "${models[@]}" --hide-sun --against "sfs=$out/sfs-untold/$list/sfs"
done
python3 "$here/score.py" "$out/told" --check
python3 "$here/baselines.py" "$out" >"$out/baselines.csv"
mv "$out/baselines.csv" "$here/baselines.csv"
