#!/usr/bin/env bash
# Predicts one huge image in parts, one a task:
#
#   array=$(sbatch --parsable --array=1-5 parts.sh --image strip.tif --coarse c.tif --model nano.eld -o dtm.tif)
#   sbatch --dependency=afterok:$array --wrap "elunar join --parts 5 --image strip.tif --coarse c.tif --model nano.eld -o dtm.tif"
#SBATCH --job-name=elunar-part
#SBATCH --requeue
set -uo pipefail

"${ELUNAR:-elunar}" predict --part "$SLURM_ARRAY_TASK_ID/$SLURM_ARRAY_TASK_MAX" --threads "${SLURM_CPUS_PER_TASK:-1}" "$@"
code=$?
if [ "$code" = 75 ] && [ "${SLURM_RESTART_COUNT:-0}" -lt "${RETRIES:-5}" ]; then
    scontrol requeue "${SLURM_ARRAY_JOB_ID}_$SLURM_ARRAY_TASK_ID" && sleep 60
fi
exit "$code"
