#!/usr/bin/env bash
# The sweep behind the default weights of `host-train sfs` (docs/sfs.md): twelve synthetic tiles under Suns of 18 to 64 degrees, four
# under Suns of 8 to 18 degrees, and every pair of weights; RMSE of height and mean absolute slope error over those of the coarse DTM.
#
#   host-train/docs/sfs-sweep.sh target/release/host-train FOLDER "0.125 0.25 0.5" "0.04 0.08 0.16"
#
# Weights are in pixels, and per pixel. The scenes are made once and kept in FOLDER. Needs python3.
set -euo pipefail
[ $# -eq 4 ] || { echo "usage: $0 HOST-TRAIN FOLDER \"SMOOTHNESS...\" \"DEM-CONSTRAINT...\"" >&2; exit 2; }
program="$(realpath "$1")"; folder="$2"; smoothness="$3"; constraint="$4"
mkdir -p "$folder"
cd "$folder"
[ -e high/manifest.json ] || "$program" synth --out high --scenes 12 --seed 90001 --rows 256 --cols 320 >&2
[ -e low/manifest.json ] || "$program" synth --out low --scenes 4 --seed 90002 --rows 256 --cols 320 --sun-elevation-deg 8 18 >&2
suns='import json, sys
for folder in ("high", "low"):
    for s in json.load(open(folder + "/manifest.json"))["scenes"]:
        print(folder + "/" + s["name"], s["sun_azimuth_deg"], s["sun_elevation_deg"])'
means='import json, math, sys
rows = [json.loads(line)["candidates"] for line in open(sys.argv[1])]
ratio = lambda key: math.exp(sum(math.log(d[key] / c[key]) for d, c in rows) / len(rows))
print(*["%.3f" % ratio(key) for key in ("rmse_m", "slope_mae_deg", "slope_rmse_deg")], len(rows))'
echo "smoothness_px constraint_per_px rmse_ratio slope_mae_ratio slope_rmse_ratio tiles"
for s in $smoothness; do
    for c in $constraint; do
        : > results.jsonl
        while read -r scene azimuth elevation; do
            # Pixels are 2 m wide.
            "$program" sfs --image "${scene}_image.tif" --coarse "${scene}_coarse.tif" -o dtm.tif \
                --sun-azimuth "$azimuth" --sun-elevation "$elevation" \
                --smoothness-weight "$(python3 -c "print(2 * $s)")" --dem-constraint-weight "$(python3 -c "print($c / 2)")" > /dev/null
            "$program" evaluate --json --dtm dtm.tif --truth "${scene}_truth.tif" --coarse "${scene}_coarse.tif" \
                | python3 -c 'import json, sys; print(json.dumps(json.load(sys.stdin)))' >> results.jsonl
        done < <(python3 -c "$suns")
        echo "$s $c $(python3 -c "$means" results.jsonl)"
    done
done
