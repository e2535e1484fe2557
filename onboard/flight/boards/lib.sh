# What the scripts of this folder and of ../proofs have in common; to be sourced.

boards_dir="$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)"
root="$(cd "$boards_dir/../../.." && pwd)"
proofs_dir="$boards_dir/../proofs"
build="${CARGO_TARGET_DIR:-$root/target}/boards"
llvm="$(/usr/bin/rustc -vV 2>/dev/null | sed -n 's/^LLVM version: \([0-9]*\).*/\1/p')"
export QEMU_AUDIO_DRV=none ELUNAR_LLVM="$llvm" PYTHONDONTWRITEBYTECODE=1

fail() { printf 'ERROR: %s\n' "$*" >&2; exit 1; }

# Names of all boards: a board is a folder with a board.sh.
all_boards() { local one; for one in "$boards_dir"/*/board.sh; do basename "$(dirname "$one")"; done; }

# Stops unless every argument is a board.
expect_boards() { local one; for one in "$@"; do [ -f "$boards_dir/$one/board.sh" ] || fail "expected a board with a folder in $boards_dir, found '$one'"; done; }

expect_tools() { "$boards_dir/setup.sh" --check >&2 || fail "expected the cross toolchain and QEMU: run $boards_dir/setup.sh"; }

# Sets the variables of board $1: target, flags, linker, qemu, load, exit_status, soft_float, features_of_core.
load_board() {
    board="$1" linker=() flags=() qemu=() load=-kernel exit_status=yes soft_float=no features_of_core="" target=""
    . "$boards_dir/$board/board.sh"
    [ ${#linker[@]} -gt 0 ] || linker=(-C "linker=ld.lld-$llvm" -C linker-flavor=ld.lld)
    # For the disassembler, which else knows no vectors.
    export ELUNAR_CPU=""
    [[ "${flags[*]}" =~ target-cpu=([^ ]+) ]] && ELUNAR_CPU="${BASH_REMATCH[1]}" || true
}

# Builds package $1 for the loaded board; further arguments go to cargo. Debian's cargo and rustc, never rustup's: only they have
# the sources of `core` at their own version, which the unstable -Zbuild-std wants. Frames' sizes are written beside the code. LIBRARY: what is
# built of Rust's library (core).
compile() {
    local package="$1" std=()
    shift
    [ -z "$features_of_core" ] || std=("-Zbuild-std-features=$features_of_core")
    ELUNAR_BOARD="$board" RUSTFLAGS="-Z emit-stack-sizes ${linker[*]} ${flags[*]}" RUSTC=/usr/bin/rustc RUSTC_BOOTSTRAP=1 \
        /usr/bin/cargo build --quiet --locked -Zbuild-std="${LIBRARY:-core}" "${std[@]}" \
        --manifest-path "$boards_dir/../Cargo.toml" --package "$package" --profile board --target "$target" \
        --target-dir "$build/$board" "$@"
}

# Where compile leaves its results.
built() { echo "$build/$board/$target/board/$1"; }

# Address of symbol $2 in program $1.
address() { "llvm-nm-$llvm" "$1" | awk -v name="$2" '$3 == name { print "0x" $1 }'; }

# Builds the instruction counter.
build_counter() { build_plugin instructions && mv "$build/instructions.so" "$build/counter.so"; }

# Builds plugin $1 of counter/.
build_plugin() { mkdir -p "$build" && "$boards_dir/counter/build.sh" qemu-system-arm "$1" "$build/$1.so"; }

# Runs program $1 with model $2 on the loaded board; what it prints goes to file $3, what is counted between its marks to file $4.
run_counted() {
    local counting
    counting="start=$(address "$1" elunar_count_start),stop=$(address "$1" elunar_count_stop),out=$4"
    run_with "$build/counter.so,$counting" "$1" "$2" "$3"
}

# Runs program $2 with model $3 on the loaded board under plugin $1; what it prints goes to file $4.
run_with() {
    timeout --foreground "${LIMIT_S:-600}" "${qemu[@]}" "$load" "$2" -plugin "$1" \
        -device "loader,file=$3,addr=$(address "$2" __model_start),force-raw=on" </dev/null >"$4" 2>&1
}

# What is wrong with a run that ended with status $1 and printed file $2; nothing if it passed.
verdict() {
    if [ "$1" = 124 ]; then echo "not done after ${LIMIT_S:-600} s"
    elif [ "$(tr -d '\r' <"$2" | grep -xE 'PASS|FAIL' | tail -1)" != PASS ]; then echo "no PASS at the end of its output"
    elif [ "$exit_status" = yes ] && [ "$1" != 0 ]; then echo "exit status $1"; fi
}

# Calls "$1 ARGUMENT" for the other arguments, JOBS (2) at once.
in_parallel() {
    local what="$1" one
    shift
    for one in "$@"; do
        while [ "$(jobs -rp | wc -l)" -ge "${JOBS:-2}" ]; do wait -n || true; done
        "$what" "$one" &
    done
    wait
}
