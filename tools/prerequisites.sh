#!/bin/sh
# Says in one sentence what a fresh machine lacks, and how to get it.
set -eu

lack() {
    echo "accelcal needs $1" >&2
    exit 1
}

python=${PYTHON:-python3}
command -v "$python" >/dev/null || lack "python3 >= 3.11; on Debian or Ubuntu: sudo apt-get install python3 python3-venv"
"$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' ||
    lack "python3 >= 3.11, found $("$python" -V); name a newer one with: make PYTHON=python3.12 demo"
"$python" -c 'import venv, ensurepip' 2>/dev/null ||
    lack "python's venv module; on Debian or Ubuntu: sudo apt-get install python3-venv"
command -v cc >/dev/null || lack "a C compiler; on Debian or Ubuntu: sudo apt-get install build-essential"
command -v cargo >/dev/null || lack "cargo >= 1.89; install Rust as https://rustup.rs says (Debian's rustc is too old)"
version=$(cargo --version | cut -d' ' -f2)
minor=$(echo "$version" | cut -d. -f2)
[ "$minor" -ge 89 ] || lack "cargo >= 1.89, found $version; update with: rustup update stable"
