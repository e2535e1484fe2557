#!/usr/bin/env bash
# Crates of the registry with our patches, for a build: copies them to target/patched and prints Cargo's option for them.
#
#   cargo build -p host-train --features vulkan --config "$(host-train/gpu/patched.sh)"
#
# Cargo.lock stays as it is. A patch is patches/<crate>-<version>.diff.
set -euo pipefail
here="$(cd "$(dirname "$0")" && pwd)"
root="$(cd "$here/../.." && pwd)"
to="${CARGO_TARGET_DIR:-$root/target}/patched"
fail() { printf 'ERROR: patched.sh: %s\n' "$*" >&2; exit 1; }
command -v patch >/dev/null || fail "expected the program patch (Debian package patch), found none"

# Where Cargo keeps the sources of all packages, fetched if need be.
manifests="$(cargo metadata --locked --format-version 1 --manifest-path "$root/Cargo.toml" --features host-train/vulkan |
    tr '"' '\n' | grep '/Cargo.toml$' | sort -u)"
mkdir -p "$to"
paths=()
for diff in "$here"/patches/*.diff; do
    crate="$(basename "$diff" .diff)"
    manifest="$(grep "/$crate/Cargo.toml$" <<<"$manifests" | head -1)" || fail "$crate: expected it in Cargo.lock, found none"
    # Made anew only if something differs, so that Cargo does not build it again.
    fresh="$(mktemp -d "$to/new.XXXXXX")"
    cp -R "$(dirname "$manifest")/." "$fresh"
    patch --silent --no-backup-if-mismatch -p1 -d "$fresh" <"$diff" || fail "$crate: expected the patch to fit, found that it does not"
    if diff -rq "$fresh" "$to/$crate" >/dev/null 2>&1; then
        rm -rf "$fresh"
    else
        rm -rf "${to:?}/$crate"
        mv "$fresh" "$to/$crate"
    fi
    paths+=("\"$to/$crate\"")
done
(IFS=,; printf 'paths=[%s]\n' "${paths[*]}")
