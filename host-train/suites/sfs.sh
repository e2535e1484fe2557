#!/usr/bin/env bash
# Shape from shading on every scene of a suite, for `host-train suite ... --against sfs=OUT/sfs`.
#
#   host-train/suites/sfs.sh OUT [LIST.toml | --real DATA]     writes the scenes into OUT/scenes and the DTMs into OUT/sfs
#
# A Sun that is not known is fitted; with HIDE_SUN=1 every Sun is (needs python3 with rasterio). WEIGHTS="SMOOTHNESS CONSTRAINT" sets the weights, in
# pixels and per pixel. PROGRAM: host-train (default: built by cargo).
set -euo pipefail
[ $# -ge 1 ] || { sed -n '2,7s/^# \{0,1\}//p' "$0"; exit 1; }
out="$1"
run() {
    if [ -n "${PROGRAM:-}" ]; then "$PROGRAM" "$@"; return; fi
    cargo run --quiet --package host-train --manifest-path "$(dirname "$0")/../../Cargo.toml" -- "$@"
}
# Writes an image without its tags, which state the Sun.
untold() {
    python3 - "$1" "$2" <<'END'
import sys, rasterio
with rasterio.open(sys.argv[1]) as image, rasterio.open(sys.argv[2], "w", **image.profile) as copy:
    copy.write(image.read())
END
}

case "${2:-}" in
"") run suite --out "$out" --scenes-only ;;
--real) run suite --out "$out" --scenes-only --real "${3:?--real: a folder expected}" ;;
*) run suite --out "$out" --scenes-only --suite "$2" ;;
esac
mkdir -p "$out/sfs" "$out/untold"
tail -n +2 "$out/scenes/scenes.csv" | while IFS=, read -r name azimuth elevation pixel; do
    [ -e "$out/sfs/$name.tif" ] && continue
    options=()
    image="$out/scenes/${name}_image.tif"
    if [ -n "${HIDE_SUN:-}" ]; then
        azimuth='' elevation=''
        untold "$image" "$out/untold/${name}_image.tif"
        image="$out/untold/${name}_image.tif"
    fi
    [ -z "$azimuth" ] || options+=(--sun-azimuth "$azimuth")
    [ -z "$elevation" ] || options+=(--sun-elevation "$elevation")
    [ ${#options[@]} = 4 ] || options+=(--fit-sun)
    if [ -n "${WEIGHTS:-}" ]; then
        read -r smoothness constraint <<<"$WEIGHTS"
        options+=(--smoothness-weight "$(awk "BEGIN { print $smoothness * $pixel }")")
        options+=(--dem-constraint-weight "$(awk "BEGIN { print $constraint / $pixel }")")
    fi
    run sfs --image "$image" --coarse "$out/scenes/${name}_coarse.tif" "${options[@]}" \
        -o "$out/sfs/$name.tif" --json >"$out/sfs/$name.json" </dev/null
done
