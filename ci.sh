#!/usr/bin/env bash
# The one check: run it before you commit; continuous integration runs the same file.
#
#   ./ci.sh               every step of `everything`, in its order
#   ./ci.sh format lint   only these steps, of either list below
#
# The first run fetches crates; later runs work offline (CARGO_NET_OFFLINE=true ./ci.sh). With LATEST_START, in seconds since 1970, no step
# behind `test` begins after that time: it says that it is skipped. Continuous integration must end in time, whatever its machine.
set -euo pipefail
cd "$(dirname "$0")"

# The steps: each is a function below.
everything=(format lint supply book test python page no_std coverage asan branches boards miri backends vulkan cluster)
on_request=(architecture order fuzz no_panic outcomes) # `test` has the first, the others take longest

target="${CARGO_TARGET_DIR:-$PWD/target}"
flight=onboard/flight/Cargo.toml
bare=thumbv7em-none-eabihf # Cortex-M4F and M7: no operating system, so nothing of std exists there

say() { printf '\n== %s\n' "$*"; }
fail() { printf 'ERROR: %s\n' "$*" >&2; exit 1; }

format() {
    cargo fmt --all --check
    cargo fmt --manifest-path "$flight" --all --check
    cargo fmt --manifest-path onboard/embassy/Cargo.toml --check
    cargo fmt --manifest-path tests/fuzz/Cargo.toml --check
}

lint() {
    cargo clippy --locked --workspace --all-targets -- -D warnings
    cargo clippy --locked --manifest-path "$flight" --workspace --target-dir "$target/flight" -- -D warnings
    RUSTDOCFLAGS="-D warnings" cargo doc --locked --no-deps --package elunar-core --package elunar-capi
    core/docs/api.py "$target/doc" # the public interface is the one that is written down
    onboard/capi/misra.py          # what MISRA C finds in the C code is listed with its reasons
    benches/peers/best.py          # the table of the best other runtimes is that of the records
}

# Whether elunar-raster can be published, with the packages that it stands on. What is built in: bills of materials, licences, sources,
# duplicates, and known faults where the database can be had.
supply() {
    cargo package --quiet --locked --no-verify --allow-dirty --package elunar-core --package elunar-base --package elunar-raster
    onboard/flight/sbom.py "$target/sbom"
    if ! cargo deny --version >/dev/null 2>&1; then
        echo "SKIPPED: supply: cargo-deny is not here (cargo install cargo-deny --locked)"
        return
    fi
    local how=(--config deny.toml --locked) checks=(licenses bans sources)
    if cargo deny "${how[@]}" fetch db >/dev/null 2>&1; then
        checks+=(advisories)
    elif cargo deny "${how[@]}" --offline check advisories >/dev/null 2>&1; then
        echo "supply: the database of advisories could not be fetched; the last copy is used"
        how+=(--offline)
        checks+=(advisories)
    else
        echo "SKIPPED: supply: advisories: https://github.com/RustSec/advisory-db cannot be had"
    fi
    cargo deny "${how[@]}" check --hide-inclusion-graph --allow no-license-field "${checks[@]}"
    # Five packages fly; most of the list does not meet them.
    cargo deny "${how[@]}" --manifest-path "$flight" check --hide-inclusion-graph --allow license-not-encountered \
        --allow license-exception-not-encountered --allow advisory-not-detected --allow unmatched-skip-root "${checks[@]}"
}

# Links and anchors of all documents, and the documents as one book.
book() {
    docs/links.py
    if ! command -v mdbook >/dev/null; then
        echo "SKIPPED: book: mdbook is not here (cargo install mdbook --locked)"
        return
    fi
    docs/book.py "$target"
}

# The network once more on the reference backend, which shares no kernel with the default one; unoptimised, because a small network is
# computed sooner than a large crate is optimised.
backends() {
    cargo run --locked --package host-train --features ndarray --config profile.dev.package.host-train.opt-level=0 --config profile.dev.package.elunar-learn.opt-level=0 -- check --backend ndarray tests/golden/{mini,ablations}/case.safetensors
}

# Whether there is a Vulkan loader and a driver; says so if not.
has_vulkan() {
    local loader driver
    loader="$(ldconfig -p 2>/dev/null | grep -c 'libvulkan\.so\.1 ' || true)"
    driver="${VK_DRIVER_FILES:-$(find /usr/share/vulkan/icd.d /etc/vulkan/icd.d -name '*.json' 2>/dev/null | head -1)}"
    [ "$loader" != 0 ] && [ -n "$driver" ] && return
    echo "SKIPPED: vulkan: no loader or no driver (Debian packages libvulkan1 and mesa-vulkan-drivers)"
    return 1
}

# Training and prediction by Burn's GPU code through Vulkan, on the first device that it finds. Without a GPU that is Mesa's lavapipe,
# which computes on the processor.
vulkan() {
    has_vulkan || return 0
    cargo build --locked --profile gpu --config profile.gpu.opt-level=0 --package host-train --features vulkan-plain \
        --config "$(host-train/gpu/patched.sh)"
    host-train/gpu/check.sh "$target/gpu/host-train" vulkan
}

test() {
    cargo test --locked --workspace
}

# The programs. Together they have the features that they have in `test`, so nothing of it is compiled again.
programs() { cargo build --locked --package elunar --package elunar-web --package host-train; }

# The Python package: a wheel in an environment of its own, with its tests, types and example.
python() {
    local venv="$target/python" wheels="$target/wheels" root="$PWD"
    if ! python3 -c "import ensurepip, sys, venv; sys.exit(sys.version_info < (3, 10))" 2>/dev/null; then
        echo "SKIPPED: python: no Python of 3.10 or later with venv (Debian package python3-venv)"
        return
    fi
    [ -x "$venv/bin/maturin" ] || python3 -m venv --clear "$venv"
    if ! "$venv/bin/python" -m pip install --quiet "maturin>=1.9.4,<2" matplotlib mypy numpy "pystac[validation]" pytest rasterio rioxarray tqdm; then
        echo "SKIPPED: python: maturin and what the tests need cannot be installed (pip install maturin)"
        return
    fi
    programs
    rm -rf "$wheels"
    "$venv/bin/maturin" build --quiet --locked --profile dev --out "$wheels"
    "$venv/bin/python" -m pip install --quiet --no-deps --force-reinstall "$wheels"/elunardtm-*.whl
    ELUNAR="$target/debug/elunar" ELUNAR_REQUIRE_ORACLES=1 "$venv/bin/python" -m pytest -q -p no:cacheprovider
    # Elsewhere, so that the package that is installed is checked.
    (cd "$target" && "$venv/bin/python" -m mypy --config-file "$root/pyproject.toml")
    "$venv/bin/python" host-train/python/examples/figure.py "$target/python.png"
}

# The runner's kernels for WebAssembly, and the page and reports in a browser against the program on this machine.
page() {
    local wasm=wasm32-wasip1 features
    if [ ! -d "$(rustc --print sysroot)/lib/rustlib/$wasm" ]; then
        echo "SKIPPED: page: target $wasm is not installed (rustup target add $wasm)"
        return
    fi
    if ! command -v node >/dev/null; then
        echo "SKIPPED: page: node is not here (Debian package nodejs)"
        return
    fi
    for features in "" +simd128; do
        RUSTFLAGS="${features:+-C target-feature=$features}" CARGO_TARGET_WASM32_WASIP1_RUNNER="node $PWD/host-train/web/run.mjs" \
            cargo test --locked --package elunar-core --target "$wasm" --target-dir "$target/web$features" \
            --lib nn:: -- --skip nn::tests::whole --skip a_wrong_product_ends # these read files of this machine
    done
    host-train/web/build.sh
    if ! command -v "${CHROMIUM:-chromium}" >/dev/null; then
        echo "SKIPPED: page in a browser: chromium is not here (Debian package chromium)"
        return
    fi
    programs
    host-train/web/test/page.mjs "$target/page" "$target/debug/elunar" "$target/debug/elunar-web"
    local made="$target/page-reports"
    "$target/debug/host-train" demo --out "$made/tour" --steps 4 >/dev/null
    "$target/debug/host-train" suite --suite host-train/web/test/suite.toml --out "$made/suite" >/dev/null
    "$target/debug/host-train" report "$made/suite" -o "$made/suite.html"
    host-train/web/test/reports.mjs "$target/page" "$target/debug/elunar" "$target/page-pictures" "$made/tour/report.html" "$made/suite.html"
}

# The whole suite twice, in random order: one test at a time, then eight at once. Shuffling is an unstable option of the test runner, which
# RUSTC_BOOTSTRAP allows; it is set for the test programs alone. ORDER_SEED=N repeats an order. Without doctests.
order() {
    local threads seed="${ORDER_SEED:-$RANDOM}"
    for threads in 1 8; do
        echo "order: $threads at once, seed $seed (ORDER_SEED=$seed ./ci.sh order)"
        cargo test --locked --workspace --lib --bins --tests --config 'target."cfg(all())".runner=["env", "RUSTC_BOOTSTRAP=1"]' \
            -- -Z unstable-options --shuffle-seed "$seed" --test-threads "$threads"
    done
}

# No branch of the network's steps follows the data: Valgrind reports each that does. Two minutes of one processor.
branches() {
    tests/branches/run.sh
}

# What the tests of core, C interface and rasters reach of their own source: lines and branches, which may not fall. Core's run once more with
# overflow checks, which its development profile leaves out for speed: its integers must not overflow on any legal model.
coverage() {
    tests/coverage.sh
}

# Arbitrary models and calls of the C interface under AddressSanitizer, which the pinned compiler has, but calls unstable.
asan() {
    local host runtime
    host="$(rustc -vV | sed -n 's/^host: //p')"
    runtime="$(rustc --print sysroot)/lib/rustlib/$host/lib/librustc-stable_rt.asan.a"
    if [ ! -f "$runtime" ]; then
        echo "SKIPPED: AddressSanitizer: this compiler has no $runtime"
        return
    fi
    RUSTC_BOOTSTRAP=1 RUSTFLAGS="-Z sanitizer=address" \
        cargo test --locked --package elunar-provoke --target "$host" --target-dir "$target/asan"
}

# The C interface under Miri, which finds what the language forbids and no machine shows, by both rules for borrows and on 32 bits.
miri() {
    if ! cargo +nightly miri --version >/dev/null 2>&1; then
        echo "SKIPPED: Miri: no nightly compiler with it (rustup component add --toolchain nightly miri rust-src)"
        return
    fi
    local rule
    for rule in "" -Zmiri-tree-borrows; do
        MIRIFLAGS="-Zmiri-permissive-provenance $rule" cargo +nightly miri test --locked --package elunar-capi \
            --target i686-unknown-linux-gnu --target-dir "$target/miri" --test aliasing --test small_calls
    done
}

# Symbols that give away an allocator or the standard library, in either of Rust's mangling schemes.
forbidden='__rust_alloc|__rust_realloc|__rust_dealloc|__rdl_|__rg_|__rust_no_alloc_shim|3std|5alloc[0-9]'

# $1: an archive. Names of all symbols, defined or referenced, of every object in it.
symbols() { nm "$1" 2>/dev/null | awk 'NF >= 2 { print $NF }' | sort -u; }

inspect() {
    local archive="$1" all found
    [ -f "$archive" ] || fail "expected an archive at $archive"
    all="$(symbols "$archive")"
    # An archive without our code would pass for the wrong reason.
    [ "$(grep -c elunar_core <<<"$all")" -gt 20 ] || fail "$archive: expected the symbols of elunar-core, found almost none"
    found="$(grep -E "$forbidden" <<<"$all" || true)"
    [ -z "$found" ] || fail "$archive: expected neither std nor an allocator, found: $(head -3 <<<"$found" | tr '\n' ' ')"
    echo "$archive: $(wc -l <<<"$all") symbols, none of std or of an allocator"
}

no_std() {
    command -v nm >/dev/null || fail "expected nm (Debian package binutils)"
    cargo build --locked --release --manifest-path "$flight" --target-dir "$target/flight"
    inspect "$target/flight/release/libelunar.a"
    # The same bytes from two folders.
    onboard/flight/archive.sh --check
    # C and C++ programs against the archive itself, with no other library.
    ELUNAR_ARCHIVE="$target/flight/release/libelunar.a" cargo test --locked --package elunar-capi --package host-train \
        --test c --test guides --test cfs # with the features of `test`
    if [ -d "$(rustc --print sysroot)/lib/rustlib/$bare" ]; then
        cargo build --locked --release --manifest-path "$flight" --target-dir "$target/flight" --target "$bare"
        inspect "$target/flight/$bare/release/libelunar.a"
        # What of Rust's core is in it.
        onboard/flight/proofs/core_functions.py
    else
        echo "SKIPPED: bare-metal build: target $bare is not installed (rustup target add $bare)"
    fi
}

# Whether boards can be built and run; says so if not.
has_boards() {
    local missing
    missing="$(onboard/flight/boards/setup.sh --check)" && return
    echo "SKIPPED: boards: $missing (onboard/flight/boards/setup.sh installs it)"
    return 1
}

# Bare boards under QEMU: same bytes out as on the host, within the budgets; and what can be proved of the programs.
boards() {
    has_boards || return 0
    onboard/flight/boards/run.sh
    # The path of a tile through the C functions: two boards of each size of words and order of bytes that there is.
    local six=(an500 rv32 leon3 e500 rv64 zcu102)
    onboard/flight/boards/run.sh --calls "${six[@]}"
    onboard/flight/boards/run.sh --calls --model tests/golden/provoked/guided.eld "${six[@]}"
    # Injections are made, and made again with the same outcomes.
    local out="$target/boards-inject" guided=tests/golden/provoked/guided.eld
    rm -rf "$out"
    onboard/flight/boards/inject.sh --out "$out/first" --injections 2 --model "$guided"
    onboard/flight/boards/inject.sh --out "$out/again" --replay "$out/first/injections.csv" --model "$guided" >/dev/null
    cmp "$out/first/injections.csv" "$out/again/injections.csv"
    onboard/flight/proofs/run.sh
    embassy
}

# The example of Embassy on a board, which needs a target of its own.
embassy() {
    local missing
    missing="$(onboard/embassy/run.sh --check)" || { echo "SKIPPED: embassy: $missing"; return 0; }
    onboard/embassy/run.sh
}

# No panic reachable in the flight archive, on every board.
no_panic() {
    has_boards || return 0
    onboard/flight/proofs/run.sh --proof panics
}

# A manifest on a Slurm cluster of three nodes on this machine, in GNU parallel and in Snakemake. Each engine is optional.
cluster() {
    programs
    host-train/cluster/check.sh "$target/debug/elunar" host-train/models/nano.eld
}

# Both outcomes of every conditional branch of the flight library in machine code: no more that are not argued than recorded.
outcomes() {
    has_boards || return 0
    onboard/flight/boards/outcomes.sh
}

# The rules for what may depend on what, in seconds.
architecture() {
    cargo test --locked --quiet -p elunar-tests --test architecture
}

# Needs a nightly compiler and cargo-fuzz: a minute of libFuzzer for every target, fifteen with what it compiles. The seeded mutations of `test` need neither.
fuzz() {
    if ! cargo +nightly fuzz --version >/dev/null 2>&1; then
        echo "SKIPPED: fuzzing: no nightly compiler with cargo-fuzz (cargo install cargo-fuzz)"
        return
    fi
    local one
    for one in $(cargo +nightly fuzz list --fuzz-dir tests/fuzz); do
        cargo +nightly fuzz run --fuzz-dir tests/fuzz "$one" -- -max_total_time="${FUZZ_SECONDS:-60}"
    done
}

# $1: a step. Whether it may still begin; says so if not.
in_time() {
    case "$1" in format | lint | supply | book | test) return ;; esac
    [ "$(date +%s)" -le "${LATEST_START:-9999999999}" ] && return
    echo "SKIPPED: $1: the time for beginning a step is over (LATEST_START)"
    return 1
}

[ $# -gt 0 ] || set -- "${everything[@]}"
late=()
for step in "$@"; do
    printf '%s\n' "${everything[@]}" "${on_request[@]}" | grep -xFe "$step" >/dev/null ||
        fail "expected a step (${everything[*]} ${on_request[*]}), found '$step'"
    say "$step"
    in_time "$step" || { late+=("$step"); continue; }
    SECONDS=0
    "$step"
    echo "$step: ${SECONDS} s"
done
say "all good${late:+, not run: ${late[*]}}"
