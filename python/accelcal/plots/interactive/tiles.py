"""Residuals by region: one tile for each bin, one row for each variable, in standard deviations."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from accelcal.plots import style
from accelcal.plots.interactive import drawing
from accelcal.plots.numbers import FULL_COLOUR, signed, tiles_of
from accelcal.plots.style import OKABE_ITO, ThemeName
from accelcal.validation.comparison import Comparison

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


def tiles(comparison: Comparison, *, theme: ThemeName = "light") -> Figure:
    """Draw one tile for each bin of each variable, in standard deviations expected from noise.

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
    seen = tiles_of(comparison)
    figure = drawing.new_figure()
    if not seen.rows:
        return drawing.message(
            figure, palette, "Residuals by region", "The record is too short for residuals by region."
        )
    count = seen.sigma.shape[1]
    texts = [["" if np.isnan(v) else signed(v) for v in row] for row in seen.sigma]
    figure.add_heatmap(
        z=np.clip(seen.sigma, -FULL_COLOUR, FULL_COLOUR)[::-1],
        x=list(range(1, count + 1)),
        y=[drawing.escaped(r) for r in seen.rows][::-1],
        text=texts[::-1],
        texttemplate="%{text}",
        xgap=2,
        ygap=2,
        customdata=[[drawing.escaped(c) for c in row] for row in seen.ranges][::-1],
        zmin=-FULL_COLOUR,
        zmax=FULL_COLOUR,
        hovertemplate="%{customdata}<br>%{text} σ<extra></extra>",
        hoverongaps=False,
        colorscale=[[0.0, OKABE_ITO["blue"]], [0.5, palette.page], [1.0, OKABE_ITO["vermillion"]]],
        showscale=False,  # each tile has its number
    )
    drawing.format_figure(
        figure,
        palette,
        "Residuals by region: mean of each bin in standard deviations expected from noise",
        note="beyond ±2 σ in one tile of twenty by chance; empty: too few data",
        height=drawing.BOTTOM + 34 * len(seen.rows),
        legend=False,
        left=drawing.label_margin(seen.rows),
    )
    figure.update_xaxes(
        title_text=drawing.axis_title("bin, from the smallest to the largest value", "1"),
        dtick=1,
        showgrid=False,
        showline=False,
        ticks="",
    )
    figure.update_yaxes(showgrid=False, showline=False, ticks="")
    return figure
