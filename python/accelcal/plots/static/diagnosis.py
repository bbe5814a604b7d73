"""Static figures of error reduction, candidates and residuals by region, for PDF and mail."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from accelcal._support.listing import listing
from accelcal.diagnosis.verdict import Diagnosis
from accelcal.effects import spelled
from accelcal.plots import style
from accelcal.plots.numbers import (
    FULL_COLOUR,
    candidate_groups,
    error_reduction_sentence,
    model_names,
    share_text,
    signed,
    tiles_of,
)
from accelcal.plots.static.comparison import WIDTH
from accelcal.plots.style import OKABE_ITO, ThemeName
from accelcal.results import words as formatting
from accelcal.selection.nested_models import NestedModels
from accelcal.validation.comparison import Comparison

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def error_reduction(nested: NestedModels, *, theme: ThemeName = "light") -> Figure:
    """Draw one bar for each model on unseen data, hatched where the effect is not in the model, and the noise floor.

    Parameters
    ----------
    nested : from `accelcal.selection.nested_models.nested_models`.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If matplotlib is not installed.
    """
    palette = style.theme_of(theme)
    figure = style.new_figure(WIDTH, 4.2, palette)
    axes = figure.subplots()
    errors = np.array(nested.errors)
    floor = nested.floor
    factor, unit = formatting.prefixed("m", errors, floor.value)
    style.format_axes(axes, palette, x="model", y=formatting.label("rms error", unit))
    for i, (member, error, around) in enumerate(zip(nested.models, errors * factor, nested.intervals, strict=True)):
        axes.bar(
            i,
            error,
            width=0.55,
            yerr=None if around is None else [[error - around.low * factor], [around.high * factor - error]],
            ecolor=palette.ink,
            capsize=4.0,
            color=palette.model.colour if member.in_model else palette.page,
            edgecolor=palette.model.colour,
            hatch="" if member.in_model else "//",
            label="in the model" if member.in_model else "not in the model yet",
        )
        top = max(error if around is None else around.high * factor, floor.high * factor)
        lines = [f"{error:.3g} {unit}", *share_text(nested, i).split(", ")]
        axes.annotate(
            "\n".join(lines).rstrip(),
            (i, top),
            xytext=(0, 3),
            textcoords="offset points",
            ha="center",
            color=palette.ink,
            fontsize=style.SMALL,
        )
    axes.axhline(
        floor.value * factor,
        color=palette.floor.colour,
        linestyle=palette.floor.line,
        linewidth=2.0,
        label="noise alone, with 95 % prediction interval",
    )
    axes.axhspan(floor.low * factor, floor.high * factor, color=palette.floor.colour, alpha=0.18, linewidth=0.0)
    axes.set_xticks(range(len(errors)), model_names(nested))
    highest = [around.high for around in nested.intervals if around is not None]
    axes.set_ylim(0.0, 1.3 * max(float(np.nanmax(errors)), floor.high, *highest) * factor)
    handles, labels = axes.get_legend_handles_labels()
    entries = dict(zip(labels, handles, strict=True))
    axes.legend(
        list(entries.values()),
        list(entries),
        frameon=False,
        fontsize=style.SMALL,
        labelcolor=palette.ink,
        loc="upper right",
    )
    style.headline(figure, error_reduction_sentence(nested), palette)
    return figure


def ranking(diagnosis: Diagnosis, *, theme: ThemeName = "light") -> Figure:
    """Draw equivalent standard deviations of each candidate; significant ones filled, confounded ones in brackets.

    Parameters
    ----------
    diagnosis : from `accelcal.diagnose`.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If matplotlib is not installed.
    """
    palette = style.theme_of(theme)
    groups = candidate_groups(diagnosis)
    flat = [c for group in groups for c in group]
    figure = style.new_figure(WIDTH, 1.4 + 0.3 * max(3, len(flat)), palette)
    axes = figure.subplots()
    style.format_axes(axes, palette, x=formatting.label("significance", "equivalent standard deviations"), y="")
    style.headline(figure, f"Candidate effects: {diagnosis.scan.examined} examined", palette)
    if not flat:
        style.message(axes, "No candidate could be tested on this record.", palette)
        return figure
    top = max(c.snr for c in flat)
    for i, c in enumerate(flat):
        sure = c.p_value < diagnosis.alpha
        axes.barh(
            i,
            c.snr,
            height=0.62,
            color=palette.model.colour if sure else palette.page,
            edgecolor=palette.model.colour if sure else palette.floor.colour,
            hatch="" if sure else "//",
        )
        axes.annotate(
            f"{c.snr:.1f} σ",
            (c.snr, i),
            xytext=(3, 0),
            textcoords="offset points",
            va="center",
            color=palette.ink,
            fontsize=style.SMALL,
        )
    begin = 0
    for group in groups:
        end = begin + len(group) - 1
        if len(group) > 1:
            x = np.array([1.18, 1.2, 1.2, 1.18]) * top
            axes.plot(x, [begin - 0.3, begin - 0.3, end + 0.3, end + 0.3], color=palette.other.colour, linewidth=1.6)
            axes.text(
                1.22 * top,
                0.5 * (begin + end),
                "confounded",
                va="center",
                color=palette.ink,
                fontsize=style.SMALL,
            )
        begin = end + 1
    axes.set_yticks(range(len(flat)), [spelled(c.effect) for c in flat])
    axes.set_ylim(len(flat) - 0.4, -0.6)
    axes.set_xlim(0.0, 1.45 * top)
    return figure


def tiles(comparison: Comparison, *, theme: ThemeName = "light") -> Figure:
    """Draw one tile for each bin of each variable, in standard deviations expected from noise.

    Parameters
    ----------
    comparison : from `accelcal.compare`.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If matplotlib is not installed.
    """
    palette = style.theme_of(theme)
    seen = tiles_of(comparison)
    figure = style.new_figure(WIDTH, 1.4 + 0.32 * max(3, len(seen.rows)), palette)
    axes = figure.subplots()
    style.headline(
        figure, "Residuals by region: mean of each bin in standard deviations expected from noise, σ", palette
    )
    style.format_axes(axes, palette, x=formatting.label("bin, from the smallest to the largest value", "1"), y="")
    if not seen.rows:
        style.message(axes, "The record is too short for residuals by region.", palette)
        return figure
    from matplotlib.colors import LinearSegmentedColormap

    colours = [OKABE_ITO["blue"], palette.page, OKABE_ITO["vermillion"]]
    count = seen.sigma.shape[1]
    axes.imshow(
        np.clip(seen.sigma, -FULL_COLOUR, FULL_COLOUR),
        aspect="auto",
        vmin=-FULL_COLOUR,
        vmax=FULL_COLOUR,
        extent=(0.5, count + 0.5, len(seen.rows) - 0.5, -0.5),
        cmap=LinearSegmentedColormap.from_list("excess", colours),
    )
    for i, row in enumerate(seen.sigma):
        for j, value in enumerate(row):
            if np.isfinite(value):
                ink = "#FFFFFF" if abs(value) > 0.6 * FULL_COLOUR else palette.ink
                axes.text(j + 1, i, signed(float(value)), ha="center", va="center", fontsize=style.SMALL, color=ink)
    axes.set_xticks(range(1, count + 1))
    axes.set_yticks(range(len(seen.rows)), seen.rows)
    axes.grid(False)
    return figure


__dir__ = listing(globals())
