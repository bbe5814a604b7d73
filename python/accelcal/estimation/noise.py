"""Process and reading noise (q, R) by innovation likelihood, at rest and in motion."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from accelcal.data.arrays import Array, Flags
from accelcal.data.references import Reference
from accelcal.estimation.drive import DriveIntegrals
from accelcal.estimation.likelihood import Likelihood
from accelcal.estimation.run import PreparedRun
from accelcal.estimation.values import Noise
from accelcal.estimation.varying_noise import VarianceFunction, most_likely

NEAR, GROWN = 0.05, 0.3
"""First steps of a search in log q and log R: the least, and that of a model to which effects were added."""
LEAST_COUNT = 256
"""Fewer settled readings than this do not determine the noise."""
REMARKED_BEYOND = 1.5
"""A fitted density that differs from the declared one by more than this factor is remarked on."""


@dataclass(frozen=True, slots=True)
class Level:
    """Noise of both channels over a part of a record, with standard deviations."""

    density: float
    """One-sided noise density of the sensor, (m/s²)/sqrt(Hz)."""
    density_std: float
    reading: float
    """Standard deviation of one reading of the reference, in its unit: m of a position."""
    reading_std: float
    count: int
    """Readings that were used."""


@dataclass(frozen=True, slots=True)
class NoiseReport:
    """Noise of one recording: as a whole, at rest, in motion, and as declared on the data sheet."""

    noise: Noise
    all: Level
    rest: Level | None
    motion: Level | None
    declared: float | None
    """Declared one-sided density, (m/s²)/sqrt(Hz)."""
    crossover: float
    """Frequency above which the accelerometer determines the acceleration better than the encoder, Hz."""
    band: float | None = None
    """Band that was imposed because the noise is not white, Hz."""
    reference: Reference = "position"
    """What the reference reads; the noise of its readings is in that unit."""

    @property
    def ratio(self) -> float | None:
        """Fitted over declared density."""
        return None if self.declared is None else self.all.density / self.declared

    @property
    def remark(self) -> str | None:
        """A sentence when fit and data sheet disagree by more than a factor 1.5."""
        if self.ratio is None or 1.0 / REMARKED_BEYOND <= self.ratio <= REMARKED_BEYOND:
            return None
        if self.ratio > 1.0:
            return (
                f"the fitted noise density is {self.ratio:.2g} times the declared one: "
                "something else shakes or disturbs the output, or the model lacks an effect"
            )
        return (
            f"the fitted noise density is {self.ratio:.2g} of the declared one: "
            "check the declared density and whether a low-pass was left undeclared"
        )


@dataclass(frozen=True, slots=True)
class NoiseSearch:
    """Most likely noise so far, and the first step of the next search."""

    noise: Noise
    """By likelihood, no band imposed."""
    width: float = 1.0
    """First step of the next search, in log q and log R."""

    def again(
        self, run: PreparedRun, integrals: DriveIntegrals, functions: Sequence[VarianceFunction] = ()
    ) -> NoiseSearch:
        """Search once more, from here; the next width is twice the distance moved.

        `functions` are the variance functions of effects that act on the noise; what they add is not in `integrals`.
        """
        if functions:
            return NoiseSearch(most_likely(run, integrals, self.noise, functions), self.width)
        found = replace(estimate_noise(run, integrals, self.noise, width=self.width), growth=self.noise.growth)
        moved = max(abs(math.log(found.q / self.noise.q)), abs(math.log(found.r / self.noise.r)))
        return NoiseSearch(found, min(max(2.0 * moved, NEAR), 1.0))

    def scaled(self, factor: float) -> NoiseSearch:
        """The same with the process density multiplied by a factor."""
        return NoiseSearch(self.noise.scaled(factor), self.width)

    def within(self, band: float | None, run: PreparedRun) -> Noise:
        """The noise whose crossover lies at `band`, Hz, with the process density kept; without a band the noise."""
        if band is None:
            return self.noise
        return replace(self.noise, r=self.noise.q / ((2.0 * np.pi * band) ** 4 * run.reading_step))


def estimate_noise(
    run: PreparedRun, integrals: DriveIntegrals, start: Noise, *, counts: Flags | None = None, width: float = 1.0
) -> Noise:
    """Most likely q and R given the nominal motion (derivations 6.3).

    Parameters
    ----------
    run, integrals : a record and the acceleration between its readings.
    start : where to begin; ten times off is near enough.
    counts : (n,) optional; readings that are to count.
    width : first steps of the search in log q and log R; it goes further where it must.

    Returns
    -------
    Noise
        Intensities; `r` is never below `run.reading_variance_floor(q)`.

    Raises
    ------
    ValueError
        From the core, if the record is unusable.
    """
    return most_likely_noise(Likelihood(run, integrals, start, counts), run.reading_variance_floor, start, width)


LARGEST_LOG = 700.0
"""Logarithm of a density or variance beyond which none is tried: near the largest number of double precision."""


def most_likely_noise(
    log_likelihood: Callable[[float, float], float], floor: Callable[[float], float], start: Noise, width: float
) -> Noise:
    """Most likely q and R, by the simplex method.

    Parameters
    ----------
    log_likelihood : of log q and log R.
    floor : least R, m², at a q.
    start, width : where to begin, and the first steps in log q and log R.
    """

    def cost(x: Array) -> float:
        log_q, log_r = float(x[0]), float(x[1])
        if max(log_q, log_r) > LARGEST_LOG:
            return math.inf
        least = math.log(floor(math.exp(log_q)))
        return -log_likelihood(log_q, max(log_r, least)) + 1e3 * max(0.0, least - log_r)

    x0 = np.log([start.q, max(start.r, floor(start.q) * 1.01)])
    simplex = x0 + width * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    best = scipy.optimize.minimize(
        cost,
        x0,
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "xatol": 3e-3, "fatol": 0.02, "maxfev": 120},
    )
    log_q, log_r = float(best.x[0]), float(best.x[1])
    return Noise(float(np.exp(log_q)), float(np.exp(max(log_r, math.log(floor(math.exp(log_q)))))))


def level_of(
    run: PreparedRun, integrals: DriveIntegrals, noise: Noise, counts: Flags, sensor_scale: float
) -> Level | None:
    """Noise level of the readings that count, estimated anew; None when they are too few."""
    if int(counts.sum()) < LEAST_COUNT:
        return None
    return level(run, integrals, estimate_noise(run, integrals, noise, counts=counts), sensor_scale, counts)


def level(
    run: PreparedRun, integrals: DriveIntegrals, fitted: Noise, sensor_scale: float, counts: Flags | None = None
) -> Level:
    """Fitted noise in the user's units, with uncertainty from the curvature of the likelihood."""
    likelihood = Likelihood(run, integrals, fitted, counts)
    log_q, log_r = likelihood.spread(fitted)
    density = abs(sensor_scale) * math.sqrt(2.0 * fitted.q)
    reading = math.sqrt(fitted.r)
    return Level(density, 0.5 * log_q * density, reading, 0.5 * log_r * reading, likelihood.count)
