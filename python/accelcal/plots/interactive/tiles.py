"""Where the model fails: excess of the residual over noise, tile by tile, every variable in a row."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from accelcal import formatting
from accelcal.data.arrays import Array
from accelcal.plots import style
from accelcal.plots.interactive import drawing
from accelcal.plots.style import OKABE_ITO, ThemeName
from accelcal.validation.comparison import Comparison

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

LOUD = 8.0
"""Standard deviations at which the colour is full."""


@dataclass(frozen=True, slots=True)
class Tiles:
    """Scores of all bins."""

    rows: tuple[str, ...]
    """Variable with its range, most prominent first."""
    sigma: Array
    """(rows, bins) mean over its deviation under noise alone; NaN where a bin has too little data."""
    ranges: tuple[tuple[str, ...], ...]
    """What each tile covers, with unit."""


def tiles_of(comparison: Comparison) -> Tiles:
    """Scores of every variable, the one that stands out most first."""
    chosen = sorted(comparison.bins, key=lambda b: -float(np.abs(b.score).max(initial=0.0)))
    rows, sigma, ranges = [], [], []
    for b in chosen:
        factor, unit = (1.0, b.unit) if b.unit in ("s", "Hz") else formatting.prefixed(b.unit, b.edges)
        shown = formatting.label("", unit).strip(" ()")
        edges = b.edges * factor
        rows.append(f"{b.variable}, {edges[0]:.3g} to {edges[-1]:.3g} {shown}".replace(" -", " −"))
        sigma.append(np.where(b.std > 0.0, b.score, np.nan))
        ranges.append(tuple(f"{a:.3g} to {z:.3g} {shown}" for a, z in itertools.pairwise(edges)))
    width = max((len(s) for s in sigma), default=0)
    return Tiles(tuple(rows), np.array(sigma).reshape(len(rows), width), tuple(ranges))


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
    look = style.theme_of(theme)
    seen = tiles_of(comparison)
    figure = drawing.canvas()
    if not seen.rows:
        return drawing.message(figure, look, "Where it fails", "The record is too short to say where it fails.")
    count = seen.sigma.shape[1]
    texts = [["" if np.isnan(v) else signed(v) for v in row] for row in seen.sigma]
    figure.add_heatmap(
        z=np.clip(seen.sigma, -LOUD, LOUD)[::-1],
        x=list(range(1, count + 1)),
        y=[drawing.plain(r) for r in seen.rows][::-1],
        text=texts[::-1],
        texttemplate="%{text}",
        xgap=2,
        ygap=2,
        customdata=[[drawing.plain(c) for c in row] for row in seen.ranges][::-1],
        zmin=-LOUD,
        zmax=LOUD,
        hovertemplate="%{customdata}<br>%{text} σ<extra></extra>",
        hoverongaps=False,
        colorscale=[[0.0, OKABE_ITO["blue"]], [0.5, look.page], [1.0, OKABE_ITO["vermillion"]]],
        colorbar={"title": {"text": "σ", "side": "top"}, "thickness": 12, "outlinewidth": 0},
    )
    drawing.dress(
        figure,
        look,
        "Where it fails: mean residual in each bin over what noise alone would give",
        note="numbers in standard deviations; |σ| of 2 happens in one tile of twenty by chance; empty: too little data",
        height=drawing.BOTTOM + 34 * len(seen.rows),
        legend=False,
        left=drawing.labels(seen.rows),
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


def signed(value: float) -> str:
    """A score as it stands in a tile: whole standard deviations with their sign."""
    shown = f"{value:+.0f}".replace("-", "−")
    return "0" if shown in ("+0", "−0") else shown
