#!/usr/bin/env bash
# Builds what users install, and prints a table of sizes and of the seconds to a first DTM:
# build.sh [binary|deb|wheel|first|arm_binary|arm|container]... All of them without a word. What its tool is missing for is SKIPPED. The files lie in
# target/packages.
set -euo pipefail
cd "$(dirname "$0")/../.."
target="${CARGO_TARGET_DIR:-$PWD/target}"
out="$target/packages"
musl=x86_64-unknown-linux-musl
arm_musl=aarch64-unknown-linux-musl
lean="-C force-unwind-tables=no"
mkdir -p "$out"

skip() { echo "SKIPPED: $1" >&2; }
row() { printf "| %s | %s MB |\n" "$1" "$(awk "BEGIN { printf \"%.1f\", $(stat -c %s "$2") / 1e6 }")"; }

has_target() { [ -d "$(rustc --print sysroot)/lib/rustlib/$1" ]; }

# The static program, with packed models: no library of the system is needed. LLVM's linker joins equal functions and packs relocations.
binary() {
    local lld=()
    if ! command -v musl-gcc >/dev/null || ! has_target "$musl"; then
        skip "binary: no musl-gcc (Debian package musl-tools) or no target (rustup target add $musl)"
        return
    fi
    if command -v ld.lld >/dev/null; then
        lld=(-C link-arg=-fuse-ld=lld -C link-arg=-Wl,--icf=all -C link-arg=-Wl,--pack-dyn-relocs=relr)
    else
        echo "NOTE: binary: larger, as there is no ld.lld (Debian package lld)" >&2
    fi
    RUSTFLAGS="$lean" cargo rustc --quiet --locked --profile small --package elunar --bin elunar --features packed --target "$musl" -- "${lld[@]}"
    cp "$target/$musl/small/elunar" "$out/elunar"
    ! ldd "$out/elunar" 2>/dev/null | grep '=>' >/dev/null || { echo "ERROR: a static program expected" >&2; exit 1; }
    (cd "$out" && tar czf "elunar-$musl.tar.gz" elunar)
    row "static binary" "$out/elunar"
    row "the same, packed for cargo binstall" "$out/elunar-$musl.tar.gz"
}

# The static program with its pages and completions.
deb() {
    cargo deb --version >/dev/null 2>&1 || { skip "deb: no cargo-deb (cargo install cargo-deb --locked)"; return; }
    [ -x "$out/elunar" ] || binary
    [ -x "$out/elunar" ] || return 0
    rm -rf "$out/man" && mkdir "$out/man"
    "$out/elunar" man "$out/man" >/dev/null
    for shell in bash fish zsh; do "$out/elunar" completions "$shell" >"$out/elunar.$shell"; done
    cargo deb --quiet --no-build --no-strip --package elunar --output "$out/elunar.deb"
    row "Debian package" "$out/elunar.deb"
}

wheel() {
    command -v maturin >/dev/null || { skip "wheel: no maturin (pip install maturin)"; return; }
    rm -f "$out"/*x86_64.whl
    maturin build --quiet --locked --out "$out"
    row "Python wheel, x86-64" "$(ls "$out"/*x86_64.whl)"
}

# From an empty virtual environment to a DTM of an image of 1000 x 1000 pixels, with the wheel; numpy is fetched.
first() {
    local folder start seconds
    ls "$out"/*x86_64.whl >/dev/null 2>&1 || wheel
    ls "$out"/*x86_64.whl >/dev/null 2>&1 || return 0
    [ -x "$out/elunar" ] || binary
    [ -x "$out/elunar" ] || return 0
    folder="$(mktemp -d)"
    "$out/elunar" synth --out "$folder" --rows 1000 --cols 1000 >/dev/null
    start="$(date +%s.%N)"
    python3 -m venv "$folder/venv"
    "$folder/venv/bin/pip" install --quiet --no-cache-dir "$out"/*x86_64.whl
    (cd "$folder" && venv/bin/python -c "
import elunardtm
model = elunardtm.Model.load('ground')
model.predict_file('scene_0000_image.tif', 'scene_0000_coarse.tif', 'dtm.tif')")
    seconds="$(awk "BEGIN { printf \"%.1f\", $(date +%s.%N) - $start }")"
    [ -s "$folder/dtm.tif" ] || { echo "ERROR: a DTM expected" >&2; exit 1; }
    rm -r "$folder"
    printf "| from an empty venv to a DTM | %s s |\n" "$seconds"
}

# Zig is the linker, and the C compiler of ring and zstd.
zig() { python3 -c "import ziglang" 2>/dev/null; }

# The static program for aarch64. If QEMU is here, its DTM must have the bytes of that for x86-64.
arm_binary() {
    if ! zig || ! command -v cargo-zigbuild >/dev/null || ! has_target "$arm_musl"; then
        skip "arm_binary: no zig (pip install cargo-zigbuild ziglang) or no target (rustup target add $arm_musl)"
        return
    fi
    RUSTFLAGS="$lean" cargo zigbuild --quiet --locked --profile small --package elunar --features packed --target "$arm_musl"
    cp "$target/$arm_musl/small/elunar" "$out/elunar-aarch64"
    row "static binary, aarch64" "$out/elunar-aarch64"
    command -v qemu-aarch64-static >/dev/null || { skip "arm_binary: not run: no qemu-aarch64-static (Debian package qemu-user-static)"; return; }
    [ -x "$out/elunar" ] || binary
    local folder program
    folder="$(mktemp -d)"
    "$out/elunar" synth --out "$folder/s" --rows 300 --cols 400 >/dev/null
    for program in "$out/elunar" "qemu-aarch64-static $out/elunar-aarch64"; do
        $program predict --image "$folder/s/scene_0000_image.tif" --coarse "$folder/s/scene_0000_coarse.tif" --model ground \
            -o "$folder/dtm.tif" >/dev/null
        sha256sum <"$folder/dtm.tif" >>"$folder/sums"
        rm "$folder"/dtm*
    done
    [ "$(sort -u "$folder/sums" | wc -l)" = 1 ] || { echo "ERROR: the DTMs of x86-64 and aarch64 differ" >&2; exit 1; }
    rm -r "$folder"
}

arm() {
    local gnu=aarch64-unknown-linux-gnu
    if ! zig || ! has_target "$gnu"; then
        skip "arm: no zig (pip install maturin ziglang) or no target (rustup target add $gnu)"
        return
    fi
    rm -f "$out"/*aarch64.whl
    maturin build --quiet --locked --zig --target "$gnu" --out "$out"
    row "Python wheel, aarch64" "$(ls "$out"/*aarch64.whl)"
}

container() {
    local tool
    tool="$(command -v podman || command -v docker || true)"
    [ -n "$tool" ] && "$tool" info >/dev/null 2>&1 || { skip "container: no podman, and no docker that runs"; return; }
    [ -x "$out/elunar" ] || binary
    "$tool" build --quiet -f host-train/packaging/Containerfile -t elunar . >/dev/null
    "$tool" save elunar >"$out/elunar-image.tar"
    row "container image" "$out/elunar-image.tar"
}

[ $# -gt 0 ] || set -- binary deb wheel first arm_binary arm container
printf '| package | size |\n|---|---|\n'
for one in "$@"; do "$one"; done
