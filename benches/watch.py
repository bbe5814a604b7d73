"""False names, power, delay and cost of a watch on a live filter.

From the top of the repository: python -m benches.watch [null|planted|late|live|cost] [--count 100] [--out FILE]
null: hours of sensors that have nothing beyond scale factor and bias, eight suspects, noise known: a line an hour; at
most 5 of 1000 hours may have a false name.
planted: one suspect, of the size that the hour shows at d = 10, from its begin on; late: from half-time on, d = 10 over
the second half. In the class that is named in the end in at least 95 of 100; the median time to the first name at most
1.5 of the time at which the same suspect reaches the threshold of a test that looks once, among 187 candidates.
live: as null, by a `LiveModel`, whose columns are those of a sensor in use: ten minutes a line.
cost: processor time of a step for each suspect.
A later call goes on behind the file. Exit code 1 where a bar is missed.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.stats import norm

from accelcal.data import Array, Rig
from accelcal.effects import find
from accelcal.filters.live_model import BETWEEN_STARTS, CLASS_WEIGHT, FALSE_NAMES, LiveModel
from accelcal.filters.stream import FACTORED, fixed_rate_with_effects
from accelcal.model import Model, Prior
from benches.monitoring import BIAS, SCALE, W, place

RATE, SECONDS = 50.0, 3600.0
NOISES, READINGS = (2e-3, 2e-2), (1e-6, 3e-6)
"""Noise of the output, (m/s²)/√Hz, and of a reading, m: one of each."""
START = 1e-3
"""Standard deviation of scale factor and bias at the begin, 1 and m/s²."""
SUSPECTS = (
    "quadratic", "cubic", "odd_quadratic", "scale_asymmetry",
    "velocity", "temperature_bias", "temperature_scale", "scale_drift",
)  # fmt: skip
LOOK = round(RATE)
"""Samples between two looks."""


def effects(f: Array, v: Array, temperature: Array, t: Array) -> tuple[Array, Array]:
    """What a unit of each suspect adds, m/s², and its derivative by the acceleration, (n, 8) each."""
    none = np.zeros_like(f)
    columns = [f**2, f**3, f * np.abs(f), np.abs(f), v, temperature, temperature * f, t * f]
    slopes = [2.0 * f, 3.0 * f**2, 2.0 * np.abs(f), np.sign(f), none, none, temperature, t]
    return np.stack(columns, axis=1), np.stack(slopes, axis=1)


class Hour:
    """A sensor in use: output and readings, and the columns of the suspects as they follow from its noisy output."""

    def __init__(self, key: Sequence[int], seconds: float = SECONDS) -> None:
        rng = np.random.default_rng(key)
        self.noise, self.reading = rng.choice(NOISES), rng.choice(READINGS)
        self.t = np.arange(round(seconds * RATE)) / RATE
        phase = rng.uniform(0.0, 2.0 * np.pi, len(W))
        x, self.a = place(self.t, phase, bool(rng.integers(2)))
        self.v = np.gradient(x, 1.0 / RATE)
        self.temperature = 3.0 * np.sin(2.0 * np.pi * self.t / rng.uniform(600.0, 3000.0) + phase[0])
        white = rng.standard_normal((2, len(self.t)))
        self.honest = BIAS + (1.0 + SCALE) * self.a + self.noise * math.sqrt(RATE / 2.0) * white[0]
        self.z = x + self.reading * white[1]
        self.start = np.array([x[0], self.v[0], *(np.array([SCALE, BIAS]) + START * rng.standard_normal(2))])
        self.seed = key

    def output(self, planted: int = 0, size: float = 0.0, since: float = 0.0) -> Array:
        """Output with a suspect of a size (SI) from a time (s) on, (n,) m/s²."""
        columns, _ = effects(self.a, self.v, self.temperature, self.t)
        return self.honest + size * columns[:, planted] * (self.t >= since)

    def watched(self, u: Array) -> Array:
        """Evidence of all suspects at every look, (looks, 8, 6)."""
        force = (u - self.start[3]) / (1.0 + self.start[2])
        here, slopes = effects(force, self.v, self.temperature, self.t)
        before = np.concatenate([here[:1], here[:-1]])
        # Half-way the filter's output is on the cubic through the last four samples, and so is its noise.
        halfway = np.convolve(force, [0.3125, 0.9375, -0.3125, 0.0625])[: len(force)]
        middle, _ = effects(halfway, self.v, self.temperature, self.t - 0.5 / RATE)
        columns = np.stack([before, middle, here], axis=1)
        P0 = np.diag([1e-8, 1e-4, START**2, START**2])
        scales = [find(name).prior.typical for name in SUSPECTS]
        filtered = fixed_rate_with_effects(
            dt=1.0 / RATE, q=self.noise**2 / 2.0, r_position=self.reading**2, x0=self.start, P0=P0,
            choice=replace(FACTORED, scores=True), watch=(scales, round(BETWEEN_STARTS * RATE)),
        )  # fmt: skip
        none, looks = np.zeros(len(SUSPECTS)), []
        outputs, readings = u.tolist(), self.z.tolist()
        for j, (output, reading) in enumerate(zip(outputs, readings, strict=True)):
            filtered.step_with_effects(output, reading, columns[j], none, slopes[j])
            if j % LOOK == LOOK - 1:
                looks.append(filtered.evidence)
        return np.array(looks)


def named(log_e: Array) -> list[int]:
    """Class that is named by e-values (8,); empty while chance explains them."""
    if np.max(log_e) <= math.log(len(SUSPECTS) / FALSE_NAMES):
        return []
    order = np.argsort(-log_e)
    weights = np.cumsum(np.exp(log_e[order] - np.max(log_e)))
    return order[: int(np.searchsorted(weights, CLASS_WEIGHT * weights[-1])) + 1].tolist()


def names(looks: Array) -> tuple[int, list[str], list[str]]:
    """Number of the first look that names anything, its class, and the last class; `len(looks)` where there is none."""
    classes = [[SUSPECTS[j] for j in named(row)] for row in looks[:, :, 0]]
    first = next((i for i, names in enumerate(classes) if names), len(looks))
    return first, next(filter(None, classes), []), next(filter(None, reversed(classes)), [])


def null(run: int, seed: int) -> dict[str, Any]:
    """An honest hour."""
    hour = Hour((seed, run, 1))
    looks = hour.watched(hour.output())
    _, first, _ = names(looks)
    z = looks[-1, :, 4] / np.sqrt(looks[-1, :, 5])
    return {"z": z.tolist(), "named": first, "noise": hour.noise, "log_e": float(looks[:, :, 0].max())}


def planted(run: int, seed: int, since: float = 0.0) -> dict[str, Any]:
    """An hour with one suspect of d = 10."""
    hour, j = Hour((seed, run, 2)), run % len(SUSPECTS)
    G = hour.watched(hour.output())[:, j, 5]
    begun = G[int(since * RATE) // LOOK - 1] if since else 0.0
    size = 10.0 / math.sqrt(G[-1] - begun)
    looks = hour.watched(hour.output(j, size, since))
    at, first, last = names(looks)
    d = size * np.sqrt(np.maximum(looks[:, j, 5] - begun, 0.0))
    bounds = {str(count): -norm.ppf(FALSE_NAMES / count / 2.0) for count in (len(SUSPECTS), 187)}
    row = looks[-1, j]
    return {
        "suspect": SUSPECTS[j],
        "first": first,
        "last": last,
        "delay": (at + 1) * LOOK / RATE - since,
        "one_look": {count: (int(np.argmax(d > bound)) + 1) * LOOK / RATE - since for count, bound in bounds.items()},
        "size": row[1] / size,
        "z": (row[1] - size) / row[2],
        "since": SECONDS - row[3] - since,
        "noise": hour.noise,
    }


def late(run: int, seed: int) -> dict[str, Any]:
    """The same from half-time on."""
    return planted(run, seed, SECONDS / 2.0)


def live(run: int, seed: int) -> dict[str, Any]:
    """Ten honest minutes of a `LiveModel`."""
    hour = Hour((seed, run, 3), 600.0)
    priors = {"scale_factor": Prior(hour.start[2], START), "bias": Prior(hour.start[3], START)}
    model = Model.linear().freeze(time_offset=0.0)
    model = replace(model, priors=priors)
    followed = LiveModel(
        model, Rig(), rate=RATE, q=hour.noise**2 / 2.0, r_position=hour.reading**2, position=float(hour.z[0]),
        watch=SUSPECTS,
    )  # fmt: skip
    reached: set[str] = set()
    for j, (u, z) in enumerate(zip(hour.output().tolist(), hour.z.tolist(), strict=True)):
        followed.step(u, z, temperature=float(hour.temperature[j]))
        if j % LOOK == LOOK - 1:
            reached |= {suspicion.name for suspicion in followed.named()}
    rows = np.asarray(followed._filter.evidence)
    return {
        "z": (rows[:, 4] / np.sqrt(np.maximum(rows[:, 5], 1e-300))).tolist(),
        "named": sorted(reached),
        "noise": hour.noise,
    }


def cost() -> bool:
    """Processor time of a step without suspects and with 16."""
    rng, seconds = np.random.default_rng(1), []
    for count in (0, 16):
        filtered = fixed_rate_with_effects(
            dt=1e-3, q=1e-6, r_position=1e-12, x0=np.zeros(4), P0=np.eye(4), choice=replace(FACTORED, scores=True),
            watch=([1.0] * count, 1000),
        )  # fmt: skip
        columns, none = rng.standard_normal((3, count)), np.zeros(count)
        best = math.inf
        for _ in range(20):
            begin = time.process_time()
            for _ in range(5000):
                filtered.step_with_effects(0.1, 0.0, columns, none, none)
            best = min(best, (time.process_time() - begin) / 5000)
        seconds.append(best)
    item = (seconds[1] - seconds[0]) / 16
    print(f"a step takes {1e9 * seconds[0]:.0f} ns, and {1e9 * item:.1f} ns more for each suspect")
    return item < 60e-9  # 416 instructions by callgrind


def judged(part: str, lines: list[dict[str, Any]]) -> bool:
    """Print what the lines say; whether the bars hold."""
    n = len(lines)
    if part in ("null", "live"):
        false = sum(bool(line["named"]) for line in lines)
        z = np.array([line["z"] for line in lines])
        unit = "h" if part == "null" else "times 10 min"
        print(f"{part}: {false} false names in {n} {unit}; scores at the end: mean {np.round(z.mean(axis=0), 2)}")
        print(f"  standard deviation {np.round(z.std(axis=0), 2)}, largest {np.max(np.abs(z)):.2f}")
        return false <= max(1, 5 * n / 1000)
    good = [line for line in lines if line["suspect"] in line["last"]]
    first = sum(line["suspect"] in line["first"] for line in lines)
    alone = sum(len(line["last"]) == 1 for line in good)
    early = sum(line["delay"] <= 0.0 for line in lines)
    within = np.mean(np.abs([line["z"] for line in good]) < 2.0)
    print(f"{part}: {len(good)} of {n} named in the end, {alone} alone; {first} at first; {early} before it was there")
    print(f"  size over truth {np.median([line['size'] for line in good]):.3f}, within 2 sigma {within:.0%}")
    ratios = [np.median([line["delay"] / line["one_look"][count] for line in good]) for count in ("8", "187")]
    print(f"  median time to the first name over that of one look: {ratios[0]:.2f} among 8, {ratios[1]:.2f} among 187")
    print(f"  begin as stated less the true one: median {np.median([line['since'] for line in good]):.0f} s")
    for name in SUSPECTS:
        these = [line for line in lines if line["suspect"] == name]
        ended = [len(line["last"]) for line in these if name in line["last"]]
        print(f"  {name}: {len(ended)} of {len(these)}, sizes of the classes {ended}")
    return len(good) >= 0.95 * n and ratios[1] <= 1.5


def main(arguments: Sequence[str] | None = None) -> int:
    """Follow the records that are not in the file yet, and judge all of them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", choices=("null", "planted", "late", "live", "cost"))
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path)
    chosen = parser.parse_args(arguments)
    if chosen.part == "cost":
        return 0 if cost() else 1
    out = chosen.out or Path(f"build/watch_{chosen.part}.jsonl")
    out.parent.mkdir(parents=True, exist_ok=True)
    lines = [json.loads(line) for line in out.read_text().splitlines()] if out.exists() else []
    lines = [line for line in lines if line["seed"] == chosen.seed]
    there = {line["run"] for line in lines}
    work = {"null": null, "planted": planted, "late": late, "live": live}[chosen.part]
    with out.open("a") as file:
        for run in range(chosen.count):
            if run not in there:
                line = {"run": run, "seed": chosen.seed, **work(run, chosen.seed)}
                file.write(json.dumps(line) + "\n")
                file.flush()
                lines.append(line)
    return 0 if judged(chosen.part, lines) else 1


if __name__ == "__main__":
    raise SystemExit(main())
