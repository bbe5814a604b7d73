"""Measured and simulated output and position over each other, the residual under them, for one or several models."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from accelcal.data.arrays import Array
from accelcal.plots import style
from accelcal.plots.interactive import drawing
from accelcal.plots.interactive.linked import CHOSEN, inside, mark
from accelcal.plots.numbers import fit_text, named_models, overlay_headline
from accelcal.plots.style import ThemeName
from accelcal.results import words as formatting
from accelcal.validation.comparison import Comparison
from accelcal.validation.worst import worst_stretches

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

PANEL = 190
"""Height of a panel, pixels."""
OUTPUT, RESIDUAL, POSITION = 1, 2, 3
"""Rows."""


def overlay(
    models: Comparison | Sequence[tuple[str, Comparison]],
    *,
    window: tuple[float, float] | None = None,
    chosen: tuple[float, float] | None = None,
    theme: ThemeName = "light",
) -> Figure:
    """Draw what was measured, what each model says, and the difference, over one time axis.

    Parameters
    ----------
    models : from `accelcal.compare`; or name and comparison of several models with one recording, the current one last.
        A click on a name in the legend switches it on and off.
    window : s, optional; only this part is drawn, thinned for it.
    chosen : a stretch of time that is marked in all panels, s.
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
    drawn: list[style.Thinned] = []

    def draw(row: int, t: Array, y: Array, line: style.LineStyle, name: str, **more: Any) -> None:
        """One trace in its unit; the first of a name is in the legend."""
        factor, shown = {OUTPUT: (1.0, "m/s²"), RESIDUAL: (ruler, residual_unit), POSITION: (scale, unit)}[row]
        t, y = inside(t, y, window)
        more |= {"unit": shown, "row": row, "showlegend": row == OUTPUT}
        drawn.append(drawing.trace(figure, t, y, line, name, factor=factor, **more))

    draw(OUTPUT, current.accel_residual[0], current.measured, palette.measured, "measured", legendgroup="measured")
    draw(POSITION, t, position, palette.measured, "measured", legendgroup="measured")
    for number, (name, seen) in enumerate(several):
        line = style.line_of_model(palette, number, len(several))
        faint = 1.0 if seen is current else 0.5 + 0.4 * number / len(several)
        at, residual = seen.accel_residual
        said = f"{name or 'model'}, {fit_text(seen)}"
        common: dict[str, Any] = {"legendgroup": f"{number} {name}", "opacity": faint}
        draw(OUTPUT, at, seen.measured - residual, line, said, **common)
        draw(RESIDUAL, at, residual, line, said, **common)
        draw(POSITION, seen.simulated[0], seen.simulated[2], line, said, **common)
    drawing.format_figure(
        figure,
        palette,
        overlay_headline(several),
        note="; ".join(filter(None, ("position: simulated from the output alone", drawing.thinning_note(*drawn)))),
        height=drawing.BOTTOM + 3 * PANEL,
        left=92,
    )
    for number, stretch in enumerate(worst_stretches(*current.accel_residual)):
        if stretch != chosen:
            mark(figure, *stretch, "" if number else "largest residual", palette)  # names would cover each other
    if chosen is not None:
        mark(figure, *chosen, CHOSEN, palette)
    ends = [at for axis in (t, current.accel_residual[0]) for at in (axis[:1].tolist() + axis[-1:].tolist())]
    low, high = window or (min(ends, default=0.0), max(ends, default=1.0))
    figure.update_xaxes(range=[low, high])
    titles = {OUTPUT: ("output", "m/s²"), RESIDUAL: ("residual", residual_unit), POSITION: ("position", unit)}
    for row, (quantity, shown) in titles.items():
        figure.update_yaxes(title_text=drawing.axis_title(quantity, shown), row=row, col=1)
    figure.update_xaxes(title_text=drawing.axis_title("time", "s"), row=POSITION, col=1)
    return figure
