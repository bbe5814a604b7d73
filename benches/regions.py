"""Where a model fails, with known truth: `python -m benches.regions [--records 30] [--effects 10] [--seed 1]`.

A rig of its own, in NumPy: six sines, moves with rests, or sweeps; a linear sensor whose noise is white, or has a 1/f
part with a knee of 0.3 to 3 Hz and a random walk besides. The model of one record is compared with another one. Right
is: noise alone gives a region with an adjusted p below 5 % in 5 of 100 records, and a region that is named in 1 of 100;
a cubic or friction that lies at 6 to 10 standard deviations in one region has its variable in the first row in 9 of 10.
In a sweep jerk and position are nearly proportional to velocity and acceleration, so these are of the others.
"""

from __future__ import annotations

import argparse
import math
from typing import Any

import numpy as np

import accelcal as ac
from accelcal.data import Array, Recording
from accelcal.validation.comparison import BINS, Evaluation
from accelcal.validation.regions import NOTABLE

RATE, SECONDS, DENSITY, READING = 500.0, 40.0, 1e-3, 2e-6
"""Hz, s, (m/s²)/sqrt(Hz), m."""
MOTIONS = ("sines", "moves", "sweep")
ERRORS = {
    "cubic": ("acceleration", lambda v, a: a**3),
    "friction": ("velocity", lambda v, a: np.tanh(v / (0.05 * np.std(v)))),
}
"""Variable and function of each error."""
Motion = tuple[Array, Array, Array, Array]
"""Times, position, velocity, acceleration."""


def moving(kind: str, rng: np.random.Generator) -> Motion:
    """A motion of a kind, (n,) each, in SI units."""
    t = np.arange(round(SECONDS * RATE)) / RATE
    if kind == "sines":
        w = 2.0 * np.pi * np.geomspace(0.3, 6.0, 6) * rng.uniform(0.8, 1.2, 6)
        turns = 1j * rng.uniform(0.3, 1.5, 6) * np.exp(1j * (np.outer(t, w) + rng.uniform(0.0, 2.0 * np.pi, 6)))
        p, v, a = (np.real((turns / (1j * w) ** k).sum(axis=1)) for k in (2, 1, 0))
        return t, p, v, a
    if kind == "sweep":
        low, high, size = rng.uniform(0.3, 0.8), rng.uniform(4.0, 8.0), rng.uniform(1.0, 2.0)
        growth = math.log(high / low) / SECONDS
        w = 2.0 * np.pi * low * np.exp(growth * t)
        phase, reach = w / growth + rng.uniform(0.0, 6.0), size / (2.0 * np.pi * high) ** 2 * high / low
        shape = reach * np.exp(-growth * t)
        p = shape * np.sin(phase)
        v = shape * (w * np.cos(phase) - growth * np.sin(phase))
        a = shape * (-(w**2) * np.sin(phase) - growth * w * np.cos(phase) + growth**2 * np.sin(phase))
        return t, p, v, a
    p, v, a = np.zeros((3, len(t)))
    begin, place = 1.0, 0.0
    while begin < SECONDS - 2.0:
        length, to = float(rng.uniform(0.3, 1.0)), float(rng.uniform(-0.1, 0.1))
        x = np.clip((t - begin) / length, 0.0, 1.0)
        p += (to - place) * x**4 * (35.0 - 84.0 * x + 70.0 * x**2 - 20.0 * x**3)
        v += (to - place) / length * 140.0 * x**3 * (1.0 - x) ** 3
        a += (to - place) / length**2 * 420.0 * x**2 * (1.0 - x) ** 2 * (1.0 - 2.0 * x)
        begin, place = begin + length + float(rng.uniform(0.1, 0.8)), to
    return t, p, v, a


def density_of(rng: np.random.Generator, n: int, *, slow: bool) -> Array:
    """Density of the noise of an output at the frequencies of 8 n samples, (m/s²)²/Hz: white, or with slow noise."""
    f = np.fft.rfftfreq(8 * n, 1.0 / RATE)
    ratio, f[0] = np.ones(len(f)), f[1]
    if slow:
        knee, walk = np.exp(rng.uniform(np.log([0.3, 0.02]), np.log([3.0, 0.2])))
        ratio += np.where(f < 0.125 / SECONDS, 0.0, knee / f + (walk / f) ** 2)
    return np.asarray(DENSITY**2 * ratio)


def deviations(mean: Array, density: Array) -> Array:
    """Standard deviations of the sums of noise along columns (m, n), (m,)."""
    power = 2.0 * np.abs(np.fft.rfft(mean, 8 * mean.shape[1])) ** 2 @ density
    return np.asarray(np.sqrt(power * RATE / 2.0 / (8 * mean.shape[1])))


def recorded(kind: str, rng: np.random.Generator, *, slow: bool, error: str = "", d: float = 0.0) -> Recording:
    """A record of the rig; the surest mean of an error in a region of its variable is `d` standard deviations of it."""
    t, p, v, a = moving(kind, rng)
    n, density = len(t), density_of(rng, len(t), slow=slow)
    white = np.fft.rfft(rng.standard_normal(8 * n)) * np.sqrt(density * RATE / 2.0)
    output = 0.05 + 1.01 * a + np.fft.irfft(white, 8 * n)[:n]
    if error:
        variable, function = ERRORS[error]
        shape, base = function(v, a), np.stack([np.ones_like(t), a, np.gradient(a)], axis=1)
        rest = shape - base @ np.linalg.lstsq(base, shape, rcond=None)[0]
        x = a if variable == "acceleration" else v
        place = np.searchsorted(np.linspace(*np.quantile(x, [0.001, 0.999]), BINS + 1)[1:-1], x)
        inside = (place == np.arange(BINS)[:, None]).astype(float)
        columns = inside / np.sum(inside, axis=1, keepdims=True) - 1.0 / n
        output += d / float(np.max(np.abs(columns @ rest) / deviations(columns, density))) * shape
    sensor, z = ac.Sensor(noise=DENSITY), p + READING * rng.standard_normal(n)
    return Recording.from_arrays(t, output, z, units={"accel": "m/s^2", "position": "m"}, rig=ac.Rig(sensor))


def evaluation_of(number: int, seed: int, *, slow: bool, error: str = "") -> Evaluation:
    """The linear model of one record against another one."""
    rng = np.random.default_rng([seed, number, slow, len(error)])
    kind, d = MOTIONS[number % (2 if error else 3)], float(rng.uniform(6.0, 10.0))
    train, other = (recorded(kind, rng, slow=slow, error=error, d=d) for _ in range(2))
    return ac.compare(ac.fit(train), other)[0]


def false_regions(evaluation: Evaluation) -> dict[str, Any]:
    """What is said to fail though noise is all that there is; against frequency noise differs from the model's."""
    regions = [region for region in evaluation.worst_regions if region.variable != "frequency"]
    worst = max(regions, key=lambda region: abs(region.sigma))
    return {
        "low p": worst.p < 0.05,
        "named": abs(worst.sigma) >= NOTABLE,
        "worst": f"{worst.variable} {worst.sigma:+.1f} of {evaluation.band:.3g} Hz",
    }


def main() -> None:
    """Print counts and bars."""
    parser = argparse.ArgumentParser(description=__doc__)
    for name, usual in (("records", 30), ("effects", 10), ("seed", 1)):
        parser.add_argument(f"--{name}", type=int, default=usual)
    asked = parser.parse_args()
    for slow in (False, True):
        n = asked.records // 2
        every = [false_regions(evaluation_of(number, asked.seed, slow=slow)) for number in range(n)]
        print(f"{'1/f and random walk' if slow else 'white'}: {[outcome['worst'] for outcome in every]}")
        for key, rate in (("low p", 0.05), ("named", 0.01)):
            print(f"    {key}: {sum(outcome[key] for outcome in every)} of {n}, expected {rate * n:.1f}")
    first = 0
    for number in range(asked.effects):
        error = list(ERRORS)[number // 2 % 2]
        evaluation = evaluation_of(number, asked.seed, slow=number % 8 > 3, error=error)
        rows = [(region.variable, round(region.sigma, 1)) for region in evaluation.worst_regions[:3]]
        right = rows[0][0] == ERRORS[error][0]
        first += right
        print(f"{error}, {MOTIONS[number % 2]}: {rows}{'' if right else '  <-'}")
    print(f"right variable first: {first} of {asked.effects}")


if __name__ == "__main__":
    main()
