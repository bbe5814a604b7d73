"""Figures of the distribution and the spectrum of residuals."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import special

from accelcal.data import NORMAL_95, Array, instant
from accelcal.diagnosis.noise.noise_test import NoiseTest
from accelcal.effects import spelled
from accelcal.estimation.estimate import Fit
from accelcal.plots.figure import (
    COLUMNS,
    Axis,
    Band,
    Figure,
    Level,
    Line,
    Mark,
    Panel,
    Points,
    Tiles,
    imposed_band_note,
    points_shown,
    sentence,
)
from accelcal.results import words as formatting
from accelcal.results.words import grouped
from accelcal.validation.comparison import Bins, Evaluation, Spectrum
from accelcal.validation.consistency import CumulativePeriodogram, Whiteness, cumulative_periodogram, whiteness
from accelcal.validation.evaluation import accel_spectrum, one_step_spectrum

HISTOGRAM_REACH = 5.0
"""Normalised residuals beyond this are counted in a note."""
LAGS = 40
"""Of the autocorrelation; fewer on short records."""
QUANTILES = 2000
"""Points of a Q-Q plot; as many again at each end are all drawn."""
WHITE = "95 % of white residuals"


def histogram(comparison: Evaluation) -> Figure:
    """Draw the distribution of normalised one-step residuals, as histogram and as quantiles, with the normal one.

    Parameters
    ----------
    comparison : from `accelcal.compare`.
    """
    y = comparison.normalised[1]
    edges = np.linspace(-HISTOGRAM_REACH, HISTOGRAM_REACH, 61)
    density = np.histogram(y, edges)[0] / (len(y) * np.diff(edges))
    steps = np.repeat(density, 2)
    x = np.linspace(-HISTOGRAM_REACH, HISTOGRAM_REACH, 301)
    normal = np.exp(-0.5 * x**2) / math.sqrt(2.0 * math.pi)
    marks = (
        Band(np.repeat(edges, 2)[1:-1], np.zeros(len(steps)), steps, "residuals", "model", outlined=False),
        Line(x, normal, "standard normal", "other"),
    )
    left = Panel(marks, Axis("residual / predicted σ", "1"), Axis("probability density", "1"))
    outside = int(np.count_nonzero(np.abs(y) > HISTOGRAM_REACH))
    beyond = f"{grouped(outside)} beyond ±{HISTOGRAM_REACH:g} not shown" if outside else ""
    right, note = _quantiles(y)
    text = f"One-step residuals over their predicted standard deviation: {_spread(comparison)}"
    return Figure((left, right), text, "; ".join(filter(None, (beyond, note))), columns=2)


def quantile_plot(comparison: Evaluation) -> Figure:
    """Draw the quantiles of normalised one-step residuals against those of the normal distribution.

    Parameters
    ----------
    comparison : from `accelcal.compare`.
    """
    panel, note = _quantiles(comparison.normalised[1])
    text = f"Q-Q plot of one-step residuals over their predicted deviation: {_spread(comparison)}"
    return Figure((panel,), text, note)


def _quantiles(y: Array) -> tuple[Panel, str]:
    """Quantiles of residuals (n,) over those of the normal distribution, and how many are drawn."""
    expected, observed = normal_quantiles(y)
    ends = np.array([expected[0], expected[-1]])
    points = Points(expected, observed, "residuals", hollow=True)
    marks = (points, Line(ends, ends, "standard normal", "other"))
    panel = Panel(marks, Axis("normal quantile", "1"), Axis("quantile of residuals", "1"), height=282.0)
    return panel, points_shown(len(observed), len(y))


def normal_quantiles(y: Array) -> tuple[Array, Array]:
    """Normal quantiles and those of `y` (n,): all of them at the two ends, evenly chosen ones between."""
    n = len(y)
    rank = np.arange(n)
    if n > 3 * QUANTILES:
        between = np.linspace(QUANTILES, n - 1 - QUANTILES, QUANTILES).astype(np.intp)
        rank = np.unique(np.concatenate([rank[:QUANTILES], between, rank[-QUANTILES:]]))
    return np.asarray(special.ndtri((rank + 0.5) / n)), np.sort(y)[rank]


def _spread(comparison: Evaluation) -> str:
    nis = "" if comparison.nis is None else f", mean normalised square {comparison.nis:.3f} (1 expected)"
    return f"standard deviation {np.std(comparison.normalised[1]):.3f}{nis}{imposed_band_note(comparison)}"


def autocorrelation(comparison: Evaluation) -> Figure:
    """Draw the autocorrelation of normalised one-step residuals with the band that holds 95 % of white ones.

    Parameters
    ----------
    comparison : from `accelcal.compare`.
    """
    headline = "Autocorrelation of one-step residuals"
    whiteness = _whiteness(comparison, 1)
    if whiteness is None:
        return sentence(headline, "The record has too few readings for an autocorrelation.")
    panel, beyond = _lags(whiteness)
    return Figure((replace(panel, title=""),), f"{headline}: {beyond} expected by chance")


def whiteness_plot(comparison: Evaluation) -> Figure:
    """Draw the autocorrelation and the cumulative periodogram of normalised one-step residuals with 95 % regions.

    Parameters
    ----------
    comparison : from `accelcal.compare`.
    """
    whiteness = _whiteness(comparison, 4)
    if whiteness is None:
        return sentence("Whiteness", "The record has too few readings for a test.")
    power = cumulative_periodogram(comparison.normalised[1])
    panel, beyond = _lags(whiteness)
    text = (
        f"Whiteness: {beyond} by chance; cumulative periodogram {power.distance / power.limit:.2g} times its 95 % limit"
    )
    return Figure((panel, _periodogram(power)), text, columns=2)


def _whiteness(comparison: Evaluation, least: int) -> Whiteness | None:
    """Autocorrelation over at least so many lags; None where there are too few readings."""
    y = comparison.normalised[1]
    lags = min(LAGS, len(y) // 4)
    return None if lags < least or not np.any(y) else whiteness(y, lags)


def _lags(whiteness: Whiteness) -> tuple[Panel, str]:
    """Autocorrelation at each lag with the limits of white residuals, and how many lie outside."""
    rho = whiteness.autocorrelation
    lags, limit = len(rho), NORMAL_95 / math.sqrt(whiteness.samples)
    lag = np.arange(1.0, lags + 1.0)
    stems = np.column_stack([np.zeros(lags), rho, np.full(lags, np.nan)]).ravel()
    marks = (
        Band(np.array([0.5, lags + 0.5]), np.full(2, -limit), np.full(2, limit), WHITE),
        Level(0.0),
        Line(np.repeat(lag, 3), stems, solid=True),
        Points(lag, rho, "residuals"),
    )
    panel = Panel(marks, Axis("lag", "readings"), Axis("autocorrelation", "1"), "autocorrelation", 262.0)
    beyond = int(np.count_nonzero(np.abs(rho) > limit))
    return panel, f"{beyond} of {lags} lags outside, {0.05 * lags:.2g}"


def _periodogram(power: CumulativePeriodogram) -> Panel:
    """Cumulative periodogram less that of white residuals."""
    marks = (
        Band(np.array([0.0, 0.5]), np.full(2, -power.limit), np.full(2, power.limit), WHITE),
        Line(power.frequency, power.share - 2.0 * power.frequency, "residuals", "residual", 500),
    )
    frequency = Axis("frequency", "cycles per reading", range=(0.0, 0.5))
    deviation = Axis("deviation from a straight line", "1")
    return Panel(marks, frequency, deviation, "cumulative periodogram: deviation from that of white residuals", 262.0)


def spectrum(fit: Fit, comparison: Evaluation, findings: Sequence[NoiseTest] = ()) -> Figure:
    """Draw the density of the accelerometer-side residual, and of one-step residuals over their predicted deviation.

    Parameters
    ----------
    fit : that predicts the noise.
    comparison : of that fit, from `accelcal.compare`.
    findings : of a diagnosis; those with a frequency are named.
    """
    lines = [(f.parts["frequency"], spelled(f.effect)) for f in findings if "frequency" in f.parts]
    below, whole = accel_spectrum(fit, comparison), one_step_spectrum(comparison)
    panels, outside = [], []
    for density, quantity, unit, title in (
        (below, "accelerometer residual", "(m/s²)/√Hz", "accelerometer residual, inside the band"),
        (whole, "one-step residual / predicted σ", "1/√Hz", "one-step residual, up to half the reading rate"),
    ):
        if density is not None:
            f = density.frequency
            marks: list[Mark] = [
                Band(
                    f,
                    np.sqrt(density.predicted * density.low),
                    np.sqrt(density.predicted * density.high),
                    "95 % of predicted noise",
                ),
                Line(f, np.sqrt(density.density), "residual", "residual", COLUMNS),
                Line(f, np.sqrt(density.predicted), "predicted noise", "floor"),
            ]
            inside = [(at, name) for at, name in lines if f[0] <= at <= f[-1]]
            marks += [Level(at, role="other", upright=True, text=f"{name} {at:.4g} Hz") for at, name in inside]
            frequency = Axis("frequency", "Hz", "log", (float(f[0]), float(f[-1])))
            panels.append(Panel(tuple(marks), frequency, Axis(quantity, unit, "log", _reach(density)), title))
            ratio = density.density / density.predicted
            outside.append(float(np.mean((ratio < density.low) | (ratio > density.high))))
    if not panels:
        return sentence("Spectrum", "The record is too short for a spectrum.")
    named = "; ".join(f"{name} at {at:.4g} Hz" for at, name in lines)
    text = (
        f"Spectrum of the residual: up to {100.0 * max(outside):.0f} % of frequencies outside the band, 5 % by chance"
    )
    return Figure(tuple(panels), text, f"lines found: {named}" if named else "no significant line", columns=2)


def _reach(density: Spectrum) -> tuple[float, float]:
    """Ends of the ordinate: residual and prediction whole, and at least two decades."""
    y = np.sqrt(np.concatenate([np.maximum(density.density, 1e-300), density.predicted]))
    low, high = 0.8 * float(np.quantile(y, 0.002)), 1.6 * float(y.max())
    middle = math.sqrt(low * high)
    return min(low, 0.1 * middle), max(high, 10.0 * middle)


FULL_COLOUR = 8.0
"""Standard deviations at which a tile has its full colour."""
TOO_SHORT = "The record is too short for residuals by region."


def ordered(comparison: Evaluation) -> list[tuple[Bins, float]]:
    """Bins of every variable of the motion with the share of the mean square that they explain, most first."""
    bins = [(b, b.explained(comparison.accel_rms_centred)) for b in comparison.bins if not b.of_frequency]
    return sorted(bins, key=lambda pair: -pair[1])


def regions(comparison: Evaluation, most: int | None = None) -> Figure:
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
    panels += [_region(b, 1.0, "1", "") for b in comparison.bins if b.of_frequency]
    worst = comparison.worst[:1].upper() + comparison.worst[1:]
    note = "title: what the variable explains of the mean square residual, set-up aside, and its largest deviation"
    return Figure(tuple(panels[:most]), worst, note, columns=3 if most is None else min(3, most))


def before_after(before: Evaluation, after: Evaluation, step: str) -> Figure:
    """Draw the mean residual under two models against the variable in which the first fails most, on one scale.

    Parameters
    ----------
    before, after : of two models on the same recording, from `accelcal.compare`.
    step : what leads from one model to the other, for the headline.
    """
    after_by_name = {b.variable: b for b in after.bins}
    several = [(b, after_by_name[b.variable]) for b in before.bins if b.variable in after_by_name]
    several = [(b, a) for b, a in several if not b.of_frequency and np.any(b.std > 0.0)]
    if not several:
        return sentence(f"Mean residual before and after {step}", TOO_SHORT)
    pair = max(several, key=lambda both: float(np.abs(both[0].score).max(initial=0.0)))
    factor, unit = formatting.prefixed("m/s²", *map(_mean, pair))
    reach = max(float(np.nanmax(np.abs(_mean(b)) + 2.0 * b.std)) for b in pair) * 1.1 * factor
    largest = [f"{np.abs(b.score).max(initial=0.0):.1f} σ" for b in pair]
    panels = tuple(
        replace(panel, title=f"{name}: {size}", y=replace(panel.y, range=(-reach, reach)))
        for panel, name, size in zip(
            (_region(b, factor, unit, "") for b in pair), ("before", "after"), largest, strict=True
        )
    )
    text = f"{step[:1].upper()}{step[1:]}: the residual against {pair[0].variable} goes from {' to '.join(largest)}"
    note = "mean of each bin; σ: largest deviation, in standard deviations expected from noise"
    return Figure(panels, text, note, columns=2)


def _mean(bins: Bins) -> Array:
    """Means of the bins that have a standard deviation, the others NaN, (n,)."""
    return np.where(bins.std > 0.0, bins.mean, np.nan)


def _region(bins: Bins, factor: float, unit: str, share: str) -> Panel:
    """Mean residual against one variable; against frequency the ratio of densities."""
    ratio = bins.of_frequency
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


def tiles(comparison: Evaluation) -> Figure:
    """Draw one tile for each bin of each variable, in standard deviations expected from noise.

    Parameters
    ----------
    comparison : from `accelcal.compare`.
    """
    headline = "Residuals by region: mean of each bin in standard deviations expected from noise, σ"
    tile_values = tiles_of(comparison)
    if not tile_values.rows:
        return sentence(headline, TOO_SHORT)
    bins = Axis("bin, from the smallest to the largest value", "1")
    note = "beyond ±2 σ in one tile of twenty by chance; empty: too few data"
    return Figure(
        (Panel((tile_values,), bins, Axis(), height=34.0 * len(tile_values.rows)),), headline, note, legend=False
    )


def tiles_of(comparison: Evaluation) -> Tiles:
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
