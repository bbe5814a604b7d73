"""Where the model fails: excess of the residual over noise, tile by tile, every variable in a row."""

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
    """Draw one tile for each bin of each variable, in standard deviations of what noise alone would give.

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
        return drawing.message(figure, palette, "Where it fails", "The record is too short to say where it fails.")
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
        colorbar={"title": {"text": "σ", "side": "top"}, "thickness": 12, "outlinewidth": 0},
    )
    drawing.format_figure(
        figure,
        palette,
        "Where it fails: mean residual in each bin over what noise alone would give",
        note="numbers in standard deviations; |σ| of 2 happens in one tile of twenty by chance; empty: too little data",
        height=drawing.BOTTOM + 34 * len(seen.rows),
        legend=False,
        left=drawing.label_margin(seen.rows),
    )
    figure.update_xaxes(
        title_text=drawing.axis_title("bin, from the least to the largest value", "1"),
        dtick=1,
        showgrid=False,
        showline=False,
        ticks="",
    )
    figure.update_yaxes(showgrid=False, showline=False, ticks="")
    return figure
