#!/usr/bin/env bash
# The long run: each target for SECONDS (600) in turn, one process, again and again until LIMIT seconds (3600) are over.
#   fuzz/long.sh [SECONDS] [LIMIT]
# Appends "target inputs seconds" to fuzz/logs/counts.tsv after each turn and prints the sums; docs/reliability.md has
# those of the last long run. Stops at the first input that fails.
set -euo pipefail
cd "$(dirname "$0")"
seconds=${1:-600}
limit=${2:-3600}
mkdir -p logs
./run.sh build
started=$SECONDS
while [ $((SECONDS - started)) -lt "$limit" ]; do
  for target in model frame pipeline c_interface photo writers; do
    if ! ./run.sh "$target" "$seconds" >"logs/$target.log" 2>&1; then
      tail -n 60 "logs/$target.log"
      exit 1
    fi
    count=$(sed -n 's/^stat::number_of_executed_units: *//p' "logs/$target.log")
    printf '%s\t%s\t%s\n' "$target" "$count" "$seconds" >>logs/counts.tsv
  done
done
awk -F'\t' '{ inputs[$1] += $2; time[$1] += $3 } END { for (t in inputs) print t, inputs[t], "inputs", time[t], "s" }' \
  logs/counts.tsv
