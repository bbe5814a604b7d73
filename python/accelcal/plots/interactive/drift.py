"""Unaided drift against the time without position, with its noise floor."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from accelcal.plots import style
from accelcal.plots.interactive import drawing
from accelcal.plots.numbers import allowed_horizons, drift_headline
from accelcal.plots.style import ThemeName
from accelcal.results import words as formatting
from accelcal.validation.comparison import Comparison

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


def coasting(comparison: Comparison, *, theme: ThemeName = "light") -> Figure:
    """Draw rms unaided drift against the time since position was withheld.

    Parameters
    ----------
    comparison : from `accelcal.compare`; horizons that the record does not allow are absent.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If plotly is not installed.
    """
    palette = style.theme_of(theme)
    figure = drawing.new_figure()
    curves = (
        ("bias of this run re-estimated", comparison.coast_rms, palette.model),
        ("all parameters from the fit", comparison.coast_frozen_rms, palette.other),
        ("noise floor", comparison.drift_floors, palette.floor),
    )
    points = [(name, *allowed_horizons(found), chosen) for name, found, chosen in curves]
    allowed = points[0][1]
    if len(allowed) == 0:
        least = min(comparison.coast_rms, default=1.0)
        return drawing.message(
            figure, palette, "Unaided drift", f"The record is too short for a drift over {least:g} s."
        )
    factor, unit = formatting.prefixed("m", *[y for _, _, y, _ in points])
    for name, h, y, chosen in points:
        drawing.curve(figure, h, y * factor, chosen, name, markers=True, unit=unit)
    counts = ", ".join(f"{h:g} s: {comparison.coast_starts[h]}" for h in allowed.tolist())
    drawing.format_figure(
        figure,
        palette,
        drift_headline(comparison),
        note=f"number of start points: {counts}",
    )
    ticks = allowed.tolist()
    time = drawing.logarithmic(ticks[0] / 1.4, ticks[-1] * 1.4)
    time |= {"tickvals": ticks, "ticktext": [f"{h:g}" for h in ticks]}
    figure.update_xaxes(**time, title_text=drawing.axis_title("time without position", "s"))
    found = np.concatenate([y for _, _, y, _ in points]) * factor
    middle, reach = (
        math.sqrt(found.min() * found.max()),
        max(1.5 * math.sqrt(found.max() / found.min()), math.sqrt(10.0)),
    )
    rms = drawing.logarithmic(middle / reach, middle * reach)  # a flat curve must not appear steep
    figure.update_yaxes(**rms, title_text=drawing.axis_title("rms unaided drift", unit))
    return figure
