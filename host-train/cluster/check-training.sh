#!/usr/bin/env bash
# Trains on a Slurm cluster of two nodes on this machine, for a few steps: check-training.sh HOST_TRAIN [STEPS]
#
# Seeds of an experiment as an array, then their comparison as the dependent job; one task is queued again in between. Runs from the same
# weights as an array, then their mean. Minutes, most of them for the test suite.
set -euo pipefail
here="$(cd "$(dirname "$0")" && pwd)"
HOST_TRAIN="$(realpath "${1:?usage: $0 HOST_TRAIN [STEPS]}")"
steps="${2:-20}"
export HOST_TRAIN
PATH="$PATH:/usr/sbin"

work="$(mktemp -d)"
trap '"$here/slurm/test-cluster.sh" down "$work/slurm" || true; rm -rf "$work" 2>/dev/null || { sleep 2; rm -rf "$work"; }' EXIT
fail() { echo "ERROR: $*" >&2; tail -n 5 "$work"/*.log >&2 || true; exit 1; }
cd "$work"

"$here/slurm/test-cluster.sh" up "$work/slurm" 2 >/dev/null
# shellcheck source=/dev/null
. "$work/slurm/env"

experiment=("$here/../experiments/anchored.toml" --seeds 2 --steps "$steps")
array="$(sbatch --parsable --array=1-2 --output=task-%a.log "$here/slurm/experiments.sh" out "${experiment[@]}")"
until [ -n "$(find out -name run.json 2>/dev/null)" ]; do
    [ "$SECONDS" -lt 120 ] || fail "experiments: a training that begins within 120 s expected, none found"
    sleep 0.2
done
scontrol requeue "${array}_1"
sbatch --wait --parsable --dependency="afterok:$array" --output=compare.log \
    --wrap "'$HOST_TRAIN' experiment ${experiment[*]} --out out --resume" >/dev/null || fail "experiments: the comparison failed"
[ -s out/comparison.csv ] || fail "experiments: out/comparison.csv expected, none found"
[ "$(grep -c '^anchored-seed' out/comparison.csv)" -ge 2 ] || fail "experiments: two seeds expected in out/comparison.csv"
echo "$SECONDS s  experiments: two seeds, one task queued again, and their comparison"

"$HOST_TRAIN" init --preset nano --seed 1 -o start.safetensors >/dev/null
few=(--preset nano --steps "$steps" --batch 1 --set "recipe.crop=[64,64]" recipe.validation_tiles=1 "recipe.validate_every=$steps")
array="$(sbatch --parsable --array=1-2 --output=seed-%a.log "$here/slurm/seeds.sh" start.safetensors runs "${few[@]}")"
sbatch --wait --parsable --dependency="afterok:$array" --output=average.log \
    --wrap "'$HOST_TRAIN' average runs/*/best.safetensors -o mean.safetensors" >/dev/null || fail "seeds: the mean failed"
"$HOST_TRAIN" inspect mean.safetensors >/dev/null
echo "$SECONDS s  seeds: two runs from the same weights, and their mean"
