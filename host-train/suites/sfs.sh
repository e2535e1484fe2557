#!/usr/bin/env bash
# Shape from shading on every scene of a suite, for `host-train suite ... --against sfs=OUT/sfs`.
#
#   host-train/suites/sfs.sh OUT [LIST.toml]     writes the scenes into OUT/scenes and the DTMs into OUT/sfs
#
# Scenes whose Sun is not known are named as skipped.
set -euo pipefail
[ $# -ge 1 ] || { sed -n '2,6s/^# \{0,1\}//p' "$0"; exit 1; }
out="$1"
run() { cargo run --quiet --package host-train --manifest-path "$(dirname "$0")/../../Cargo.toml" -- "$@"; }

run suite --out "$out" --scenes-only ${2:+--suite "$2"}
mkdir -p "$out/sfs"
tail -n +2 "$out/scenes/scenes.csv" | while IFS=, read -r name azimuth elevation; do
    if [ -z "$azimuth" ] || [ -z "$elevation" ]; then
        echo "SKIPPED: $name: its Sun is not known"
        continue
    fi
    [ -e "$out/sfs/$name.tif" ] && continue
    run sfs --image "$out/scenes/${name}_image.tif" --coarse "$out/scenes/${name}_coarse.tif" \
        --sun-azimuth "$azimuth" --sun-elevation "$elevation" -o "$out/sfs/$name.tif" --json >"$out/sfs/$name.json" </dev/null
done
