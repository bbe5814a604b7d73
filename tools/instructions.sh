#!/bin/sh
# Instructions per step by callgrind: the difference of a 40 000- and a 20 000-step run.
# usage: tools/instructions.sh KERNEL WORKLOAD
set -eu
steps="${CARGO_TARGET_DIR:-target}/release/examples/steps"
count() { valgrind --tool=callgrind --callgrind-out-file=/dev/null "$steps" "$@" 2>&1 | sed -n 's/.*Collected : //p'; }
case "$1" in
    alone | four) record=runs ;;
    effects) record=columns ;;
    *) record=none ;;
esac
# Making the record costs as much for every kernel, and is taken off.
both=$(($(count "$1" "$2" 40000) - $(count "$1" "$2" 20000)))
none=$(($(count "$record" "$2" 40000) - $(count "$record" "$2" 20000)))
echo $(((both - none + 10000) / 20000))
