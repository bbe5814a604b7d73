"""Measured and simulated output and position over each other, the residual under them, for one or several models."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from accelcal import formatting
from accelcal.data.arrays import Array
from accelcal.plots import style
from accelcal.plots.interactive import drawing
from accelcal.plots.interactive.linked import mark
from accelcal.plots.style import LineStyle, Theme, ThemeName
from accelcal.validation.comparison import Comparison

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

PANEL = 190
"""Height of a panel, pixels."""
STRETCHES, WORST = 40, 3
"""Stretches of the record that are compared with each other, and those of the largest residual that are marked."""
STANDS_OUT = 2.0
"""A stretch is marked whose residual is this many times the median of all stretches."""
OUTPUT, RESIDUAL, POSITION = 1, 2, 3
"""Rows."""


def overlay(models: Sequence[tuple[str, Comparison]], *, theme: ThemeName = "light") -> Figure:
    """Draw what was measured, what each model says, and the difference, over one time axis.

    Parameters
    ----------
    models : name and comparison of each model, with one recording, in order; the last one is the current model. A click
        on a name in the legend switches it on and off.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If plotly or tsdownsample is not installed.
    ValueError
        If there is no model.
    """
    if not models:
        raise ValueError("an overlay needs at least one comparison")
    palette = style.theme_of(theme)
    last, current = models[-1]
    figure = drawing.new_figure(3, 1, shared_xaxes=True, vertical_spacing=0.09)
    t, position, _ = current.simulated
    scale, unit = formatting.prefixed("m", position)
    ruler, residual_unit = formatting.prefixed("m/s²", *(seen.accel_residual[1] for _, seen in models))
    drawn = [
        drawing.trace(
            figure,
            current.accel_residual[0],
            current.measured,
            palette.measured,
            "measured",
            unit="m/s²",
            row=OUTPUT,
            legendgroup="measured",
        ),
        drawing.trace(
            figure,
            t,
            position,
            palette.measured,
            "measured",
            factor=scale,
            unit=unit,
            row=POSITION,
            legendgroup="measured",
            showlegend=False,
        ),
    ]
    for number, (name, seen) in enumerate(models):
        line, faint = _line(palette, number, len(models))
        at, residual = seen.accel_residual
        said = f"{name}, {_fit(seen)}"
        common: dict[str, Any] = {"legendgroup": f"{number} {name}", "opacity": faint}
        drawn.append(drawing.trace(figure, at, seen.measured - residual, line, said, unit="m/s²", row=OUTPUT, **common))
        common["showlegend"] = False
        drawing.trace(figure, at, residual, line, said, factor=ruler, unit=residual_unit, row=RESIDUAL, **common)
        moved, _, simulated = seen.simulated
        drawing.trace(figure, moved, simulated, line, said, factor=scale, unit=unit, row=POSITION, **common)
    drawing.format_figure(
        figure,
        palette,
        f"Measured and simulated output ({last}): {_fit(current)} below {current.band:.3g} Hz",
        note="; ".join(filter(None, ("position: simulated from the output alone", drawing.thinning_note(*drawn)))),
        height=drawing.BOTTOM + 3 * PANEL,
        left=92,
    )
    for number, (begin, end) in enumerate(worst_stretches(*current.accel_residual)):
        mark(figure, begin, end, "" if number else "largest residual", palette)  # names would cover each other
    titles = {OUTPUT: ("output", "m/s²"), RESIDUAL: ("residual", residual_unit), POSITION: ("position", unit)}
    for row, (quantity, shown) in titles.items():
        figure.update_yaxes(title_text=drawing.axis_title(quantity, shown), row=row, col=1)
    figure.update_xaxes(title_text=drawing.axis_title("time", "s"), row=POSITION, col=1)
    return figure


def _line(palette: Theme, number: int, count: int) -> tuple[LineStyle, float]:
    """Line and opacity of a model: the current one in full colour, older ones paler."""
    return (palette.model, 1.0) if number == count - 1 else (palette.other, 0.5 + 0.4 * number / count)


def _fit(seen: Comparison) -> str:
    return (
        "too short for a fit in percent" if seen.fit_percent is None else f"fit {formatting.percent(seen.fit_percent)}"
    )


def worst_stretches(t: Array, residual: Array) -> list[tuple[float, float]]:
    """Stretches of time in which a residual (n,) stands out, largest first, s."""
    if len(t) < STRETCHES:
        return []
    parts = np.array_split(np.arange(len(t)), STRETCHES)
    power = np.array([np.mean(residual[rows] ** 2) for rows in parts])
    ranked = np.argsort(power)[::-1][:WORST]
    limit = STANDS_OUT**2 * float(np.median(power))
    return [(float(t[parts[i][0]]), float(t[parts[i][-1]])) for i in ranked if power[i] > limit]
