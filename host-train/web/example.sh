#!/usr/bin/env bash
# Makes the example of the page, a scene of the synthetic Moon.
#
#   host-train/web/example.sh [ELUNAR]
set -euo pipefail
cd "$(dirname "$0")"
scenes="$(mktemp -d)"
"${1:-../../target/release/elunar}" synth --out "$scenes" --scenes 2 --seed 4 --rows 384 --cols 480 --sun-elevation-deg 18 32
for what in image coarse; do cp "$scenes/scene_0001_$what.tif" "example/example_$what.tif"; done
rm -r "$scenes"
