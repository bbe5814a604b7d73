#!/bin/sh
# Processor time and peak memory of the main jobs, this checkout against another revision, runs alternated.
# usage: tools/bench_against.sh REV [--rounds 3] [--hour]
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
other=$("$root/tools/revision.sh" "$1")
shift
exec "$root/.venv/bin/python" "$root/tools/bench_against.py" "$other/.venv/bin/python" "$root/.venv/bin/python" "$@"
