#!/usr/bin/env bash
# Builds the demo for bare boards, runs the model's self test on each under QEMU, and prints one PASS or FAIL line per board.
#
#   ./run.sh                     every board (a board is a folder with a board.sh)
#   ./run.sh an547 leon3         these
#   ./run.sh --record [BOARD..]  and write their instruction counts into instructions.csv
#   ./run.sh --operators BOARD   print what each operator costs (as CSV; steps by single units, which costs some instructions)
#   ./run.sh --model M.eld ...   another model file; its counts are not compared
#
# A board passes if the model opens, every kernel's output is byte for byte the exporter's, and no count in instructions.csv
# has risen by more than 3 %. ./setup.sh installs what is needed. JOBS: boards at once (2); LIMIT_S: seconds for each run (300).
set -euo pipefail
here="$(cd "$(dirname "$0")" && pwd)"
root="$(cd "$here/../../.." && pwd)"
build="${CARGO_TARGET_DIR:-$root/target}/boards"
table="$here/instructions.csv"
columns=board,kernel,tile,macs,instructions,instructions_per_mac
max_rise_percent=3
export QEMU_AUDIO_DRV=none

fail() { printf 'ERROR: %s\n' "$*" >&2; exit 1; }

model="$root/host-train/models/nano.eld" compared=yes record=no operators=no features=() boards=()
while [ $# -gt 0 ]; do
    case "$1" in
    --record) record=yes ;;
    --operators) operators=yes compared=no features=(--features per_operator) ;;
    --model) [ $# -gt 1 ] || fail "--model: expected a file"; shift; model="$1" compared=no ;;
    -*) fail "expected --record, --operators, --model FILE or boards, found '$1'" ;;
    *) boards+=("$1") ;;
    esac
    shift
done
[ ${#boards[@]} -gt 0 ] || for one in "$here"/*/board.sh; do boards+=("$(basename "$(dirname "$one")")"); done
for one in "${boards[@]}"; do [ -f "$here/$one/board.sh" ] || fail "expected a board with a folder in $here, found '$one'"; done
[ -f "$model" ] || fail "$model: expected a model file, found none"
[ "$record$compared" != yesno ] || fail "--record: expected the default model and whole tiles, found --model or --operators"
"$here/setup.sh" --check >&2 || fail "expected the cross toolchain and QEMU: run $here/setup.sh"

llvm="$(/usr/bin/rustc -vV | sed -n 's/^LLVM version: \([0-9]*\).*/\1/p')"
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
mkdir -p "$build"

# QEMU's plugin interface has no version that old and new releases take.
counter() {
    local release api=1
    release="$(qemu-system-arm --version | sed -n '1s/.*version \([0-9]*\).*/\1/p')"
    [ "$release" -lt 9 ] || api=2
    cc -O2 -Wall -Wextra -Werror -shared -fPIC -fvisibility=hidden -DAPI=$api -o "$build/counter.so" "$here/counter/instructions.c"
}

# Builds for a board; its variables are set. Debian's cargo and rustc, never rustup's: only they have the sources of `core` at
# their own version, which the unstable -Zbuild-std wants.
compile() {
    [ ${#linker[@]} -gt 0 ] || linker=(-C "linker=ld.lld-$llvm" -C linker-flavor=ld.lld)
    ELUNAR_BOARD="$board" RUSTFLAGS="${linker[*]} ${flags[*]}" RUSTC=/usr/bin/rustc RUSTC_BOOTSTRAP=1 \
        /usr/bin/cargo build --quiet --locked -Zbuild-std=core --manifest-path "$here/../Cargo.toml" --package elunar-demo \
        --profile board "${features[@]}" --target "$target" --target-dir "$build/$board" || return
    elf="$build/$board/$target/board/elunar-demo"
}

# Address of a symbol.
address() { "llvm-nm-$llvm" "$elf" | awk -v name="$1" '$3 == name { print "0x" $1 }'; }

run() {
    local counting
    counting="start=$(address elunar_count_start),stop=$(address elunar_count_stop),out=$work/$board.counts"
    timeout --foreground "${LIMIT_S:-300}" "${qemu[@]}" -kernel "$elf" -plugin "$build/counter.so,$counting" \
        -device "loader,file=$model,addr=$(address __model_start),force-raw=on" </dev/null >"$work/$board.log" 2>&1
}

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

# The life of one board, in a process of its own; one line on standard output, complaints into $work/BOARD.wrong.
try() {
    local board="$1" linker=() flags=() exit_status=yes target qemu elf status=0 reason=""
    . "$here/$board/board.sh"
    compile >"$work/$board.log" 2>&1 || { conclude "does not build"; return; }
    run || status=$?
    if [ "$status" = 124 ]; then reason="not done after ${LIMIT_S:-300} s"
    elif [ "$(tr -d '\r' <"$work/$board.log" | grep -xE 'PASS|FAIL' | tail -1)" != PASS ]; then reason="no PASS at the end of its output"
    elif [ "$exit_status" = yes ] && [ "$status" != 0 ]; then reason="exit status $status"
    elif [ "$operators" = yes ]; then evaluate_operators >"$work/$board.rows"
    elif ! evaluate >"$work/$board.rows"; then reason="the counter saw other marks than the demo passed"
    elif [ "$compared" = yes ] && [ "$record" = no ]; then
        reason="$(compare)"
        [ -z "$reason" ] || reason+=" (if that is meant: ./run.sh --record $board)"
        touch "$work/$board.ran"
    fi
    conclude "$reason"
}

conclude() {
    local figures
    if [ -n "$1" ]; then
        [ -e "$work/$board.ran" ] || sed "s/^/    $board: /" "$work/$board.log" | tail -8
        printf 'FAIL %s: %s\n' "$board" "$1"
        return
    fi
    touch "$work/$board.passed"
    if [ "$operators" = yes ]; then
        echo "PASS $board"
        cat "$work/$board.rows"
        return
    fi
    figures="$(awk -F, '{ printf("%s%s %s instructions (%s per MAC)", (NR > 1 ? ", " : ""), $2, $5, $6) }' "$work/$board.rows")"
    printf 'PASS %s: tile %s, %s\n' "$board" "$(cut -d, -f3 "$work/$board.rows" | head -1)" "$figures"
}

counter
for one in "${boards[@]}"; do
    while [ "$(jobs -rp | wc -l)" -ge "${JOBS:-2}" ]; do wait -n; done
    try "$one" &
done
wait

if [ "$record" = yes ]; then
    {
        echo "$columns"
        for one in "$here"/*/board.sh; do
            one="$(basename "$(dirname "$one")")"
            if [ -e "$work/$one.passed" ]; then cat "$work/$one.rows"
            elif [ -f "$table" ]; then grep "^$one," "$table" || true; fi
        done
    } >"$work/table"
    cp "$work/table" "$table"
fi
[ "$compared" = yes ] || echo "SKIPPED: comparing instruction counts: not the shipped model, or not a whole tile"
for one in "${boards[@]}"; do [ -e "$work/$one.passed" ] || exit 1; done
