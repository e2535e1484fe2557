#!/usr/bin/env bash
# Proofs about what is linked for the boards: one PASS or FAIL line per proof and board.
#
#   ./run.sh                          stack, heap, archive, floats, steps on every board
#   ./run.sh an500 rv32               on these
#   ./run.sh --proof panics [BOARD..] only this one (may be given several times)
#
#   stack    the stack of every call of the library has a bound, in the demo and in the archive: no recursion, no unlisted call through a
#            pointer; and what the demo painted stays below it (after ../boards/run.sh, which leaves its log)
#   heap     neither the demo nor the archive contains an allocator, `alloc` or `std`
#   archive  linked into one object, all that the archive offers wants nothing from outside but what every C library has (list below)
#   floats   between quantise and dequantise there is no floating point (boards without floating-point unit)
#   steps    every step takes exactly as many instructions for one tile as for another (boards named in STEPS)
#   panics   no panic is reachable: an image of the archive in which a panic would be an undefined symbol links
#
# JOBS: boards at once (2). What each proof rests on: README.md.
set -euo pipefail
. "$(dirname "${BASH_SOURCE[0]}")/../boards/lib.sh"

# What Rust's compiler may call by itself, and every C library offers.
C_LIBRARY='memcpy|memmove|memset|memcmp|bcmp'
# Symbols that give away an allocator or the standard library, in either of Rust's mangling schemes.
FORBIDDEN='__rust_alloc|__rust_realloc|__rust_dealloc|__rdl_|__rg_|__rust_no_alloc_shim|3std|5alloc[0-9]|^(malloc|calloc|realloc|free)$'
# Where steps are counted: a processor with conditional instructions that divides 64 bits in software, and one the other way round.
STEPS='an500 rv64'
# Functions of the archive that others call: the C interface, and the runner's interface of staticlib/src/proof.rs.
ROOT='^(eld|elunar)_'
PROBE=elunar_a_panic_is_reachable

proofs=() boards=()
while [ $# -gt 0 ]; do
    case "$1" in
    --proof) [ $# -gt 1 ] || fail "--proof: expected a name"; shift; proofs+=("$1") ;;
    -*) fail "expected --proof NAME or boards, found '$1'" ;;
    *) boards+=("$1") ;;
    esac
    shift
done
[ ${#proofs[@]} -gt 0 ] || proofs=(stack heap archive floats steps)
for one in "${proofs[@]}"; do
    case "$one" in stack | heap | archive | floats | steps | panics) ;; *) fail "expected a proof (stack heap archive floats steps panics), found '$one'" ;; esac
done
[ ${#boards[@]} -gt 0 ] || mapfile -t boards < <(all_boards)
expect_boards "${boards[@]}"
expect_tools

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
archive() { built libelunar.a; }

# The board's linker, as a command.
link() {
    local words="${linker[*]}" emulation=()
    [[ "$words" =~ link-arg=(-m[^ ]+) ]] && emulation=("${BASH_REMATCH[1]}")
    [[ "$words" =~ linker=([^ ]+) ]]
    "${BASH_REMATCH[1]}" "${emulation[@]}" "$@"
}

symbols() { "llvm-nm-$llvm" "$1" 2>/dev/null; }

# Sets `roots`: what makes a linker take all that the archive offers.
roots() {
    local one
    for one in $(symbols "$(archive)" | awk '$2 == "T" { print $NF }' | grep -E "$ROOT" | sort -u); do roots+=(-u "$one"); done
    [ ${#roots[@]} -gt 0 ] || { echo "expected functions in the archive, found none"; return 1; }
}

# Links what the archive offers, and what that needs, into a program of its own that leaves the panic handler's probe open.
link_image() {
    link --gc-sections -e "${roots[1]}" "${roots[@]}" --unresolved-symbols=ignore-all -o "$1" "$(archive)" >"$work/$board.link" 2>&1 ||
        { head -3 "$work/$board.link"; return 1; }
}

prove_stack() {
    local log="$build/$board.log" image="$build/$board.image" roots=() demo library
    [ "$log" -nt "$(built elunar-demo)" ] || { echo "expected the log of this program, found none: run ../boards/run.sh $board first"; return 1; }
    demo="$(python3 "$proofs_dir/stack.py" "$(built elunar-demo)" "$log" 2>/dev/null)" || { echo "demo: $demo"; return 1; }
    roots && link_image "$image" || return 1
    library="$(python3 "$proofs_dir/stack.py" "$image" 2>/dev/null)" || { echo "archive: $library"; return 1; }
    echo "demo $demo; archive $library"
}

prove_heap() {
    local file names
    for file in "$(built elunar-demo)" "$(archive)"; do
        names="$(symbols "$file" | awk 'NF >= 2 { print $NF }' | sort -u)"
        # A file without our code would pass for the wrong reason.
        [ "$(grep -c elunar_core <<<"$names")" -gt 5 ] || { echo "$file: expected the symbols of elunar-core, found almost none"; return 1; }
        if grep -E "$FORBIDDEN" <<<"$names" | head -3; then return 1; fi
    done
    echo "no allocator, no alloc, no std in demo and archive"
}

prove_archive() {
    local all="$work/$board.o" roots=() wanted more
    roots || return 1
    link -r --gc-sections "${roots[@]}" -o "$all" "$(archive)" 2>&1 || return 1
    # Undefined, and still referred to: what was left out leaves its names behind.
    wanted="$(comm -12 <("llvm-nm-$llvm" -u "$all" | awk '{ print $NF }' | sort -u) \
        <("llvm-readelf-$llvm" -r "$all" | awk 'NF >= 5 { print $5 }' | sort -u))"
    more="$(grep -vxE "$C_LIBRARY|$PROBE" <<<"$wanted" || true)"
    [ -z "$more" ] || { echo "undefined: $(tr '\n' ' ' <<<"$more")"; return 1; }
    wanted="$(grep -vxE "$PROBE|" <<<"$wanted" | paste -sd ' ')"
    echo "undefined: ${wanted:-nothing}"
}

prove_floats() { python3 "$proofs_dir/floats.py" "$(built elunar-demo)"; }

prove_steps() {
    local model="$root/host-train/models/nano.eld" program="$work/$board.steps" status=0 reason half
    compile elunar-demo --features two_tiles >"$work/$board.log" 2>&1 || { echo "the demo does not build with two tiles"; return 1; }
    cp "$(built elunar-demo)" "$program"
    run_counted "$program" "$model" "$work/$board.log" "$work/$board.counts" || status=$?
    reason="$(verdict "$status" "$work/$board.log")"
    [ -z "$reason" ] || { echo "$reason"; return 1; }
    half=$(($(wc -l <"$work/$board.counts") / 2))
    [ "$half" -gt 100 ] || { echo "expected hundreds of steps, counted $half"; return 1; }
    # The first tile's counts, the second's, and where in the program they began.
    paste <(head -n "$half" "$work/$board.counts") <(tail -n "+$((half + 1))" "$work/$board.counts") \
        <(tr -d '\r' <"$work/$board.log" | awk '$1 == "at" { print $2 }' | tail -n "$half") |
        awk '
        { if ($1 > most) most = $1 }
        $1 != $2 {
            differ++
            d = 100 * ($1 > $2 ? $1 - $2 : $2 - $1) / $1
            if (d > worst) { worst = d; place = $3 }
        }
        END {
            printf("%d steps, the longest %d instructions; between two tiles %d differ", NR, most, differ)
            if (differ) printf(", by up to %.2f %% (operator %d)", worst, place)
            print ""
            exit differ > 0
        }'
}

prove_panics() {
    local image="$build/$board.image" roots=()
    roots || return 1
    if link --gc-sections -e "${roots[1]}" "${roots[@]}" -o "$work/$board.image" "$(archive)" >"$work/$board.link" 2>&1; then
        echo "$((${#roots[@]} / 2)) functions link without a panic"
        return
    fi
    grep -q "$PROBE" "$work/$board.link" || { head -3 "$work/$board.link"; return 1; }
    # What still refers to it is found in a program with the probe left open.
    link_image "$image" || return 1
    echo "reachable from $(python3 "$proofs_dir/panic_sites.py" "$image" | wc -l) places; list them with panic_sites.py $image"
    return 1
}

# Whether a proof is about the loaded board.
applies() {
    case "$1" in
    floats) [ "$soft_float" = yes ] ;;
    steps) [[ " $STEPS " == *" $board "* ]] ;;
    esac
}

# Builds what a proof looks at.
needs() {
    case "$1" in
    floats) compile elunar-demo ;;
    stack | heap) compile elunar-demo && compile elunar-staticlib --features proof ;;
    archive | panics) compile elunar-staticlib --features proof ;;
    esac
}

# All proofs of one board, in a process of its own.
prove() {
    local proof words
    load_board "$1"
    for proof in "${proofs[@]}"; do
        applies "$proof" || continue
        # Cargo knows what is fresh.
        if ! needs "$proof" >"$work/$board.build" 2>&1; then
            tail -5 "$work/$board.build" | sed "s/^/    $board: /"
            echo "FAIL $board $proof: does not build"
        elif words="$("prove_$proof")"; then
            echo "PASS $board $proof: $words"
            touch "$work/$board.$proof.passed"
        else
            echo "FAIL $board $proof: $words"
        fi
    done
}

[[ " ${proofs[*]} " != *" steps "* ]] || build_counter
in_parallel prove "${boards[@]}"
for one in "${boards[@]}"; do
    load_board "$one"
    for proof in "${proofs[@]}"; do
        ! applies "$proof" || [ -e "$work/$one.$proof.passed" ] || exit 1
    done
done
