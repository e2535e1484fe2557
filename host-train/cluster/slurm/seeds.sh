#!/usr/bin/env bash
# Trains several runs from the same weights, each with its own seed, as a job array; a dependent job takes the mean of their weights:
#
#   array=$(sbatch --parsable --array=1-3 seeds.sh start.safetensors runs)
#   sbatch --dependency=afterok:$array --wrap "host-train average runs/*/best.safetensors -o mean.safetensors"
#
# Runs from different random weights have no useful mean.
#SBATCH --job-name=elunar-seeds
#SBATCH --requeue
#SBATCH --signal=TERM@300
set -uo pipefail

start="${1:?usage: sbatch --array=1-N seeds.sh START.safetensors RUNS [OPTIONS OF TRAIN]}"
runs="${2:?usage: sbatch --array=1-N seeds.sh START.safetensors RUNS [OPTIONS OF TRAIN]}"
shift 2
run="$runs/$SLURM_ARRAY_TASK_ID"
program="${HOST_TRAIN:-host-train}"
if [ -e "$run/last.safetensors" ]; then
    "$program" train --out "$run" --resume
else
    "$program" train --out "$run" --start-from "$start" --seed "$SLURM_ARRAY_TASK_ID" "$@"
fi
code=$?
if [ "$code" = 75 ] && [ "${SLURM_RESTART_COUNT:-0}" -lt "${RETRIES:-20}" ]; then
    scontrol requeue "${SLURM_ARRAY_JOB_ID}_$SLURM_ARRAY_TASK_ID" && sleep 60
fi
exit "$code"
