#!/usr/bin/env bash
# Builds the example for MPS2 AN500 (Cortex-M7), runs it under QEMU, and compares what it prints with the same work on the host.
#
#   ./run.sh            with a small model of the tests
#   ./run.sh MODEL.eld  with another one, at most 8 MiB, whose strip fits 8 MiB
#
# Needs qemu-system-arm and Rust's target thumbv7em-none-eabihf. With --check it only says what is missing.
set -euo pipefail
here="$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)"
root="$(cd "$here/../.." && pwd)"
target=thumbv7em-none-eabihf
fail() { printf 'ERROR: %s\n' "$*" >&2; exit 1; }

missing=""
command -v qemu-system-arm >/dev/null || missing="qemu-system-arm (Debian package qemu-system-arm)"
[ -d "$(rustc --print sysroot)/lib/rustlib/$target" ] || missing="rustup target add $target"
if [ "${1:-}" = --check ]; then
    echo "$missing"
    [ -z "$missing" ]
    exit
fi
[ -z "$missing" ] || fail "expected $missing"

model="${1:-$root/tests/golden/provoked/guided.eld}"
[ -f "$model" ] || fail "$model: expected a model file, found none"
folder="${CARGO_TARGET_DIR:-$root/target}/embassy"
cd "$here"
expected="$(cargo run --quiet --locked --release --target-dir "$folder" -- "$model")"
MODEL_BYTES="$(wc -c <"$model")" RUSTFLAGS="-C link-arg=-Tlink.x -C target-cpu=cortex-m7" \
    cargo build --quiet --locked --release --target "$target" --target-dir "$folder"
found="$(timeout --foreground 300 qemu-system-arm -M mps2-an500 -nographic -monitor none -serial none -semihosting-config enable=on,target=native \
    -kernel "$folder/$target/release/elunar-embassy" -device "loader,file=$model,addr=0x60000000,force-raw=on" </dev/null)" ||
    fail "the board ended with status $?: $found"
[ "$found" = "$expected" ] || fail "expected of the board '$expected', found '$found'"
echo "PASS embassy on an500: $found, as on the host"
