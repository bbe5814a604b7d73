"""Measured and simulated output and position over each other, the residual under them, for one or several models."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from accelcal import formatting
from accelcal.plots import style
from accelcal.plots.interactive import drawing
from accelcal.plots.interactive.linked import mark
from accelcal.plots.numbers import fit_text, named_models, overlay_headline
from accelcal.plots.style import ThemeName
from accelcal.validation.comparison import Comparison
from accelcal.validation.worst import worst_stretches

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

PANEL = 190
"""Height of a panel, pixels."""
OUTPUT, RESIDUAL, POSITION = 1, 2, 3
"""Rows."""


def overlay(models: Comparison | Sequence[tuple[str, Comparison]], *, theme: ThemeName = "light") -> Figure:
    """Draw what was measured, what each model says, and the difference, over one time axis.

    Parameters
    ----------
    models : from `accelcal.compare`; or name and comparison of several models with one recording, the current one last.
        A click on a name in the legend switches it on and off.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If plotly or tsdownsample is not installed.
    ValueError
        If there is no model.
    """
    several = named_models(models)
    palette = style.theme_of(theme)
    current = several[-1][1]
    figure = drawing.new_figure(3, 1, shared_xaxes=True, vertical_spacing=0.09)
    t, position, _ = current.simulated
    scale, unit = formatting.prefixed("m", position)
    ruler, residual_unit = formatting.prefixed("m/s²", *(seen.accel_residual[1] for _, seen in several))
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
    for number, (name, seen) in enumerate(several):
        line = style.line_of_model(palette, number, len(several))
        faint = 1.0 if seen is current else 0.5 + 0.4 * number / len(several)
        at, residual = seen.accel_residual
        said = f"{name}, {fit_text(seen)}" if name else fit_text(seen)
        common: dict[str, Any] = {"legendgroup": f"{number} {name}", "opacity": faint}
        drawn.append(drawing.trace(figure, at, seen.measured - residual, line, said, unit="m/s²", row=OUTPUT, **common))
        common["showlegend"] = False
        drawing.trace(figure, at, residual, line, said, factor=ruler, unit=residual_unit, row=RESIDUAL, **common)
        moved, _, simulated = seen.simulated
        drawing.trace(figure, moved, simulated, line, said, factor=scale, unit=unit, row=POSITION, **common)
    drawing.format_figure(
        figure,
        palette,
        overlay_headline(several),
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
