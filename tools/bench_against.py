"""Processor time and peak memory of fit and diagnose in two installations of accelcal, runs alternated.

    python tools/bench_against.py THEN NOW [--rounds 3] [--samples 1000200] [--limit 1.05]

THEN and NOW are the interpreters of two virtual environments. Every run is a command in a fresh process; of each figure
the least counts, since whatever else runs on the machine only adds. Exit code 1 where NOW needs more than --limit times
the time or memory of THEN.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
RECORD = """
import sys
from pathlib import Path
from benches.fit import record, write_sample
write_sample(record(int(sys.argv[1])), Path(sys.argv[2]))
"""
"""In a process of its own: a child inherits the peak memory of the process that starts it."""
TEN_MINUTES = 1_000_200
"""Samples of a record of ten minutes; an hour has 6 001 200, a minute 100 200."""


def cost(command: list[str], folder: Path) -> tuple[float, float]:
    """Processor time (s) and peak memory (MB) of a command.

    Raises
    ------
    SystemExit
        If the command fails.
    """
    output = os.open(os.devnull, os.O_WRONLY)
    child = subprocess.Popen(command, cwd=folder, stdout=output, stderr=subprocess.PIPE, text=True)
    error = child.stderr.read() if child.stderr else ""
    _, status, usage = os.wait4(child.pid, 0)
    os.close(output)
    if os.waitstatus_to_exitcode(status) != 0:
        raise SystemExit(f"{' '.join(command)}: {error}")
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def main() -> int:
    """Alternate the two, and compare the least of each figure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("then")
    parser.add_argument("now")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--samples", type=int, default=TEN_MINUTES, help="of the accelerometer: 6001200 in an hour")
    parser.add_argument("--limit", type=float, default=1.05)
    given = parser.parse_args()
    missed = 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        samples = given.samples
        subprocess.run([sys.executable, "-c", RECORD, str(samples), str(folder / "run.parquet")], cwd=ROOT, check=True)
        jobs = {
            "fit": ["fit", "run.parquet", "-o", "{which}.json"],  # each reads the models that it wrote
            "diagnose": ["diagnose", "{which}.json", "run.parquet", "--json"],
        }
        for job, arguments in jobs.items():
            found: dict[str, list[tuple[float, float]]] = {"then": [], "now": []}
            for _ in range(given.rounds):
                for which, python in (("then", given.then), ("now", given.now)):
                    own = [argument.format(which=which) for argument in arguments]
                    found[which].append(cost([python, "-m", "accelcal", *own], folder))
            for index, (figure, unit) in enumerate((("processor time", "s"), ("peak memory", "MB"))):
                then, now = (min(run[index] for run in found[which]) for which in ("then", "now"))
                verdict = "ok" if now <= given.limit * then else "MISSED"
                missed += verdict != "ok"
                print(
                    f"{job} of {samples} samples, {figure}: {then:.2f} {unit} then, {now:.2f} {unit} now, "
                    f"ratio {now / then:.3f} (least of {given.rounds} each, limit {given.limit:g}): {verdict}",
                    flush=True,
                )
    return min(1, missed)


if __name__ == "__main__":
    raise SystemExit(main())
