"""Figures of two calibrations of one sensor: the difference of their characteristics, and En of every parameter."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from accelcal.calibration.agreement import LIMIT, Agreement
from accelcal.effects import spelled
from accelcal.plots import style
from accelcal.plots.style import ThemeName
from accelcal.results.words import label, prefixed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDTH, HEIGHT = 8.0, 3.2
"""Inches."""
REACH = 10.0
"""|En| beyond this is drawn on a logarithmic axis."""


def agreement(found: Agreement, *, theme: ThemeName = "light") -> Figure:
    """Draw the difference of the characteristics with its expanded uncertainty, and En of every common parameter.

    Parameters
    ----------
    found : from `accelcal.calibration.agreement.agreement`.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If matplotlib is not installed.
    """
    palette = style.theme_of(theme)
    figure = style.new_figure(WIDTH, HEIGHT, palette)
    left, right = figure.subplots(1, 2, width_ratios=(1.4, 1.0))
    curve = found.characteristic
    if curve is None:
        style.message(left, "The ranges of acceleration do not overlap.", palette)
    else:
        factor, unit = prefixed("m/s²", curve.difference, curve.expanded)
        style.format_axes(left, palette, x=label("acceleration", "m/s²"), y=label("difference of output", unit))
        half = factor * curve.expanded
        left.fill_between(
            curve.a, -half, half, color=palette.band, alpha=0.3, linewidth=0.0, label="± expanded uncertainty, |En| ≤ 1"
        )
        left.plot(curve.a, factor * curve.difference, color=palette.model.colour, linewidth=1.6, label="second − first")
        style.legend(left, palette, columns=2)
    shown = [one for one in found.parameters if one.en is not None]
    en = np.array([one.en for one in shown], dtype=np.float64)
    style.format_axes(right, palette, x=label("En", "1"), y="")
    right.axvspan(-LIMIT, LIMIT, color=palette.band, alpha=0.3, linewidth=0.0)
    rows = np.arange(len(shown))
    right.plot(en, rows, color=palette.model.colour, linestyle="none", marker=palette.model.marker, markersize=5.0)
    right.set_yticks(rows, [spelled(one.name) for one in shown])
    right.set_ylim(len(shown) - 0.5, -0.5)
    reach = 1.15 * max(2.0, float(np.abs(en).max(initial=0.0)))
    if reach > REACH:
        right.set_xscale("symlog", linthresh=LIMIT)
    right.set_xlim(-reach, reach)
    return figure
