"""The falling error: one bar for each model on unseen data, the noise floor, and what each effect explains."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from accelcal import formatting
from accelcal.plots import style
from accelcal.plots.interactive import drawing
from accelcal.plots.numbers import error_reduction_sentence, model_names
from accelcal.plots.style import ThemeName
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
    factor, unit = formatting.prefixed("m", errors, nested.floor)
    names, shares = model_names(nested), nested.shares
    figure = drawing.new_figure()
    texts = [
        f"{e * factor:.3g} {unit}" + ("" if s is None else f"<br>{100.0 * s:.0f} % of the excess explained")
        for e, s in zip(errors, shares, strict=True)
    ]
    for said, inside, shape in (("in the model", True, ""), ("not in the model yet", False, "/")):
        rows = [i for i, member in enumerate(nested.models) if member.in_model == inside]
        if rows:
            figure.add_bar(
                x=rows,
                y=errors[rows] * factor,
                name=said,
                width=0.55,
                text=[texts[i] for i in rows],
                textposition="outside",
                cliponaxis=False,
                marker={
                    "color": palette.model.colour if inside else drawing.translucent(palette.model.colour, 0.25),
                    "line": {"color": palette.model.colour, "width": 1.5},
                    "pattern": {"shape": shape, "size": 6, "fgcolor": palette.model.colour},
                },
                hovertemplate="%{y:.4g} " + unit + "<extra></extra>",
            )
    ends = np.array([-0.5, len(errors) - 0.5])
    drawing.curve(figure, ends, np.full(2, nested.floor * factor), palette.floor, "noise alone", unit=unit, width=2.4)
    unseen = (
        "the end of the fitted run: set-up and slow-drift errors cannot show"
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
    top = 1.22 * max(float(np.nanmax(errors)), nested.floor) * factor
    figure.update_yaxes(title_text=drawing.axis_title("rms error", unit), range=[0.0, top])
    return figure
