#!/usr/bin/env bash
# Not run: an example for PBS Pro and OpenPBS.   qsub -J 1-100 -v MANIFEST=$PWD/m.jsonl,CHUNKS=100 pbs.sh
#PBS -N elunar
#PBS -r y
#PBS -l select=1:ncpus=16
cd "$(dirname "$MANIFEST")" && mkdir -p logs || exit 65
# A code of 75 leaves the item for the next qsub: finished work is recognised.
exec elunar batch --manifest "$MANIFEST" --chunk "$PBS_ARRAY_INDEX/$CHUNKS" --jobs 16 --wait 300 >>"logs/pbs.$PBS_ARRAY_INDEX.jsonl" 2>>"logs/pbs.$PBS_ARRAY_INDEX.err"
