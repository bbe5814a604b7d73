"""Static figures of a fit and of its comparison with a recording; they compute nothing new.

Traces are thinned to the extremes of each pixel column; every number in a title comes from the full data.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from accelcal._support.listing import listing
from accelcal.data.arrays import Array
from accelcal.data.units import instant
from accelcal.effects import find
from accelcal.estimation.estimate import Fit
from accelcal.io import together
from accelcal.model import Estimate
from accelcal.plots import style
from accelcal.plots.numbers import (
    LAGS,
    TWO_SIDED_95,
    allowed_horizons,
    drift_headline,
    imposed_band_note,
    normal_quantiles,
    one_step_residuals,
)
from accelcal.plots.static.nonlinearity import nonlinearity
from accelcal.plots.static.overlay import overlay
from accelcal.plots.style import Theme, ThemeName
from accelcal.results.words import concise, grouped, label, length, prefixed, with_unit
from accelcal.validation.comparison import Bins, Comparison
from accelcal.validation.consistency import whiteness

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, SubFigure

__all__ = [
    "accel_residual",
    "autocorrelation",
    "coasting",
    "histogram",
    "one_step",
    "overview",
    "parameters",
    "regions",
    "simulated",
    "write",
]

WIDTH = 8.0
"""Inches; 1280 pixels."""
A4_LANDSCAPE = (11.69, 8.27)
"""Inches."""
HISTOGRAM_REACH = 5.0
"""Normalised residuals beyond this are counted in a note."""
LINEAR_REACH = 30.0
"""Estimates beyond this many typical sizes are drawn on a logarithmic axis, linear about zero."""


def simulated(comparison: Comparison, *, theme: ThemeName = "light") -> Figure:
    """Draw measured and simulated position, and below them the error of the simulation.

    Parameters
    ----------
    comparison : from `accelcal.compare`.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If matplotlib is not installed.
    """
    palette = style.theme_of(theme)
    figure = style.new_figure(WIDTH, 5.0, palette)
    _simulated(figure, comparison, palette)
    return figure


def coasting(comparison: Comparison, *, theme: ThemeName = "light") -> Figure:
    """Draw rms unaided drift against the time since position was withheld, with its noise floor.

    Parameters
    ----------
    comparison : from `accelcal.compare`; horizons that the record does not allow are absent.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If matplotlib is not installed.
    """
    palette = style.theme_of(theme)
    figure = style.new_figure(WIDTH, 4.5, palette)
    _coasting(figure, comparison, palette)
    return figure


def one_step(comparison: Comparison, *, theme: ThemeName = "light") -> Figure:
    """Draw one-step residuals against time with the band that should hold 95 % of them.

    Parameters
    ----------
    comparison : from `accelcal.compare`.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If matplotlib is not installed.
    """
    palette = style.theme_of(theme)
    figure = style.new_figure(WIDTH, 4.0, palette)
    _one_step(figure, comparison, palette)
    return figure


def regions(comparison: Comparison, *, theme: ThemeName = "light") -> Figure:
    """Draw the mean residual against each variable, most significant variable first.

    Parameters
    ----------
    comparison : from `accelcal.compare`; bins with too little data to have a band are absent.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If matplotlib is not installed.
    """
    palette = style.theme_of(theme)
    rows = max(1, math.ceil(len(comparison.bins) / 3))
    figure = style.new_figure(WIDTH, 1.1 + 2.1 * rows, palette)
    _regions(figure, comparison, palette, columns=3)
    return figure


def accel_residual(comparison: Comparison, *, theme: ThemeName = "light") -> Figure:
    """Draw the accelerometer residual below the highest frequency at which the encoder is a reference.

    Parameters
    ----------
    comparison : from `accelcal.compare`.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If matplotlib is not installed.
    """
    palette = style.theme_of(theme)
    figure = style.new_figure(WIDTH, 4.0, palette)
    axes = figure.subplots()
    t, residual = comparison.accel_residual
    factor, unit = prefixed("m/s²", residual)
    style.format_axes(axes, palette, x=label("time", "s"), y=label("accelerometer residual", unit))
    if len(t) == 0:
        style.headline(figure, "Accelerometer residual", palette)
        style.message(axes, f"The record is too short for a residual below {comparison.band:.3g} Hz.", palette)
        return figure
    drawn = style.trace(axes, t, residual, palette.residual, factor=factor, name="output − model")
    for sign in (-1.0, 1.0):
        axes.axhline(
            sign * comparison.accel_rms * factor,
            color=palette.other.colour,
            linestyle=palette.other.line,
            linewidth=1.2,
            label="± rms" if sign > 0.0 else "_",
        )
    style.legend(axes, palette)
    style.note(axes, drawn.note, palette)
    text = f"Accelerometer residual below {comparison.band:.3g} Hz: rms {comparison.accel_rms * factor:.3g} {unit}"
    style.headline(figure, text, palette)
    return figure


def histogram(comparison: Comparison, *, theme: ThemeName = "light") -> Figure:
    """Draw the distribution of normalised one-step residuals, as histogram and as quantiles, with the normal one.

    Parameters
    ----------
    comparison : from `accelcal.compare`.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If matplotlib is not installed.
    """
    palette = style.theme_of(theme)
    y = comparison.normalised[1]
    figure = style.new_figure(WIDTH, 4.2, palette)
    left, right = figure.subplots(1, 2)

    edges = np.linspace(-HISTOGRAM_REACH, HISTOGRAM_REACH, 61)
    density = np.histogram(y, edges)[0] / (len(y) * np.diff(edges))
    style.format_axes(left, palette, x=label("residual / predicted σ", "1"), y=label("probability density", "1"))
    left.stairs(density, edges, color=palette.model.colour, fill=True, alpha=0.45, label="residuals")
    x = np.linspace(-HISTOGRAM_REACH, HISTOGRAM_REACH, 301)
    normal = np.exp(-0.5 * x**2) / math.sqrt(2.0 * math.pi)
    left.plot(
        x, normal, color=palette.other.colour, linestyle=palette.other.line, linewidth=1.4, label="standard normal"
    )
    style.legend(left, palette)
    outside = int(np.count_nonzero(np.abs(y) > HISTOGRAM_REACH))
    style.note(left, f"{grouped(outside)} beyond ±{HISTOGRAM_REACH:g} not shown" if outside else "", palette)

    expected, seen = normal_quantiles(y)
    style.format_axes(right, palette, x=label("normal quantile", "1"), y=label("quantile of residuals", "1"))
    reach = float(np.abs(expected).max())
    ends = [-reach, reach]
    right.plot(
        ends, ends, color=palette.other.colour, linestyle=palette.other.line, linewidth=1.4, label="standard normal"
    )
    right.plot(
        expected,
        seen,
        color=palette.model.colour,
        linestyle="none",
        marker=palette.model.marker,
        markersize=2.2,
        label="residuals",
        rasterized=True,
    )
    style.legend(right, palette)
    style.note(right, style.Thinned(expected, seen, len(seen), len(y)).note, palette)

    nis = "" if comparison.nis is None else f", mean normalised square {comparison.nis:.3f} (1 expected)"
    text = f"One-step residuals over their predicted standard deviation: standard deviation {np.std(y):.3f}{nis}"
    style.headline(figure, text + imposed_band_note(comparison), palette)
    return figure


def autocorrelation(comparison: Comparison, *, theme: ThemeName = "light") -> Figure:
    """Draw the autocorrelation of normalised one-step residuals with the band that holds 95 % of white ones.

    Parameters
    ----------
    comparison : from `accelcal.compare`.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If matplotlib is not installed.
    """
    palette = style.theme_of(theme)
    figure = style.new_figure(WIDTH, 4.0, palette)
    axes = figure.subplots()
    style.format_axes(axes, palette, x=label("lag", "readings"), y=label("autocorrelation", "1"))
    y = comparison.normalised[1]
    lags = min(LAGS, len(y) // 4)
    if lags < 1 or not np.any(y):
        style.headline(figure, "Autocorrelation of one-step residuals", palette)
        style.message(axes, "The record has too few readings for an autocorrelation.", palette)
        return figure
    found = whiteness(y, lags)
    limit = TWO_SIDED_95 / math.sqrt(found.samples)
    lag = np.arange(1, lags + 1)
    axes.axhspan(-limit, limit, color=palette.band, alpha=0.25, linewidth=0.0, label="95 % of white residuals")
    axes.axhline(0.0, color=palette.ink, linewidth=0.8)
    axes.vlines(lag, 0.0, found.autocorrelation, color=palette.model.colour, linewidth=1.2)
    axes.plot(
        lag,
        found.autocorrelation,
        color=palette.model.colour,
        linestyle="none",
        marker=palette.model.marker,
        markersize=4.0,
        label="residuals",
    )
    style.legend(axes, palette)
    beyond = int(np.count_nonzero(np.abs(found.autocorrelation) > limit))
    text = (
        f"Autocorrelation of one-step residuals: {beyond} of {lags} lags outside, {0.05 * lags:.2g} expected by chance"
    )
    style.headline(figure, text, palette)
    return figure


def parameters(fit: Fit, *, theme: ThemeName = "light") -> Figure:
    """Draw each estimate with two standard deviations, over the typical size of its effect.

    Parameters
    ----------
    fit : from `accelcal.fit`.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If matplotlib is not installed.
    """
    palette = style.theme_of(theme)
    figure = style.new_figure(WIDTH, 1.5 + 0.42 * len(fit.estimates), palette)
    axes = figure.subplots()
    style.format_axes(axes, palette, x=label("estimate / typical size, ± 2 standard deviations", "1"), y="")
    for kind, chosen in (("estimated", palette.model), ("held fixed", palette.floor)):
        fixed = kind == "held fixed"
        rows = [i for i, e in enumerate(fit.estimates) if (e.name in fit.model.fixed) == fixed]
        if not rows:
            continue
        scale = np.array([find(fit.estimates[i].name).scale for i in rows])
        axes.errorbar(
            np.array([fit.estimates[i].value for i in rows]) / scale,
            rows,
            xerr=None if fixed else 2.0 * np.array([fit.estimates[i].std for i in rows]) / scale,
            color=chosen.colour,
            linestyle="none",
            marker=chosen.marker,
            markerfacecolor="none" if fixed else chosen.colour,
            markersize=5.0,
            capsize=4.0,
            label=kind,
        )
    axes.axvline(0.0, color=palette.ink, linewidth=0.8)
    if max(abs(x) for x in axes.get_xlim()) > LINEAR_REACH:
        axes.set_xscale("symlog", linthresh=1.0)
        axes.xaxis.set_major_formatter(lambda x, _: f"{x:g}".replace("-", "−"))
    axes.set_yticks(range(len(fit.estimates)), [_name(e) for e in fit.estimates])
    axes.set_ylim(len(fit.estimates) - 0.5, -0.5)
    values = axes.secondary_yaxis("right")
    values.set_yticks(range(len(fit.estimates)), [_value(e, fit) for e in fit.estimates])
    values.tick_params(length=0.0, colors=palette.ink, labelsize=style.SMALL)
    values.spines["right"].set_visible(False)
    style.legend(axes, palette)
    style.headline(figure, f"{len(fit.free)} estimated parameters, standard uncertainty in parentheses", palette)
    return figure


def overview(fit: Fit, comparison: Comparison, *, theme: ThemeName = "light") -> Figure:
    """Draw one page: simulation, unaided drift, one-step residuals, and the most significant regions.

    Parameters
    ----------
    fit : the model that was compared.
    comparison : from `accelcal.compare`.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If matplotlib is not installed.
    """
    palette = style.theme_of(theme)
    figure = style.new_figure(*A4_LANDSCAPE, palette)
    top_left, top_right, bottom_left, bottom_right = np.asarray(figure.subfigures(2, 2, wspace=0.03, hspace=0.03)).flat
    _simulated(top_left, comparison, palette, size=style.NORMAL)
    _coasting(top_right, comparison, palette, size=style.NORMAL)
    _one_step(bottom_left, comparison, palette, size=style.NORMAL)
    _regions(bottom_right, comparison, palette, columns=2, most=2, size=style.NORMAL)
    style.headline(figure, summary_sentence(fit, comparison), palette)
    return figure


def write(fit: Fit, comparison: Comparison, directory: str | Path, *, theme: ThemeName = "light") -> list[Path]:
    """Write every figure as PNG and SVG, all of them or none.

    Parameters
    ----------
    fit : the model that was compared.
    comparison : from `accelcal.compare`.
    directory : made if it does not exist. Dark figures end in "-dark", so both themes can share a folder.
    theme : "light" or "dark".

    Returns
    -------
    The files, the overview first.

    Raises
    ------
    MissingExtra
        If matplotlib is not installed; nothing is written then.
    """
    figures: Mapping[str, Callable[[], Figure]] = {
        "overview": lambda: overview(fit, comparison, theme=theme),
        "overlay": lambda: overlay(comparison, theme=theme),
        "simulated": lambda: simulated(comparison, theme=theme),
        "coasting": lambda: coasting(comparison, theme=theme),
        "one_step": lambda: one_step(comparison, theme=theme),
        "regions": lambda: regions(comparison, theme=theme),
        "accel_residual": lambda: accel_residual(comparison, theme=theme),
        "histogram": lambda: histogram(comparison, theme=theme),
        "autocorrelation": lambda: autocorrelation(comparison, theme=theme),
        "parameters": lambda: parameters(fit, theme=theme),
        "nonlinearity": lambda: nonlinearity(fit, theme=theme),
    }
    folder = Path(directory)
    ending = "-dark" if theme == "dark" else ""
    written: list[Path] = []
    with together():
        for name, draw in figures.items():
            figure = draw()
            folder.mkdir(parents=True, exist_ok=True)
            for kind in ("png", "svg"):
                path = folder / f"{name}{ending}.{kind}"
                style.save(figure, path)
                written.append(path)
    return written


def summary_sentence(fit: Fit, comparison: Comparison) -> str:
    """The key figures: one-step rms, unaided drift with its noise floor, largest residual."""
    drifted = drift_headline(comparison)
    drifted = f"{drifted[:1].lower()}{drifted[1:]}"
    added = ", ".join(e.symbol for e in fit.estimates)
    return (
        f"{comparison.recording or 'recording'}, model with {added}: one-step rms "
        f"{length(comparison.one_step_rms)}; {drifted}; {comparison.worst}"
    )


def _simulated(part: Figure | SubFigure, comparison: Comparison, palette: Theme, size: float = style.LARGE) -> None:
    t, measured, position = comparison.simulated
    top, bottom = part.subplots(2, 1, sharex=True, height_ratios=(3, 2))
    factor, unit = prefixed("m", measured, position)
    error = position - measured
    error_factor, error_unit = prefixed("m", error)

    style.format_axes(top, palette, x="", y=label("position", unit))
    drawn = style.trace(top, t, measured, palette.measured, factor=factor, name="measured")
    style.trace(top, t, position, palette.model, factor=factor, name="simulated")
    style.format_axes(bottom, palette, x=label("time", "s"), y=label("error", error_unit))
    bottom.axhline(0.0, color=palette.ink, linewidth=0.8)
    style.trace(bottom, t, error, palette.residual, factor=error_factor, name="simulated − measured")
    limits = top.get_ylim()  # the band grows larger than the motion and must not set the axis limits
    spread = 2.0 * comparison.simulated_std
    rows = _extremes(t, position - spread, position + spread)
    middle, reach = position[rows] * factor, spread[rows]
    _band(top, t[rows], middle - reach * factor, middle + reach * factor, "expected from noise, ± 2 σ", palette)
    top.set_ylim(limits)
    _band(bottom, t[rows], -reach * error_factor, reach * error_factor, "expected from noise, ± 2 σ", palette)
    style.legend(bottom, palette)
    style.legend(top, palette)
    style.note(bottom, drawn.note, palette)
    text = f"Simulated without position from {instant(t[0])} s on: rms error {length(comparison.simulated_rms)}"
    style.headline(part, text, palette, size)


def _extremes(t: Array, *several: Array) -> NDArray[np.intp]:
    """Rows that thinning keeps of any of several series at the same times."""
    kept = np.concatenate([style.thin(t, y).t for y in several])
    return np.searchsorted(t, np.unique(kept))


def _band(axes: Axes, t: Array, low: Array, high: Array, name: str, palette: Theme) -> None:
    """The region expected from noise, outlined as a second cue besides colour."""
    axes.fill_between(t, low, high, color=palette.band, alpha=0.25, linewidth=0.0, label=name, rasterized=True)
    for edge in (low, high):
        axes.plot(t, edge, color=palette.band, linestyle=(0, (6, 2)), linewidth=1.3, rasterized=True)


def _coasting(part: Figure | SubFigure, comparison: Comparison, palette: Theme, size: float = style.LARGE) -> None:
    axes = part.subplots()
    curves = (
        ("bias of this run re-estimated", comparison.coast_rms, palette.model),
        ("all parameters from the fit", comparison.coast_frozen_rms, palette.other),
        ("noise floor", comparison.drift_floors, palette.floor),
    )
    points = {name: allowed_horizons(found) for name, found, _ in curves}
    factor, unit = prefixed("m", *[y for _, y in points.values()])
    style.format_axes(axes, palette, x=label("time without position", "s"), y=label("rms unaided drift", unit))
    allowed = [h for h, found in comparison.coast_rms.items() if found is not None]
    if not allowed:
        least = min(comparison.coast_rms, default=1.0)
        style.message(axes, f"The record is too short for a drift over {least:g} s.", palette)
        style.headline(part, "Unaided drift", palette, size)
        return
    for name, _, chosen in curves:
        h, y = points[name]
        axes.plot(
            h,
            y * factor,
            color=chosen.colour,
            linestyle=chosen.line,
            marker=chosen.marker,
            markersize=7.5 if chosen is palette.floor else 5.0,
            markerfacecolor="none" if chosen is palette.floor else chosen.colour,
            linewidth=1.6,
            label=name,
        )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(min(allowed) / 1.4, max(allowed) * 1.4)
    low, high = axes.get_ylim()
    middle = math.sqrt(low * high)
    reach = max(1.3 * math.sqrt(high / low), math.sqrt(10.0))  # a flat curve must not appear steep
    axes.set_ylim(middle / reach, middle * reach)
    style.plain_decades(axes.yaxis, decades=2.0 * math.log10(reach))
    axes.set_xticks(allowed, [f"{h:g}\n{_starts(comparison, h)}" for h in allowed])
    axes.minorticks_off()
    style.legend(axes, palette, columns=3 if size == style.LARGE else 2)
    style.headline(part, drift_headline(comparison), palette, size)


def _starts(comparison: Comparison, horizon: float) -> str:
    count = comparison.coast_starts[horizon]
    return f"{count} start" + ("" if count == 1 else "s")


def _one_step(part: Figure | SubFigure, comparison: Comparison, palette: Theme, size: float = style.LARGE) -> None:
    axes = part.subplots()
    shown = one_step_residuals(comparison)
    t, e, reach, edge = shown.t, shown.e, shown.reach, shown.edge
    factor, unit = prefixed(shown.unit, edge)
    style.format_axes(axes, palette, x=label("time", "s"), y=label("one-step residual", unit))
    drawn = style.trace(axes, t, e, palette.residual, factor=factor, name="residual")
    at, usual = style.column_medians(t, reach)
    usual = np.minimum(usual, 1.1 * edge) * factor
    _band(axes, at, -usual, usual, "predicted 95 % band", palette)
    axes.set_ylim(-edge * factor, edge * factor)
    style.legend(axes, palette)
    beyond = int(np.count_nonzero(np.abs(e) > edge))
    off = f"{grouped(beyond)} reading{'s'[: beyond > 1]} beyond the axis" if beyond else ""
    style.note(axes, "; ".join(filter(None, (off, drawn.note))), palette)
    style.headline(part, shown.headline, palette, size)


def _regions(
    part: Figure | SubFigure,
    comparison: Comparison,
    palette: Theme,
    *,
    columns: int,
    most: int | None = None,
    size: float = style.LARGE,
) -> None:
    chosen = sorted(comparison.bins, key=_prominence, reverse=True)[:most]
    worst = comparison.worst[:1].upper() + comparison.worst[1:]
    if not chosen:
        axes = part.subplots()
        style.format_axes(axes, palette, x="", y="")
        style.message(axes, "The record is too short for residuals by region.", palette)
        style.headline(part, "Mean residual", palette, size)
        return
    factor, unit = prefixed("m/s²", *[_known(b) for b in comparison.bins if b.variable != "frequency"])
    rows = math.ceil(len(chosen) / columns)
    grid = part.subplots(rows, columns, squeeze=False).ravel()
    for axes, bins in zip(grid, chosen, strict=False):
        _region(axes, bins, factor, unit, palette)
    for axes in grid[len(chosen) :]:
        axes.set_visible(False)
    style.shared_legend(part, grid[0], palette)
    style.headline(part, worst, palette, size)


def _prominence(bins: Bins) -> float:
    """Significance of a variable: its largest deviation in standard deviations."""
    return float(np.abs(bins.score).max(initial=0.0))


def _known(bins: Bins) -> Array:
    """Means of the bins that have a standard deviation, the others NaN, (n,)."""
    return np.where(bins.std > 0.0, bins.mean, np.nan)


def _region(axes: Axes, bins: Bins, factor: float, unit: str, palette: Theme) -> None:
    """Mean residual against one variable; against frequency the ratio of densities."""
    from matplotlib.ticker import MaxNLocator

    ratio = bins.variable == "frequency"
    zero = 1.0 if ratio else 0.0
    factor = 1.0 if ratio else factor
    x_factor, x_unit = (1.0, bins.unit) if bins.variable == "time" else prefixed(bins.unit, bins.edges)
    y_title = label("density / predicted", "1") if ratio else label("mean residual", unit)
    title = f"{bins.variable}: up to {_prominence(bins):.1f} σ"
    style.format_axes(axes, palette, x=label(bins.variable, x_unit), y=y_title, title=title)
    centre, means = 0.5 * (bins.edges[1:] + bins.edges[:-1]), _known(bins)
    x = np.repeat(bins.edges, 2)[1:-1] * x_factor
    band = np.repeat(np.where(bins.std > 0.0, 2.0 * bins.std, np.nan), 2) * factor
    said = "expected from noise, ± 2 σ (1 bin in 20 lies outside by chance)"
    axes.fill_between(x, zero - band, zero + band, color=palette.band, alpha=0.3, linewidth=0.0, label=said)
    axes.axhline(zero, color=palette.ink, linewidth=0.8)
    axes.plot(
        centre * x_factor,
        means * factor,
        color=palette.residual.colour,
        linestyle=palette.residual.line,
        linewidth=1.0,
        marker=palette.residual.marker,
        markersize=3.5,
        label="residual",
    )
    mean = bins.mean[bins.std > 0.0]
    if ratio and len(mean) and mean.min() > 0.0 and mean.max() / mean.min() > 10.0:
        axes.set_yscale("log")
        style.plain_decades(axes.yaxis, decades=math.log10(mean.max() / mean.min()))
    else:
        axes.yaxis.set_major_locator(MaxNLocator(5))
    axes.xaxis.set_major_locator(MaxNLocator(4))


def _name(estimate: Estimate) -> str:
    run = "" if estimate.run is None else f", run {estimate.run + 1}"
    return f"{estimate.symbol}  {estimate.name.replace('_', ' ')}{run}"


def _value(estimate: Estimate, fit: Fit) -> str:
    """A value as metrologists write it, with its unit: 0.012 34(5) m/s² is 0.01234 ± 0.00005."""
    if estimate.name in fit.model.fixed:
        return f"{with_unit(f'{estimate.value:g}', estimate.unit)} (fixed)"
    return with_unit(concise(estimate.value, estimate.std), estimate.unit)


__dir__ = listing(globals())
