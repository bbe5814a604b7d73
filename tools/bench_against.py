"""Processor time and peak memory of the commands of the loop in two installations of accelcal, runs alternated.

    python tools/bench_against.py THEN NOW [--rounds 5] [--hour ROUNDS] [--samples 100200] [--limit 1.05]

THEN and NOW are the interpreters of two virtual environments. A minute as CSV beside an ordinary sidecar: every command
in a fresh process with nothing kept in the user's cache, beside `import numpy` in the same rounds, which is the ruler;
then the same work in one warm process. With --hour ten minutes and an hour as Parquet as well. Medians of the rounds.
Exit code 1 where NOW needs more than its limit, or more than --limit times the time of THEN.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
RECORD = """
import sys
from pathlib import Path
from accelcal.io import write_csv, write_parquet, write_sidecar
from benches.fit import record
for name, samples in zip(sys.argv[1::2], sys.argv[2::2]):
    recording, path = record(int(samples)), Path(name)
    write = write_csv if path.suffix == ".csv" else write_parquet
    write_sidecar(recording.rig, write(recording, path), path.with_suffix(".toml"))
"""
"""In a process of its own: a child inherits the peak memory of the process that starts it."""
WARM = """
import json, statistics, sys, time
import accelcal as ac
run = ac.load(sys.argv[1])
model = ac.fit(run)
jobs = {
    "fit": lambda: ac.fit(run),
    "diagnose": lambda: ac.diagnose(model, run),
    "add": lambda: ac.add(model, run, "quadratic"),
    "improve": lambda: ac.improve(run),
}
took = {job: [] for job in jobs}
for _ in range(int(sys.argv[2]) + 1):
    for job, work in jobs.items():
        run.accel.y[0] += 1e-9  # other content: nothing of it was examined before
        begin = time.process_time()
        work()
        took[job].append(time.process_time() - begin)
print(json.dumps({job: statistics.median(seconds[1:]) for job, seconds in took.items()}))
"""
"""Prints medians of the same work in one process, the first call of each left out."""
COMMANDS = {
    "check": "check {run}",
    "fit": "fit {run} -o {model} --force",
    "diagnose": "diagnose {model} {run}",
    "improve": "improve {run}",
    "add": "add {model} {run} --effect quadratic -o added-{model} --force",
    "report": "report {model} {run} -o {model}.html --force",
    "report --light": "report {model} {run} -o {model}.html --force --light",
}
"""Arguments of each command, in an order in which each finds the files that it reads."""
RULERS = {"check": 8.0, "fit": 13.0, "diagnose": 16.0, "improve": 17.0}
"""Most processor time of a command on a minute over that of `import numpy`."""
SECONDS = {"report": 3.5}
"""Most processor time of a command on a minute, s."""
WARM_SECONDS = {"fit": 0.3, "diagnose": 0.5, "add": 0.2, "improve": 0.7}
"""The same in a warm process, s."""
HOUR = {"fit": 15.0, "diagnose": 20.0, "improve": 35.0, "report": 45.0}
"""Most processor time on an hour, s."""
MEGABYTES = 1000.0
"""Most memory on an hour."""
GROWTH = 1.1
"""Most time per sample of an hour over that of ten minutes."""
MINUTE, TEN_MINUTES, AN_HOUR = 100_200, 1_000_200, 6_001_200
"""Samples of a record at 1667 Hz."""


@dataclass(frozen=True, slots=True)
class Cost:
    """What a process took."""

    seconds: float
    """Processor time, s."""
    megabytes: float = 0.0


def cost(command: list[str], folder: Path) -> Cost:
    """What a command takes where no run before it has kept anything for it.

    Raises
    ------
    SystemExit
        If the command fails.
    """
    cache = folder / "cache"
    shutil.rmtree(cache / "accelcal", ignore_errors=True)
    environment = {**os.environ, "XDG_CACHE_HOME": str(cache), "OPENBLAS_NUM_THREADS": "1"}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)  # a user's modules are compiled once
    with open(os.devnull, "w") as output:
        child = subprocess.Popen(command, cwd=folder, env=environment, stdout=output, stderr=subprocess.PIPE, text=True)
    error = child.stderr.read() if child.stderr else ""
    _, status, usage = os.wait4(child.pid, 0)
    if os.waitstatus_to_exitcode(status) != 0:
        raise SystemExit(f"{' '.join(command)}: {error}")
    return Cost(usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024)


Costs = Mapping[str, Mapping[str, Cost]]
"""Medians by installation and job."""


def alternated(pythons: Mapping[str, str], jobs: Mapping[str, str], run: str, folder: Path, rounds: int) -> Costs:
    """Medians of every job, and of the ruler "import numpy", in each installation, all of them in turn."""
    costs: dict[str, dict[str, list[Cost]]] = {which: {} for which in pythons}
    for _ in range(rounds):
        for job in ("import numpy", *jobs):
            for which, python in pythons.items():
                arguments = jobs[job].format(run=run, model=f"{which}.json").split() if job in jobs else []
                command = [python, "-m", "accelcal", *arguments] if arguments else [python, "-c", job]
                costs[which].setdefault(job, []).append(cost(command, folder))
    return {
        which: {
            job: Cost(*(statistics.median(getattr(c, part) for c in several) for part in ("seconds", "megabytes")))
            for job, several in by_job.items()
        }
        for which, by_job in costs.items()
    }


def within(value: float, limit: float | None) -> str:
    """What is printed of a limit; empty where there is none."""
    return "" if limit is None else f", limit {limit:g}: {'ok' if value <= limit else 'MISSED'}"


def figure(job: str, then: float, now: float, unit: str, limit: float | None = None, ratio: float | None = None) -> str:
    """One figure of both installations, with the limit of the second and of their ratio."""
    return (
        f"{job}: {then:.2f} {unit} then, {now:.2f} {unit} now{within(now, limit)}; "
        f"ratio {now / then:.3f}{within(now / then, ratio)}"
    )


def main() -> int:
    """Alternate the two, print every figure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("then")
    parser.add_argument("now")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--hour", type=int, default=0, help="rounds with ten minutes and an hour; none by default")
    parser.add_argument("--samples", type=int, default=MINUTE, help="of the accelerometer in what is the minute")
    parser.add_argument("--limit", type=float, default=1.05)
    given = parser.parse_args()
    pythons = {"then": given.then, "now": given.now}
    lines = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        lengths = {"minute.csv": given.samples} | (
            {"ten.parquet": TEN_MINUTES, "hour.parquet": AN_HOUR} if given.hour else {}
        )
        record = [text for file, samples in lengths.items() for text in (str(folder / file), str(samples))]
        subprocess.run([sys.executable, "-c", RECORD, *record], cwd=ROOT, check=True)
        of = alternated(pythons, COMMANDS, "minute.csv", folder, given.rounds)
        for job in ("import numpy", *COMMANDS):
            then, now = of["then"][job], of["now"][job]
            lines.append(figure(job, then.seconds, now.seconds, "s", SECONDS.get(job), given.limit))
            rulers = [c.seconds / of[which]["import numpy"].seconds for which, c in (("then", then), ("now", now))]
            lines.append(figure(job, *rulers, "times import numpy", RULERS.get(job)))
            lines.append(figure(job, then.megabytes, now.megabytes, "MB"))
        print("\n".join(lines), flush=True)
        warm = {
            which: json.loads(
                subprocess.check_output([python, "-c", WARM, "minute.csv", str(given.rounds)], cwd=folder, text=True)
            )
            for which, python in pythons.items()
        }
        lines += [
            figure(f"{job}, warm", warm["then"][job], warm["now"][job], "s", limit, given.limit)
            for job, limit in WARM_SECONDS.items()
        ]
        print("\n".join(lines[-len(WARM_SECONDS) :]), flush=True)
        if given.hour:
            jobs = {job: COMMANDS[job] for job in HOUR}
            ten, hour = (alternated(pythons, jobs, f"{run}.parquet", folder, given.hour) for run in ("ten", "hour"))
            for job, limit in HOUR.items():
                then, now = hour["then"][job], hour["now"][job]
                lines.append(figure(f"{job} of an hour", then.seconds, now.seconds, "s", limit, given.limit))
                lines.append(figure(f"{job} of an hour", then.megabytes, now.megabytes, "MB", MEGABYTES, given.limit))
                growth = [
                    c.seconds / ten[which][job].seconds * TEN_MINUTES / AN_HOUR
                    for which, c in (("then", then), ("now", now))
                ]
                lines.append(figure(f"{job}, a sample of an hour", *growth, "times one of ten minutes", GROWTH))
            print("\n".join(lines[-3 * len(HOUR) :]), flush=True)
    return 1 if any("MISSED" in line for line in lines) else 0


if __name__ == "__main__":
    raise SystemExit(main())
