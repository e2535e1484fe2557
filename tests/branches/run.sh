#!/usr/bin/env bash
# No branch of the network's steps follows the data, shown by Valgrind: samples and arena are marked as undefined, so that Memcheck reports every
# conditional jump, and every address, that depends on them.
#
#   tests/branches/run.sh            a report that expected.csv does not list is an error, as is a listed one that does not come; so is another record
#   tests/branches/run.sh --write    writes record.csv
#   tests/branches/run.sh --check    says what is missing here
#
# With the kernels `scalar` and `avx2` (Valgrind has no AVX-512): nano, the models of tests/golden/provoked, and 200 random programs; each without
# and with the check of products. Then a planted branch and look-up must be found. Outside: what follows the data on purpose, that is the preparation of a tile
# (scaling, light) and the heights made from the output (validity, fit).
set -euo pipefail
cd "$(dirname "$0")/../.."

missing() {
    [ "$(uname -sm)" = "Linux x86_64" ] || { echo "Linux on x86-64 is expected, this is $(uname -sm)"; return; }
    command -v valgrind >/dev/null || { echo "Valgrind is not here (Debian package valgrind)"; return; }
    grep -qw avx2 /proc/cpuinfo || echo "this processor has no AVX2"
}
why="$(missing)"
case "${1:-}" in
--check) [ -z "$why" ] || { echo "$why"; exit 1; }; exit ;;
--write | "") ;;
*) echo "ERROR: expected --write or --check, found '$1'" >&2; exit 1 ;;
esac
[ -z "$why" ] || { echo "SKIPPED: branches: $why"; exit 0; }

export CARGO_PROFILE_DEV_DEBUG=line-tables-only # reports name lines
cargo build --locked --quiet --package elunar-branches
program="${CARGO_TARGET_DIR:-target}/debug/elunar-branches"
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT

# $1: a kernel. $2: a model or `programs`. $3: `planted` or nothing. Leaves a report and the counts.
examine() {
    local name
    name="$work/$1-$(basename "$2")${3:+-$3}"
    valgrind --leak-check=no --error-limit=no --num-callers=16 --read-inline-info=yes --expensive-definedness-checks=yes --xml=yes --xml-file="$name.xml" \
        "$program" "$@" >"$name.counts"
}

of_kernel() {
    local model
    for model in host-train/models/nano.eld tests/golden/provoked/*.eld programs; do examine "$1" "$model"; done
}

of_kernel avx2 &
avx2=$!
of_kernel scalar
examine scalar programs planted
wait "$avx2"
tests/branches/report.py "$work" "$@"
