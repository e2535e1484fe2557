#!/usr/bin/env bash
# Predicts the DTMs of a manifest as a job array; one task runs one chunk.
#
#   sbatch --array=1-100 --cpus-per-task=16 array.sh m.jsonl          (100 chunks, 16 images at a time in each)
#
# ELUNAR names the program (default: elunar), PART_DIR a folder on a disk of the node. Logs of finished items, JSON lines, lie in logs/ beside
# the manifest; `elunar status --manifest m.jsonl logs/*.jsonl` reads them.
#SBATCH --job-name=elunar
#SBATCH --requeue
#SBATCH --open-mode=append
#SBATCH --signal=B:TERM@120
#SBATCH --output=/dev/null
set -uo pipefail

manifest="${1:?usage: sbatch --array=1-N array.sh MANIFEST}"
logs="$(dirname "$manifest")/logs"
mkdir -p "$logs"
# The array's bounds say how many chunks there are: it must begin with 1 and have no step.
k="$SLURM_ARRAY_TASK_ID" n="$SLURM_ARRAY_TASK_MAX"
name="$logs/$SLURM_ARRAY_JOB_ID.$k.${SLURM_RESTART_COUNT:-0}"
more=()
[ -z "${PART_DIR:-}" ] || more+=(--part-dir "$PART_DIR")

# The signal comes two minutes before the time limit, to this script alone (B:). The batch hands it to its processes.
"${ELUNAR:-elunar}" batch --manifest "$manifest" --chunk "$k/$n" --jobs "${JOBS:-${SLURM_CPUS_PER_TASK:-1}}" --wait "${WAIT:-60}" \
    "${more[@]}" >"$name.jsonl" 2>"$name.err" &
batch=$!
trap 'kill -TERM "$batch" 2>/dev/null' TERM INT
while :; do
    wait "$batch"
    code=$?
    # A trapped signal ends wait, but not the batch.
    kill -0 "$batch" 2>/dev/null || break
done

# 75: the same again, a few times. The task goes back into the queue, and another node may take it.
if [ "$code" = 75 ] && [ "${SLURM_RESTART_COUNT:-0}" -lt "${RETRIES:-5}" ]; then
    scontrol requeue "${SLURM_ARRAY_JOB_ID}_$k" && sleep 60
fi
exit "$code"
