#!/bin/sh
# Holds the outputs of the checkout to those of another revision on ten recordings: numbers and names, sentences aside.
# usage: ACCELCAL_REAL_DATA=... tools/compare_outputs.sh REV [--rtol 1e-12]
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
other=$("$root/tools/revision.sh" "$1")
shift
rm -rf "$root/build/outputs"
"$other/.venv/bin/python" "$root/tools/compare_outputs.py" run "$root/build/outputs/then"
"$root/.venv/bin/python" "$root/tools/compare_outputs.py" run "$root/build/outputs/now"
"$root/.venv/bin/python" "$root/tools/compare_outputs.py" diff "$root/build/outputs/then" "$root/build/outputs/now" "$@"
