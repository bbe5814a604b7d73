"""Where a residual is large: its mean by regions of time and of the motion, and what lies beyond the fitted range."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from accelcal.data import Array, Flags, instant
from accelcal.effects.building_blocks import lagged, since_reversal
from accelcal.effects.mechanisms import temperature_rate
from accelcal.estimation.estimate import Fit
from accelcal.signals.signals import Signals
from accelcal.validation.comparison import BINS, Bins, Outside, Region, RmsInterval
from accelcal.validation.prediction import Coasting, Prediction, rms

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
    rms : of the residual, set-up aside, m/s².
    """
    number = sum(int(np.sum(b.std > 0.0)) for b in bins)
    worst = [_worst_of(b, rms, number) for b in bins if np.any(b.std > 0.0)]
    return tuple(sorted(worst, key=lambda r: (r.variable == "frequency" or abs(r.sigma) < NOTABLE, -abs(r.sigma))))


def _worst_of(bins: Bins, rms: float, number: int) -> Region:
    """The region of one variable that stands out most, of so many regions in all."""
    i = int(np.argmax(np.abs(bins.score)))
    of_frequency = bins.of_frequency
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
    if not bins.of_frequency:
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
        largest = max(abs(region.sigma) for region in regions)
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
    spans = np.stack([t[np.minimum(first[chosen], len(t) - 1)], t[last[chosen]]], axis=1)
    return np.where(np.sum(count, axis=1, keepdims=True) > 0, spans, np.nan)


def worst_stretches(t: Array, residual: Array) -> list[tuple[float, float]]:
    """Stretches of time in which a residual (n,) stands out, largest first, s."""
    if len(t) < STRETCHES:
        return []
    several = np.split(np.arange(len(t)), np.flatnonzero(np.diff(parts_of(len(t)))) + 1)
    power = np.array([np.mean(residual[rows] ** 2) for rows in several])
    ranked = np.argsort(power)[::-1][:WORST]
    limit = STANDS_OUT**2 * float(np.median(power))
    return [(float(t[several[i][0]]), float(t[several[i][-1]])) for i in ranked if power[i] > limit]


RECENT = 0.5
"""Time constant of the recent size of a variable, s."""


def variables_of(motion: Signals) -> dict[str, tuple[Array, str]]:
    """What an error may depend on, (n,) each, with its unit: time, motion, what came before, side channels."""
    since = since_reversal(motion)
    turned = np.arange(len(since)) - np.rint(np.nan_to_num(since) / motion.step).astype(np.intp)
    side = {name: (y, "") for name, y in motion.side.items()}
    if "temperature" in side:
        side["temperature rate"] = (temperature_rate(motion), "K/s")  # a coarse sensor steps
    return {
        "time": (motion.t, "s"),
        "position": (motion.p, "m"),
        "velocity": (motion.v, "m/s"),
        "acceleration": (motion.a, "m/s²"),
        "jerk": (motion.jerk, "m/s³"),
        "recent velocity": (recent_size(motion.v, motion.step), "m/s"),
        "recent acceleration": (recent_size(motion.a, motion.step), "m/s²"),
        "time since reversal": (since, "s"),
        "distance since reversal": (np.where(np.isfinite(since), np.abs(motion.p - motion.p[turned]), np.nan), "m"),
        **side,
    }


def recent_size(y: Array, step: float) -> Array:
    """Mean magnitude of a variable (n,) over the last moments."""
    size = np.abs(y)
    return lagged(size, RECENT, step, float(np.mean(size)))


def largest_of(several: Sequence[Bins], scale: float) -> tuple[str, RmsInterval] | None:
    """Variable and mean error of the region that differs from zero most surely, and the largest of all regions, m/s².

    Parameters
    ----------
    several : bins of all variables. The interval is that of all regions at once (Bonferroni), and begins at 0 unless
        one is notable.
    scale : change of the output with acceleration, 1 + k.
    """
    rows = [(b.variable, b.mean[i], b.std[i]) for b in several for i in np.flatnonzero(b.std) if not b.of_frequency]
    if not rows:
        return None
    sizes, std = (np.abs([row[k] for row in rows]) / scale for k in (1, 2))
    reach = float(scipy.special.ndtri(1.0 - 0.025 / len(rows))) * std
    least = sizes - np.maximum(reach, NOTABLE * std)
    k = int(np.argmax(least))
    return rows[k][0], RmsInterval(float(sizes[k]), max(0.0, float(least[k])), float(np.max(sizes + reach)))


def bin_residual(
    t: Array,
    residuals: Array,
    scales: Array,
    variables: Mapping[str, tuple[Array, str]],
    least: float,
    variances: Callable[[Array], Array],
) -> list[list[Bins]]:
    """Mean residual of each of several models by regions of every variable; the mean of all samples is taken off.

    Parameters
    ----------
    t, residuals, scales : (n,) s, (models, n) m/s², and how much each output changes with acceleration, (models,).
    variables : of the same samples, (n,) each, with its unit.
    least : samples without which a region says nothing.
    variances : of the sums of the noise of an output of scale 1 along columns (m, n), (m,) (m/s²)².
    """
    bins: list[list[Bins]] = [[] for _ in residuals]
    residuals = residuals - np.mean(residuals, axis=1, keepdims=True)
    for name, (y, unit) in variables.items():
        for _, low, high in spans([y]):
            edges = np.linspace(low, high, BINS + 1)
            index = np.clip(np.searchsorted(edges, y, side="right") - 1, 0, BINS - 1)
            index[~np.isfinite(y)] = -1
            inside = index == np.arange(BINS)[:, None]
            count = np.sum(inside, axis=1)
            enough = count >= least
            columns = inside[enough] / count[enough, None]
            means, std = np.zeros((len(residuals), BINS)), np.zeros(BINS)
            means[:, enough] = [columns @ residual for residual in residuals]  # to the bit what each gives alone
            std[enough] = np.sqrt(variances(columns - 1.0 / len(t)))
            for several, residual, mean, scale in zip(bins, residuals, means, scales, strict=True):
                at = seen_at(t, residual, index, mean)
                several.append(Bins(name, unit, edges, mean, scale * std, at, count / len(t)))
    return bins


def spans(several: Iterable[Array]) -> list[tuple[Array, float, float]]:
    """Variables (n,) each that change, with their usual range."""
    usual = [(y, *np.nanquantile(y, [0.001, 0.999])) for y in several if np.isfinite(y).any()]
    return [(y, float(low), float(high)) for y, low, high in usual if high > low]


def fitted_variables(fit: Fit, motion: Signals) -> dict[str, tuple[Array, str]]:
    """Variables of the motion that have a fitted range, with their units."""
    variables = {
        "a": (motion.a, "m/s²"),
        "v": (motion.v, "m/s"),
        "p": (motion.p + fit.origins.p, "m"),
        **{
            name: (y + fit.origins.of(name), "degC" if name == "temperature" else "") for name, y in motion.side.items()
        },
    }
    return {key: value for key, value in variables.items() if key in fit.validity}


def outside(
    fit: Fit, ahead: Prediction, t: Array, motion: Signals, coasting: Mapping[float, Coasting]
) -> tuple[Outside, ...]:
    """Count and errors of the readings outside the fitted ranges; empty where no range is known.

    Parameters
    ----------
    t : (n,) s, times of `motion`.
    coasting : drift by horizon. A window that leaves the range at any reading counts as outside.
    """
    run, variables = ahead.run, fitted_variables(fit, motion)
    if len(t) == 0 or not variables:
        return ()
    at = np.clip(np.searchsorted(t, run.t - 0.5 * run.reading_step), 0, len(t) - 1)
    counted = ahead.counts & (np.abs(t[at] - run.t) <= run.reading_step)
    parts, anywhere = [], np.zeros_like(counted)
    for key, (y, unit) in variables.items():
        low, high = fit.validity[key]
        flags, here = counted & ((y < low) | (y > high))[at], y[at][counted & np.isfinite(y[at])]
        anywhere |= flags
        part = scored(ahead, counted, flags, coasting, key, unit, fit.validity[key])
        parts.append(replace(part, reach=(float(np.min(here)), float(np.max(here))) if len(here) else None))
    return (*parts, scored(ahead, counted, anywhere, coasting, "any", "", None))


def scored(
    ahead: Prediction,
    counted: Flags,
    out: Flags,
    coasting: Mapping[float, Coasting],
    variable: str,
    unit: str,
    span: tuple[float, float] | None,
) -> Outside:
    """Errors inside and outside of a range."""
    left = np.cumsum(out)
    leaves = {h: left[c.ends] > left[c.starts] for h, c in coasting.items()}
    return Outside(
        variable=variable,
        unit=unit,
        range=span,
        count=int(out.sum()),
        of=int(counted.sum()),
        one_step=(rms(ahead.e[counted & ~out & ahead.steps]), rms(ahead.e[out & ahead.steps])),
        coast={h: (rms(c.rezeroed[~leaves[h]]), rms(c.rezeroed[leaves[h]])) for h, c in coasting.items()},
        starts={h: (int(np.sum(~leaves[h])), int(np.sum(leaves[h]))) for h in coasting},
    )
