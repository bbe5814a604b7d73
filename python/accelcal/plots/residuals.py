"""Figures of the distribution and the spectrum of residuals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import special

from accelcal.data.arrays import Array
from accelcal.diagnosis.noise_tests.noise_test import NoiseTest
from accelcal.effects import spelled
from accelcal.estimation.estimate import Fit
from accelcal.plots.figure import COLUMNS, Axis, Band, Figure, Level, Line, Mark, Panel, Points, points_shown, sentence
from accelcal.plots.numbers import TWO_SIDED_95, imposed_band_note
from accelcal.results.words import grouped
from accelcal.validation.comparison import Comparison, Spectrum
from accelcal.validation.consistency import CumulativePeriodogram, Whiteness, cumulative_periodogram, whiteness
from accelcal.validation.spectrum import accel_spectrum, one_step_spectrum

HISTOGRAM_REACH = 5.0
"""Normalised residuals beyond this are counted in a note."""
LAGS = 40
"""Of the autocorrelation; fewer on short records."""
QUANTILES = 2000
"""Points of a Q-Q plot; as many again at each end are all drawn."""
WHITE = "95 % of white residuals"


def histogram(comparison: Comparison) -> Figure:
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


def quantile_plot(comparison: Comparison) -> Figure:
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
    expected, seen = normal_quantiles(y)
    ends = np.array([expected[0], expected[-1]])
    points = Points(expected, seen, "residuals", hollow=True)
    marks = (points, Line(ends, ends, "standard normal", "other"))
    panel = Panel(marks, Axis("normal quantile", "1"), Axis("quantile of residuals", "1"), height=282.0)
    return panel, points_shown(len(seen), len(y))


def normal_quantiles(y: Array) -> tuple[Array, Array]:
    """Normal quantiles and those of `y` (n,): all of them at the two ends, evenly chosen ones between."""
    n = len(y)
    rank = np.arange(n)
    if n > 3 * QUANTILES:
        between = np.linspace(QUANTILES, n - 1 - QUANTILES, QUANTILES).astype(np.intp)
        rank = np.unique(np.concatenate([rank[:QUANTILES], between, rank[-QUANTILES:]]))
    return np.asarray(special.ndtri((rank + 0.5) / n)), np.sort(y)[rank]


def _spread(comparison: Comparison) -> str:
    nis = "" if comparison.nis is None else f", mean normalised square {comparison.nis:.3f} (1 expected)"
    return f"standard deviation {np.std(comparison.normalised[1]):.3f}{nis}{imposed_band_note(comparison)}"


def autocorrelation(comparison: Comparison) -> Figure:
    """Draw the autocorrelation of normalised one-step residuals with the band that holds 95 % of white ones.

    Parameters
    ----------
    comparison : from `accelcal.compare`.
    """
    headline = "Autocorrelation of one-step residuals"
    found = _whiteness(comparison, 1)
    if found is None:
        return sentence(headline, "The record has too few readings for an autocorrelation.")
    panel, beyond = _lags(found)
    return Figure((replace(panel, title=""),), f"{headline}: {beyond} expected by chance")


def whiteness_plot(comparison: Comparison) -> Figure:
    """Draw the autocorrelation and the cumulative periodogram of normalised one-step residuals with 95 % regions.

    Parameters
    ----------
    comparison : from `accelcal.compare`.
    """
    found = _whiteness(comparison, 4)
    if found is None:
        return sentence("Whiteness", "The record has too few readings for a test.")
    power = cumulative_periodogram(comparison.normalised[1])
    panel, beyond = _lags(found)
    text = (
        f"Whiteness: {beyond} by chance; cumulative periodogram {power.distance / power.limit:.2g} times its 95 % limit"
    )
    return Figure((panel, _periodogram(power)), text, columns=2)


def _whiteness(comparison: Comparison, least: int) -> Whiteness | None:
    """Autocorrelation over at least so many lags; None where there are too few readings."""
    y = comparison.normalised[1]
    lags = min(LAGS, len(y) // 4)
    return None if lags < least or not np.any(y) else whiteness(y, lags)


def _lags(found: Whiteness) -> tuple[Panel, str]:
    """Autocorrelation at each lag with the limits of white residuals, and how many lie outside."""
    rho = found.autocorrelation
    lags, limit = len(rho), TWO_SIDED_95 / math.sqrt(found.samples)
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


def spectrum(fit: Fit, comparison: Comparison, findings: Sequence[NoiseTest] = ()) -> Figure:
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
    for seen, quantity, unit, title in (
        (below, "accelerometer residual", "(m/s²)/√Hz", "accelerometer residual, inside the band"),
        (whole, "one-step residual / predicted σ", "1/√Hz", "one-step residual, up to half the reading rate"),
    ):
        if seen is not None:
            f = seen.frequency
            marks: list[Mark] = [
                Band(
                    f,
                    np.sqrt(seen.predicted * seen.low),
                    np.sqrt(seen.predicted * seen.high),
                    "95 % of predicted noise",
                ),
                Line(f, np.sqrt(seen.density), "residual", "residual", COLUMNS),
                Line(f, np.sqrt(seen.predicted), "predicted noise", "floor"),
            ]
            inside = [(at, name) for at, name in lines if f[0] <= at <= f[-1]]
            marks += [Level(at, role="other", upright=True, text=f"{name} {at:.4g} Hz") for at, name in inside]
            frequency = Axis("frequency", "Hz", "log", (float(f[0]), float(f[-1])))
            panels.append(Panel(tuple(marks), frequency, Axis(quantity, unit, "log", _reach(seen)), title))
            ratio = seen.density / seen.predicted
            outside.append(float(np.mean((ratio < seen.low) | (ratio > seen.high))))
    if not panels:
        return sentence("Spectrum", "The record is too short for a spectrum.")
    named = "; ".join(f"{name} at {at:.4g} Hz" for at, name in lines)
    text = (
        f"Spectrum of the residual: up to {100.0 * max(outside):.0f} % of frequencies outside the band, 5 % by chance"
    )
    return Figure(tuple(panels), text, f"lines found: {named}" if named else "no significant line", columns=2)


def _reach(seen: Spectrum) -> tuple[float, float]:
    """Ends of the ordinate: residual and prediction whole, and at least two decades."""
    y = np.sqrt(np.concatenate([np.maximum(seen.density, 1e-300), seen.predicted]))
    low, high = 0.8 * float(np.quantile(y, 0.002)), 1.6 * float(y.max())
    middle = math.sqrt(low * high)
    return min(low, 0.1 * middle), max(high, 10.0 * middle)
