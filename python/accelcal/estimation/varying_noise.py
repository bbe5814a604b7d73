"""Noise that effects of the model make stronger or weaker along the record: its likelihood, and what it adds.

Derivations 6.14. An effect that acts on noise states a variance as a function of the motion. How much of it reaches the
process noise and how much the reading noise depends on its spectrum: white noise of the output, integrated twice, is
process noise; noise far above the crossover leaves a bounded error of position, which is reading noise. Both shares
are estimated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from accelcal import _core
from accelcal.data.arrays import Array
from accelcal.effects import Effect
from accelcal.estimation.drive import DriveIntegrals
from accelcal.estimation.likelihood import counted_blocks
from accelcal.estimation.run import PreparedRun
from accelcal.estimation.values import Noise
from accelcal.signals.signals import Signals

LEAST_SHARE, FIRST_SHARE, MOST_SHARE = 1e-4, 0.1, 1e8
"""Growth of a noise, averaged over the readings, over the noise itself: limits and start of its search."""
NONE_BELOW = 1.5
"""A share below this many times the least one is none."""
CONSTANT = 1e-3
"""Largest change over the mean of a variance function that is the same all along: it is the noise itself."""
DIFFERENCE, MOST_STEPS = 1e-4, 60
"""Step of the numerical gradient in logarithms, and steps of the search."""


@dataclass(frozen=True, slots=True)
class VarianceFunction:
    """The variance function of an effect at the readings of a run."""

    effect: Effect
    before: Array
    """Mean over the interval before each reading, in the unit of the function, (n,)."""
    at: Array
    """At each reading, (n,)."""

    def part(self, rows: slice) -> VarianceFunction:
        """The readings in `rows`."""
        return VarianceFunction(self.effect, self.before[rows], self.at[rows])


def variance_functions(run: PreparedRun, noise: Noise, signals: Signals | None) -> list[VarianceFunction]:
    """Variance functions of the effects that act on the noise of a run and change along it; none without a motion."""
    found = []
    for one in noise.growth if signals is not None else ():
        assert signals is not None
        at = np.interp(run.t, signals.t + run.origins.t, one.effect.column(signals))
        if np.ptp(at) > CONSTANT * float(np.mean(np.abs(at))):
            before = 0.5 * (at + np.concatenate([at[:1], at[:-1]]))
            found.append(VarianceFunction(one.effect, before, at))
    return found


def with_growth(integrals: DriveIntegrals, noise: Noise, functions: Sequence[VarianceFunction]) -> DriveIntegrals:
    """The integrals with what the effects add to the noise of each interval and each reading."""
    if not functions:
        return integrals
    of = {one.effect.name: one for one in noise.growth}
    extra_q, extra_r = integrals.extra_q.copy(), np.zeros(len(integrals.t))
    for function in functions:
        extra_q += of[function.effect.name].q * function.before
        extra_r += of[function.effect.name].r * function.at
    return replace(integrals, extra_q=extra_q, extra_r=extra_r)


def most_likely(
    run: PreparedRun, integrals: DriveIntegrals, start: Noise, functions: Sequence[VarianceFunction]
) -> Noise:
    """Most likely q, R and growth of both, none of it negative, near `start` (derivations 6.14).

    Parameters
    ----------
    run, integrals : a record and the acceleration between its readings.
    start : where to begin.
    functions : of the effects whose growth is estimated; that of others stays.
    """
    rows_counted = counted_blocks(run, integrals, start)
    parts = [(integrals.part(rows), counts, [f.part(rows) for f in functions]) for rows, counts in rows_counted]
    usual = np.array([[np.mean(f.before), np.mean(f.at)] for f in functions])
    names, held = [f.effect.name for f in functions], {one.effect.name: one for one in start.growth}

    def noise_at(x: Array) -> Noise:
        q = math.exp(x[0])
        r = max(math.exp(x[1]), run.reading_variance_floor(q))
        share = np.exp(x[2:].reshape(-1, 2))
        shares = np.where(share > NONE_BELOW * LEAST_SHARE, share, 0.0) * (q, r) / usual
        grown = {
            name: replace(held[name], q=float(a), r=float(b), mean=float(mean))
            for name, (a, b), mean in zip(names, shares, usual[:, 0], strict=True)
        }
        return Noise(q, r, tuple(grown.get(one.effect.name, one) for one in start.growth))

    def cost(x: Array) -> float:
        noise = noise_at(x)
        grown = _core.Parts([(with_growth(part, noise, own).arrays, counts) for part, counts, own in parts])
        return -grown.log_likelihood(q=noise.q, r=noise.r, prior=run.prior(noise.r))

    r = max(start.r, 1.01 * run.reading_variance_floor(start.q))
    before = np.array([[held[name].q / start.q, held[name].r / r] for name in names]) * usual
    shares = np.log(np.where(before > 0.0, np.clip(before, 2.0 * LEAST_SHARE, MOST_SHARE), FIRST_SHARE))
    limits = [(None, None)] * 2 + [(math.log(LEAST_SHARE), math.log(MOST_SHARE))] * (2 * len(functions))
    best = scipy.optimize.minimize(
        cost,
        np.concatenate([np.log([start.q, r]), shares.ravel()]),
        method="L-BFGS-B",
        bounds=limits,
        options={"eps": DIFFERENCE, "ftol": 1e-9, "maxiter": MOST_STEPS},
    )
    return noise_at(best.x)
