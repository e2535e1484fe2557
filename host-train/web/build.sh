#!/usr/bin/env bash
# Builds the page into a folder, target/page unless told: the program for WebAssembly with SIMD and without, the model `nano`, the example.
#
#   host-train/web/build.sh [FOLDER]
set -euo pipefail
cd "$(dirname "$0")/../.."
target="${CARGO_TARGET_DIR:-$PWD/target}"
page="${1:-$target/page}"
wasm=wasm32-wasip1

[ -d "$(rustc --print sysroot)/lib/rustlib/$wasm" ] ||
    { echo "ERROR: the target $wasm expected, none found (rustup target add $wasm)" >&2; exit 1; }
mkdir -p "$page"
for features in "" +simd128; do
    RUSTFLAGS="${features:+-C target-feature=$features}" cargo build --locked --profile web --package elunar-web --target "$wasm" \
        --target-dir "$target/web$features"
    gzip -9 -n -c "$target/web$features/$wasm/web/elunar-web.wasm" > "$page/elunar${features/+/-}.wasm.gz"
done
cp host-train/web/page/* host-train/web/example/*.tif host-train/models/nano.eld host-train/elunar/src/html/*.{js,css} "$page"
echo "$page: $(du -sh --apparent-size "$page" | cut -f1), of it $(stat -c %s "$page/elunar-simd128.wasm.gz") bytes of program"
