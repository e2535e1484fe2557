#!/usr/bin/env bash
# Times one large image with one thread and with two, phase by phase:
#
#   host-train/cluster/one-image.sh target/release/elunar host-train/models/nano.eld [ROWS COLUMNS]
set -euo pipefail

program="$(realpath "${1:?usage: one-image.sh PROGRAM MODEL.eld [ROWS COLUMNS]}")"
model="$(realpath "${2:?usage: one-image.sh PROGRAM MODEL.eld [ROWS COLUMNS]}")"
folder="$(mktemp -d)"
trap 'rm -rf "$folder"' EXIT
cd "$folder"

"$program" synth --out s --rows "${3:-8192}" --cols "${4:-5000}" --seed 5 >/dev/null
for threads in 1 2 1 2; do
    rm -f dtm*
    "$program" predict --image s/scene_0000_image.tif --coarse s/scene_0000_coarse.tif --model "$model" --threads "$threads" --json \
        -o dtm.tif 2>/dev/null >record.json
    echo "threads $threads: $(tr -d '\n" {}' <record.json | sed 's/.*,seconds:/seconds:/')"
done
