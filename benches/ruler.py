"""The systematic error in closed form: `python -m benches.ruler [--worlds 1000] [--chains N] [--budgets N] [--seed 1]`.

A motion is a sum of sines, the noise Gaussian with a known density, the error a function of the motion whose rms over
the record is exact. Right is: above twice the limit of detection the two-sided 95 % interval holds the truth in 93 to
97 of 100 worlds; at and below the limit the bound holds in at least 94; a narrow bump that no direction resolves lies
below the bounds in at least 90; a model that has the error is better, a model with a false one is not.

Chains are two records each of an independent simulated rig that has nothing but its four parameters, with white noise,
noise that rises at low frequencies, or a coarse encoder. The linear model of the first is compared with the second: its
error is that of the fitted scale factor and delay. Right is: the interval begins above it in at most 5 of 100.

Budgets are of such rigs that hide one effect, at 15 to 60 standard deviations: the drift of the model that lacks it on
another motion is within 10 % of the sum of its parts in 90 of 100.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import accelcal as ac
from accelcal.data import Array
from accelcal.signals.signals import Signals
from accelcal.validation.comparison import Resolved, SensorNoise, SystematicError
from accelcal.validation.differences import systematic_change, verdict_of
from accelcal.validation.systematic import Grid, dictionary, resolve
from benches.outcomes import Outcome, run_all
from tests.worlds import MOTIONS, Hidden, World, at_d
from tests.worlds.coloured import coloured
from tests.worlds.world import pass_through

RATE, BAND, DENSITY = 200.0, 30.0, 9.8e-4
"""Hz, Hz, (m/s²)/sqrt(Hz)."""
ERRORS: dict[str, Callable[[Signals], Array]] = {
    "cubic": lambda s: s.a**3,
    "fourth power": lambda s: s.a**4,
    "asymmetry": lambda s: np.abs(s.a),
    "drag": lambda s: np.tanh(2.0 * s.v / np.std(s.v)),
    "speed times scale": lambda s: s.a * np.abs(s.v),
    "wave along the rail": lambda s: np.sin(2.0 * s.p / np.std(s.p)),
    "warming up": lambda s: np.sqrt(s.t),
    "scale that ages": lambda s: s.a * s.t,
}
LEVELS = {"none": 0.0, "half": 0.5, "limit": 1.0, "twice": 2.0, "four": 4.0, "ten": 10.0}
"""Errors in limits of detection."""


def density(f: Array) -> Array:
    """One-sided density of the noise below the band, (m/s²)²/Hz."""
    return np.asarray(DENSITY**2 / (1.0 + (f / BAND) ** 8) ** 2)


def motion(rng: np.random.Generator, seconds: float) -> Signals:
    """Six sines with random frequencies, sizes and phases."""
    t = np.arange(round(seconds * RATE)) / RATE
    w = 2.0 * np.pi * np.geomspace(0.3, 6.0, 6) * rng.uniform(0.8, 1.2, 6)
    sizes, phases = rng.uniform(0.1, 1.5, 6), rng.uniform(0.0, 2.0 * np.pi, 6)
    turns = 1j * w * np.exp(1j * (np.outer(t, w) + phases))
    v = turns * sizes / w**2
    rig = ac.Rig(ac.Sensor(noise=DENSITY))
    p, a, jerk = (np.real((v / (1j * w) * (1j * w) ** k).sum(axis=1)) for k in (0, 2, 3))
    return Signals(t=t, p=p, v=np.real(v.sum(axis=1)), a=a, jerk=jerk, scale=1.0, rig=rig)


def noise(rng: np.random.Generator, n: int) -> Array:
    """Noise with that density, (n,) m/s²."""
    white = np.fft.rfft(rng.normal(size=2 * n))
    power = density(np.fft.rfftfreq(2 * n, 1.0 / RATE)) * RATE / 2.0
    return np.asarray(np.fft.irfft(white * np.sqrt(power), 2 * n)[:n])


def grid_of(s: Signals) -> Grid:
    """Every sample of a motion."""
    every = np.arange(len(s.t))
    return Grid(every, every, 1, 1.0 / RATE, BAND)


def resolved(s: Signals, *errors: Array, sensor: SensorNoise | None = None) -> tuple[Resolved, ...]:
    """Errors of some models in the directions that a motion resolves."""
    grid = grid_of(s)
    return resolve(np.array(errors), grid, dictionary(s, grid), density, sensor)[0]


def shape(s: Signals, function: Callable[[Signals], Array]) -> Array:
    """A function of the motion without what set-up and scale factor take up, rms 1."""
    inside = grid_of(s).inside
    base, e = np.stack([np.ones_like(s.t), inside(s.a)], axis=1), inside(function(s))
    e = e - base @ np.linalg.lstsq(base, e, rcond=None)[0]
    return np.asarray(e / np.sqrt(np.mean(e**2)))


@dataclass(frozen=True, slots=True)
class Case:
    """One record."""

    level: str
    number: int
    seed: int

    @property
    def key(self) -> str:
        """Identifier under which its outcome is kept."""
        return f"{self.level}/{self.seed}/{self.number}"


def outcome(world: Case) -> Outcome:
    """What is estimated in one world, in limits of detection."""
    if world.level in (*CHAINS, "budget"):
        return of_budget(world) if world.level == "budget" else of_chain(world)
    rng = np.random.default_rng((world.seed, world.number, *map(ord, world.level)))
    s = motion(rng, float(rng.uniform(20.0, 60.0)))
    sensor = SensorNoise(DENSITY, 0.0, "declared")
    present = noise(rng, len(s.t))
    name = list(ERRORS)[world.number % len(ERRORS)]
    (silent,) = resolved(s, present)
    limit = SystematicError.of([silent])
    assert limit is not None
    if world.level == "bump":
        middle, width = rng.uniform(-1.5, 1.5) * np.std(s.a), 0.03 * float(np.ptp(s.a))
        error = shape(s, lambda s: np.exp(-0.5 * ((s.a - middle) / width) ** 2)) * 2.0 * limit.detection_limit
    else:
        error = LEVELS.get(world.level, 4.0) * limit.detection_limit * shape(s, ERRORS[name])
    models = [error + present]
    if world.level == "right":
        models.append(present + 0.1 * error)
    elif world.level == "false":
        other = shape(s, list(ERRORS.values())[(world.number + 3) % len(ERRORS)])
        models = [present, present + 2.0 * float(rng.normal()) * DENSITY / np.sqrt(2.0 * s.t[-1]) * other]
    parts = resolved(s, *models, sensor=sensor)
    estimate = SystematicError.of(parts[:1])
    assert estimate is not None
    change = systematic_change(parts[:1], parts[1:]) if len(parts) > 1 else None
    truth = float(np.sqrt(np.mean((error - np.mean(error)) ** 2)))
    return {
        "key": world.key,
        "level": world.level,
        "error": "" if world.level == "bump" else name,
        "truth": truth / limit.detection_limit,
        "rms": estimate.rms / limit.detection_limit,
        "low": estimate.low / limit.detection_limit,
        "high": estimate.high / limit.detection_limit,
        "bound": float(np.hypot(estimate.high, estimate.unresolved)) / limit.detection_limit,
        "verdict": verdict_of(change),
    }


CHAINS = ("white", "flicker_output", "steep_output", "coarse")
"""Noise of a rig whose model lacks nothing."""
LENGTHS = (20.0, 40.0, 60.0)
"""Of its records, s; with long rests 60."""


def of_chain(case: Case) -> Outcome:
    """What is estimated of a rig that has its four parameters alone, and the error of those, m/s²."""
    rng = np.random.default_rng((case.seed, case.number, *map(ord, case.level)))
    motions, (first, second) = rng.choice(sorted(MOTIONS), 2), rng.integers(1 << 30, size=2)
    resolution = 10e-6 if case.level == "coarse" else 1e-6
    sensor = str(rng.choice(["ADXL105", "CXL02"]))
    seconds = 60.0 if "long_rest" in motions else float(rng.choice(LENGTHS))
    rig = World(str(motions[0]), sensor, seconds=seconds, seed=int(first), resolution=resolution)
    records = [rig.record(), rig.settled().again(str(motions[1]), int(second)).record()]
    if case.level not in ("white", "coarse"):
        records = [coloured(record, case.level) for record in records]
    with tempfile.TemporaryDirectory() as folder:
        train, held_out = (ac.load(record.write(folder, f"run{n}")) for n, record in enumerate(records))
        fit = ac.fit(train)
        estimate = ac.compare([fit], held_out)[0].systematic
    truth = records[1].truth
    inside = (truth.t > 1.0) & (truth.t < rig.seconds - 1.0)
    a, jerk = truth.a[inside], np.gradient(truth.a, truth.t)[inside]
    k = 1.0 + records[1].world.scale_factor
    error = (fit["scale_factor"].value + 1.0 - k) / k * a - fit["time_offset"].value * jerk
    size = float(np.std(error))
    keys = ("rms", "low", "high", "detection_limit", "unresolved")
    fields = {key: 0.0 if estimate is None else float(getattr(estimate, key)) for key in keys}  # too short for it
    return {"key": case.key, "level": case.level, "motion": list(map(str, motions)), "truth": size, **fields}


BUDGETS = {"cubic": 5e-4, "quadratic": 1e-3, "velocity": 0.05, "coulomb": 0.01, "rail_slope": 0.1}
"""Effects whose part of a drift is predicted, with a size to begin with."""


LARGEST_SHARE = 0.1
"""Of the acceleration that an effect makes: beyond that no specification lets an accelerometer go."""


def share_of(world: World) -> float:
    """Largest contribution of the hidden effect over the largest acceleration."""
    chain = pass_through(world)
    added = chain.contributions[0].output
    return 0.0 if added is None else float(np.max(np.abs(added)) / np.max(np.abs(chain.scene.a)))


def of_budget(case: Case) -> Outcome:
    """Drift of a model that lacks an effect on another motion, and the sum of its parts, m."""
    rng = np.random.default_rng((case.seed, case.number, *map(ord, case.level)))
    name = list(BUDGETS)[case.number % len(BUDGETS)]
    motions, (first, second) = rng.choice(["interleaved", "moves", "bursts", "fast"], 2), rng.integers(1 << 30, size=2)
    rig = World(str(motions[0]), "ADXL105", (Hidden(name, BUDGETS[name]),), seed=int(first))
    rig = at_d(rig, float(rng.uniform(15.0, 60.0))).settled()
    share = max(share_of(rig), share_of(rig.again(str(motions[1]), int(second))))
    hidden = Hidden(name, rig.hidden[0].magnitude * min(1.0, LARGEST_SHARE / share))
    rig = replace(rig, hidden=(hidden,))
    with tempfile.TemporaryDirectory() as folder:
        worlds = rig, rig.again(str(motions[1]), int(second))
        train, other = (ac.load(w.record().write(folder, f"run{n}")) for n, w in enumerate(worlds))
        base = ac.fit(train)
        budget = (
            ac.compare([base, ac.add(base, train, name)], other, horizons=(1.0,), budget=True).evaluations[0][0].budget
        )
    assert budget is not None
    fields = {"predicted": budget.predicted, "total": budget.total.value, "missing": budget.missing}
    span = {"low": budget.total.low, "high": budget.total.high}
    return {"key": case.key, "level": case.level, "effect": name, "motion": list(map(str, motions)), **fields, **span}


def main() -> int:
    """Print counts by level; 1 where a bar is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=1000)
    parser.add_argument("--chains", type=int, default=0, help="of each noise")
    parser.add_argument("--budgets", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("build/ruler.jsonl"))
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()
    counts = {level: options.worlds // 3 + 1 for level in LEVELS} | {"bump": 100, "right": 200, "false": 200}
    counts = (counts if options.worlds else {}) | dict.fromkeys(CHAINS, options.chains) | {"budget": options.budgets}
    worlds = [Case(level, number, options.seed) for level, count in counts.items() for number in range(count)]
    cases = run_all(outcome, worlds, options.out, options.workers)
    missed = []

    def say(text: str, hits: int, of: int, low: float, high: float = 1.0) -> None:
        share = hits / max(of, 1)
        missed.extend([text] if not low <= share <= high else [])
        print(f"{text}: {hits} of {of} = {share:.1%} (asked {low:.0%} to {high:.0%})")

    sized = [case for case in cases if case["level"] in LEVELS]
    held = [case for case in sized if LEVELS[case["level"]] >= 2.0]
    say(
        "two-sided interval holds the truth",
        sum(c["low"] <= c["truth"] <= c["high"] for c in held),
        len(held),
        0.93,
        0.97,
    )
    for level in LEVELS:
        part = [case for case in sized if case["level"] == level]
        ratio = np.mean([case["rms"] ** 2 for case in part]) if LEVELS[level] == 0.0 else None
        inside = sum(c["low"] <= c["truth"] <= c["high"] for c in part)
        print(f"  {level}: interval {inside} of {len(part)}" + ("" if ratio is None else f", mean square {ratio:.2f}"))
    for name in ERRORS:
        part = [case for case in held if case["error"] == name]
        print(f"  {name}: interval {sum(c['low'] <= c['truth'] <= c['high'] for c in part)} of {len(part)}")
    low = [case for case in sized if LEVELS[case["level"]] <= 1.0]
    say("bound at and below the limit", sum(c["truth"] <= c["high"] for c in low), len(low), 0.94)
    bumps = [case for case in cases if case["level"] == "bump"]
    say("narrow bump below the bounds", sum(c["truth"] <= c["bound"] for c in bumps), len(bumps), 0.90)
    right = [case["verdict"] for case in cases if case["level"] == "right"]
    say("falls with the right effect", right.count("better"), len(right), 0.98)
    false = [case["verdict"] for case in cases if case["level"] == "false"]
    say("does not fall with a false effect", len(false) - false.count("better"), len(false), 0.97)
    for level in CHAINS:
        part = [case for case in cases if case["level"] == level]
        detected = sum(c["rms"] > c["detection_limit"] for c in part)
        print(f"  {level}: error detected in {detected}, bound holds in {sum(c['truth'] <= c['high'] for c in part)}")
        say(
            f"begins above the error of parameters: {level}",
            sum(c["low"] > c["truth"] for c in part),
            len(part),
            0.0,
            0.05,
        )
    parts = [case for case in cases if case["level"] == "budget"]
    near = [case for case in parts if abs(case["predicted"] / case["total"] - 1.0) <= 0.1]
    say("drift on another motion within 10 % of its parts", len(near), len(parts), 0.9)
    covered = sum(case["low"] <= case["predicted"] <= case["high"] for case in parts)
    print(f"  within the 95 % interval of its stretches: {covered} of {len(parts)}")
    return int(bool(missed))


if __name__ == "__main__":
    sys.exit(main())
