"""Output of the sensor against acceleration, and its deviation from a straight line (paper, Fig. 3)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from accelcal.calibration.straight_line import straight_line
from accelcal.estimation.estimate import Fit
from accelcal.plots import style
from accelcal.plots.numbers import TWO_SIDED_95
from accelcal.plots.style import ThemeName
from accelcal.results.words import label, prefixed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

__all__ = ["nonlinearity"]

SIZE = (8.0, 6.0)
"""Inches."""


def nonlinearity(fit: Fit, *, theme: ThemeName = "light") -> Figure:
    """Draw the output against acceleration over the trained range, and its deviation from the best straight line.

    Bands hold 95 % at each acceleration, by the covariance of the fit. That of the deviation has no share of bias and
    scale factor.

    Parameters
    ----------
    fit : from `accelcal.fit`, any model.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If matplotlib is not installed.
    ValueError
        If the fit has seen one acceleration only.
    """
    palette = style.theme_of(theme)
    line = straight_line(fit)
    figure = style.new_figure(*SIZE, palette)
    top, bottom = figure.subplots(2, 1, sharex=True)
    style.format_axes(top, palette, x="", y=label("output", "m/s²"))
    reach = TWO_SIDED_95 * line.output_std
    top.fill_between(line.a, line.output - reach, line.output + reach, color=palette.band, alpha=0.4, linewidth=0.0)
    fitted = line.offset + line.slope * line.a
    for y, kind, name in ((line.output, palette.model, "output"), (fitted, palette.other, "best straight line")):
        top.plot(line.a, y, color=kind.colour, linestyle=kind.line, linewidth=1.3, label=name)
    style.legend(top, palette)

    reach = TWO_SIDED_95 * line.deviation_std
    factor, unit = prefixed("m/s²", np.abs(line.deviation) + reach)
    style.format_axes(
        bottom, palette, x=label("acceleration along the input axis", "m/s²"), y=label("deviation from the line", unit)
    )
    bottom.fill_between(
        line.a,
        (line.deviation - reach) * factor,
        (line.deviation + reach) * factor,
        color=palette.band,
        alpha=0.4,
        linewidth=0.0,
        label="95 % band",
    )
    bottom.plot(
        line.a,
        line.deviation * factor,
        color=palette.residual.colour,
        linestyle=palette.residual.line,
        linewidth=1.3,
        label="deviation",
    )
    bottom.axhline(0.0, color=palette.ink, linewidth=0.8)
    style.legend(bottom, palette)
    style.headline(figure, _sentence(fit), palette)
    return figure


def _sentence(fit: Fit) -> str:
    line = straight_line(fit)
    at, span = line.largest, f"{line.a[0]:.3g} to {line.a[-1]:.3g} m/s²"
    if not np.any(line.deviation_std):
        return f"Output over {span}: the model is a straight line, slope {line.slope:.5f}"
    factor, unit = prefixed("m/s²", abs(float(line.deviation[at])), float(line.deviation_std[at]))
    return (
        f"Output over {span}: largest deviation from the best straight line {factor * line.deviation[at]:+.3g} ± "
        f"{factor * TWO_SIDED_95 * line.deviation_std[at]:.2g} {unit} at {line.a[at]:+.3g} m/s², "
        f"{100.0 * abs(line.deviation[at]) / line.span:.2g} % of the span"
    )
