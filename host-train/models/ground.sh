#!/usr/bin/env bash
# The training of `ground`. g1 (at commit 3fca3c4, stopped at 6,720 steps) took 94 minutes, g2 50 and g3 137 (at 05caa25), on one core of an AMD
# EPYC. From a folder with nano.safetensors; HERE: host-train/models.
set -euo pipefail
here="${HERE:-host-train/models}"
train() {
    host-train train --config "$here/wide-moon.toml" --start-from "$1" --steps "$2" --learning-rate "$3" --seed "$4" --out "$5" \
        --set recipe.validation_tiles=48 "recipe.validate_every=$6"
}
host-train init --from nano.safetensors --set network.detail=32 network.detail_inner=16 network.detail_blocks=2 --seed 5 -o ground0.safetensors
train ground0.safetensors 10000 1e-3 401 g1 1000
train g1/last.safetensors 3600 7e-4 402 g2 600
train g2/last.safetensors 9000 8e-4 403 g3 1000
cp g3/last.safetensors ground.safetensors
