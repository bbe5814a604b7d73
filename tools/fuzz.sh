#!/usr/bin/env bash
# Each fuzz target of ekf-core for a time by libFuzzer, from the stored corpus: fuzz.sh SECONDS [TARGET...]
set -euo pipefail
cd "$(dirname "$0")/../crates/ekf-core/fuzz"
seconds=$1
shift
found=$(cd ../../.. && pwd)/build/fuzz
for target in "${@:-$(basename -s .rs fuzz_targets/*.rs)}"; do
    for each in $target; do
        mkdir -p "$found/$each"
        cargo +nightly fuzz run "$each" --fuzz-dir . --features libfuzzer "$found/$each" "corpus/$each" -- \
            -max_len=600 -timeout=10 "-max_total_time=$seconds" "-artifact_prefix=$found/$each-"
    done
done
