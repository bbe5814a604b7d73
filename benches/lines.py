"""Lines in the output and waves over position: is each named, added where it is, and is nothing missing then?

This file's simulator imports nothing of the product: motion, noise and the size of what is hidden are its own. Periods
lie between 8 and 1000 um with amplitudes of at most 5 % of the period, lines between 20 and 400 Hz, both at 15 to 60
standard deviations, everything else known.

    python -m benches.lines [--records 60] [--seed 1] [--out target/bench/lines.jsonl]
"""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from dataclasses import dataclass

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from numpy.typing import NDArray

from benches.outcomes import Outcome, asked, run_all

Array = NDArray[np.float64]
Generator = np.random.Generator

DENSITIES = {"CXL02": 1.4e-3, "ADXL105": 2.2e-3}
"""Noise of the paper's two sensors, m/s²/√Hz."""
SECONDS, RATES = 30.0, (1000.0, 2000.0)
CROSSOVERS = 0.012, 0.08
"""Where both noises determine the acceleration equally well, in sampling rates: beyond them the product thins readings,
and what it then cannot see is not asked for."""
LARGEST = 0.05
"""Amplitude of a wave over its period, at most."""
PERIODS, FREQUENCIES = (8e-6, 1e-3), (20.0, 400.0)
"""m and Hz."""
LEAST_D, MOST_D = 15.0, 60.0
MOST_DRAWS = 100
"""Draws until an amplitude that stands out is small enough for its period."""
RIGHT, ADEQUATE = 57, 56
"""Records of 60 that must be right, and adequate afterwards."""
SIGMA = 4.0


@dataclass(frozen=True, slots=True)
class Trial:
    """One record with one line or one wave."""

    seed: int
    number: int

    @property
    def key(self) -> str:
        """Identifier."""
        return f"{self.seed}/{self.number}"


@dataclass(frozen=True, slots=True)
class Record:
    """A record and what is hidden in it."""

    t: Array
    output: Array
    position: Array
    density: float
    effect: str
    shape: str
    value: float
    """Period, m, or frequency, Hz."""
    amplitude: float
    d: float


def sines(t: Array, rng: Generator) -> Array:
    """Hand-like motion: sines of incommensurable frequencies, (n,) m."""
    f = rng.uniform(0.8, 1.25, 5) * np.array([0.3, 0.7, 1.3, 2.4, 4.1])
    size = 0.02 * np.array([1.0, 0.5, 0.2, 0.08, 0.03]) * rng.uniform(0.5, 1.5, 5)
    return np.asarray(np.sin(2.0 * np.pi * f * t[:, None] + rng.uniform(0.0, 6.3, 5)) @ size)


def moves(t: Array, rng: Generator) -> Array:
    """Moves between random places on 80 mm, polynomials of the seventh degree, rests between them, (n,) m."""
    p, at, place = np.zeros_like(t), 0.0, 0.0
    while at < t[-1]:
        target, rest = rng.uniform(-0.04, 0.04), rng.uniform(0.05, 0.3)
        duration = rng.uniform(0.25, 0.6) + 2.0 * abs(target - place) / 0.4
        x = np.clip((t - at) / duration, 0.0, 1.0)
        p += (target - place) * x**4 * (35.0 - 84.0 * x + 70.0 * x**2 - 20.0 * x**3)
        at, place = at + duration + rest, target
    return p


def strength(e: Array, rate: float, density: float, reading: float, *, at_output: bool) -> float:
    """Standard deviations at which an error stands, everything else known: the spectrum of position less twice
    integrated output has the power of both noises."""
    omega = 2.0 * np.pi * np.fft.rfftfreq(len(e), 1.0 / rate)[1:]
    noise = 0.5 * density**2 * rate + omega**4 * reading**2  # of one sample of the acceleration, (m/s²)²
    power = 2.0 * np.abs(np.fft.rfft(e)[1:]) ** 2 / len(e) * (1.0 if at_output else omega**4)
    return float(np.sqrt(np.sum(power / noise)))


def record(trial: Trial) -> Record:
    """Make the record of a trial."""
    rng = np.random.default_rng([20341, trial.seed, trial.number])
    rate, density = float(rng.choice(RATES)), float(rng.choice(list(DENSITIES.values())))
    crossover = float(np.exp(rng.uniform(*np.log(CROSSOVERS))))
    reading = density * np.sqrt(0.5 * rate) / (2.0 * np.pi * crossover * rate) ** 2
    t = np.arange(int(SECONDS * rate)) / rate
    fine = np.arange(-8, 8 * len(t) + 8) / (8.0 * rate)
    motion = (sines, moves)[trial.number // 2 % 2](fine, rng)
    a = np.gradient(np.gradient(motion, fine), fine)[8:-8:8]
    p, wave, phase = motion[8:-8:8], trial.number % 2 == 0, rng.uniform(0.0, 6.3)
    for _ in range(MOST_DRAWS):
        lowest, highest = PERIODS if wave else FREQUENCIES
        value = float(np.exp(rng.uniform(np.log(lowest), np.log(highest))))
        e = np.sin(2.0 * np.pi * (p / value if wave else value * t) + phase)
        ratio = strength(e, rate, density, reading, at_output=not wave)
        d = float(np.exp(rng.uniform(np.log(LEAST_D), np.log(MOST_D))))
        amplitude = d / ratio
        if not wave or amplitude < LARGEST * value:
            break
    bias, k = rng.uniform(-0.2, 0.2), rng.uniform(-0.02, 0.02)
    output = bias + (1.0 + k) * a + density * np.sqrt(0.5 * rate) * rng.standard_normal(len(t))
    position = p + reading * rng.standard_normal(len(t))
    if wave:
        position += amplitude * e
    else:
        output += amplitude * e
    name, shape = ("encoder_cyclic", "period") if wave else ("tone", "frequency")
    return Record(t, output, position, density, name, shape, value, amplitude, d)


def run(trial: Trial) -> Outcome:
    """Diagnose, add what was named, diagnose again."""
    import accelcal as ac

    planted_line, started = record(trial), time.perf_counter()
    rig = ac.Rig(ac.Sensor(noise=planted_line.density))
    units = {"accel": "m/s^2", "position": "m"}
    recording = ac.Recording.from_arrays(
        planted_line.t, planted_line.output, planted_line.position, units=units, rig=rig
    )
    fit = ac.fit(recording)
    before = ac.diagnose(fit, recording)
    outcome: Outcome = {
        "key": trial.key,
        "hidden": planted_line.effect,
        "value": planted_line.value,
        "amplitude": planted_line.amplitude,
        "d": planted_line.d,
        "named": before.effects,
        "before": before.sentence,
    }
    try:
        grown = ac.add(fit, recording, planted_line.effect)
        after = ac.diagnose(grown, recording)
        shape = next(e for e in grown.shapes if e.name == f"{planted_line.effect}.{planted_line.shape}")
        sine, cosine = (grown[f"{planted_line.effect}.{part}"] for part in ("sin", "cos"))
        outcome |= {
            "shape": [shape.value, shape.std],
            "size": [float(np.hypot(sine.value, cosine.value)), float(max(sine.std, cosine.std))],
            "remarks": [remark.sentence for remark in grown.remarks],
            "verdict": after.verdict,
            "after": after.sentence,
        }
    except ValueError as error:
        outcome["error"] = str(error)
    return {**outcome, "seconds": time.perf_counter() - started}


def right(outcome: Outcome) -> bool:
    """Whether the effect was named, and added where it is with its size."""
    if outcome["hidden"] not in outcome["named"] or "error" in outcome:
        return False
    pairs = ((outcome["shape"], outcome["value"]), (outcome["size"], outcome["amplitude"]))
    return all(abs(value - truth) < SIGMA * std for (value, std), truth in pairs)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is missing, then print figure, count and threshold."""
    chosen = asked(__doc__, "lines", 60, arguments)
    trials = [Trial(chosen.seed, number) for number in range(chosen.records)]
    outcomes = run_all(run, trials, chosen.out, chosen.workers)
    good = [outcome for outcome in outcomes if right(outcome)]
    adequate = [outcome for outcome in outcomes if outcome.get("verdict") == "adequate"]
    for outcome in outcomes:
        if outcome not in good or outcome not in adequate:
            print(
                f"{outcome['key']}: {outcome['hidden']} {outcome['value']:.6g}, {outcome['amplitude']:.3g}, d = ",
                end="",
            )
            print(
                f"{outcome['d']:.0f}; named {', '.join(outcome['named']) or 'nothing'}; shape {outcome.get('shape')}, ",
                end="",
            )
            print(f"size {outcome.get('size')}; {outcome.get('error') or outcome['after']}")
    least = [bar * len(outcomes) / 60.0 for bar in (RIGHT, ADEQUATE)]
    print(f"named and added right: {len(good)} of {len(outcomes)}, at least {least[0]:.3g}")
    print(f"adequate afterwards: {len(adequate)} of {len(outcomes)}, at least {least[1]:.3g}")
    return 0 if len(good) >= least[0] and len(adequate) >= least[1] else 1


if __name__ == "__main__":
    raise SystemExit(main())
