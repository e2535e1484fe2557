#!/usr/bin/env bash
# Installs what run.sh needs, from Debian's packages (Debian 12 or later, root or sudo); does nothing that is already done.
#
#   ./setup.sh            install what is missing
#   ./setup.sh --check    only say what is missing; exit status 1 if anything is
#
# rustc-web with the sources of the same version builds `core` for targets that rustup has no library for; no version is
# pinned, because the security suite moves these packages. SPARC has no lld, so it gets GNU ld.
set -euo pipefail

packages=(rustc-web cargo-web rust-web-src gcc libc6-dev python3
    qemu-system-arm qemu-system-misc qemu-system-sparc qemu-system-ppc binutils-sparc64-linux-gnu)

as_root() { if [ "$(id -u)" = 0 ]; then "$@"; else sudo "$@"; fi; }
status() { dpkg-query -W -f='${db:Status-Status}' "$1" 2>/dev/null || true; }
missing() {
    local package
    for package in "$@"; do [ "$(status "$package")" = installed ] || printf '%s ' "$package"; done
}
install() {
    local list
    read -ra list <<<"$(missing "$@")"
    [ ${#list[@]} = 0 ] && return
    echo "installing ${list[*]}"
    as_root apt-get -qq update
    as_root env DEBIAN_FRONTEND=noninteractive apt-get -qq -y -o DPkg::Lock::Timeout=300 -o Acquire::Retries=3 \
        install --no-install-recommends "${list[@]}" >/dev/null
}
# The linker and the binary tools of the LLVM inside rustc.
llvm() { /usr/bin/rustc -vV | sed -n 's/^LLVM version: \([0-9]*\).*/\1/p'; }

command -v dpkg-query >/dev/null || { echo "expected Debian's package manager, found none"; exit 1; }
if [ "${1:-}" = --check ]; then
    list="$(missing "${packages[@]}")"
    [ -n "$list" ] || list="$(missing "lld-$(llvm)" "llvm-$(llvm)")"
    [ -z "$list" ] || { echo "not installed: ${list% }"; exit 1; }
    exit 0
fi
install "${packages[@]}"
install "lld-$(llvm)" "llvm-$(llvm)"
compiler="$(dpkg-query -W -f='${Version}' rustc-web)"
sources="$(dpkg-query -W -f='${Version}' rust-web-src)"
[ "$compiler" = "$sources" ] || { echo "ERROR: expected one version of rustc-web and rust-web-src, found $compiler and $sources" >&2; exit 1; }
