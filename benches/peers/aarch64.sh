#!/usr/bin/env bash
# Counts the instructions of a tile in other runtimes on AArch64 under QEMU's user mode, as CSV. Counts do not depend on the machine or its load.
#
#   benches/peers/aarch64.sh NAME...      networks that compare.py has prepared in made/, such as nano-53739a26
#
# The processor is a Cortex-A76 (dot products, no i8mm). Needs Debian's qemu-user (version 7 or later) and the right to add the architecture arm64
# to apt, whose packages are only unpacked; the runtimes are wheels of the versions in venv. Ours: benches/aarch64.sh.
set -euo pipefail
fail() { printf 'ERROR: %s\n' "$*" >&2; exit 1; }
[ $# -ge 1 ] || fail "expected the name of a network in made/"
here="$(cd "$(dirname "$0")" && pwd)"
command -v qemu-aarch64 >/dev/null || fail "qemu-aarch64: expected QEMU's user mode (Debian package qemu-user)"
for name in "$@"; do [ -e "$here/made/$name-int8.onnx" ] || fail "made/$name-int8.onnx: expected a file of compare.py, found none"; done

arm="$here/made/aarch64"
if [ ! -e "$arm/ready" ]; then
    mkdir -p "$arm/packages" "$arm/root/proc" "$arm/site"
    python="$(apt-cache depends python3-minimal | sed -n 's/.*Depends: \(python3\.[0-9]*\)-minimal/\1/p')"
    packages=("$python-minimal" "lib$python-minimal" "lib$python-stdlib" libc6 libgcc-s1 libstdc++6 zlib1g libexpat1 libffi8 libssl3)
    packages+=(libbz2-1.0 liblzma5 libuuid1 libcrypt1)
    dpkg --add-architecture arm64
    apt-get update -qq
    (cd "$arm/packages" && apt-get download -qq "${packages[@]/%/:arm64}")
    for package in "$arm/packages"/*.deb; do dpkg-deb -x "$package" "$arm/root"; done
    platforms=()
    for libc in 2014 _2_17 _2_27 _2_28; do platforms+=(--platform "manylinux${libc}_aarch64"); done
    "$here/venv/bin/pip" freeze | grep -E '^(onnxruntime|ai-edge-litert)==' >"$arm/wanted"
    "$here/venv/bin/pip" download -q -d "$arm/wheels" "${platforms[@]}" --python-version "${python#python}" --only-binary=:all: -r "$arm/wanted"
    for wheel in "$arm/wheels"/*.whl; do python3 -m zipfile -e "$wheel" "$arm/site"; done
    # Runtimes look here for the processor, where QEMU shows that of the host.
    for core in 0 1; do
        printf 'processor\t: %s\nFeatures\t: fp asimd aes pmull sha1 sha2 crc32 atomics fphp asimdhp asimdrdm lrcpc dcpop asimddp\n' "$core"
        printf 'CPU implementer\t: 0x41\nCPU architecture: 8\nCPU variant\t: 0x4\nCPU part\t: 0xd0b\nCPU revision\t: 1\n\n'
    done >"$arm/root/proc/cpuinfo"
    "$here/../../onboard/flight/boards/counter/build.sh" qemu-aarch64 instructions "$arm/counter.so"
    touch "$arm/ready"
fi

# Instructions of a program that runs $3 tiles of the file $2 by the runtime $1.
count() {
    local variables="PYTHONHOME=$arm/root/usr,PYTHONPATH=$arm/site,LD_LIBRARY_PATH=/lib/aarch64-linux-gnu:/usr/lib/aarch64-linux-gnu"
    QEMU_SET_ENV="$variables" qemu-aarch64 -cpu cortex-a76 -plugin "$arm/counter.so,out=$arm/count" -L "$arm/root" \
        "$(echo "$arm"/root/usr/bin/python3.[0-9]*)" "$here/aarch64_tiles.py" "$@" >&2
    cat "$arm/count"
}
echo "network,runtime,instructions_of_a_tile"
for name in "$@"; do
    for runtime in "onnxruntime int8.onnx" "onnxruntime float.onnx" "litert static.tflite" "litert dynamic.tflite" "litert float.tflite"; do
        read -r library end <<<"$runtime"
        file="$here/made/$name-$end"
        [ -e "$file" ] || continue
        one="$(count "$library" "$file" 1)" two="$(count "$library" "$file" 2)"
        echo "$name,$library ${end%.*},$((two - one))"
    done
done
