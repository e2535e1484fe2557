#!/usr/bin/env bash
# Builds the guide's FreeRTOS task for MPS2 AN500 and runs it under QEMU: PASS, and heights.f32 in the folder OUT.
#
#   ./run.sh KERNEL OUT      KERNEL: a folder of FreeRTOS-Kernel
#
# Needs a C compiler for Cortex-M7 with the headers of a C library (CC, else arm-none-eabi-gcc; CFLAGS: more options), qemu-system-arm, and Rust's
# target thumbv7em-none-eabihf. ELUNAR_ARCHIVE: a libelunar.a that is built already.
set -euo pipefail
here="$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)"
root="$(cd "$here/../../../.." && pwd)"
fail() { printf 'ERROR: %s\n' "$*" >&2; exit 1; }

[ $# = 2 ] || fail "expected the folder of FreeRTOS-Kernel and a folder for the output, found $# arguments"
kernel="$(cd "$1" 2>/dev/null && pwd)" && [ -f "$kernel/tasks.c" ] || fail "expected tasks.c in $1, found none"
mkdir -p "$2"
cd "$2"
port="$kernel/portable/GCC/ARM_CM7/r0p1"
archive="${ELUNAR_ARCHIVE:-}"
if [ -z "$archive" ]; then
    cargo build --locked --release --manifest-path "$root/onboard/flight/Cargo.toml" --target thumbv7em-none-eabihf --target-dir target
    archive=target/thumbv7em-none-eabihf/release/libelunar.a
fi
model="$root/host-train/models/nano.eld"
tile="$root/tests/golden/flight_tile"
# shellcheck disable=SC2086 # options are words
${CC:-arm-none-eabi-gcc} -std=gnu99 -O2 -Wall -Wextra -mcpu=${CPU:-cortex-m7} -mthumb -mfloat-abi=hard -ffunction-sections -fdata-sections ${CFLAGS:-} \
    -DMODEL_BYTES="$(wc -c < "$model")" -I "$here" -I "$here/.." -I "$root/onboard/capi/include" -I "$kernel/include" -I "$port" \
    "$here/main.c" "$here"/../{freertos_task,duty,service}.c "$kernel"/{tasks,list,queue}.c "$port/port.c" "$archive" \
    -T "$here/link.ld" -nostartfiles -nostdlib -Wl,--gc-sections -o freertos.elf
qemu-system-arm -M mps2-an500 -nographic -monitor none -serial none -semihosting-config enable=on,target=native -icount shift=0,sleep=off -kernel freertos.elf \
    -device loader,file="$model",addr=0x60000000,force-raw=on -device loader,file="$tile/image.f32",addr=0x60800000,force-raw=on \
    -device loader,file="$tile/coarse_m.f32",addr=0x60900000,force-raw=on
