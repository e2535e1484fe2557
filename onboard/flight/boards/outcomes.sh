#!/usr/bin/env bash
# Which outcomes every conditional branch of the library has on a board under QEMU, and why a branch need not have both: outcomes.py says what counts.
#
#   ./outcomes.sh [BOARD..]            an500 and e500 unless told; more branches that are not argued than in outcomes.csv is an error
#   ./outcomes.sh --record [BOARD..]   and writes outcomes.csv
#   ./outcomes.sh --missed [BOARD..]   also prints every branch that is not argued
#
# One program makes the calls of ./run.sh --calls, the self test with each kernel, and random calls, changed models and random programs
# (../../../tests/provoke): once with each model below. ./setup.sh installs what is needed. LIMIT_S: seconds for each run (600).
set -euo pipefail
. "$(dirname "${BASH_SOURCE[0]}")/lib.sh"

models=("$root"/host-train/models/nano.eld "$root"/tests/golden/provoked/*.eld)
boards=() passed=()
while [ $# -gt 0 ]; do
    case "$1" in
    --record | --missed) passed+=("$1") ;;
    -*) fail "expected --record, --missed or boards, found '$1'" ;;
    *) boards+=("$1") ;;
    esac
    shift
done
[ ${#boards[@]} -gt 0 ] || boards=(an500 e500)
expect_boards "${boards[@]}"
expect_tools

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
build_plugin outcomes
status=0
for one in "${boards[@]}"; do
    load_board "$one"
    # Lines of what the linker has left out, away from the addresses of what it has kept.
    [[ "${linker[*]}" != *lld* ]] || linker+=(-C "link-arg=-zdead-reloc-in-nonalloc=.debug_*=0xffffffff")
    LIBRARY=core,alloc compile elunar-demo --features provoke
    program="$(built elunar-demo)" edges=()
    for model in "${models[@]}"; do
        name="$one.$(basename "$model" .eld)" ended=0
        edges+=("$work/$name.edges")
        run_with "$build/outcomes.so,out=${edges[-1]}" "$program" "$model" "$work/$name.log" || ended=$?
        reason="$(verdict "$ended" "$work/$name.log")"
        [ -z "$reason" ] || { tail -8 "$work/$name.log" >&2; fail "$name: $reason"; }
    done
    "$boards_dir/outcomes.py" "$one" "$program" "${edges[@]}" "${passed[@]}" || status=1
done
exit $status
