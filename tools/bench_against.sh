#!/bin/sh
# Processor time and peak memory of the main jobs, this checkout against another revision, runs alternated. Both are
# installed with what the report needs alone: what else lies in an environment is imported too (pint imports dask where
# it finds it).
# usage: tools/bench_against.sh REV [--rounds 5] [--hour ROUNDS] [--samples 100200] [--limit 1.05]
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
other=$("$root/tools/revision.sh" "$1")
shift
plain="$root/build/revisions/plain"
[ -x "$plain/bin/python" ] || "${PYTHON:-python3}" -m venv "$plain" >&2
# Not editable: that build is quicker to make and slower to run.
"$plain/bin/python" -m pip install --quiet --disable-pip-version-check --force-reinstall "$root[report]" >&2
exec "$root/.venv/bin/python" "$root/tools/bench_against.py" "$other/.venv/bin/python" "$plain/bin/python" "$@"
