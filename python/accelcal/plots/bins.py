"""Figures of the mean residual by region: in bins of every variable, and as tiles."""

from __future__ import annotations

import itertools
import math

import numpy as np

from accelcal.data.arrays import Array
from accelcal.data.units import instant
from accelcal.plots.figure import Axis, Band, Figure, Level, Line, Panel, Tiles, sentence
from accelcal.results import words as formatting
from accelcal.validation.comparison import Bins, Comparison

FULL_COLOUR = 8.0
"""Standard deviations at which a tile has its full colour."""
TOO_SHORT = "The record is too short for residuals by region."


def ordered(comparison: Comparison) -> list[tuple[Bins, float]]:
    """Bins of every variable of the motion with the share of the mean square that they explain, most first."""
    rms = comparison.accel_rms
    found = [(b, b.explained(rms)) for b in comparison.bins if b.variable != "frequency"]
    return sorted(found, key=lambda pair: -pair[1])


def regions(comparison: Comparison, most: int | None = None) -> Figure:
    """Draw the mean residual against each variable, and its density against frequency.

    Parameters
    ----------
    comparison : from `accelcal.compare`; bins with too little data to have a band are absent.
    most : variables that are drawn, those that explain most; by default all.
    """
    shares = ordered(comparison)
    if not shares:
        return sentence("Mean residual", TOO_SHORT)
    factor, unit = formatting.prefixed("m/s²", *(_mean(b) for b, _ in shares))
    panels = [_region(b, factor, unit, f"{100.0 * share:.2g} %, ") for b, share in shares]
    panels += [_region(b, 1.0, "1", "") for b in comparison.bins if b.variable == "frequency"]
    worst = comparison.worst[:1].upper() + comparison.worst[1:]
    note = "title: what the variable explains of the mean square residual, and its largest deviation"
    return Figure(tuple(panels[:most]), worst, note, columns=3 if most is None else min(3, most))


def _mean(bins: Bins) -> Array:
    """Means of the bins that have a standard deviation, the others NaN, (n,)."""
    return np.where(bins.std > 0.0, bins.mean, np.nan)


def _region(bins: Bins, factor: float, unit: str, share: str) -> Panel:
    """Mean residual against one variable; against frequency the ratio of densities."""
    ratio = bins.variable == "frequency"
    scale, x_unit = (1.0, bins.unit) if bins.unit == "s" else formatting.prefixed(bins.unit, bins.edges)
    centre, zero = 0.5 * (bins.edges[1:] + bins.edges[:-1]) * scale, 1.0 if ratio else 0.0
    reach = np.repeat(np.where(bins.std > 0.0, 2.0 * bins.std, np.nan), 2) * factor
    edges = np.repeat(bins.edges, 2)[1:-1] * scale
    mean = bins.mean[bins.std > 0.0]
    wide = ratio and len(mean) and mean.min() > 0.0 and mean.max() / mean.min() > 10.0
    marks = (
        Band(edges, zero - reach, zero + reach, "expected from noise, ± 2 σ (1 bin in 20 lies outside by chance)"),
        Level(zero),
        Line(centre, _mean(bins) * factor, "residual", "residual", marker="."),
    )
    title = f"{bins.variable}: {share}{np.abs(bins.score).max(initial=0.0):.1f} σ"
    y = Axis("density / predicted" if ratio else "mean residual", unit, few=True)
    if wide:
        y = Axis(y.title, unit, "log", (0.7 * min(1.0, float(mean.min())), 1.4 * float(mean.max())))
    return Panel(marks, Axis(bins.variable, x_unit, few=True), y, title, 148.0)


def tiles(comparison: Comparison) -> Figure:
    """Draw one tile for each bin of each variable, in standard deviations expected from noise.

    Parameters
    ----------
    comparison : from `accelcal.compare`.
    """
    headline = "Residuals by region: mean of each bin in standard deviations expected from noise, σ"
    seen = tiles_of(comparison)
    if not seen.rows:
        return sentence(headline, TOO_SHORT)
    bins = Axis("bin, from the smallest to the largest value", "1")
    note = "beyond ±2 σ in one tile of twenty by chance; empty: too few data"
    return Figure((Panel((seen,), bins, Axis(), height=34.0 * len(seen.rows)),), headline, note, legend=False)


def tiles_of(comparison: Comparison) -> Tiles:
    """Scores of every variable, the one with the largest score first; NaN where a bin has too little data."""
    chosen = sorted(comparison.bins, key=lambda b: -float(np.abs(b.score).max(initial=0.0)))
    width = max((len(b.score) for b in chosen), default=0)
    rows, hover, sigma = [], [], np.full((len(chosen), width), math.nan)
    for row, b in zip(sigma, chosen, strict=True):
        factor, unit = (1.0, b.unit) if b.unit in ("s", "Hz") else formatting.prefixed(b.unit, b.edges)
        shown = formatting.label("", unit).strip(" ()")
        texts = [instant(x) if unit == "s" else f"{x:.3g}" for x in b.edges * factor]
        rows.append(f"{b.variable}, {texts[0]} to {texts[-1]} {shown}".replace(" -", " −"))
        row[: len(b.score)] = np.where(b.std > 0.0, b.score, np.nan)
        pairs = zip(itertools.pairwise(texts), row.tolist(), strict=False)
        hover.append([f"{low} to {high} {shown}: {signed(score)} σ" for (low, high), score in pairs])
    text = [[signed(value) for value in row] for row in sigma.tolist()]
    return Tiles(sigma, rows, [str(i + 1) for i in range(width)], text, hover, FULL_COLOUR)


def signed(value: float) -> str:
    """A score as a tile shows it: whole standard deviations with their sign, nothing where there is none.

    Examples
    --------
    >>> signed(2.6), signed(-3.2), signed(-0.1), signed(math.nan)
    ('+3', '−3', '0', '')
    """
    if math.isnan(value):
        return ""
    shown = f"{value:+.0f}".replace("-", "−")
    return "0" if shown in ("+0", "−0") else shown
