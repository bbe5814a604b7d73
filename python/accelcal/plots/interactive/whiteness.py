"""Whiteness of one-step residuals: autocorrelation and cumulative periodogram."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from accelcal.data.arrays import Array
from accelcal.plots import style
from accelcal.plots.interactive import drawing
from accelcal.plots.numbers import LAGS, TWO_SIDED_95
from accelcal.plots.style import Theme, ThemeName, Thinned
from accelcal.validation.comparison import Comparison
from accelcal.validation.consistency import CumulativePeriodogram, cumulative_periodogram, whiteness

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


def whiteness_plot(comparison: Comparison, *, theme: ThemeName = "light") -> Figure:
    """Draw the autocorrelation and the cumulative periodogram of normalised one-step residuals with 95 % regions.

    Parameters
    ----------
    comparison : from `accelcal.compare`.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If plotly is not installed.
    """
    palette = style.theme_of(theme)
    y = comparison.normalised[1]
    lags = min(LAGS, len(y) // 4)
    if lags < 4 or not np.any(y):
        return drawing.message(
            drawing.new_figure(), palette, "Whiteness", "The record has too few readings for a test."
        )
    found, power = whiteness(y, lags), cumulative_periodogram(y)
    limit = TWO_SIDED_95 / float(np.sqrt(found.samples))
    titles = ["autocorrelation", "cumulative periodogram: deviation from that of white residuals"]
    figure = drawing.new_figure(1, 2, subplot_titles=titles, horizontal_spacing=0.1)
    _autocorrelation(figure, found.autocorrelation, limit, palette)
    drawn = _periodogram(figure, power, palette)
    beyond = int(np.count_nonzero(np.abs(found.autocorrelation) > limit))
    drawing.format_figure(
        figure,
        palette,
        f"Whiteness: {beyond} of {lags} lags outside, {0.05 * lags:.2g} by chance; cumulative periodogram "
        f"{power.distance / power.limit:.2g} times its 95 % limit",
        note=drawn.note,
        height=320,
        titled=True,
    )
    figure.update_xaxes(title_text=drawing.axis_title("lag", "readings"), row=1, col=1)
    figure.update_yaxes(title_text=drawing.axis_title("autocorrelation", "1"), row=1, col=1)
    figure.update_xaxes(title_text=drawing.axis_title("frequency", "cycles per reading"), range=[0, 0.5], row=1, col=2)
    figure.update_yaxes(title_text=drawing.axis_title("deviation from a straight line", "1"), row=1, col=2)
    return figure


def _autocorrelation(figure: Figure, rho: Array, limit: float, palette: Theme) -> None:
    """Autocorrelation at each lag, (lags,), with the limits of white residuals."""
    lags = len(rho)
    lag = np.arange(1, lags + 1).astype(float)
    ends = np.array([0.5, lags + 0.5])
    drawing.band(
        figure, ends, np.full(2, -limit), np.full(2, limit), "95 % of white residuals", palette.band, group="band"
    )
    figure.add_scatter(
        x=np.repeat(lag, 3),
        y=np.column_stack([np.zeros(lags), rho, np.full(lags, np.nan)]).ravel(),
        mode="lines",
        line={"color": palette.model.colour, "width": 1.4},
        showlegend=False,
        hoverinfo="skip",
        row=1,
        col=1,
    )
    figure.add_scatter(
        x=lag,
        y=rho,
        mode="markers",
        name="residuals",
        legendgroup="residuals",
        marker={"color": palette.model.colour, "symbol": "square", "size": 6},
        row=1,
        col=1,
        hovertemplate="lag %{x}: %{y:.3f}<extra></extra>",
    )


def _periodogram(figure: Figure, power: CumulativePeriodogram, palette: Theme) -> Thinned:
    """Cumulative periodogram less that of white residuals; returns what is drawn."""
    ends = np.array([0.0, 0.5])
    drawing.band(
        figure,
        ends,
        np.full(2, -power.limit),
        np.full(2, power.limit),
        "95 % of white residuals",
        palette.band,
        row=1,
        column=2,
        legend=False,
        group="band",
    )
    drawn = drawing.thin(power.frequency, power.share - 2.0 * power.frequency, 1000)
    drawing.curve(
        figure, drawn.t, drawn.y, palette.residual, "residuals", column=2, showlegend=False, legendgroup="residuals"
    )
    return drawn
