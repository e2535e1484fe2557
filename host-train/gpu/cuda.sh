#!/usr/bin/env bash
# Builds host-train with the backend `cuda`:
#
#   host-train/gpu/cuda.sh [arguments of cargo build]
#
# Burn's CUDA backend compiles its kernels with LLVM. One of its packages, tracel-llvm-bundler, downloads an LLVM for that while it builds.
# This script gives it the LLVM 22 of the system instead, so nothing is downloaded but Debian's packages and crates. No GPU is needed.
#
# LLVM_CONFIG      the program llvm-config of LLVM 22 or 23 [default: llvm-config-22, or the one of Debian's llvm-22-dev]
# CARGO_TARGET_DIR as for Cargo [default: target]; the program is in its folder `gpu`
set -euo pipefail
cd "$(dirname "$0")/../.."

packages=(llvm-22-dev libzstd-dev zlib1g-dev)
debian=/usr/lib/llvm-22/bin/llvm-config

fail() { # what, expected, found
    echo "ERROR: $1: expected $2, found $3" >&2
    exit 1
}

[ "$(uname -sm)" = "Linux x86_64" ] || fail system "Linux x86_64" "$(uname -sm)"

# 1. An LLVM with static libraries, and the two libraries that it uses.
find_llvm() { command -v "${LLVM_CONFIG:-llvm-config-22}" || { [ -z "${LLVM_CONFIG:-}" ] && command -v "$debian"; }; }
links() { echo 'int main(void) { return 0; }' | cc -x c - -o /dev/null "$@" 2>/dev/null; }
complete() { find_llvm >/dev/null && links -lzstd -lz; }
command -v cc >/dev/null || fail compiler "cc and c++" none
if ! complete && [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    echo "installing ${packages[*]}" >&2
    apt-get install -y --no-install-recommends "${packages[@]}" >&2 || fail "apt-get install ${packages[*]}" success "exit status $?"
fi
llvm="$(find_llvm)" || fail LLVM "version 22: apt-get install ${packages[*]}, or its llvm-config in LLVM_CONFIG" "${LLVM_CONFIG:-none}"
links -lzstd -lz || fail libraries "libzstd and zlib to link with: apt-get install ${packages[*]}" "none"
version="$("$llvm" --version)"
case "$version" in 22.* | 23.*) ;; *) fail "$llvm" "version 22 or 23" "$version" ;; esac
# Only what NVPTX needs. The processor's own target and the two compilers in memory are named by code that host-train never runs.
parts="core analysis nvptx x86 passes bitreader bitwriter irreader linker target orcjit mcjit executionengine native"
# shellcheck disable=SC2086 # a list of words
libraries="$("$llvm" --link-static --libs $parts 2>&1)" || fail "$llvm" "static libraries" "${libraries%%$'\n'*}"

# 2. A folder that looks like the downloaded one: llvm-config, include, lib, and the file that says it is complete.
mkdir -p "${CARGO_TARGET_DIR:-target}/llvm"
data="$(cd "${CARGO_TARGET_DIR:-target}/llvm" && pwd)"
bundle="$(sed -n '/^name = "tracel-llvm-bundler"$/{n;s/^version = "\(.*\)"$/\1/p}' Cargo.lock)"
[ -n "$bundle" ] || fail Cargo.lock "one version of tracel-llvm-bundler" none
folder="$data/tracel/tracel-llvm-$bundle"
mkdir -p "$folder/bin"
ln -sfn "$("$llvm" --includedir)" "$folder/include"
ln -sfn "$("$llvm" --libdir)" "$folder/lib"
cat >"$folder/bin/llvm-config" <<END
#!/bin/sh
# Stands in for llvm-config of the downloaded LLVM. Called as: llvm-config --link-static --OPTION
for option; do :; done
flags="-D_GNU_SOURCE -D__STDC_CONSTANT_MACROS -D__STDC_FORMAT_MACROS -D__STDC_LIMIT_MACROS"
case "\$option" in
--version) echo "$version" ;;
--libdir) echo "$folder/lib" ;;
--includedir) echo "$folder/include" ;;
--libs) echo "${libraries//$'\n'/ }" ;;
--system-libs) echo "-lrt -ldl -lm -lz -lzstd" ;;
--cflags) echo "-I$folder/include \$flags" ;;
--cxxflags) echo "-I$folder/include -std=c++17 -fno-exceptions \$flags" ;;
*) echo "llvm-config: expected an option that a build script uses, found: \$*" >&2 && exit 1 ;;
esac
END
chmod +x "$folder/bin/llvm-config"
# An existing file is left alone: a newer one makes Cargo build everything above LLVM anew.
[ -e "$folder/.tracel-llvm-installed" ] || touch "$folder/.tracel-llvm-installed"

# 3. Where no nvcc tells it, the version of CUDA whose driver functions are declared. They are looked up when the program runs.
command -v nvcc >/dev/null || export CUDARC_CUDA_VERSION="${CUDARC_CUDA_VERSION:-13000}"

XDG_DATA_HOME="$data" exec cargo build --locked --profile gpu -p host-train --features cuda "$@"
