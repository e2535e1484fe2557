#!/usr/bin/env bash
# Joins all finished DTMs of a manifest, once enough of them are done:
#
#   array=$(sbatch --parsable --array=1-100 array.sh m.jsonl)
#   sbatch --dependency=afterany:$array mosaic.sh m.jsonl mosaic.tif 99%
#
# afterany, since a task with one broken image ends with 65: `status --require` decides.
#SBATCH --job-name=elunar-mosaic
#SBATCH --requeue
set -euo pipefail

manifest="${1:?usage: sbatch mosaic.sh MANIFEST MOSAIC.tif [SHARE%]}"
mosaic="${2:?usage: sbatch mosaic.sh MANIFEST MOSAIC.tif [SHARE%]}"
list="$(mktemp)"
trap 'rm -f "$list"' EXIT
"${ELUNAR:-elunar}" status --manifest "$manifest" --require "${3:-100%}" --done "$list"
"${ELUNAR:-elunar}" mosaic --dem-list "$list" -o "$mosaic"
