#!/usr/bin/env bash
# Counts the instructions of every AArch64 kernel under QEMU's user mode, as CSV. Counts do not depend on the machine or its load.
#
#   benches/aarch64.sh PROGRAM [MODEL]     elunar for aarch64, linked statically (host-train/packaging/build.sh arm_binary)
#
# Two passes of the network: alone, and in a whole tile as `predict` makes it (`latency` with one tile of each more). Wants qemu-aarch64 with plugins
# (Debian package qemu-user), version 7 or later; QEMU names another one.
set -euo pipefail
fail() { printf 'ERROR: %s\n' "$*" >&2; exit 1; }
[ $# -ge 1 ] || fail "expected PROGRAM [MODEL]"
program="$1" model="${2:-nano}" qemu="${QEMU:-qemu-aarch64}"
[ -x "$program" ] || fail "$program: expected a program, found none"
command -v "$qemu" >/dev/null || fail "$qemu: expected QEMU's user mode (Debian package qemu-user)"

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
"$(dirname "$0")/../onboard/flight/boards/counter/build.sh" "$qemu" instructions "$work/counter.so"

# Instructions of `latency` with kernel $1 and $2 tiles of each kind; what it prints goes to $work/said.
count() {
    "$qemu" -cpu max -plugin "$work/counter.so,out=$work/count" "$program" latency --model "$model" --kernel "$1" --tiles "$2" --json >"$work/said"
    cat "$work/count"
}

kernels="$("$qemu" -cpu max "$program" latency --model "$model" --kernel none 2>&1 | sed -n 's/.*one of \(.*\), found.*/\1/p' | tr -d ,)"
[ -n "$kernels" ] || fail "$program: expected the names of its kernels, found none"
echo "model,kernel,macs,instructions_of_two_passes,instructions_per_mac"
for kernel in $kernels; do
    one="$(count "$kernel" 1)" two="$(count "$kernel" 2)"
    macs="$(sed -n 's/.*"macs":\([0-9]*\).*/\1/p' "$work/said")"
    awk -v m="$model" -v k="$kernel" -v macs="$macs" -v n="$((two - one))" 'BEGIN { printf("%s,%s,%.0f,%.0f,%.3f\n", m, k, macs, n, n / 2 / macs) }'
done
