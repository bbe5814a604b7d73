"""What `accelcal --help` costs: processor time of a fresh process, least of five.

Run from the top of the repository: python -m benches.start
Prints figure and threshold; exit code 1 when it is missed.
"""

from __future__ import annotations

import resource
import subprocess
import sys

RUNS = 5
SECONDS = 0.6
"""Processor time, s."""


def spent() -> float:
    """Processor time of all children so far, s."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def main() -> int:
    """Start the command line a few times; the least is what it costs when nothing else wants the caches."""
    costs = []
    for _ in range(RUNS):
        before = spent()
        subprocess.run([sys.executable, "-m", "accelcal", "--help"], check=True, stdout=subprocess.DEVNULL)
        costs.append(spent() - before)
    print(f"accelcal --help: {min(costs):.2f} s processor time, least of {RUNS} (goal {SECONDS} s)")
    return 0 if min(costs) <= SECONDS else 1


if __name__ == "__main__":
    sys.exit(main())
