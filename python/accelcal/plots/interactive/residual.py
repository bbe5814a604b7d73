"""One-step residuals against time with the band that should hold 95 % of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from accelcal.plots import style
from accelcal.plots.interactive import drawing
from accelcal.plots.numbers import one_step_residuals
from accelcal.plots.style import ThemeName
from accelcal.results import words as formatting
from accelcal.validation.comparison import Comparison

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


def one_step(comparison: Comparison, *, previous: Comparison | None = None, theme: ThemeName = "light") -> Figure:
    """Draw one-step residuals with their 95 % band; those of the previous model drawn pale.

    Parameters
    ----------
    comparison : from `accelcal.compare`.
    previous : of the previous model, on the same recording.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If plotly or tsdownsample is not installed.
    """
    palette = style.theme_of(theme)
    shown = one_step_residuals(comparison)
    t, e, reach, edge = shown.t, shown.e, shown.reach, shown.edge
    factor, unit = formatting.prefixed(shown.unit, edge)
    figure = drawing.new_figure()
    if previous is not None:
        old = one_step_residuals(previous)
        edge = max(edge, 1.15 * float(np.quantile(np.abs(old.e), 0.999)))
        drawing.trace(figure, old.t, old.e, palette.floor, "before", factor=factor, unit=unit, opacity=0.35)
    drawn = drawing.trace(figure, t, e, palette.residual, "residual", factor=factor, unit=unit)
    at, usual = style.column_medians(t, reach)
    usual = np.minimum(usual, 1.1 * edge) * factor
    drawing.band(figure, at, -usual, usual, "predicted 95 % band", palette.band)
    beyond = int(np.count_nonzero(np.abs(e) > edge))
    off = f"{formatting.grouped(beyond)} beyond the axis" if beyond else ""
    drawing.format_figure(
        figure,
        palette,
        shown.headline,
        note="; ".join(filter(None, (off, drawn.note))),
        height=320,
    )
    figure.update_xaxes(title_text=drawing.axis_title("time", "s"))
    figure.update_yaxes(title_text=drawing.axis_title("one-step residual", unit), range=[-edge * factor, edge * factor])
    return figure


def accel_residual(comparison: Comparison, *, previous: Comparison | None = None, theme: ThemeName = "light") -> Figure:
    """Draw the accelerometer residual below the highest frequency at which the encoder is a reference.

    Parameters and errors are those of `one_step`.
    """
    palette = style.theme_of(theme)
    t, residual = comparison.accel_residual
    figure = drawing.new_figure()
    headline = "Accelerometer residual"
    if len(t) == 0:
        return drawing.message(figure, palette, headline, f"The record is too short below {comparison.band:.3g} Hz.")
    factor, unit = formatting.prefixed("m/s²", residual)
    if previous is not None and len(previous.accel_residual[0]):
        drawing.trace(figure, *previous.accel_residual, palette.floor, "before", factor=factor, unit=unit, opacity=0.35)
    drawn = drawing.trace(figure, t, residual, palette.residual, "output − model", factor=factor, unit=unit)
    drawing.format_figure(
        figure,
        palette,
        f"{headline} below {comparison.band:.3g} Hz: rms {comparison.accel_rms * factor:.3g} {unit}",
        note=drawn.note,
        height=320,
        legend=previous is not None,
    )
    figure.update_xaxes(title_text=drawing.axis_title("time", "s"))
    figure.update_yaxes(title_text=drawing.axis_title("accelerometer residual", unit))
    return figure
