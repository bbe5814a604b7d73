"""Coefficients that follow a driver: what is named, and its time constant, on worlds of a simulator of its own.

python -m benches.mechanisms --seed 4001 --records 120 [--workers 2 --out FILE]

Bars: mechanism in the class in >= 114 of 120, a process named alone in <= 2; rms z of log tau inside the exact 99 %
interval; a mechanism named in <= 3 of 120 records of a true process; systematic error on another motion at most 1.1
times that with the true mechanism; friction with a memory of 1 to 10 mm and play of the encoder of 1 to 20 um in the
class in >= 19 of 20 each, a step of the encoder named for the play in none; bias, scale factor and delay equal within
0.05 std whichever of two processes is added first, over all pairs. `ac.formulas` names the mechanism in
>= 95 % of the records of `FORMULAS`, one in <= 3 of 120 of a true process, and in none of 40 with nothing in them.
"""

from __future__ import annotations

import itertools
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.signal import lfilter

import accelcal as ac
from benches.outcomes import Outcome, Trial, asked, guarded, run_all

Array = NDArray[np.float64]
RATE, OVER, SECONDS, BEFORE, LATE = 1667.0, 8, 60.0, 15.0, 3
"""Samples of the output per second, steps of the world per sample, length of the record and of the motion before it in
s, and the delay of the output in steps."""
DENSITY, RESOLUTION, LOWPASS = 20e-6 * 9.80665, 1e-6, 159.0
"""Noise of the output, (m/s²)/sqrt(Hz), step of the encoder, m, and corner of the low-pass, Hz."""
KINDS = "mechanism", "process", "distance", "play", "order", "null"
CURVES = "shape_of_acceleration", "shape_of_velocity", "shape_of_temperature"
"""Curves for which a formula is asked, in turn: the mechanism is the answer to each."""
DISTANCE = 20.0
"""Standard deviations by which an effect differs from none beside bias, scale factor, delay and its carrier."""
SIDECAR = """sensor.noise = "20 ug/sqrt(Hz)"
rig.axis = "level"
[channels]
time = { column = "t", unit = "s" }
accel = { column = "accel", unit = "m/s^2", lowpass = { kind = "RC", fc = "159 Hz" } }
position = { column = "position", unit = "m", resolution = "1 um" }
temperature = { column = "temp", unit = "degC" }
supply = { column = "supply", unit = "V" }
"""


@dataclass(frozen=True)
class Scene:
    """Motion and recorded channels at the steps of a world."""

    t: Array
    p: Array
    v: Array
    a: Array
    temperature: Array
    supply: Array

    @property
    def step(self) -> float:
        """Spacing, s."""
        return float(self.t[1])

    def memory(self, driver: Array, tau: float) -> Array:
        """Memory of a driver, at rest before the record."""
        weight = 1.0 - np.exp(-self.step / tau)
        return np.asarray(lfilter([weight], [1.0, weight - 1.0], driver - driver[0])) + driver[0]


CARRIERS: dict[str, Callable[[Scene], Array]] = {
    "bias": lambda s: np.ones_like(s.t),
    "scale_factor": lambda s: s.a,
    "time_offset": lambda s: -np.gradient(s.a, s.step),
    "velocity": lambda s: s.v,
}
DRIVERS: dict[str, Callable[[Scene], Array]] = {
    "abs_a": lambda s: np.abs(s.a),
    "a2": lambda s: s.a**2,
    "abs_v": lambda s: np.abs(s.v),
    "v2": lambda s: s.v**2,
    "temperature": lambda s: s.temperature,
    "supply": lambda s: s.supply,
}
WORLDS = (
    ("scale_factor", "abs_a", 0.4),
    ("scale_factor", "a2", 3.0),
    ("scale_factor", "v2", 1.0),
    ("scale_factor", "temperature", 4.0),
    ("scale_factor", "supply", 0.5),
    ("bias", "a2", 5.0),
    ("bias", "abs_v", 1.0),
    ("bias", "temperature", 4.0),
    ("bias", "supply", 0.5),
    ("time_offset", "temperature", 2.0),
    ("time_offset", "supply", 1.0),
    ("velocity", "abs_v", 3.0),
)
"""Carrier, driver and time constant, s."""
FORMULAS = {0, 4, 7, 8}
"""Worlds of a gain that sags with |a|, of a bias that follows temperature, and of a recorded channel."""
PROCESSES = (("scale_factor", 1.0), ("bias", 2.0), ("scale_factor", 0.0), ("bias", 0.0))
"""Carrier and correlation time, s, of true random processes; 0 for a random walk."""


ENTERED = ("bias_gauss_markov", "bias_random_walk", "scale_gauss_markov", "scale_random_walk")
PAIRS = tuple(itertools.combinations((*ENTERED, "quadratic_gauss_markov", "velocity_random_walk"), 2))
"""Processes that are added in both orders."""


def scene(rng: np.random.Generator) -> Scene:
    """Nine tones of slowly changing amplitudes, a temperature that wanders, a supply that other loads pull down."""
    t = np.arange(int((SECONDS + BEFORE) * RATE * OVER)) / (RATE * OVER)
    dt = float(t[1])
    p = np.zeros_like(t)
    for f in np.geomspace(0.35, 5.5, 9):
        phase = rng.uniform(0.0, 2.0 * np.pi, 2)
        envelope = 1.0 + 0.7 * np.sin(2.0 * np.pi * rng.uniform(0.02, 0.07) * t + phase[0])
        p += 0.05 / (6.0 * np.pi * f) * envelope * np.sin(2.0 * np.pi * f * t + phase[1])
    v = np.gradient(p, dt)
    temperature = 25.0 + sum(
        rng.normal(0.0, 1.5) * np.sin(2.0 * np.pi * f * t + rng.uniform(0.0, 6.28)) for f in (0.011, 0.023, 0.047, 0.09)
    )
    knots = np.arange(0.0, SECONDS + BEFORE + 4.0, 3.0)
    level = 5.0 + 0.1 * rng.standard_normal(len(knots))[np.searchsorted(knots, t, "right") - 1]
    weight = 1.0 - np.exp(-dt / 0.3)
    supply = np.asarray(lfilter([weight], [1.0, weight - 1.0], level - level[0])) + level[0]
    return Scene(t, p, v, np.gradient(v, dt), temperature, supply)


def distance(s: Scene, e: Array, carrier: Array) -> float:
    """Standard deviations that an addition to the output is from none beside its carrier, below the crossover (19 Hz
    here)."""
    thin = slice(int(BEFORE * RATE) * OVER, None, OVER)
    jerk = np.gradient(s.a, s.step)
    base = np.column_stack([np.ones_like(s.t), s.a, jerk, carrier])[thin]
    left = e[thin] - base @ np.linalg.lstsq(base, e[thin], rcond=None)[0]
    return float(np.sqrt(left @ left / RATE / (0.5 * DENSITY**2)))


def play(p: Array, width: float) -> Array:
    """Position behind play of a full width: a head that is dragged along once the play is used up."""
    behind = np.empty_like(p)
    at = float(p[0])
    for i, x in enumerate(p.tolist()):
        at = min(max(at, x - 0.5 * width), x + 0.5 * width)
        behind[i] = at
    return behind


def write(s: Scene, e: Array, rng: np.random.Generator, path: Path, at_head: Array | None = None) -> Path:
    """The record of a rig whose output has an addition; the encoder may see another position."""
    weight = 1.0 - np.exp(-2.0 * np.pi * LOWPASS * s.step)
    raw = np.asarray(lfilter([weight], [1.0, weight - 1.0], 0.05 + 1.004 * s.a + e))
    thin = slice(int(BEFORE * RATE) * OVER, None, OVER)
    output = np.roll(raw, LATE)[thin]
    output = output + DENSITY * np.sqrt(0.5 * RATE) * rng.standard_normal(len(output))
    t, temperature, supply = s.t[thin] - BEFORE, s.temperature[thin], s.supply[thin]
    p = (
        np.round(((s.p if at_head is None else at_head)[thin] + 2e-7 * rng.standard_normal(len(t))) / RESOLUTION)
        * RESOLUTION
    )
    rows = (
        f"{t[i]:.7f},{output[i]:.7f},{f'{p[i]:.6f}' if i % 2 == 0 else ''},{temperature[i]:.4f},{supply[i]:.5f}"
        for i in range(len(t))
    )
    path.write_text("\n".join(["t,accel,position,temp,supply", *rows]) + "\n")
    path.with_suffix(".toml").write_text(SIDECAR)
    return path


def followed(s: Scene, world: tuple[str, str, float], origin: float) -> Array:
    """A carrier times the memory of a driver, from an origin of the driver on."""
    carrier, driver, tau = world
    return np.asarray(CARRIERS[carrier](s) * (s.memory(DRIVERS[driver](s), tau) - origin))


def origin_of(s: Scene, world: tuple[str, str, float]) -> float:
    """Driver at which the coefficient is that of the carrier: at the start for temperature and supply, not at 0 V."""
    return float(DRIVERS[world[1]](s)[0]) if world[1] in ("temperature", "supply") else 0.0


def added(s: Scene, trial: Trial, rng: np.random.Generator) -> Array:
    """What is added to the output of a trial, at `DISTANCE` for mechanisms, of a usual size for processes."""
    if trial.kind == "null":
        return np.zeros_like(s.t)
    if trial.kind == "mechanism":
        world = carrier, _, _ = WORLDS[trial.number]
        e = followed(s, world, origin_of(s, world))
    elif trial.kind == "distance":
        length = 1e-3 * 10.0 ** rng.uniform()
        z, decay = np.zeros_like(s.t), np.exp(-np.abs(np.diff(s.p, prepend=s.p[0])) / length)
        for i, way in enumerate(np.sign(s.v).tolist()[1:], 1):
            z[i] = way + (z[i - 1] - way) * decay[i]
        carrier, e = "bias", z
    else:
        carrier, tau = PROCESSES[trial.number]
        shocks = rng.standard_normal(len(s.t)) * np.sqrt(s.step)
        decay = np.exp(-s.step / tau) if tau else 1.0
        e = CARRIERS[carrier](s) * lfilter([1.0], [1.0, -decay], shocks)
    return np.asarray(e * rng.choice([-1.0, 1.0]) * DISTANCE / distance(s, e, CARRIERS[carrier](s)))


def judged(trial: Trial) -> Outcome:
    """What a diagnosis says of a trial."""
    rng = np.random.default_rng([trial.seed, trial.number])
    if trial.kind == "order":
        return in_both_orders(trial, rng)
    s = scene(rng)
    at_head = play(s.p, 1e-6 * 20.0 ** rng.uniform()) if trial.kind == "play" else s.p
    e = np.zeros_like(s.t) if trial.kind == "play" else added(s, trial, rng)
    with tempfile.TemporaryDirectory() as folder:
        run = ac.load(write(s, e, rng, Path(folder) / "record.csv", at_head))
        fit = ac.fit(run)
        diagnosis = ac.diagnose(fit, run)
        beyond = [of.members for of in diagnosis.classes if of.members[0] != "time_offset"]  # each fit has the delay
        group = list(beyond[0]) if beyond else []
        outcome = {"key": trial.key, "kind": trial.kind, "named": group, "verdict": diagnosis.verdict}
        outcome["process"] = bool(group) and all(ac.effects.find(name).port == "process" for name in group)
        outcome["mechanism"] = bool(group) and ac.effects.find(group[0]).mechanism is not None
        if trial.kind in ("distance", "play"):
            right = "presliding" if trial.kind == "distance" else "encoder_backlash"
            return outcome | {"right": right in group, "step": "encoder_step" in group}
        formulas = ac.formulas(fit, run, CURVES[trial.seed % len(CURVES)]).formulas
        outcome["formula"] = formulas[0].mechanism if formulas else ""
        outcome["formula_right"] = not outcome["formula"]
        if trial.kind != "mechanism":
            return outcome | {"right": not outcome["mechanism"]}
        world = carrier, driver, tau = WORLDS[trial.number]
        name = ac.effects.find(f"{carrier}_follows_{driver}").name
        outcome["formula_right"] = outcome["formula"] == name
        grown = ac.add(fit, run, name)
        shape = grown.model.shapes[name]["tau"]
        std = next((e.std for e in grown.shapes if e.name == f"{name}.tau"), np.nan)
        outcome["z"] = float(np.log(shape / tau) / (std / shape))
        if group:  # its error on another motion beside that of the true one
            other, origin = scene(rng), origin_of(s, world)
            unit = followed(s, world, origin)
            size = float(unit @ e / (unit @ unit))
            path = write(other, size * followed(other, world, origin), rng, Path(folder) / "other.csv")
            models = [grown, grown if group[0] == name else ac.add(fit, run, group[0])]
            truth, chosen = (table[0].systematic for table in (ac.compare([m], ac.load(path)) for m in models))
            outcome["elsewhere"] = chosen.high / truth.high if truth and chosen else np.nan
        return outcome | {"right": name in group, "tau": shape, "std": std}


def in_both_orders(trial: Trial, rng: np.random.Generator) -> Outcome:
    """Largest difference, in std, between estimates with two processes that are added in either order."""
    s, pair = scene(rng), PAIRS[trial.number]
    e = np.zeros_like(s.t)
    for name, tau in zip(pair, (1.5, 12.0), strict=True):
        stem = name.split("_")[0]
        carrier = {"bias": np.ones_like(s.t), "scale": s.a, "quadratic": s.a**2, "velocity": s.v}[stem]
        decay = np.exp(-s.step / tau)
        path = lfilter([np.sqrt(1.0 - decay**2)], [1.0, -decay], rng.standard_normal(len(s.t)))
        e += 0.02 * carrier / np.sqrt(np.mean(carrier**2)) * path
    with tempfile.TemporaryDirectory() as folder:
        run = ac.load(write(s, e, rng, Path(folder) / "record.csv"))
        fit = ac.fit(run)
        first, second = (ac.add(ac.add(fit, run, a), run, b) for a, b in (pair, pair[::-1]))
    names = "bias", "scale_factor", "time_offset"
    apart = max(abs(first[name].value - second[name].value) / first[name].std for name in names)
    spread = max(abs(second[name].std / first[name].std - 1.0) for name in names)
    outcome = {"key": trial.key, "kind": trial.kind, "named": list(pair), "apart": apart, "spread": spread}
    return outcome | {"right": max(apart, spread) < SAME}


SAME = 0.05
"""Difference of estimates, in std, and of their std, as a share, that counts as none."""


def main(arguments: list[str] | None = None) -> int:
    """Print counts and figures beside their bars; 1 if one is missed."""
    given = asked(__doc__, "mechanisms", 120, arguments)
    rounds = given.records // len(WORLDS)
    trials = [Trial("mechanism", k, given.seed + j) for j in range(rounds) for k in range(len(WORLDS))]
    trials += [Trial("process", k, given.seed + j) for j in range(3 * rounds) for k in range(len(PROCESSES))]
    trials += [Trial("distance", 0, given.seed + j) for j in range(2 * rounds)]
    trials += [Trial("play", 0, given.seed + j) for j in range(2 * rounds)]
    trials += [Trial("order", k, given.seed) for k in range(len(PAIRS))]
    trials += [Trial("null", 0, given.seed + j) for j in range(4 * rounds)]
    outcomes = run_all(partial(guarded, judged), trials, given.out, given.workers)
    by_kind = {kind: [o for o in outcomes if o["kind"] == kind] for kind in KINDS}
    mechanisms, processes, distances, plays, orders, nulls = by_kind.values()
    planted = [o for o in mechanisms if int(o["key"].split("-")[1]) in FORMULAS]
    right, named = sum(o["right"] for o in mechanisms), sum(not o["right"] for o in processes)
    alone = sum(o.get("process", False) for o in mechanisms)
    print(f"mechanism in the class: {right} of {len(mechanisms)} (114 of 120)")
    print(f"a process named alone: {alone} of {len(mechanisms)} (2 of 120)")
    print(f"a mechanism named for a true process: {named} of {len(processes)} (3 of 120)")
    dahl = sum(o["right"] for o in distances)
    print(f"memory in distance in the class: {dahl} of {len(distances)} (19 of 20)")
    behind, steps = sum(o["right"] for o in plays), sum(o.get("step", False) for o in plays)
    print(f"play of the encoder in the class: {behind} of {len(plays)} (19 of 20), a step named: {steps} (0)")
    same = sum(o["right"] for o in orders)
    worst = max((o["apart"] for o in orders if "apart" in o), default=np.nan)
    print(f"pairs of processes equal in both orders: {same} of {len(orders)}, at most {worst:.3f} std apart")
    ratios = np.array([o["elsewhere"] for o in mechanisms if np.isfinite(o.get("elsewhere", np.nan))])
    small = int(np.sum(ratios <= 1.1))
    print(f"error on another motion at most 1.1 times that with the truth: {small} of {len(ratios)} (0.95)")
    missed, by_process, by_null = (sum(not o.get("formula_right") for o in of) for of in (planted, processes, nulls))
    print(f"by a formula, the mechanism first: {len(planted) - missed} of {len(planted)} (38 of 40)")
    print(f"by a formula, for a true process: {by_process} of {len(processes)} (3 of 120)")
    print(f"by a formula, for nothing: {by_null} of {len(nulls)} (0 of 40)")
    z = np.array([o["z"] for o in mechanisms if np.isfinite(o.get("z", np.nan))])
    low, high = np.sqrt(stats.chi2.ppf([0.005, 0.995], len(z)) / len(z))
    rms = float(np.sqrt(np.mean(z**2)))
    print(f"rms z of log tau: {rms:.2f} of {len(z)} ({low:.2f} to {high:.2f})")
    for o in outcomes:
        if not (o["right"] and o.get("formula_right", True)):
            print(o["key"], o.get("verdict", o.get("error", "")[-200:]), o.get("named"), o.get("formula"))
    held = right >= 0.95 * len(mechanisms) and alone <= len(mechanisms) / 60 and named <= len(processes) / 40
    held &= dahl >= 0.95 * len(distances) and behind >= 0.95 * len(plays) and not steps
    held &= same == len(orders) and small >= 0.95 * len(ratios)
    held &= missed <= len(planted) / 20 and by_process <= len(processes) / 40 and by_null == 0
    return 0 if held and low <= rms <= high else 1


if __name__ == "__main__":
    sys.exit(main())
