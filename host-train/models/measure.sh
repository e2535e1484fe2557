#!/usr/bin/env bash
# Prints the tables behind README.md beside it: four scenes of a Moon that no shipped model was trained or validated on.
#
#   host-train/models/measure.sh [FOLDER]     keeps the scenes and predictions in FOLDER (default: a temporary one)
set -euo pipefail
cd "$(dirname "$0")/../.."
out="${1:-$(mktemp -d)}"
run() { cargo run --quiet --package host-train -- "$@"; }

run synth --out "$out" --scenes 4 --seed 424242
for image in "$out"/scene_*_image.tif; do
    scene="${image%_image.tif}"
    for kind in safetensors eld; do
        run predict --image "$image" --coarse "${scene}_coarse.tif" --model "host-train/models/nano.$kind" \
            --output "${scene}_$kind.tif" --threads 2
        run evaluate --dtm "${scene}_$kind.tif" --truth "${scene}_truth.tif" --coarse "${scene}_coarse.tif"
    done
    # As the paper has it: the network changes long wavelengths too.
    run predict --image "$image" --coarse "${scene}_coarse.tif" --model host-train/models/nano.safetensors --no-anchor \
        --output "${scene}_free.tif" --threads 2
    run evaluate --dtm "${scene}_free.tif" --truth "${scene}_truth.tif" --coarse "${scene}_coarse.tif"
done
