"""Measured and simulated output and position over each other, the residual under them: one or several models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from accelcal.data.arrays import Array
from accelcal.io import together
from accelcal.plots import style
from accelcal.plots.numbers import fit_text, named_models, overlay_headline
from accelcal.plots.style import LineStyle, ThemeName
from accelcal.results.words import label, prefixed
from accelcal.validation.comparison import Comparison
from accelcal.validation.differences import PairedComparison
from accelcal.validation.worst import worst_stretches

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH, HEIGHT = 8.0, 6.6
"""Inches."""


def overlay(models: Comparison | Sequence[tuple[str, Comparison]], *, theme: ThemeName = "light") -> Figure:
    """Draw what was measured, what each model says, and the difference, over one time axis.

    The stretches in which the residual of the last model is largest are shaded in all panels.

    Parameters
    ----------
    models : from `accelcal.compare`; or name and comparison of several models with one recording, the current one last.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If matplotlib is not installed.
    ValueError
        If there is no model.
    """
    several = named_models(models)
    palette = style.theme_of(theme)
    current = several[-1][1]
    figure = style.new_figure(WIDTH, HEIGHT, palette)
    output, residual, position = figure.subplots(3, 1, sharex=True, height_ratios=(3, 2, 3))
    t, moved, _ = current.simulated
    factor, unit = prefixed("m", moved)
    ruler, residual_unit = prefixed("m/s²", *(seen.accel_residual[1] for _, seen in several))
    style.format_axes(output, palette, x="", y=label("output", "m/s²"))
    style.format_axes(residual, palette, x="", y=label("residual", residual_unit))
    style.format_axes(position, palette, x=label("time", "s"), y=label("position", unit))
    _draw(output, current.accel_residual[0], current.measured, palette.measured, 1.0, "measured")
    drawn = style.trace(position, t, moved, palette.measured, factor=factor)
    residual.axhline(0.0, color=palette.ink, linewidth=0.8)
    for number, (name, seen) in enumerate(several):
        line = style.line_of_model(palette, number, len(several))
        at, left = seen.accel_residual
        said = f"{name or 'model'}, {fit_text(seen)}"
        _draw(output, at, seen.measured - left, line, 1.0, said)
        _draw(residual, at, left, replace(line, line="-"), ruler)
        style.trace(position, seen.simulated[0], seen.simulated[2], line, factor=factor)
    for number, (begin, end) in enumerate(worst_stretches(*current.accel_residual)):
        for axes in (output, residual, position):
            said = "largest residual" if axes is output and not number else "_"
            axes.axvspan(begin, end, color=palette.band, alpha=0.25, linewidth=0.0, label=said)
    if not len(current.accel_residual[0]):
        style.message(output, f"The record is too short for a residual below {current.band:.3g} Hz.", palette)
    else:
        style.legend(output, palette, columns=2 if len(several) > 2 else 4)
    small = ("position: simulated from the output alone", drawn.note)
    style.note(position, "; ".join(filter(None, small)), palette)
    style.headline(figure, overlay_headline(several), palette)
    return figure


def _draw(axes: Axes, t: Array, y: Array, line: LineStyle, factor: float, name: str = "") -> None:
    """A trace, unless the record is too short to have one."""
    if len(t):
        style.trace(axes, t, y, line, factor=factor, name=name)


def write(found: PairedComparison, directory: str | Path, *, theme: ThemeName = "light") -> list[Path]:
    """Write the figure of each recording, with all models in it, as PNG and SVG, all of them or none.

    Parameters
    ----------
    found : from `accelcal.compare_paired`.
    directory : made if it does not exist.
    theme : "light" or "dark".

    Returns
    -------
    The files.

    Raises
    ------
    MissingExtra
        If matplotlib is not installed; nothing is written then.
    """
    folder = Path(directory)
    ending = "-dark" if theme == "dark" else ""
    written: list[Path] = []
    with together():
        for number, seen in enumerate(found.seen, start=1):
            figure = overlay(list(zip(found.names, seen, strict=True)), theme=theme)
            folder.mkdir(parents=True, exist_ok=True)
            for kind in ("png", "svg"):
                path = folder / f"overlay{f'-{number}' if len(found.seen) > 1 else ''}{ending}.{kind}"
                style.save(figure, path)
                written.append(path)
    return written
