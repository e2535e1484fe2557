#!/usr/bin/env bash
# Flips one bit of a register, the stack or the code of a board under QEMU while it makes a tile through the C functions; each injection can be
# made again from its line of the record.
#
#   ./inject.sh --out DIR [--injections N] [--seed S] [--model M.eld] [--no-checks] [BOARD..]    an500 and rv64 unless told
#   ./inject.sh --out DIR --replay RECORD.csv ...                                                the same injections
#
# DIR gets injections.csv; the table is printed. N (100) injections of each class. ./setup.sh installs what is needed. JOBS: runs at once (2).
set -euo pipefail
. "$(dirname "${BASH_SOURCE[0]}")/lib.sh"

model="$root/host-train/models/nano.eld" boards=() passed=()
while [ $# -gt 0 ]; do
    case "$1" in
    --out | --injections | --seed | --replay) [ $# -gt 1 ] || fail "$1: expected a value"; passed+=("$1" "$2"); shift ;;
    --no-checks) passed+=("$1") ;;
    --model) [ $# -gt 1 ] || fail "--model: expected a file"; shift; model="$1" ;;
    -*) fail "expected --out, --injections, --seed, --replay, --model, --no-checks or boards, found '$1'" ;;
    *) boards+=("$1") ;;
    esac
    shift
done
[ ${#boards[@]} -gt 0 ] || boards=(an500 rv64)
expect_boards "${boards[@]}"
expect_tools
for one in "${boards[@]}"; do
    load_board "$one"
    compile elunar-demo --features inject
    program="$(built elunar-demo)"
    "$boards_dir/inject.py" "${passed[@]}" --board "$board" --program "$program" --model "$model" \
        --start "$(address "$program" __model_start)" --end "$(address "$program" __model_end)" --jobs "${JOBS:-2}" -- "${qemu[@]}" "$load"
done
