#!/usr/bin/env bash
# Runs a spec as a job array of Slurm, one shard a task:
#
#   segsim run SPEC --data DATA --work WORK --prepare-only
#   sbatch --array=0-7 --cpus-per-task=4 --time=4:00:00 experiments/engines/slurm_array.sh SPEC --data DATA --work WORK
#   segsim merge WORK                                            # when the array has ended, or before
#
# WORK lies on a file system that all nodes see. SEGSIM names the program if it is not in PATH. To run some
# tasks again by themselves, keep the number of parts: SHARD_COUNT=8 sbatch --array=3,5 ...
#SBATCH --job-name=segsim
#SBATCH --requeue
#SBATCH --open-mode=append
#SBATCH --signal=B:TERM@30
set -uo pipefail

"${SEGSIM:-segsim}" run "$@" --shard auto --workers "${SLURM_CPUS_PER_TASK:-1}" &
worker=$!
trap 'kill -TERM "$worker" 2>/dev/null' TERM INT
# The first wait ends early when a signal comes; the worker then finishes the trial in hand.
wait "$worker"
code=$?
while kill -0 "$worker" 2>/dev/null; do
  wait "$worker"
  code=$?
done

# 4: stopped with trials left, because the time was up. The same task goes on where it was.
if [[ $code == 4 && -n ${SLURM_ARRAY_JOB_ID:-} ]]; then
  scontrol requeue "${SLURM_ARRAY_JOB_ID}_${SLURM_ARRAY_TASK_ID}" && exit 0
fi
exit "$code"
