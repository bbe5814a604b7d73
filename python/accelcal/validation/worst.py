"""Where a model fails: of every variable the region that stands out most, and the stretches of time it is seen in."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

from accelcal.data.arrays import Array
from accelcal.data.units import instant
from accelcal.validation.comparison import Bins, Region

NOTABLE = 4.0
"""A region that differs from zero by more standard deviations than this is named as the worst."""
STRETCHES, WORST = 40, 3
"""Stretches of the record that are compared with each other, and those of the largest residual that are marked."""
STANDS_OUT = 2.0
"""A stretch is marked whose residual is this many times the median of all stretches."""


def worst_regions(bins: Sequence[Bins], rms: float) -> tuple[Region, ...]:
    """The worst region of every variable, worst first.

    Any error has a spectrum, so frequency comes behind every variable of the motion that is notable.

    Parameters
    ----------
    bins : of all variables; a bin with too little data does not count.
    rms : of the residual, m/s².
    """
    number = sum(int(np.sum(b.std > 0.0)) for b in bins)
    found = [_worst_of(b, rms, number) for b in bins if np.any(b.std > 0.0)]
    return tuple(sorted(found, key=lambda r: (r.variable == "frequency" or abs(r.sigma) < NOTABLE, -abs(r.sigma))))


def _worst_of(bins: Bins, rms: float, number: int) -> Region:
    """The region of one variable that stands out most, of so many regions in all."""
    i = int(np.argmax(np.abs(bins.score)))
    of_frequency = bins.variable == "frequency"
    low, high = (float(x) for x in bins.edges[i : i + 2])
    at = tuple(float(x) for x in bins.seen_at[i]) if len(bins.seen_at) else ()
    return Region(
        variable=bins.variable,
        unit=bins.unit,
        low=low,
        high=high,
        excess=math.sqrt(max(float(bins.mean[i]), 0.0)) if of_frequency else float(bins.mean[i]),
        excess_unit="1" if of_frequency else "m/s²",
        sigma=float(bins.score[i]),
        share=None if of_frequency else bins.explained_by(rms)[i],
        p=min(1.0, number * _by_chance(bins, i)),
        stretch=(at[0], at[1]) if at and all(map(math.isfinite, at)) else None,
    )


def _by_chance(bins: Bins, i: int) -> float:
    """Probability that noise alone deviates as far on either side: normal, of a density chi-square."""
    if bins.variable != "frequency":
        return float(2.0 * scipy.special.ndtr(-abs(bins.score[i])))
    half = float(bins.std[i]) ** -2.0  # a density with a variance of 2/(2 half) has 2 half degrees of freedom
    x = half * float(bins.mean[i])
    return 2.0 * min(float(scipy.special.gammaincc(half, x)), float(scipy.special.gammainc(half, x)))


def worst_sentence(regions: Sequence[Region], number: int) -> str:
    """A sentence on the worst of some regions, of so many deviations in all."""
    if not regions:
        return "the record is too short to say where the model fails"
    worst = regions[0]
    if abs(worst.sigma) < NOTABLE:
        largest = max(abs(each.sigma) for each in regions)
        return f"no region stands out: the largest of {number} deviations is {largest:.1f} sigma"
    low, high = (instant(x) if worst.variable == "time" else f"{x:.4g}" for x in (worst.low, worst.high))
    where = f"{worst.variable} between {low} and {high} {worst.unit}".rstrip()
    sigma = f"({abs(worst.sigma):.1f} sigma)"
    if worst.variable == "frequency":
        return f"{where}: the residual is {worst.excess:.2g} times the predicted noise {sigma}"
    return f"{where}: mean residual {worst.excess:+.3g} m/s² {sigma}"


def parts_of(count: int) -> NDArray[np.intp]:
    """The stretch that each of so many samples belongs to, of equal numbers of them, (count,)."""
    return np.arange(count, dtype=np.intp) * STRETCHES // max(count, 1)


def seen_at(t: Array, residual: Array, index: NDArray[np.intp], mean: Array) -> Array:
    """For every bin the stretch of time that adds most to its mean, (bins, 2) s; NaN where a bin is empty.

    Parameters
    ----------
    t, residual : (n,) s and m/s².
    index : bin of each sample, (n,); negative where it is in none.
    mean : of each bin, (bins,) m/s².
    """
    part, inside = parts_of(len(t)), index >= 0
    cell = index[inside] * STRETCHES + part[inside]
    shape = (len(mean), STRETCHES)
    total = np.bincount(cell, residual[inside], minlength=len(mean) * STRETCHES).reshape(shape) * np.sign(mean)[:, None]
    count = np.bincount(cell, minlength=len(mean) * STRETCHES).reshape(shape)
    first = np.searchsorted(part, np.arange(STRETCHES))
    last = np.searchsorted(part, np.arange(STRETCHES), side="right") - 1
    chosen = np.argmax(total, axis=1)
    found = np.stack([t[np.minimum(first[chosen], len(t) - 1)], t[last[chosen]]], axis=1)
    return np.where(np.sum(count, axis=1, keepdims=True) > 0, found, np.nan)


def worst_stretches(t: Array, residual: Array) -> list[tuple[float, float]]:
    """Stretches of time in which a residual (n,) stands out, largest first, s."""
    if len(t) < STRETCHES:
        return []
    several = np.split(np.arange(len(t)), np.flatnonzero(np.diff(parts_of(len(t)))) + 1)
    power = np.array([np.mean(residual[rows] ** 2) for rows in several])
    ranked = np.argsort(power)[::-1][:WORST]
    limit = STANDS_OUT**2 * float(np.median(power))
    return [(float(t[several[i][0]]), float(t[several[i][-1]])) for i in ranked if power[i] > limit]
