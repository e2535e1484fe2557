#!/usr/bin/env bash
# libelunar.a with the same bytes from any folder.
#
#   ./archive.sh OUT.a [CARGO'S OPTIONS..]   builds it, e.g. with --target thumbv7em-none-eabihf
#   ./archive.sh --check                     builds it from two copies of the sources in folders of their own, and compares them
#
# Cargo mixes the folders of packages into the names of symbols and members, the compiler writes those of sources into messages. So cargo calls
# this script in place of the compiler: names come from packages and their versions, folders get fixed names. Profile: one unit of code, whole
# optimisation (Cargo.toml). Sources, compiler, options and target must be the same.
set -euo pipefail
here="$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)"
fail() { printf 'ERROR: %s\n' "$*" >&2; exit 1; }

# Runs the compiler, "$@", with names that do not depend on the folder; then gives its files the names that cargo looks for.
compile() {
    local words=() word crate="" suffix="" out="" one before="" fixed=""
    fixed="${CARGO_PKG_VERSION:-}" fixed="${fixed//./_}" # none when cargo asks for the version of the compiler
    for word in "$@"; do
        case "$before $word" in
        "--crate-name "*) crate="$word" ;;
        "--out-dir "*) out="$word" ;;
        "-C metadata="*) word="metadata=$CARGO_PKG_NAME-$CARGO_PKG_VERSION" ;;
        "-C extra-filename="*) suffix="${word#extra-filename=}" word="extra-filename=-$fixed" ;;
        esac
        words+=("$word")
        before="$word"
    done
    # Cargo uses the metadata before the compiler is done.
    [ -z "$suffix" ] || ln -sf "lib$crate-$fixed.rmeta" "$out/lib$crate$suffix.rmeta"
    "${words[@]}" --remap-path-prefix="$ELUNAR_SOURCES=/elunar" --remap-path-prefix="${CARGO_HOME:-$HOME/.cargo}=/cargo"
    [ -n "$suffix" ] || return 0
    for one in "$out"/{,lib}"$crate-$fixed"{,.*}; do
        [ ! -e "$one" ] || mv "$one" "${one/"$crate-$fixed"/"$crate$suffix"}"
    done
}

# $1: the archive, $2: the repository; then options of cargo.
build() {
    local out="$1" sources="$2" target="${CARGO_TARGET_DIR:-$2/target}/archive"
    shift 2
    mkdir -p "$target"
    RUSTC_WRAPPER="$here/archive.sh" ELUNAR_SOURCES="$sources" CARGO_INCREMENTAL=0 \
        cargo build --quiet --locked --release --manifest-path "$sources/onboard/flight/Cargo.toml" --package elunar-staticlib \
        --target-dir "$target" "$@"
    # With a target, below a folder of its name.
    cp "$(find "$target" -maxdepth 3 -path '*/release/libelunar.a' -print0 | xargs -0 ls -t | head -1)" "$out"
}

check() {
    local one root
    root="$(cd "$here/../.." && pwd)"
    work="$(mktemp -d)"
    trap 'rm -rf "$work"' EXIT
    for one in one another/folder; do
        mkdir -p "$work/$one"
        (cd "$root" && git ls-files -z | xargs -0 tar -cf -) | tar -xf - -C "$work/$one"
        CARGO_TARGET_DIR="" build "$work/$(basename "$one").a" "$work/$one" "$@"
    done
    cmp "$work/one.a" "$work/folder.a" || fail "two builds of libelunar.a differ"
    echo "$(wc -c <"$work/one.a") bytes, the same from two folders: $(sha256sum "$work/one.a" | cut -c1-16)"
}

case "${1:-}" in
"") fail "expected OUT.a or --check" ;;
--check) shift; check "$@" ;;
*rustc) compile "$@" ;;
*) build "$1" "$(cd "$here/../.." && pwd)" "${@:2}" ;;
esac
