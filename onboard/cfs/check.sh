#!/usr/bin/env bash
# Compiles ELUNAR_APP against the headers of a cFS tree, as C99 with warnings as errors; nothing is linked or run.
#
#   ./check.sh TREE      TREE: a cFS mission that was configured (make prep), so that the headers which its build makes are there
#
# CC names another compiler, CFLAGS more options. Folders of stubs and unit tests are left out.
set -euo pipefail
here="$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)"
fail() { printf 'ERROR: %s\n' "$*" >&2; exit 1; }

[ $# = 1 ] && [ -d "$1" ] || fail "expected the folder of a cFS tree, found '${1:-nothing}'"
tree="$(cd "$1" && pwd)"

work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT

# Headers whose folders an application sees; those of a configured build among them. This folder may be linked into the tree: its stubs are not cFE.
wanted='cfe.*\.h|osapi.*\.h|(os|psp)config\.h|common_types\.h|ccsds_.*\.h'
mapfile -t folders < <(find -L "$tree" -regextype posix-extended -regex ".*/($wanted)" -printf '%h\n' 2>/dev/null |
    grep -vE '/(ut[-_]stubs?|ut_assert|unit[-_]tests?|unit-test-coverage|functional-test|elunar_app/test)(/|$)' | sort -u)
includes=()
for folder in "${folders[@]}"; do includes+=(-I "$folder"); done
for header in cfe.h osapi.h common_types.h cfe_tbl_filedef.h; do
    found=no
    for folder in "${folders[@]}"; do [ ! -f "$folder/$header" ] || found=yes; done
    [ "$found" = yes ] || fail "$tree: expected $header, found none: is it a configured cFS tree (make prep)?"
done

# The defaults of the configuration, for what the tree's build does not have.
for header in "$here"/config/default_*.h; do
    printf '#include "%s"\n' "$header" > "$work/${header##*/default_}"
done
sources=("$here"/fsw/src/*.c "$here"/fsw/tables/*.c "$here"/../capi/examples/service.c)
for source in "${sources[@]}"; do
    # shellcheck disable=SC2086 # options are words
    "${CC:-cc}" -std=c99 -Wall -Wextra -Werror ${CFLAGS:-} -I "$here/fsw/inc" -I "$here/fsw/src" -I "$here/../capi/include" \
        -I "$here/../capi/examples" "${includes[@]}" -I "$work" -c "$source" -o "$work/object.o" || fail "$source does not compile against $tree"
done
echo "${#sources[@]} files compile against $tree"
