"""Detectable drift bandwidth: smallest sinusoidal change of bias and scale factor, against its frequency."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from accelcal.experiment import DriftBandwidth
from accelcal.plots import style
from accelcal.plots.interactive import drawing
from accelcal.plots.style import ThemeName
from accelcal.results import words as formatting

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

PERIODS = 10.0
"""Half periods over which the limit of a tumble test is drawn, its slowest change over the fastest."""


def drift_limits(found: DriftBandwidth, *, theme: ThemeName = "light") -> Figure:
    """Draw the smallest sinusoidal change that a record shows at 5 standard deviations, and that of a tumble test.

    Parameters
    ----------
    found : from `accelcal.power(...).drift`.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If plotly is not installed.
    """
    palette = style.theme_of(theme)
    tumble = found.tumble
    slow = np.array([tumble.frequency / PERIODS, tumble.frequency])
    panels = (
        ("bias", found.bias, tumble.bias, "m/s²"),
        ("scale factor", found.scale_factor, tumble.scale_factor, "1"),
    )
    figure = drawing.new_figure(1, 2, horizontal_spacing=0.14)
    for column, (name, smallest, limit, unit) in enumerate(panels, 1):
        shown = np.isfinite(smallest)
        drawing.curve(
            figure,
            found.frequency[shown],
            smallest[shown],
            palette.model,
            "this record",
            column=column,
            unit=unit,
            showlegend=column == 1,
        )
        drawing.curve(
            figure,
            slow,
            np.full(2, limit),
            palette.other,
            f"tumble test of {tumble.seconds / 60.0:.0f} min",
            column=column,
            unit=unit,
            showlegend=column == 1,
        )
        least, most = (float(f(np.append(smallest[shown], limit))) for f in (np.min, np.max))
        figure.update_xaxes(
            **drawing.logarithmic(float(slow[0]), 1.2 * float(found.frequency[-1])),
            title_text=drawing.axis_title("frequency of the change", "Hz"),
            row=1,
            col=column,
        )
        figure.update_yaxes(
            **drawing.logarithmic(0.6 * least, 1.6 * most),
            title_text=drawing.axis_title(f"amplitude of the {name}", unit),
            row=1,
            col=column,
        )
    best = int(np.argmin(found.scale_factor))
    least = float(found.scale_factor[best])
    headline = "This record shows no change of the scale factor"
    if np.isfinite(least):
        blind = np.flatnonzero(found.scale_factor > 2.0 * least)
        first = int(np.max(blind[blind < best], initial=-1)) + 1
        last = int(np.min(blind[blind > best], initial=len(found.frequency))) - 1
        low, high = (formatting.number(float(found.frequency[i]), 2) for i in (first, last))
        size = formatting.number(2.0 * least, 2)
        headline = f"Changes of the scale factor by {size} are shown at 5 sigma from {low} to {high} Hz"
    drawing.format_figure(
        figure,
        palette,
        headline,
        note="smallest amplitude that is shown, whatever its phase; the tumble has 24 dwells, the noise of this "
        "record and angles to 0.001 degrees",
    )
    return figure
