"""Normal Q-Q plot of the one-step residuals."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from accelcal.plots import style
from accelcal.plots.interactive import drawing
from accelcal.plots.numbers import imposed_band_note, normal_quantiles
from accelcal.plots.style import ThemeName
from accelcal.validation.comparison import Comparison

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


def quantile_plot(comparison: Comparison, *, theme: ThemeName = "light") -> Figure:
    """Draw the quantiles of normalised one-step residuals against those of the normal distribution.

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
    y = comparison.normalised[1]
    expected, seen = normal_quantiles(y)
    figure = drawing.new_figure()
    figure.add_scatter(
        x=expected.astype(np.float32),
        y=seen.astype(np.float32),
        mode="markers",
        name="residuals",
        marker={"color": palette.model.colour, "symbol": "square-open", "size": 4},
        hovertemplate="%{x:.2f} expected, %{y:.2f} observed<extra></extra>",
    )
    reach = float(np.abs(expected).max())
    drawing.curve(figure, np.array([-reach, reach]), np.array([-reach, reach]), palette.other, "standard normal")
    nis = "" if comparison.nis is None else f", mean normalised square {comparison.nis:.3f} (1 expected)"
    drawing.format_figure(
        figure,
        palette,
        f"Q-Q plot of one-step residuals over their predicted deviation: standard deviation {np.std(y):.3f}{nis}"
        f"{imposed_band_note(comparison)}",
        note=style.Thinned(expected, seen, len(seen), len(y)).note,
        height=340,
    )
    figure.update_xaxes(title_text=drawing.axis_title("normal quantile", "1"))
    figure.update_yaxes(title_text=drawing.axis_title("quantile of residuals", "1"))
    return figure
