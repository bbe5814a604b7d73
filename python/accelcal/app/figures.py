"""Figures of the library for the page: the headline becomes text, the rest goes to the browser as data."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from accelcal.app.run import Run, Stretch
from accelcal.app.state import State
from accelcal.data.recording import Recording
from accelcal.data.units import instant
from accelcal.diagnosis.verdict import Diagnosis
from accelcal.effects import spelled
from accelcal.live.moments import LiveHistory
from accelcal.plots import bins, comparison, diagnosis, plotly, residuals, timeline, tracks
from accelcal.plots.figure import Bars, Figure, Level, Line
from accelcal.plots.numbers import share_text
from accelcal.plots.response import sensitivity
from accelcal.plots.style import ThemeName
from accelcal.response import FrequencyResponse
from accelcal.results import words as formatting
from accelcal.validation.comparison import Evaluation
from accelcal.validation.differences import Comparison
from accelcal.validation.stretches import quoted_error

MARKERS = ("o", "s", "D", "^", "P", "X")
"""Of the held-out recordings."""


@dataclass(frozen=True, slots=True)
class Picture:
    """A figure, the sentence above it and the small print."""

    headline: str
    note: str
    figure: dict[str, Any]


def picture(figure: Figure, theme: ThemeName, **config: Any) -> Picture:
    """Separate the headline from a figure."""
    content = plotly.as_dict(figure, theme, headline=False)
    content["config"] = {"displaylogo": False, "responsive": True, **config}
    return Picture(figure.headline, figure.small_print, content)


def marked(run: Run) -> list[tuple[float, float, str]]:
    """Stretches that are held out or excluded."""
    found = [(a, b, "excluded") for a, b in run.excluded]
    return found + ([(*run.held_out, "held out")] if run.held_out is not None else [])


def arriving(recording: Recording, theme: ThemeName) -> Picture:
    """A recording before its check."""
    return picture(timeline.linked(recording), theme)


def data(run: Run, theme: ThemeName, window: tuple[float, float] | None = None) -> Picture:
    """The recording with its marks, ready for brushing."""
    assert run.recording is not None
    figure = timeline.linked(run.recording, window=window, marked=marked(run))
    first, *rest = figure.panels
    breaks = [Level(at, role="other", upright=True, text=f"break at {instant(at)} s") for at in run.breaks]
    figure = replace(figure, panels=(replace(first, marks=(*first.marks, *breaks)), *rest), key="")
    made = picture(figure, theme, modeBarButtonsToRemove=["lasso2d", "autoScale2d"], scrollZoom=False)
    made.figure["layout"] |= {"dragmode": "select", "selectdirection": "h"}
    # Plotly selects markers only: two invisible ones make the axes react to brushing.
    low, high = (float(run.recording.position.t[i]) for i in (0, -1))
    unseen = {"type": "scatter", "mode": "markers", "showlegend": False, "hoverinfo": "skip"}
    made.figure["data"].append({**unseen, "x": [low, high], "y": [None, None], "xaxis": "x", "yaxis": "y"})
    return made


def linked(
    state: State,
    seen: Evaluation | None,
    theme: ThemeName,
    window: Stretch | None = None,
    chosen: Stretch | None = None,
) -> Picture:
    """Position, output, residual and side channels with one time axis, and a stretch that was chosen."""
    marks = marked(state.run) if state.run is not None else []
    marks += [(*chosen, timeline.CHOSEN)] if chosen is not None else []
    return picture(timeline.linked(state.data, seen, window=window, marked=marks), theme)


def path_of(state: State, number: int | None = None) -> Comparison:
    """Models on the path to the current one: on one held-out recording, by default on all of them."""
    seen = tuple(zip(*(step.heldouts for step in state.path), strict=True))
    seen = seen if number is None else seen[number : number + 1]
    return Comparison(
        tuple(step.fit for step in state.path),
        tuple(step.label for step in state.path),
        tuple(each[0].recording for each in seen),
        seen,
        state.holds_out_parts,
    )


def falling(state: State, theme: ThemeName) -> Picture:
    """One bar for each model on the path, and beside the error on all held-out data that on each of the recordings."""
    compared = path_of(state)
    figure = diagnosis.error_reduction(compared)
    (panel,) = figure.panels
    sizes = [formatting.length(error) for error in compared.errors]
    names = [
        f"{spelled(step.label)}: {size}\n{share_text(compared, i)}"
        for i, (step, size) in enumerate(zip(state.path, sizes, strict=True))
    ]
    marks = [replace(m, text=()) if isinstance(m, Bars) else m for m in panel.marks]  # text would sit on the noise line
    several, top = len(state.unseen_runs), panel.y.range[1] if panel.y.range else 0.0
    if several > 1:
        factor, _ = formatting.prefixed("m", np.array(compared.errors), compared.floor.value)
        for run, seen, marker in zip(state.unseen_runs, compared.seen, itertools.cycle(MARKERS)):
            errors = np.array([quoted_error(evaluation, compared.horizon) for evaluation in seen])
            marks.append(Line(np.arange(float(len(errors))), errors * factor, run.name, "ink", marker=marker))
            top = max(top, 1.1 * float(np.max(errors)) * factor)
    panel = replace(
        panel,
        marks=tuple(marks),
        x=replace(panel.x, title="", ticks=(range(len(names)), names)),
        y=replace(panel.y, range=(0.0, top)),
        height=panel.height - 60.0,
    )
    note = f"unseen data: {several} recordings; bars are their error together" if several > 1 else figure.note
    return picture(replace(figure, panels=(panel,), note=note), theme, displayModeBar=False)


def overlay(state: State, theme: ThemeName, window: Stretch | None = None, chosen: Stretch | None = None) -> Picture:
    """Measured and simulated on held-out data, for every model on the path, and a stretch that was chosen."""
    seen = [(spelled(step.label), step.heldouts[state.looked_at]) for step in state.path]
    return picture(timeline.overlay(seen, window=window, chosen=chosen), theme)


def residual(state: State, before: Evaluation | None, theme: ThemeName) -> Picture:
    """Accelerometer residual on held-out data; pale that of the previous model, in the same frequency band."""
    assert state.step is not None
    return picture(comparison.accel_residual(state.step.heldouts[state.looked_at], previous=before), theme)


def one_step(state: State, theme: ThemeName) -> Picture:
    """One-step residuals on held-out data; pale those of the previous model."""
    assert state.step is not None
    before = state.previous.heldouts[state.looked_at] if state.previous is not None else None
    return picture(comparison.one_step(state.step.heldouts[state.looked_at], previous=before), theme)


def coasting(state: State, theme: ThemeName) -> Picture:
    """Unaided drift on held-out data."""
    assert state.step is not None
    return picture(comparison.coasting(state.step.heldouts[state.looked_at]), theme)


def live(history: LiveHistory, theme: ThemeName) -> Picture:
    """A running measurement so far."""
    return picture(tracks.live_tracks(history), theme)


def response(found: FrequencyResponse, theme: ThemeName) -> Picture:
    """Sensitivity by frequency, and where the parametric fit deviates."""
    return picture(sensitivity(found), theme)


def where(found: Diagnosis, theme: ThemeName) -> list[Picture]:
    """Residuals of the model on the fitted data, by variable, frequency and lag."""
    seen = found.where
    return [
        picture(bins.tiles(seen), theme, displayModeBar=False),
        picture(bins.regions(seen), theme),
        picture(residuals.spectrum(found.fit, seen, found.channels), theme),
        picture(residuals.whiteness_plot(seen), theme),
        picture(residuals.quantile_plot(seen), theme),
    ]
