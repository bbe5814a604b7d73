"""A nonparametric curve as fitted, with its band."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from accelcal.estimation.shape_functions import Shape
from accelcal.plots import style
from accelcal.plots.interactive import drawing
from accelcal.plots.style import ThemeName
from accelcal.results import words as formatting

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


def fitted_curve(recovered: Sequence[Shape], *, theme: ThemeName = "light") -> Figure:
    """Draw the branches of one nonparametric curve with ± 2 standard deviations.

    Parameters
    ----------
    recovered : branches of one effect, from `accelcal.estimation.shape_functions.shapes`.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If plotly is not installed.
    """
    palette = style.theme_of(theme)
    figure = drawing.new_figure()
    if not recovered:
        return drawing.message(figure, palette, "Nonparametric curve", "The model contains no nonparametric curve.")
    first = recovered[0]
    factor, unit = formatting.prefixed(first.unit, *[branch.value for branch in recovered])
    x_factor, x_unit = (1.0, first.variable_unit)
    if first.variable_unit != "s":
        x_factor, x_unit = formatting.prefixed(first.variable_unit, first.x)
    for branch, chosen in zip(recovered, (palette.model, palette.other), strict=False):
        x, y, reach = branch.x * x_factor, branch.value * factor, 2.0 * branch.std * factor
        name = branch.label or "estimate"
        drawing.band(figure, x, y - reach, y + reach, f"{name}, ± 2 σ", chosen.colour)
        drawing.curve(figure, x, y, chosen, name, unit=unit)
    drawing.format_figure(
        figure,
        palette,
        f"Nonparametric curve of {first.variable}",
        note="a constant offset is confounded with bias",
        height=340,
    )
    figure.update_xaxes(title_text=drawing.axis_title(first.variable, x_unit))
    figure.update_yaxes(title_text=drawing.axis_title("contribution", unit))
    return figure
