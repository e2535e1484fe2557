#!/usr/bin/env bash
# What the tests of a package reach of its own source, in lines and in branches, against the limits in coverage.csv.
#
#   tests/coverage.sh [PACKAGE..]             more missed lines or branches than coverage.csv states are errors; fewer are said
#   tests/coverage.sh --write [PACKAGE..]     writes them, and the lines that are missed (missed.csv, for ../onboard/flight/boards/outcomes.sh)
#   tests/coverage.sh --missed [PACKAGE..]    also prints every missed branch and line; else the counts of each file
#
# A package's own unit, integration and documentation tests count. Tests themselves do not count as source, nor do kernels for one kind of processor,
# which another machine does not run. The C programs of elunar-capi do not count: their runs write no profile. Some tests of elunar-raster need GDAL.
#
# A branch is one outcome of a condition. This compiler counts no arm of `match`, and refuses MC/DC: `-Z coverage-options=mcdc` has no meaning for it.
# Counting of branches is unstable, so RUSTC_BOOTSTRAP is set for the packages of this repository alone. LLVM's tools are those of the compiler's LLVM:
# rustup component add llvm-tools, or the Debian package llvm-N.
set -euo pipefail

# As a wrapper of rustc: cargo calls this file for the crates of this repository alone. The package that is measured counts; the others run as fast
# as ever.
if [ -n "${COVERAGE_OF:-}" ]; then
    [[ " $COVERAGE_OF " == *" ${CARGO_PKG_NAME:-none} "* ]] || exec "$@"
    RUSTC_BOOTSTRAP=1 exec "$@" -C instrument-coverage -Z coverage-options=branch
fi

cd "$(dirname "$0")/.."
root="$PWD"
target="$(realpath -m "${CARGO_TARGET_DIR:-$root/target}")/coverage"
options=() packages=()
for word in "$@"; do
    case "$word" in --*) options+=("$word") ;; *) packages+=("$word") ;; esac
done
[ ${#packages[@]} -gt 0 ] || packages=(elunar-core elunar-capi elunar-raster)

# $1: a tool of LLVM. Prints its path: that of the compiler's own, else that of the same LLVM.
tool() {
    local own major
    own="$(rustc --print sysroot)/lib/rustlib/$(rustc -vV | sed -n 's/^host: //p')/bin/$1"
    major="$(rustc -vV | sed -n 's/^LLVM version: \([0-9]*\).*/\1/p')"
    if [ -x "$own" ]; then echo "$own"; else command -v "$1-$major"; fi
}
if ! profdata="$(tool llvm-profdata)" || ! cov="$(tool llvm-cov)"; then
    echo "SKIPPED: coverage, and the overflow checks of core: no llvm-cov of the compiler's LLVM (rustup component add llvm-tools)"
    exit 0
fi

export CARGO_INCREMENTAL=0
export RUSTDOCFLAGS="-C instrument-coverage" # for the linker: the crate's own code is in the library
# The same random cases every time, and no data from outside of the repository, so that the same branches are reached.
export PROPTEST_RNG_SEED=1 PROPTEST_DISABLE_FAILURE_PERSISTENCE=true ELUNAR_SHARED="$target/none"
for package in "${packages[@]}"; do
    made="$target/$package"
    rm -rf "$made" && mkdir -p "$made"
    # Cargo tells builds of the repository's crates apart by their wrapper's path, and shares all others with `cargo test`. C interface and rasters
    # stand on the same crates, so these are built once for both.
    if [ "$package" = elunar-core ]; then export COVERAGE_OF="$package"; else export COVERAGE_OF="elunar-capi elunar-raster"; fi
    export RUSTC_WORKSPACE_WRAPPER="$target/rustc-${COVERAGE_OF// /-}"
    ln -sf "$root/tests/coverage.sh" "$RUSTC_WORKSPACE_WRAPPER"
    # Core has these checks here alone: a setting, not a profile of its own, so that what it depends on is not compiled again.
    checks=()
    for check in overflow-checks debug-assertions; do
        [ "$package" != elunar-core ] || checks+=(--config "profile.dev.package.elunar-core.$check=true")
    done
    export LLVM_PROFILE_FILE="$made/%p-%m.profraw"
    # The programs have the map of the source, each run adds its counts.
    cargo test --locked "${checks[@]}" --package "$package" --lib --bins --tests --no-run --message-format=json |
        sed -n 's/.*"executable":"\([^"]*\)".*/\1/p' >"$made/programs"
    find "$made" -name '*.profraw' -delete # of build scripts
    cargo test --locked "${checks[@]}" --package "$package" --quiet >"$made/log" 2>&1 || { cat "$made/log"; exit 1; }
    "$profdata" merge --sparse --failure-mode=all "$made"/*.profraw -o "$made/merged.profdata"
    # Each program by itself: of functions with one name in several programs, llvm-cov keeps one.
    while read -r program; do
        found="$made/$(basename "$program")"
        export_() { "$cov" export "$@" "$program" --instr-profile "$made/merged.profdata" 2>>"$made/warnings"; }
        export_ --format=text --skip-functions --skip-expansions >"$found.json"
        export_ --format=lcov >"$found.info"
    done <"$made/programs"
done
exec tests/coverage.py "$target" "${options[@]}" "${packages[@]}"
