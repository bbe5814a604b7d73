#!/bin/sh
# Prepares another revision beside the checkout, installed in a virtual environment of its own; prints its folder.
# usage: tools/revision.sh REV
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
rev=$(git -C "$root" rev-parse --short "$1^{commit}")
there="$root/build/revisions/$rev"
if [ ! -x "$there/.venv/bin/accelcal" ]; then
    [ -d "$there" ] || git -C "$root" worktree add --detach --force "$there" "$rev" >&2
    "${PYTHON:-python3}" -m venv "$there/.venv" >&2
    "$there/.venv/bin/python" -m pip install --quiet --disable-pip-version-check -e "$there[report]" >&2
fi
echo "$there"
