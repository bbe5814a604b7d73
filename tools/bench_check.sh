#!/bin/sh
# Holds instructions per step to the stored budgets, and to 5 % of what was stored: tools/instructions.txt.
set -eu
command -v valgrind > /dev/null || { echo "bench-check needs valgrind: apt-get install valgrind"; exit 1; }
cargo build --release --quiet -p ekf-simd --example steps
failed=0
while read -r workload stored budget; do
    found=$(tools/instructions.sh structured "$workload")
    limit=$((stored + stored / 20))
    [ "$limit" -lt "$budget" ] || limit=$budget
    echo "W$workload: $found instructions per step (stored $stored, budget $budget)"
    [ "$found" -le "$limit" ] || failed=1
done < tools/instructions.txt
exit $failed
