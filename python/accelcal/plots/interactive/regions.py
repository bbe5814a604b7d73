"""Mean residual against every variable, in bins with bands; the variable that explains most comes first."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from accelcal.data.arrays import Array
from accelcal.plots import style
from accelcal.plots.interactive import drawing
from accelcal.plots.style import Theme, ThemeName
from accelcal.results import words as formatting
from accelcal.validation.comparison import Bins, Comparison

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

COLUMNS = 3
PANEL, GAP = 230, 82
"""Height of a row of panels, and of the space between two, pixels."""


def ordered(comparison: Comparison) -> list[tuple[Bins, float]]:
    """Bins of every variable of the motion with the share of the mean square that they explain, most first."""
    rms = comparison.accel_rms
    found = [(b, b.explained(rms)) for b in comparison.bins if b.variable != "frequency"]
    return sorted(found, key=lambda pair: -pair[1])


def regions(comparison: Comparison, *, theme: ThemeName = "light") -> Figure:
    """Draw the mean residual against a, v, p, jerk, time, time since reversal and every side channel.

    Parameters
    ----------
    comparison : from `accelcal.compare`; bins with too little data to have a band are absent.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If plotly is not installed.
    """
    palette = style.theme_of(theme)
    chosen = ordered(comparison)
    if not chosen:
        return drawing.message(
            drawing.new_figure(), palette, "Mean residual", "The record is too short for residuals by region."
        )
    rows = math.ceil(len(chosen) / COLUMNS)
    titles = [drawing.escaped(f"{b.variable}: explains {100.0 * share:.2g} %") for b, share in chosen]
    figure = drawing.new_figure(
        rows, COLUMNS, subplot_titles=titles, vertical_spacing=min(0.5, GAP / (PANEL * rows)), horizontal_spacing=0.075
    )
    means = [np.where(b.std > 0.0, b.mean, np.nan) for b, _ in chosen]
    factor, unit = formatting.prefixed("m/s²", *means)
    for i, ((bins, _), mean) in enumerate(zip(chosen, means, strict=True)):
        _panel(figure, i, bins, mean * factor, factor, unit, palette)
    drawing.format_figure(
        figure,
        palette,
        comparison.worst[:1].upper() + comparison.worst[1:],
        height=drawing.BOTTOM + PANEL * rows,
        titled=True,
    )
    for i, (bins, _) in enumerate(chosen):
        at = {"row": i // COLUMNS + 1, "col": i % COLUMNS + 1}
        figure.update_xaxes(title_text=drawing.axis_title(bins.variable, _scale(bins)[1]), nticks=5, **at)
        title = drawing.axis_title("mean residual", unit) if i % COLUMNS == 0 else None
        figure.update_yaxes(title_text=title, nticks=6, **at)
    return figure


def _scale(bins: Bins) -> tuple[float, str]:
    """Factor and unit of a variable's axis."""
    return (1.0, bins.unit) if bins.unit == "s" else formatting.prefixed(bins.unit, bins.edges)


def _panel(figure: Figure, i: int, bins: Bins, mean: Array, factor: float, unit: str, palette: Theme) -> None:
    """Mean residual against one variable; `mean` (n,) is in `unit` already, by `factor`."""
    place: dict[str, Any] = {"row": i // COLUMNS + 1, "column": i % COLUMNS + 1}
    x_factor, _ = _scale(bins)
    centre = 0.5 * (bins.edges[1:] + bins.edges[:-1]) * x_factor
    x = np.repeat(bins.edges, 2)[1:-1] * x_factor
    reach = np.repeat(np.where(bins.std > 0.0, 2.0 * bins.std, np.nan), 2) * factor
    known = np.isfinite(reach)
    drawing.band(
        figure,
        x[known],
        -reach[known],
        reach[known],
        "expected from noise, ± 2 σ",
        palette.band,
        legend=i == 0,
        group="band",
        **place,
    )
    drawing.curve(
        figure,
        centre,
        mean,
        palette.residual,
        "mean residual",
        markers=True,
        width=1.2,
        unit=unit,
        showlegend=i == 0,
        legendgroup="mean",
        **place,
    )
