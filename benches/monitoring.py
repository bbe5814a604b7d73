"""Alarms of a live view: how often a block is as far from an honest model as stated, what is said of dishonest ones.

From the top of the repository: python -m benches.monitoring PART [--hours 20] [--seed 1] [--out FILE]
null: ten rigs that are declared right, an hour a line; blocks whose p is below 1e-2, 1e-3, 1e-4 within the exact 99 %
interval over all, at most 2 alarms in 200 h.
causes: noise of the sensor that doubles, a scale factor that steps by five standard deviations of what a block tells
of it, lost counts: an alarm of the right cause within 30 s in at least 57 of 60.
simulate: the rows of `accelcal simulate` under the sidecar that it writes: no alarm in 1000 blocks.
starts: rigs that begin with nothing, one record of 40 s each an hour: none is more than six deviations off at its end.
A later call goes on behind the file. Exit code 1 where a bar is missed.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy import stats

from accelcal.data import Array, Flags, Rig, Sensor
from accelcal.filters.stream import Readings
from accelcal.io.stream import Rows
from accelcal.live.tracker import SETTLING, Alarm, InnovationMonitor, LiveSettings, Tracker, settings_of

W = 2.0 * np.pi * np.array([0.11, 0.23, 0.37, 0.59])
SIZE = np.array([1.4, 1.05, 0.7, 0.49])
SCALE, BIAS = 0.01, 0.05
CHUNK = 200_000


@dataclass(frozen=True)
class Setting:
    """A rig that is declared right."""

    noise: float
    """(m/s²)/√Hz"""
    rate: float
    """Of the output, Hz."""
    resolution: float
    """m"""
    gaussian: float = 0.0
    """Noise of the encoder, m."""
    readings: float = 0.0
    """Rate of the readings on a clock of their own, Hz; 0 for the clock of the output."""
    jitter: float = 0.0
    """Of the stamps, steps."""
    lost: float = 0.0
    """Share of the rows."""
    rests: bool = False
    """The stage rests half of the time."""
    model: bool = False
    """Start from parameters as a fit would tell them."""


SETTINGS = (
    Setting(2e-3, 50, 1e-6),
    Setting(2e-3, 50, 1e-6, rests=True),
    Setting(2e-3, 50, 0.0, gaussian=1e-6, model=True),
    Setting(2e-3, 1000, 1e-6, gaussian=0.5e-6, readings=431.7, model=True),
    Setting(2e-3, 400, 1e-6, jitter=0.2, lost=0.05, model=True),
    Setting(2e-2, 1000, 1e-7),
    Setting(2e-2, 1000, 1e-7, model=True),
    Setting(2e-2, 1667, 1e-7),
    Setting(2.2e-3, 1667, 1e-8),
    Setting(2e-3, 500, 1e-6, model=True),
)


def settings(rig: Setting, rng: np.random.Generator, seconds: float = 1e4) -> LiveSettings:
    """Those of `accelcal live` for a rig, from nothing or from what a fit of an earlier record would tell."""
    sensor = Sensor(noise=rig.noise, range=50.0)
    anew = settings_of(Rig(sensor, resolution=rig.resolution or None, reading_noise=rig.gaussian or None))
    if not rig.model:
        return anew
    spread = np.diag([1e-4, 1e-4]) ** 2
    truth = np.array([SCALE, BIAS]) + 1e-4 * rng.standard_normal(2)
    return replace(anew, theta=truth, covariance=spread, begun=True)


def place(t: Array, phase: Array, rests: bool) -> tuple[Array, Array]:
    """Position (m) and acceleration (m/s²) of the stage, (n,) each: sines, which rests slow to nothing and back."""
    if not rests:
        s = np.sin(W[:, None] * t + phase[:, None])
        return -(SIZE / W**2) @ s, SIZE @ s
    # The stage follows sines of a clock that stands still every second twenty seconds, its ends smooth.
    part = np.mod(t, 40.0) / 20.0
    x = np.clip(part, 0.0, 1.0)
    clock = 20.0 * (np.floor(t / 40.0) + x**3 * (10.0 - 15.0 * x + 6.0 * x * x))
    rate = 30.0 * x**2 * (1.0 - x) ** 2
    change = 60.0 * x * (1.0 - x) * (1.0 - 2.0 * x) / 20.0
    angle = W[:, None] * clock + phase[:, None]
    s, c = np.sin(angle), np.cos(angle)
    return -(SIZE / W**2) @ s, (SIZE @ s) * rate**2 - (SIZE / W) @ c * change


@dataclass
class Change:
    """What happens to a rig after a time."""

    kind: str = ""
    t: float = math.inf
    """s"""
    size: float = 0.0
    """Factor of the noise, added scale factor or bias, or counts."""


class Record:
    """Rows of a rig, chunk by chunk."""

    def __init__(self, rig: Setting, rng: np.random.Generator, change: Change | None = None) -> None:
        self.rig, self.rng, self.change = rig, rng, change or Change()
        self.phase = rng.uniform(0.0, 2.0 * np.pi, len(W))
        self.rows = 0

    def take(self, n: int) -> Rows:
        """The next n samples of the output, with the readings between them."""
        rig, rng, change = self.rig, self.rng, self.change
        i = np.arange(self.rows, self.rows + n)
        self.rows += n
        t = i / rig.rate
        if rig.jitter:
            t = t + rig.jitter / rig.rate * rng.uniform(-0.5, 0.5, n)
        x, a = place(t, self.phase, rig.rests)
        after = t >= change.t
        scale = SCALE + np.where(after & (change.kind == "scale"), change.size, 0.0)
        factor = np.where(after & (change.kind == "noise"), change.size, 1.0)
        bias = BIAS + np.where(after & (change.kind == "bias"), change.size, 0.0)
        u = bias + (1.0 + scale) * a + factor * rng.standard_normal(n) * rig.noise * math.sqrt(rig.rate / 2.0)
        if not rig.readings:
            rows = Rows(t, u, self._read(x, t))
        else:
            k = np.arange(math.ceil(t[0] * rig.readings), math.ceil((t[-1] + 1.0 / rig.rate) * rig.readings))
            stamps = k / rig.readings
            z = self._read(place(stamps, self.phase, rig.rests)[0], stamps)
            both = np.concatenate([t, stamps])
            order = np.argsort(both, kind="stable")
            nothing = np.full(len(stamps), np.nan), np.full(n, np.nan)
            rows = Rows(both[order], np.concatenate([u, nothing[0]])[order], np.concatenate([nothing[1], z])[order])
        if rig.lost:
            remaining = rng.uniform(size=len(rows.t)) >= rig.lost
            rows = Rows(rows.t[remaining], rows.accel[remaining], rows.position[remaining])
        return rows

    def _read(self, x: Array, t: Array) -> Array:
        rig = self.rig
        z = x + rig.gaussian * self.rng.standard_normal(len(x))
        z = np.round(z / rig.resolution) * rig.resolution if rig.resolution else z
        step = rig.resolution or rig.gaussian
        return z + np.where((t >= self.change.t) & (self.change.kind == "counts"), self.change.size * step, 0.0)


class Remembering(InnovationMonitor):
    """A monitor that keeps the p of each block."""

    def __init__(self, chosen: LiveSettings) -> None:
        super().__init__(resolution=chosen.sharp_resolution, settling=1 if chosen.begun else SETTLING)
        self.every: list[float] = []
        self.remarks = 0

    def _judged(self, block: Readings, moved: Flags) -> Alarm | None:
        alarm = super()._judged(block, moved)
        assert self.p is not None
        if np.sum(moved) > 0.5 * len(moved):  # the slopes alone are too small at rest
            self.every.append(self.p)
        self.remarks += bool(self.remark)
        return alarm


def null(task: tuple[int, int, int], hours: float = 1.0) -> dict[str, Any]:
    """Hours of an honest rig."""
    at, run, seed = task
    rng = np.random.default_rng((seed, at, run))
    rig = SETTINGS[at]
    chosen = settings(rig, rng)
    record, tracker = Record(rig, rng), Tracker(chosen)
    monitor, alarms, squares, readings = Remembering(chosen), list[Alarm](), 0.0, 0
    most = math.ceil(hours * 3600 * rig.rate)
    while record.rows < most:
        rows = tracker.feed(record.take(min(CHUNK, most - record.rows)))
        squares += float(np.sum(rows.white**2 / rows.white_variance))
        readings += len(rows.t)
        alarms += monitor.add(rows)
    p = np.array(monitor.every)
    below = [int(np.sum(p < limit)) for limit in LIMITS]
    kinds = Counter(alarm.kind for alarm in alarms)
    return {
        "setting": at,
        "run": run,
        "seed": seed,
        "blocks": len(p),
        "below": below,
        "alarms": kinds,
        "remarks": monitor.remarks,
        "nis": squares / readings,
    }


LIMITS = (1e-2, 1e-3, 1e-4)
CAUSES = {"noise": "noise", "scale": "mean", "counts": "jump"}
BEFORE = 120.0
"""Time before something happens, s."""


def cause(task: tuple[int, int, int]) -> dict[str, object]:
    """A rig to which something happens: the causes of the alarms after it."""
    at, run, seed = task
    rng = np.random.default_rng((seed, at, run, 7))
    rig = SETTINGS[CAUSED[run % len(CAUSED)]]
    kind = list(CAUSES)[at]
    chosen = replace(settings(rig, rng), covariance=np.diag([1e-4, 1e-4]) ** 2, theta=np.array([SCALE, BIAS]))
    size = {"noise": 2.0, "counts": 20.0}.get(kind) or 5.0 * block_deviation(rig, chosen, rng)
    change = Change(kind, BEFORE + rng.uniform(0.0, 5.0), size)
    record, tracker = Record(rig, rng, change), Tracker(chosen)
    monitor, alarms = InnovationMonitor(resolution=chosen.sharp_resolution), list[Alarm]()
    while record.rows < (BEFORE + 35.0) * rig.rate:
        alarms += monitor.add(tracker.feed(record.take(max(100, int(rig.rate)))))
    early = [alarm.kind for alarm in alarms if alarm.t < change.t]
    kinds = [alarm.kind for alarm in alarms if change.t <= alarm.t < change.t + 30.0]
    return {"setting": at, "run": run, "seed": seed, "early": early, "kinds": kinds, "size": size}


CAUSED = (0, 4, 5, 8, 9)
"""Settings to which something happens."""


def block_deviation(rig: Setting, chosen: LiveSettings, rng: np.random.Generator) -> float:
    """Standard deviation of the scale factor that a block of readings tells by itself."""
    record, tracker = Record(rig, np.random.default_rng(rng.integers(2**32))), Tracker(chosen)
    readings = tracker.feed(record.take(int(60 * rig.rate)))
    late = readings.t > 20.0
    seconds = max(1.0, 200.0 / (np.sum(late) / 40.0))
    return float((np.sum(readings.informations[late, 0]) / 40.0 * seconds) ** -0.5)


def start(task: tuple[int, int, int]) -> dict[str, Any]:
    """A rig that begins with nothing: how far its scale factor is off after 40 s, in standard deviations."""
    at, run, seed = task
    rng = np.random.default_rng((seed, at, run))
    rig = SETTINGS[at]
    record, tracker = Record(rig, rng), Tracker(settings(rig, rng))
    while record.rows < 40 * rig.rate:
        tracker.feed(record.take(int(rig.rate)))
    assert tracker.filter is not None
    k = tracker.filter.names.index("k")
    z = (tracker.filter.estimate[k] - SCALE) / math.sqrt(tracker.filter.covariance[k, k])
    return {"setting": at, "run": run, "seed": seed, "z": float(z)}


WORK = {
    "null": (null, range(len(SETTINGS))),
    "causes": (cause, range(len(CAUSES))),
    "starts": (start, [at for at, rig in enumerate(SETTINGS) if not rig.model]),
}
"""Of each part what is done, and with which settings."""


def simulated(seeds: range) -> tuple[int, int]:
    """Blocks and alarms of `accelcal simulate` followed by `accelcal live`."""
    from typer.testing import CliRunner

    from accelcal.cli import app

    runner, blocks, alarms = CliRunner(), 0, 0
    with TemporaryDirectory() as folder:
        for seed in seeds:
            run = Path(folder) / f"{seed}.csv"
            for words in (
                ["simulate", "--seconds", "200", "--seed", str(seed), "-o", str(run)],
                ["live", "--file", str(run), "--rig", str(run.with_suffix(".toml")), "--json"],
            ):
                answer = runner.invoke(app, words)
                assert answer.exit_code == 0, answer.output
            end = json.loads([line for line in answer.stdout.splitlines() if line.startswith("{")][-1])
            blocks, alarms = blocks + end["state"]["blocks"], alarms + end["state"]["alarms"]
    return blocks, alarms


def judged(part: str, lines: list[dict]) -> bool:
    """Print what the lines say; whether the bars hold."""
    holds = True
    if part == "null":
        totals = np.zeros(len(LIMITS), dtype=int)
        blocks, alarms = 0, 0
        for at in range(len(SETTINGS)):
            these = [line for line in lines if line["setting"] == at]
            if not these:
                continue
            count = sum(line["blocks"] for line in these)
            below = np.sum([line["below"] for line in these], axis=0)
            raised = sum((Counter(line["alarms"]) for line in these), Counter())
            ratios = [float(b / (count * limit)) for b, limit in zip(below, LIMITS, strict=True)]
            nis = float(np.mean([line["nis"] for line in these]))
            remarks = sum(line["remarks"] for line in these)
            print(
                f"{at}: {len(these)} h, {count} blocks, NIS {nis:.4f}, below over stated "
                f"{', '.join(f'{ratio:.2f}' for ratio in ratios)}, {remarks} remarks, alarms {dict(raised)}"
            )
            totals, blocks, alarms = totals + below, blocks + count, alarms + raised.total()
        for total, limit in zip(totals, LIMITS, strict=True):
            low, high = stats.binom.interval(0.99, blocks, limit)
            print(f"p < {limit:g}: {total} of {blocks} blocks, {low:g} to {high:g}")
            holds &= bool(low <= total <= high)
        print(f"alarms: {alarms} in {len(lines)} h (at most 2 in 200)")
        holds &= alarms <= 2
    elif part == "starts":
        astray = [line for line in lines if abs(line["z"]) > 6.0]
        print(f"{len(astray)} of {len(lines)} starts more than six deviations off after 40 s (none)")
        holds = not astray
    else:
        right = 0
        for at, (kind, wanted) in enumerate(CAUSES.items()):
            these = [line for line in lines if line["setting"] == at]
            first = [line["kinds"][0] if line["kinds"] else "none" for line in these]
            good = sum(wanted == Counter(line["kinds"]).most_common(1)[0][0] for line in these if line["kinds"])
            right += good
            print(f"{kind}: {good} of {len(these)} right by most alarms; by the first {dict(Counter(first))}")
        print(f"{right} of {len(lines)} in all (57 of 60)")
        holds = right >= 0.95 * len(lines)
    return holds


def main(arguments: Sequence[str] | None = None) -> int:
    """Follow the records that are not in the file yet, and judge all of them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", choices=("null", "causes", "simulate", "starts"))
    parser.add_argument("--hours", type=int, default=20, help="of each rig; of causes and starts, records of each")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--settings", type=int, nargs="*")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path)
    chosen = parser.parse_args(arguments)
    if chosen.part == "simulate":
        blocks, alarms = simulated(range(chosen.seed, chosen.seed + 6))
        print(f"simulate | live: {alarms} alarms in {blocks} blocks (0 of 1000)")
        return int(alarms > 0 or blocks < 1000)
    out = chosen.out or Path(f"build/monitoring_{chosen.part}.jsonl")
    out.parent.mkdir(parents=True, exist_ok=True)
    lines = [json.loads(line) for line in out.read_text().splitlines()] if out.exists() else []
    lines = [line for line in lines if line["seed"] == chosen.seed]
    there = {(line["setting"], line["run"]) for line in lines}
    work, usual = WORK[chosen.part]
    tasks = [
        (at, run, chosen.seed)
        for run in range(chosen.hours)
        for at in (chosen.settings or usual)
        if (at, run) not in there
    ]
    with multiprocessing.Pool(chosen.workers) as pool, out.open("a") as file:
        for line in pool.imap_unordered(work, tasks):
            lines.append(json.loads(json.dumps(line)))
            file.write(json.dumps(line) + "\n")
            file.flush()
    return int(not judged(chosen.part, lines))


if __name__ == "__main__":
    raise SystemExit(main())
