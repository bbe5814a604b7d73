#!/bin/sh
# Installs the wheel of dist/ into an empty environment that has neither compiler nor cargo, and runs the main commands
# there: with the newest versions of what it needs, or with `--lowest` the lowest that pyproject.toml allows.
# usage: tools/try_wheel.sh [--lowest]
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
there="$root/build/wheel${1:-}"
rm -rf "$there"
"${PYTHON:-python3}" -m venv "$there"
python="$there/bin/python"
set -- "$root"/dist/accelcal-*.whl ${1:+"$1"}
"$python" -m zipfile -l "$1" | grep -q licenses/LICENSES-THIRD-PARTY.txt # of the crates that are compiled in
constraints="$root/constraints.txt"
if [ "${2:-}" = --lowest ]; then
    constraints="$there/lowest.txt"
    "$python" "$root/tools/lowest.py" >"$constraints"
fi
# Build tools are out of reach: a package that would have to be compiled is refused.
unset PIP_CONSTRAINT
PATH="$there/bin" "$python" -m pip install --quiet --disable-pip-version-check --only-binary :all: \
    --constraint "$constraints" "$1"
mkdir "$there/run"
cd "$there/run"
accelcal() {
    PATH="$there/bin" "$python" -W error::DeprecationWarning:accelcal -m accelcal "$@" >>out.txt
}
accelcal simulate -o run12.csv --sensor CXL02 --cubic 1e-3 --seed 21
accelcal simulate -o run13.csv --sensor CXL02 --cubic 1e-3 --seed 22
accelcal check run12.csv
accelcal fit run12.csv -o m1.json
accelcal compare m1.json run13.csv
accelcal diagnose m1.json run12.csv
accelcal add m1.json run12.csv --effect cubic -o m2.json
accelcal compare m1.json m2.json run13.csv
accelcal power run12.csv
accelcal export m2.json --c sensor.h --rust sensor.rs
accelcal doctor
"$python" -m pip list --format freeze --disable-pip-version-check | grep -iE '^(accelcal|numpy|scipy|pyarrow|pint)=' |
    tr '\n' ' '
echo "ran the main commands"
