"""Figure of a frequency response: magnitude and phase with expanded uncertainties, each above its deviation."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from accelcal.plots import style
from accelcal.plots.response import ResponseCurves, ResponsePanel, response_curves
from accelcal.plots.style import Theme, ThemeName
from accelcal.response import FrequencyResponse
from accelcal.results.words import label

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH, TALL, THIN = 7.0, 2.1, 1.05
"""Width of the figure, heights of a panel and of a deviation, inches."""


def sensitivity(found: FrequencyResponse, *, theme: ThemeName = "light") -> Figure:
    """Draw magnitude and phase against frequency, and where the parametric fit deviates.

    Parameters
    ----------
    found : from `accelcal.response.frequency_response`.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If matplotlib is not installed.
    """
    palette = style.theme_of(theme)
    curves = response_curves(found)
    heights = [THIN if panel.is_deviation else TALL for panel in curves.panels]
    figure = style.new_figure(WIDTH, sum(heights) + 0.6, palette)
    several = figure.subplots(len(heights), 1, sharex=True, gridspec_kw={"height_ratios": heights})
    for axes, panel in zip(several, curves.panels, strict=True):
        last = axes is several[-1]
        style.format_axes(
            axes, palette, x=label("frequency", "Hz") if last else "", y=label(panel.quantity, panel.unit)
        )
        _draw(axes, curves, panel, palette)
    low, high = curves.ends()
    several[0].set_xscale("log")
    several[0].set_xlim(low, high)
    style.plain_decades(several[0].xaxis, math.log10(high / low))
    figure.align_ylabels(several)
    style.legend(several[0], palette, columns=3)
    return figure


def _draw(axes: Axes, curves: ResponseCurves, panel: ResponsePanel, palette: Theme) -> None:
    """Measured values with their bars, those at which the fit fails in another colour and shape, and the fit."""
    kinds = (
        (~curves.failing, palette.model, "measured, U (k = 2)"),
        (curves.failing, palette.other, "measured, the fit fails"),
    )
    for chosen, line, name in kinds:
        if chosen.any():
            axes.errorbar(
                curves.frequency[chosen], panel.measured[chosen], panel.expanded[chosen], color=line.colour,
                linestyle="none", marker=line.marker, markersize=4.0, capsize=2.0, label=name,
            )  # fmt: skip
    if panel.fitted is not None:
        axes.plot(curves.grid, panel.fitted, color=palette.band, linewidth=1.4, label=curves.structure)
    axes.set_ylim(*panel.reach())
