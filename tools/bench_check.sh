#!/bin/sh
# Instructions per step against tools/instructions.txt: fails 5 % above what is stored there, and says which bar is missed.
set -eu
command -v valgrind > /dev/null || { echo "bench-check needs valgrind: apt-get install valgrind"; exit 1; }
cargo build --release --quiet -p ekf-simd --example steps
failed=0
while read -r workload stored bar; do
    found=$(tools/instructions.sh structured "$workload")
    case "$found" in '' | *[!0-9]*) echo "W$workload: no count"; exit 1 ;; esac
    verdict="bar <= $bar met"
    [ "$found" -le "$bar" ] || verdict="bar <= $bar MISSED by $((found - bar))"
    if [ "$found" -gt $((stored + stored / 20)) ]; then
        verdict="$verdict; MORE THAN 5 % above the stored $stored"
        failed=1
    fi
    echo "W$workload: $found instructions per step; $verdict"
done < tools/instructions.txt
exit $failed
