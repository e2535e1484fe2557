#!/usr/bin/env bash
# Predicts the DTMs of a manifest on this machine, or over ssh, by GNU parallel. One chunk an image; a chunk that ends with 75 is tried again.
#
#   parallel.sh m.jsonl [options of parallel, such as --jobs 16 or --sshloginfile nodes]
#
# A second run goes on: what is finished is recognised by its contents.
set -euo pipefail

manifest="${1:?usage: parallel.sh MANIFEST [OPTIONS OF PARALLEL]}"
shift
logs="$(dirname "$manifest")/logs"
mkdir -p "$logs"
program="${ELUNAR:-elunar}"
items="$("$program" manifest --check "$manifest" | sed 's/.*: \([0-9]*\) items$/\1/')"
one() {
    local code tries=0
    while :; do
        code=0
        "$1" batch --manifest "$2" --chunk "$3/$4" >>"$5/parallel.$3.jsonl" 2>>"$5/parallel.$3.err" || code=$?
        [ "$code" = 75 ] && [ "$((tries += 1))" -le "${RETRIES:-5}" ] || return "$code"
        sleep "$tries"
    done
}
export -f one
code=0
seq "$items" | parallel --will-cite "$@" one "$program" "$manifest" {} "$items" "$logs" || code=$?
# parallel's own code counts chunks that failed.
[ "$code" = 0 ] || { echo "ERROR: $code chunks are not done: $program status --manifest $manifest $logs/*.jsonl" >&2; exit 65; }
