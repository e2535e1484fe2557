#!/usr/bin/env bash
# Checks the backend `cuda` on a machine without a GPU:
#
#   host-train/gpu/check-cuda.sh [PROGRAM]
#
# PROGRAM [default: target/gpu/host-train, from cuda.sh] runs a forward pass and a few training steps of `nano` on a driver that records
# and computes nothing (fake-cuda/driver.c). Every kernel must then pass NVIDIA's assembler. Whether kernels compute the right numbers,
# and how fast, only a GPU can tell. CUBECL_AUTOTUNE_LEVEL=full takes more time: every kernel that could be chosen is made.
#
# CUDA_PATH a CUDA toolkit with bin/ptxas and nvvm/libdevice [default: NVIDIA's Python packages, in the target folder]
# KEEP      a folder for kernels, counts and output [default: a temporary one, removed at the end]
set -euo pipefail
program="${1:+$(realpath -m "$1")}"
keep="${KEEP:+$(realpath -m "$KEEP")}"
cd "$(dirname "$0")/../.."

fail() { # what, expected, found
    echo "ERROR: $1: expected $2, found $3" >&2
    exit 1
}

target="$(realpath -m "${CARGO_TARGET_DIR:-target}")"
program="${program:-$target/gpu/host-train}"
model="$PWD/host-train/models/nano.safetensors"
driver="$PWD/host-train/gpu/fake-cuda/driver.c"
[ -x "$program" ] || fail "$program" "a program from host-train/gpu/cuda.sh" "none"

work="${keep:-$(mktemp -d)}"
[ -n "$keep" ] || trap 'rm -rf "$work"' EXIT
mkdir -p "$work/lib" "$work/kernels"

# 1. Assembler, and the library of mathematical functions that the kernels are linked with.
if [ -z "${CUDA_PATH:-}" ]; then
    tools="$target/cuda-tools"
    packages=(nvidia-cuda-nvcc==13.0.88 nvidia-nvvm==13.0.88)
    found() { CUDA_PATH="$(find "$tools" -path '*/nvidia/cu13' -print -quit 2>/dev/null)" && [ -x "$CUDA_PATH/bin/ptxas" ]; }
    if ! found; then
        python3 -m venv "$tools" || fail "python3 -m venv $tools" success failure
        "$tools/bin/pip" install --quiet "${packages[@]}" || fail "pip install ${packages[*]}" success failure
        found || fail "$tools" "nvidia/cu13/bin/ptxas" none
    fi
fi
ptxas="$CUDA_PATH/bin/ptxas"
[ -x "$ptxas" ] || fail "$ptxas" "NVIDIA's assembler" none
[ -f "$CUDA_PATH/nvvm/libdevice/libdevice.10.bc" ] || fail "$CUDA_PATH/nvvm/libdevice" libdevice.10.bc none

# 2. The driver. It lies first in the search path, under the first name that is looked for. Kernels are kept apart from the user's.
cc -shared -fPIC -O1 -Wall -Wextra -Wno-unused-parameter -o "$work/lib/libcuda.so" "$driver"
record() { # name, arguments of the program
    local name="$1"
    shift
    rm -rf "${work:?}/$name" && mkdir -p "$work/$name"
    (
        cd "$work/$name" # without a manifest of Cargo above it, or the kernels would be kept beside that
        # shellcheck disable=SC2030 # for this run alone
        export CUDA_PATH XDG_CACHE_HOME="$work/cache" LD_LIBRARY_PATH="$work/lib:${LD_LIBRARY_PATH:-}" FAKE_CUDA_FOLDER="$PWD"
        "$program" "$@" >output.txt 2>&1
    ) || fail "$program $*" "exit status 0" "$(grep -iE 'error|panic' "$work/$name/output.txt" | head -n 1 || true)"
    [ -s "$work/$name/launches.txt" ] || fail "$program $*" "launches of kernels" none
}
launches() { awk '{ sum += $1 } END { print sum }' "$work/$1/launches.txt"; }

# 3. A forward pass, and training. The first run tries kernels out; the others find the choice on disk and differ by two steps.
train=(train --preset nano --backend cuda --batch 2 --set "recipe.crop=[64,64]" recipe.validation_tiles=1 recipe.checkpoint_every=1000 --out run)
record forward latency --model "$model" --backend cuda --tiles 1
record first "${train[@]}" --steps 2
record two "${train[@]}" --steps 2
record four "${train[@]}" --steps 4

# A missing driver or library is one line.
one_line() { # what is missing, what the line must say, environment
    local what="$1" says="$2" rc=0
    shift 2
    rm -rf "$work/missing" && mkdir -p "$work/missing"
    (cd "$work/missing" && env XDG_CACHE_HOME="$work/missing" XDG_RUNTIME_DIR="$work" "$@" "$program" latency --model "$model" --backend cuda --tiles 1) \
        >"$work/missing.txt" 2>&1 || rc=$?
    if [ "$rc" = 0 ] || [ "$(wc -l <"$work/missing.txt")" != 1 ] || ! grep -q "^ERROR: backend cuda: .*$says" "$work/missing.txt"; then
        fail "without $what" "one ERROR line with '$says'" "$(head -n 3 "$work/missing.txt" | cut -c1-300)"
    fi
    echo "without $what: $(cut -c1-160 "$work/missing.txt")"
}
ldconfig -p 2>/dev/null | grep libcuda.so >/dev/null || one_line "a driver" "libcuda"
# shellcheck disable=SC2031 # the user's search path
[ -n "$(find /usr/local/cuda /opt/cuda /usr/lib/cuda /usr/nvvm -name libdevice.10.bc 2>/dev/null | head -n 1)" ] ||
    one_line libdevice libdevice CUDA_PATH="$work/missing" LD_LIBRARY_PATH="$work/lib:${LD_LIBRARY_PATH:-}"

# 4. Every different kernel once through the assembler.
for file in "$work"/{forward,first,two,four}/*.ptx; do
    cp "$file" "$work/kernels/$(sha256sum "$file" | cut -c1-16).ptx"
done
# shellcheck disable=SC2317 # called by xargs
assemble() { # prints the name of a file that is refused, and why
    local arch
    arch="$(sed -n 's/^\.target[[:space:]]*\(sm_[0-9a-z]*\).*/\1/p' "$1")"
    "$ptxas" -arch="${arch:-sm_90}" -o /dev/null "$1" >"$1.txt" 2>&1 || echo "$1: $(head -n 1 "$1.txt")"
}
export -f assemble
export ptxas
modules="$(find "$work/kernels" -name '*.ptx' | wc -l)"
# shellcheck disable=SC2016 # expanded by the inner shell
refused="$(find "$work/kernels" -name '*.ptx' -print0 | xargs -0 -n 1 -P "$(nproc)" bash -c 'assemble "$1"' _)"
count="$(grep -c . <<<"$refused" || true)"

echo "kernels: $modules different modules, $((modules - count)) accepted by $("$ptxas" --version | sed -n 's/^Cuda compilation tools, //p')"
echo "launches: $((($(launches four) - $(launches two)) / 2)) of a training step"
[ "$count" = 0 ] || fail "${refused%%$'\n'*}" "kernels that ptxas accepts" "$count refused"
[ "$modules" -ge 100 ] || fail kernels "at least 100 modules" "$modules"
