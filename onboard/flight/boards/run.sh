#!/usr/bin/env bash
# Builds the demo for bare boards, runs the model's self test on each under QEMU, and prints one PASS or FAIL line per board.
#
#   ./run.sh                     every board (a board is a folder with a board.sh)
#   ./run.sh an547 leon3         these
#   ./run.sh --record [BOARD..]  and write their instruction counts into instructions.csv, their limits into BOARD/budget.toml
#   ./run.sh --operators BOARD   print what each operator costs (as CSV; steps by single units, which costs some instructions)
#   ./run.sh --calls [BOARD..]   run tiles, strips, terrain maps and slots through the C functions; heights must be the host's, and no call longer than in calls.csv
#                                (all boards by default; with --model only the heights are compared)
#   ./run.sh --calls --record [BOARD..]  and write calls.csv
#   ./run.sh --model M.eld ...   another model file; its figures are not compared
#
# A board passes if the model opens, every kernel's output is byte for byte the exporter's, no count in instructions.csv has risen
# by more than 3 %, and flash, RAM, stack and instructions stay below its budget.toml. ./setup.sh installs what is needed. JOBS: boards
# at once (2); LIMIT_S: seconds for each run (600).
set -euo pipefail
. "$(dirname "${BASH_SOURCE[0]}")/lib.sh"
table="$boards_dir/instructions.csv" calls_table="$boards_dir/calls.csv"
columns=board,kernel,tile,macs,instructions,instructions_per_mac
max_rise_percent=3

model="$root/host-train/models/nano.eld" compared=yes record=no operators=no calls=no features=() boards=()
while [ $# -gt 0 ]; do
    case "$1" in
    --record) record=yes ;;
    --operators) operators=yes compared=no features=(--features per_operator) ;;
    --calls) calls=yes features=(--features c_calls) ;;
    --model) [ $# -gt 1 ] || fail "--model: expected a file"; shift; model="$1" compared=no ;;
    -*) fail "expected --record, --operators, --calls, --model FILE or boards, found '$1'" ;;
    *) boards+=("$1") ;;
    esac
    shift
done
[ ${#boards[@]} -gt 0 ] || mapfile -t boards < <(all_boards)
expect_boards "${boards[@]}"
[ -f "$model" ] || fail "$model: expected a model file, found none"
[ "$record$compared" != yesno ] || fail "--record: expected the default model and whole tiles, found --model or --operators"
expect_tools

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT

# Joins what the demo says it did with what the counter counted, in rows of the table: a count per kernel.
evaluate() {
    awk -v board="$board" '
        FNR == NR { count[NR] = $1; counts = NR; next }
        { sub(/\r$/, "") }
        $1 == "model" { tile = $7; sub(",", "", tile); macs = $8 }
        $1 == "ran" { sub(":", "", $2); n++; printf("%s,%s,%s,%.0f,%.0f,%.3f\n", board, $2, tile, macs, count[n], count[n] / macs) }
        END { if (n != counts || !n) exit 1 }' "$work/$board.counts" "$work/$board.log"
}

# The same of a run by entries of the schedule: a count per kernel and operator.
evaluate_operators() {
    echo "board,kernel,operator,macs,instructions,instructions_per_mac"
    awk -v board="$board" '
        function flush_kernel(    i) {
            for (i = 0; i <= last; i++)
                printf("%s,%s,%d,%.0f,%.0f,%.3f\n", board, kernel, i, macs[i], sum[i], (macs[i] > 0 ? sum[i] / macs[i] : 0))
            split("", macs); split("", sum); last = -1
        }
        BEGIN { last = -1 }
        FNR == NR { count[NR] = $1; next }
        $1 == "run" { flush_kernel(); kernel = $2 }
        $1 == "at" { macs[$2] += $3; sum[$2] += count[++n]; if ($2 > last) last = $2 }
        END { flush_kernel() }' "$work/$board.counts" "$work/$board.log"
}

# What each C function costs at most, and in all.
evaluate_calls() {
    awk -v board="$board" '
        FNR == NR { count[NR] = $1; next }
        { sub(/\r$/, "") }
        $1 == "tile" && NF == 2 { of = $2 }
        $1 == "call" { c = count[++n]; name = $2 "," of; calls[name]++; all[name] += c; if (c > most[name]) most[name] = c }
        BEGIN { of = "-" }
        END { for (name in calls) printf("%s,%s,%d,%.0f,%.0f\n", board, name, calls[name], most[name], all[name]) }
        ' "$work/$board.counts" "$work/$board.log" | sort
}

# Compares the longest calls with the committed table; prints what is wrong.
compare_calls() {
    awk -F, -v max="$max_rise_percent" '
        FNR == NR { before[$1 "," $2 "," $3] = $5; next }
        {
            key = $1 "," $2 "," $3
            if (!(key in before)) print key ": no such row in calls.csv"
            else if (100 * ($5 / before[key] - 1) > max) printf "%s: a call of %.0f instructions, %.0f recorded\n", key, $5, before[key]
        }' "$calls_table" "$work/$board.rows"
}

# The lines about tiles, which are the same on every machine.
tiles() { tr -d '\r' <"$1" | grep -E '^tile .* sum '; }

# Compares $work/BOARD.rows with the committed table; prints what is wrong.
compare() {
    awk -F, -v max="$max_rise_percent" '
        FNR == NR { before[$1 "," $2 "," $3] = $5; next }
        {
            key = $1 "," $2 "," $3
            if (!(key in before)) { print key ": no such row in instructions.csv"; next }
            rise = 100 * ($5 / before[key] - 1)
            if (rise > max) printf "%s: %.0f instructions, %.1f %% more than recorded\n", key, $5, rise
        }' "$table" "$work/$board.rows"
}

# Compares, or with --record writes, the budget; prints what is wrong.
budget() {
    python3 "$boards_dir/budget.py" "$1" "$boards_dir/$board/budget.toml" "$(built elunar-demo)" "$work/$board.log" "$work/$board.rows" 2>&1
}

# The life of one board, in a process of its own; one line on standard output, complaints after it.
try() {
    local status=0 reason
    load_board "$1"
    compile elunar-demo "${features[@]}" >"$work/$board.log" 2>&1 || { conclude "does not build"; return; }
    run_counted "$(built elunar-demo)" "$model" "$work/$board.log" "$work/$board.counts" || status=$?
    reason="$(verdict "$status" "$work/$board.log")"
    if [ -n "$reason" ]; then :
    elif [ "$calls" = yes ]; then
        tiles "$work/$board.log" | cmp -s - "$work/host.tiles" || reason="other heights than on the host"
        evaluate_calls >"$work/$board.rows"
        [ -n "$reason" ] || [ "$compared$record" != yesno ] || reason="$(compare_calls)"
    elif [ "$operators" = yes ]; then evaluate_operators >"$work/$board.rows"
    elif ! evaluate >"$work/$board.rows"; then reason="the counter saw other marks than the demo passed"
    elif [ "$record" = yes ]; then reason="$(budget record)"
    elif [ "$compared" = yes ]; then
        reason="$(compare; budget compare)"
        [ -z "$reason" ] || reason+=" (if that is meant: ./run.sh --record $board)"
        touch "$work/$board.ran"
    fi
    # For ../proofs, which compares the stack that was used with the stack that can be used.
    [ "$compared$calls" != yesno ] || cp "$work/$board.log" "$build/$board.log"
    conclude "$reason"
}

conclude() {
    if [ -n "$1" ]; then
        [ -e "$work/$board.ran" ] || sed "s/^/    $board: /" "$work/$board.log" | tail -8
        printf 'FAIL %s: %s\n' "$board" "$1"
        return
    fi
    touch "$work/$board.passed"
    if [ "$calls$record" = yesno ]; then
        echo "PASS $board: heights as on the host; longest call $(cut -d, -f5 "$work/$board.rows" | sort -n | tail -1) instructions"
        return
    fi
    if [ "$operators" = yes ]; then
        echo "PASS $board"
        cat "$work/$board.rows"
        return
    fi
    [ "$calls" = no ] || { echo "PASS $board"; return; }
    printf 'PASS %s: tile %s, %s; %s\n' "$board" "$(cut -d, -f3 "$work/$board.rows" | head -1)" \
        "$(awk -F, '{ printf("%s%s %s instructions (%s per MAC)", (NR > 1 ? ", " : ""), $2, $5, $6) }' "$work/$board.rows")" \
        "$(budget print)"
}

build_counter
if [ "$calls" = yes ]; then
    cargo run --quiet --locked --manifest-path "$boards_dir/../Cargo.toml" --package elunar-demo --features c_calls --target-dir "$build/../flight" \
        -- "$model" >"$work/host.log"
    tiles "$work/host.log" >"$work/host.tiles"
fi
in_parallel try "${boards[@]}"

[ "$calls" = no ] || { table="$calls_table" columns=board,function,tile,calls,most_instructions,all_instructions; }
if [ "$record" = yes ]; then
    {
        echo "$columns"
        for one in $(all_boards); do
            if [ -e "$work/$one.passed" ]; then cat "$work/$one.rows"
            elif [ -f "$table" ]; then grep "^$one," "$table" || true; fi
        done
    } >"$work/table"
    cp "$work/table" "$table"
fi
[ "$compared" = yes ] || echo "SKIPPED: comparing instruction counts and budgets: not the shipped model, or not a whole tile"
for one in "${boards[@]}"; do [ -e "$work/$one.passed" ] || exit 1; done
