"""What a start costs: `import accelcal` and `accelcal --help` against `import numpy`, in one run.

Run from the top of the repository: python -m benches.start
Each is started many times in turn in a fresh process; compared are the medians of their processor times. Prints figures
and thresholds; exit code 1 when one is missed.
"""

from __future__ import annotations

import resource
import statistics
import subprocess
import sys

RUNS = 21
STARTED = {
    "import numpy": ("-c", "import numpy"),
    "import accelcal": ("-c", "import accelcal"),
    "accelcal --help": ("-m", "accelcal", "--help"),
}
"""What follows the name of the interpreter; the first is what the others are compared with."""
MOST = {"import accelcal": 2.0, "accelcal --help": 3.0}
"""Processor time over that of the first."""
SECONDS = 0.6
"""Most processor time of the help, s, where nothing else wants the caches."""


def spent() -> float:
    """Processor time of all children so far, s."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def cost(arguments: tuple[str, ...]) -> float:
    """Processor time of one fresh process, s."""
    before = spent()
    subprocess.run([sys.executable, *arguments], check=True, stdout=subprocess.DEVNULL)
    return spent() - before


def main() -> int:
    """Start everything in turn, so that what else the machine does falls on all alike."""
    costs: dict[str, list[float]] = {name: [] for name in STARTED}
    for _ in range(RUNS):
        for name, arguments in STARTED.items():
            costs[name].append(cost(arguments))
    medians = {name: statistics.median(all_of) for name, all_of in costs.items()}
    unit = next(iter(medians.values()))
    for name, median in medians.items():
        goal = f" (goal {MOST[name]})" if name in MOST else ""
        print(f"{name}: {median:.3f} s processor time, median of {RUNS}; {median / unit:.2f} of numpy{goal}")
    least = min(costs["accelcal --help"])
    print(f"accelcal --help: {least:.2f} s at least (goal {SECONDS} s)")
    return 0 if least <= SECONDS and all(medians[name] <= most * unit for name, most in MOST.items()) else 1


if __name__ == "__main__":
    sys.exit(main())
