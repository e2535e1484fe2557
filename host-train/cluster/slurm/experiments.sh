#!/usr/bin/env bash
# Trains experiments, or the seeds of one, as a job array; one task trains one. It goes on where a requeued task stopped.
#
#   array=$(sbatch --parsable --array=1-5 experiments.sh out host-train/experiments/full.toml --seeds 5)
#   sbatch --dependency=afterok:$array --wrap "host-train experiment host-train/experiments/full.toml --seeds 5 --out out --resume"
#
# The second job tests all and compares them.
#SBATCH --job-name=elunar-experiments
#SBATCH --requeue
#SBATCH --signal=TERM@300
set -uo pipefail

out="${1:?usage: sbatch --array=1-N experiments.sh OUT FILE.toml... [OPTIONS]}"
shift
"${HOST_TRAIN:-host-train}" experiment "$@" --out "$out" --task "$SLURM_ARRAY_TASK_ID"
code=$?
if [ "$code" = 75 ] && [ "${SLURM_RESTART_COUNT:-0}" -lt "${RETRIES:-20}" ]; then
    scontrol requeue "${SLURM_ARRAY_JOB_ID}_$SLURM_ARRAY_TASK_ID" && sleep 60
fi
exit "$code"
