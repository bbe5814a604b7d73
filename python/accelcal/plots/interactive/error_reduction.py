"""Error reduction: one bar for each model on unseen data, the noise floor, and the share that each effect explains."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from accelcal.plots import style
from accelcal.plots.interactive import drawing
from accelcal.plots.numbers import error_reduction_sentence, model_names, share_text
from accelcal.plots.style import ThemeName
from accelcal.results import words as formatting
from accelcal.selection.nested_models import NestedModels

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


def error_reduction(nested: NestedModels, *, theme: ThemeName = "light") -> Figure:
    """Draw one bar for each model, hatched where the effect is not in the model, and the noise floor.

    Parameters
    ----------
    nested : from `accelcal.selection.nested_models.nested_models`.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If plotly is not installed.
    """
    palette = style.theme_of(theme)
    errors = np.array(nested.errors)
    floor = nested.floor
    factor, unit = formatting.prefixed("m", errors, floor.value)
    names = model_names(nested)
    tops, bottoms = (np.array([reach(nested, i) for i in range(len(errors))]) * factor).T
    figure = drawing.new_figure()
    texts = [
        "<br>".join([f"{e * factor:.3g} {unit}", *share_text(nested, i).split(", ")]) for i, e in enumerate(errors)
    ]
    for said, inside, shape in (("in the model", True, ""), ("not in the model yet", False, "/")):
        rows = [i for i, member in enumerate(nested.models) if member.in_model == inside]
        if rows:
            figure.add_bar(
                x=rows,
                y=errors[rows] * factor,
                name=said,
                width=0.55,
                error_y={
                    "array": tops[rows],
                    "arrayminus": bottoms[rows],
                    "color": palette.ink,
                    "thickness": 1.6,
                    "width": 6,
                },
                text=[texts[i] for i in rows],
                textposition="outside",
                cliponaxis=False,
                constraintext="none",
                marker={
                    "color": palette.model.colour if inside else drawing.translucent(palette.model.colour, 0.25),
                    "line": {"color": palette.model.colour, "width": 1.5},
                    "pattern": {"shape": shape, "size": 6, "fgcolor": palette.model.colour},
                },
                hovertemplate="%{y:.4g} " + unit + "<extra></extra>",
            )
    ends = np.array([-0.5, len(errors) - 0.5])
    said = "noise alone, with 95 % prediction interval"
    drawing.curve(figure, ends, np.full(2, floor.value * factor), palette.floor, said, unit=unit, width=2.4)
    figure.add_hrect(
        y0=floor.low * factor,
        y1=floor.high * factor,
        fillcolor=drawing.translucent(palette.floor.colour, 0.18),
        line_width=0,
        layer="below",
    )
    unseen = (
        "a part of the fitted run, which does not reveal set-up and slow-drift errors"
        if nested.same_run
        else "another recording"
    )
    drawing.format_figure(figure, palette, error_reduction_sentence(nested), note=f"unseen data: {unseen}", height=360)
    figure.update_xaxes(
        tickvals=list(range(len(names))),
        ticktext=[drawing.escaped(n) for n in names],
        range=[-0.6, len(names) - 0.4],
        showgrid=False,
        title_text="model",
    )
    top = 1.22 * max(float(np.nanmax(errors * factor + np.nan_to_num(tops))), floor.high * factor)
    figure.update_yaxes(title_text=drawing.axis_title("rms error", unit), range=[0.0, top])
    return figure


def reach(nested: NestedModels, number: int) -> tuple[float, float]:
    """How far the interval of an error reaches above and below it, m; NaN where it has none."""
    around, error = nested.intervals[number], nested.errors[number]
    return (math.nan, math.nan) if around is None else (around.high - error, error - around.low)
