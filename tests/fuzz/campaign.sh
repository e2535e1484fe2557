#!/usr/bin/env bash
# Fuzzes every target for a while, one after the other, in slices: may be stopped at any time and goes on where it was.
#
#   tests/fuzz/campaign.sh                    an hour for each target
#   tests/fuzz/campaign.sh model tiff         these targets alone
#   FUZZ_SECONDS=60 tests/fuzz/campaign.sh    this long for each target
#   FUZZ_FOLDER=DIR                           where corpora, findings and logs are (default: tests/fuzz/campaign)
#
# DIR/log.txt has a line for each slice: time, target, seconds, executions, edges and features covered, files of the corpus, findings so far.
set -euo pipefail
cd "$(dirname "$0")"

seconds="${FUZZ_SECONDS:-3600}"
slice="${FUZZ_SLICE_SECONDS:-600}"
mkdir -p "${FUZZ_FOLDER:-campaign}"
folder="$(cd "${FUZZ_FOLDER:-campaign}" && pwd)"
mkdir -p "$folder/findings" "$folder/output"
touch "$folder/log.txt"
build="${CARGO_TARGET_DIR:-$PWD/target}"
host="$(rustc -vV | sed -n 's/^host: //p')"
[ $# -gt 0 ] || set -- $(cargo +nightly fuzz list --fuzz-dir .)

[ "$slice" -le "$seconds" ] || slice="$seconds"
# With debug assertions and overflow checks, under AddressSanitizer.
CARGO_TARGET_DIR="$build" cargo +nightly fuzz build --fuzz-dir . --debug-assertions
CARGO_TARGET_DIR="$build/seeds" cargo +nightly run --quiet --manifest-path Cargo.toml --example seeds -- "$folder/seeds"
[ ! -d /dev/shm ] || export TMPDIR=/dev/shm # the targets `tiff` and `labels` write files each time

# $1: target. Prints the seconds that it has run so far.
spent() {
    awk -v target="$1" '$2 == target { sum += $3 } END { print sum + 0 }' "$folder/log.txt"
}

# $1: file of libFuzzer's output, $2: name of a figure. Prints its last value.
figure() { sed -n "s/.*$2: *\([0-9]*\).*/\1/p" "$1" | tail -1; }

# $1: target. Runs one slice and writes its line.
run_slice() {
    local target="$1" out="$folder/output/$1.txt" options=() begin=$SECONDS ended=0
    mkdir -p "$folder/corpus/$target" "$folder/findings/$target" "$folder/seeds/$target"
    [ ! -f "dictionaries/$target.dict" ] || options+=("-dict=dictionaries/$target.dict")
    [ "$target" != model ] || options+=(-max_len=81920)
    "$build/$host/release/$target" -max_total_time="$slice" -timeout=60 -report_slow_units=60 -rss_limit_mb=3072 -print_final_stats=1 \
        -artifact_prefix="$folder/findings/$target/" "${options[@]}" "$folder/corpus/$target" "$folder/seeds/$target" >"$out" 2>&1 || ended=$?
    printf '%s %s %s s, %s executions, cov %s ft %s corpus %s, findings %s, exit %s\n' "$(date -u +%FT%TZ)" "$target" $((SECONDS - begin)) \
        "$(figure "$out" stat::number_of_executed_units)" "$(figure "$out" cov)" "$(figure "$out" ft)" \
        "$(find "$folder/corpus/$target" -type f | wc -l)" "$(find "$folder/findings/$target" -type f | wc -l)" "$ended" | tee -a "$folder/log.txt"
    [ "$ended" = 0 ] || cp "$out" "$folder/findings/$target.$(date +%s).txt"
}

for target in "$@"; do
    failed=0
    while [ "$(spent "$target")" -lt "$seconds" ] && [ "$failed" -lt 5 ]; do
        before="$(find "$folder/findings" -type f | wc -l)"
        run_slice "$target"
        [ "$(find "$folder/findings" -type f | wc -l)" = "$before" ] || failed=$((failed + 1))
    done
done
if [ -n "$(find "$folder/findings" -type f)" ]; then
    echo "ERROR: expected no findings, found those in $folder/findings" >&2
    exit 1
fi
