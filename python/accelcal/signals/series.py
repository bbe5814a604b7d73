"""Sampled series: error of each sample against its neighbours, local scale, and the grid on which values lie."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from accelcal.data import Array, Flags, batches, runs_of

HOLE_LEAST = 1.5
"""Spacings of samples from which on an interval counts as a gap."""
END_WEIGHT = 13.0 / 24.0
"""Weight of either end of a gap in the integral of a cubic over it, in lengths of the gap."""
LOCAL = 64
"""Samples over which a local spread is taken; within them no noise level changes much."""
NEIGHBOURS = (-4, -3, -2, -1, 1, 2, 3, 4)
"""Samples from which one between them is interpolated."""
TOGETHER = 8192
"""Samples whose neighbours are weighted at a time: what they take lies in the processor's cache."""


def interpolation_errors(t: Array, y: Array) -> tuple[Array, Array]:
    """Sample minus the polynomial through its eight neighbours, (n,), and its standard deviation for unit white noise.

    Uneven times are allowed. The four samples at either end have no error.
    """
    n, reach = len(y), max(NEIGHBOURS)
    error, gain = np.zeros(n), np.ones(n)
    for begin in range(reach, n - reach, TOGETHER):
        end = min(begin + TOGETHER, n - reach)
        rows = slice(begin, end)
        offsets = [t[begin + k : end + k] - t[rows] for k in NEIGHBOURS]
        predicted, power = np.zeros(end - begin), np.ones(end - begin)
        for k, weight in zip(NEIGHBOURS, lagrange_weights(offsets), strict=True):
            predicted += weight * y[begin + k : end + k]
            power += weight**2
        error[rows] = y[rows] - predicted
        gain[rows] = np.sqrt(power)
    return error, gain


def lagrange_weights(offsets: Sequence[Array]) -> list[Array]:
    """Weights at 0 of values at `offsets`, (n,) each, in the polynomial through them: products over all other offsets o
    of o / (o - own)."""
    weights = []
    for i, offset in enumerate(offsets):
        others = [*offsets[:i], *offsets[i + 1 :]]
        above, below = others[0].copy(), others[0] - offset
        for other in others[1:]:
            above *= other
            below *= other - offset
        above /= below
        weights.append(above)
    return weights


def interpolation_spread(t: Array, y: Array) -> float:
    """Standard deviation of white noise in a series, robustly, from its interpolation errors."""
    error, gain = interpolation_errors(t, y)
    if not len(error):
        return float("nan")
    error /= gain
    return float(np.median(np.abs(error, out=error), overwrite_input=True)) / 0.6745


def local_spread(y: Array) -> Array:
    """Robust standard deviation about each sample, (n,): the largest of its block and both neighbours, and no less
    than that of the whole series."""
    whole = float(np.median(np.abs(y), overwrite_input=True)) / 0.6745 if len(y) else 0.0
    K = len(y) // LOCAL
    if K < 3:
        return np.full(len(y), max(whole, 1e-300))
    spreads = np.median(np.abs(y[: K * LOCAL].reshape(K, LOCAL)), axis=1, overwrite_input=True) / 0.6745
    spreads = np.maximum(np.maximum(spreads, np.append(spreads[1:], 0.0)), np.append(0.0, spreads[:-1]))
    lengths = np.full(K, LOCAL)
    lengths[-1] += len(y) - K * LOCAL
    return np.asarray(np.repeat(np.maximum(spreads, max(whole, 1e-300)), lengths))


def runs_of_true(flags: Flags, least: int) -> list[tuple[int, int]]:
    """First and last index of each run of true flags of at least this length."""
    return [(int(a), int(b) - 1) for a, b in runs_of(flags) if b - a >= least]


def least_change(y: Array) -> float:
    """Smallest step between two neighbours that differ; infinite where none do."""
    steps = np.diff(y)
    np.abs(steps, out=steps)
    return float(np.min(steps, where=steps > 0.0, initial=math.inf))


def grid_step(y: Array) -> float:
    """Spacing of the values of a quantised channel; 0 when they do not lie on a grid that is used repeatedly."""
    levels = np.unique(y)
    if len(levels) < 2 or len(levels) > 0.5 * len(y):
        return 0.0
    gaps = np.diff(levels)
    step = float(np.min(gaps[gaps > 1e-9 * (levels[-1] - levels[0])], initial=math.inf))
    if not math.isfinite(step):
        return 0.0
    count = np.rint(gaps / step)
    step = float(np.sum(gaps) / np.sum(count))
    off = np.abs((levels - levels[0]) / step - np.rint((levels - levels[0]) / step))
    return step if float(np.max(off)) < 0.1 else 0.0


SIDE = 8
"""Samples to either side of a stretch from which it is bridged."""
DEGREE = 5
"""Degree of the polynomial that bridges it: value, slope and curvature continue at both ends."""


def bridged(y: Array, hidden: Flags) -> Array:
    """Uniform samples (n,) with the `hidden` stretches replaced by polynomials through their neighbours."""
    filled = y.copy()
    for begin, end in runs_of(hidden):
        low, high = max(0, begin - SIDE), min(len(y), end + SIDE)
        x = (np.arange(low, high) - 0.5 * (low + high - 1)) / (0.5 * (high - low))
        visible = ~hidden[low:high]
        if int(visible.sum()) <= DEGREE:
            filled[begin:end] = np.interp(np.arange(begin, end), np.flatnonzero(~hidden), y[~hidden])
            continue
        powers = np.vander(x, DEGREE + 1)
        coefficients, *_ = np.linalg.lstsq(powers[visible], y[low:high][visible], rcond=None)
        filled[begin:end] = (powers @ coefficients)[begin - low : end - low]
    return filled


def widened(marked: Flags, reach: int) -> Flags:
    """Samples that are marked, or at most `reach` from one that is, (n,)."""
    if not marked.any():
        return np.zeros(len(marked), dtype=np.bool_)
    total = np.cumsum(np.pad(marked, (reach + 1, reach)))
    return np.asarray(total[2 * reach + 1 :] > total[: len(marked)])


def running_median(y: Array, reach: int, ends: Literal["edge", "symmetric"]) -> Array:
    """Median of each sample and of `reach` on either side, (n,); beyond an end its value is held, or all mirrored."""
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(y, reach, mode=ends), 2 * reach + 1)
    median = np.empty(len(y), dtype=y.dtype)
    for part in batches(len(y), TOGETHER):
        median[part] = np.partition(windows[part], reach, axis=1)[:, reach]
    return median


MOST_FILLED = 16
"""Lost samples in a row that are filled in; over more the motion changes too much."""
FILL_DEGREE, FILL_BESIDE = 7, 3
"""Degree of the polynomial that fills a gap, and by how many samples those to either side that it is fitted to exceed
the lost ones: as many as keep its noise near that of a cubic through four."""
FILL_MISFIT = (6.0, 20.0)
"""Misfit to those samples beyond its expectation, in its deviations and in variances of a sample, above which a gap is
not filled in: the motion there is no such polynomial."""
GAPS = 4096
"""Gaps that are filled in at a time."""


@dataclass(frozen=True, slots=True)
class FilledSeries:
    """A series with its short gaps filled in."""

    t: Array
    y: Array
    begin: Array
    """Last sample before each gap, filled or not, (gaps,) s."""
    end: Array
    """First sample behind it, (gaps,) s."""
    noise: Array
    """Variance of the integral over each gap beyond the usual, for samples of unit variance and spacing, (gaps,)."""
    filled: Flags
    """Whether the gap was filled in, (gaps,)."""


def fill_gaps(t: Array, y: Array, step: float) -> FilledSeries:
    """Fill in up to `MOST_FILLED` lost samples in a row by a polynomial fitted to their neighbours.

    A cubic over such a gap errs by (w gap)^4, always towards less motion, and would bias the scale factor; what is left
    here is noise. Longer gaps, and those whose neighbours no such polynomial describes, are left to the interpolant of
    the replay.

    Parameters
    ----------
    t, y : (n,) times and values.
    step : usual spacing.
    """
    before = np.flatnonzero(np.diff(t) > HOLE_LEAST * step)
    length = t[before + 1] - t[before]
    spacings = length / step
    lost = np.rint(spacings).astype(np.intp) - 1
    noise = 2.0 * (0.5 + END_WEIGHT * spacings) ** 2 - (spacings + 1.0)
    filled = np.zeros(len(before), dtype=np.bool_)
    times, values = [t], [y]
    if len(before) == 0:
        return FilledSeries(t, y, t[before], t[before], noise, filled)
    variance = interpolation_spread(t, y) ** 2 + grid_step(y) ** 2 / 12.0
    for count in np.unique(lost[(lost > 0) & (lost <= MOST_FILLED)]):
        side = int(count) + FILL_BESIDE
        which = np.flatnonzero((lost == count) & (before >= side - 1) & (before + side < len(t)))
        inside = np.arange(1, count + 1) / (count + 1.0)
        for some in np.split(which, range(GAPS, len(which), GAPS)):
            rows = before[some][:, None] + np.arange(1 - side, side + 1)
            at = t[before[some]][:, None] + length[some][:, None] * inside
            weights, misfit = fitted_polynomials(t[rows], y[rows], at)
            free = 2 * side - FILL_DEGREE - 1
            fits = misfit <= (free + FILL_MISFIT[0] * math.sqrt(2.0 * free) + FILL_MISFIT[1]) * variance
            times.append(at[fits].ravel())
            values.append(np.einsum("gkj,gj->gk", weights[fits], y[rows[fits]]).ravel())
            noise[some[fits]] = np.sum((1.0 + weights[fits].sum(axis=1)) ** 2, axis=1) - (2 * side + count)
            filled[some[fits]] = True
    begin, end = t[before], t[before + 1]
    if not filled.any():
        return FilledSeries(t, y, begin, end, noise, filled)
    every = np.concatenate(times)
    order = np.argsort(every, kind="stable")
    return FilledSeries(every[order], np.concatenate(values)[order], begin, end, noise, filled)


def fitted_polynomials(nodes: Array, values: Array, at: Array) -> tuple[Array, Array]:
    """Polynomials of degree `FILL_DEGREE` fitted to values at `nodes`, (g, j) each.

    Returns
    -------
    Weights of the values in each polynomial at times `at` (g, k), as (g, k, j); sums of squared misfits, (g,).
    """
    middle, half = 0.5 * (nodes[:, :1] + nodes[:, -1:]), 0.5 * (nodes[:, -1:] - nodes[:, :1])
    basis = np.polynomial.legendre.legvander((nodes - middle) / half, FILL_DEGREE)
    orthonormal, triangle = np.linalg.qr(basis)
    here = np.polynomial.legendre.legvander((at - middle) / half, FILL_DEGREE)
    weights = np.linalg.solve(triangle.transpose(0, 2, 1), here.transpose(0, 2, 1)).transpose(0, 2, 1)
    weights = weights @ orthonormal.transpose(0, 2, 1)
    centred = values - values.mean(axis=1, keepdims=True)
    explained = np.einsum("gjb,gj->gb", orthonormal, centred)
    return weights, np.sum(centred**2, axis=1) - np.sum(explained**2, axis=1)
