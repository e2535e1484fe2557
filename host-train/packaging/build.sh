#!/usr/bin/env bash
# Builds what users install, and prints a table of sizes: build.sh [binary|deb|wheel|arm|container]... All of them without a word. What its tool is
# missing for is SKIPPED. The files lie in target/packages.
set -euo pipefail
cd "$(dirname "$0")/../.."
target="${CARGO_TARGET_DIR:-$PWD/target}"
out="$target/packages"
musl=x86_64-unknown-linux-musl
mkdir -p "$out"

skip() { echo "SKIPPED: $1" >&2; }
row() { printf "| %s | %s MB |\n" "$1" "$(awk "BEGIN { printf \"%.1f\", $(stat -c %s "$2") / 1e6 }")"; }

# The static program, with packed models: no library of the system is needed.
binary() {
    if ! command -v musl-gcc >/dev/null || [ ! -d "$(rustc --print sysroot)/lib/rustlib/$musl" ]; then
        skip "binary: no musl-gcc (Debian package musl-tools) or no target (rustup target add $musl)"
        return
    fi
    cargo build --quiet --locked --profile small --package elunar --features packed --target "$musl"
    cp "$target/$musl/small/elunar" "$out/elunar"
    ! ldd "$out/elunar" 2>/dev/null | grep -q '=>' || { echo "ERROR: a static program expected" >&2; exit 1; }
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

# Zig is the linker, and the C compiler of zstd.
arm() {
    local gnu=aarch64-unknown-linux-gnu
    if ! python3 -c "import ziglang" 2>/dev/null || [ ! -d "$(rustc --print sysroot)/lib/rustlib/$gnu" ]; then
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

[ $# -gt 0 ] || set -- binary deb wheel arm container
printf '| package | size |\n|---|---|\n'
for one in "$@"; do "$one"; done
