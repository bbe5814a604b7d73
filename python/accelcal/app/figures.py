"""Figures of the library for the page: the headline becomes text, the rest goes to the browser as data."""

from __future__ import annotations

import html
import json
import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from accelcal.app.run import Run, Stretch
from accelcal.app.state import State
from accelcal.data.recording import Recording
from accelcal.data.units import instant
from accelcal.diagnosis.verdict import Diagnosis
from accelcal.effects import spelled
from accelcal.live.moments import LiveHistory
from accelcal.plots import interactive, style
from accelcal.plots.interactive.linked import CHOSEN
from accelcal.plots.numbers import share_text
from accelcal.plots.style import ThemeName
from accelcal.response import FrequencyResponse
from accelcal.results import words as formatting
from accelcal.selection.nested_models import NestedModel, NestedModels
from accelcal.validation.comparison import Comparison
from accelcal.validation.stretches import headline_horizon, quoted_error

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

LINE, SMALL = 20, 15
"""Heights of lines of a headline and of small print, pixels, as the figures are laid out."""

SYMBOLS = ("circle", "square", "diamond", "triangle-up", "cross", "x")
"""Of the held-out recordings."""


@dataclass(frozen=True, slots=True)
class Picture:
    """A figure, the sentence above it and the small print."""

    headline: str
    note: str
    figure: dict[str, Any]


def picture(figure: Figure, **config: Any) -> Picture:
    """Separate the headline from a figure; the axes move up by its height."""
    content = json.loads(figure.to_json())
    layout = content["layout"]
    layout.pop("template", None)
    notes = layout.get("annotations", [])
    headline = next((n["text"] for n in notes if n.get("name") == "headline"), "")
    layout["annotations"] = [n for n in notes if n.get("name") != "headline"]
    lines = headline.split("<br>") if headline else []
    small = [line for line in lines if line.startswith("<span")]
    large = [line for line in lines if not line.startswith("<span")]
    freed = LINE * len(large) + SMALL * len(small)
    layout["margin"]["t"] = max(8, layout["margin"]["t"] - freed)
    layout["height"] -= freed
    content["config"] = {"displaylogo": False, "responsive": True, **config}
    return Picture(_text(large), _text(small), content)


def _text(lines: list[str]) -> str:
    return html.unescape(re.sub(r"</?span[^>]*>", "", " ".join(lines)))


def marked(run: Run) -> list[tuple[float, float, str]]:
    """Stretches that are held out or excluded."""
    found = [(a, b, "excluded") for a, b in run.excluded]
    return found + ([(*run.held_out, "held out")] if run.held_out is not None else [])


def arriving(recording: Recording, theme: ThemeName) -> Picture:
    """A recording before its check."""
    return picture(interactive.linked(recording, theme=theme))


def data(run: Run, theme: ThemeName, window: tuple[float, float] | None = None) -> Picture:
    """The recording with its marks, ready for brushing."""
    assert run.recording is not None
    figure = interactive.linked(run.recording, window=window, marked=marked(run), theme=theme)
    for at in run.breaks:
        figure.add_vline(x=at, line={"dash": "dash", "width": 2}, annotation_text=f"break at {instant(at)} s")
    figure.update_layout(dragmode="select", selectdirection="h")
    # Plotly selects markers only: two invisible ones make the axes react to brushing.
    low, high = run.recording.position.t[0], run.recording.position.t[-1]
    figure.add_scatter(x=[low, high], y=[None, None], mode="markers", showlegend=False, hoverinfo="skip", row=1, col=1)
    return picture(figure, modeBarButtonsToRemove=["lasso2d", "autoScale2d"], scrollZoom=False)


def linked(
    state: State,
    seen: Comparison | None,
    theme: ThemeName,
    window: Stretch | None = None,
    chosen: Stretch | None = None,
) -> Picture:
    """Position, output, residual and side channels with one time axis, and a stretch that was chosen."""
    marks = marked(state.run) if state.run is not None else []
    marks += [(*chosen, CHOSEN)] if chosen is not None else []
    figure = interactive.linked(state.data, seen, window=window, marked=marks, theme=theme)
    figure.update_layout(uirevision="linked")
    return picture(figure)


def nested_of(state: State, number: int | None = None) -> NestedModels:
    """Held-out errors along the path to the current model: on one held-out recording, by default on all together."""
    seen = [step.heldout if number is None else step.heldouts[number] for step in state.path]
    models = tuple(NestedModel(s.label, True, s.fit, one) for s, one in zip(state.path, seen, strict=True))
    every = [one for step in state.path for one in (step.heldouts if number is None else seen)]
    return NestedModels(models, state.holds_out_parts, headline_horizon(*every))


def falling(state: State, theme: ThemeName) -> Picture:
    """One bar for each model on the path."""
    nested = nested_of(state)
    figure = interactive.error_reduction(nested, theme=theme)
    names = [html.escape(spelled(s.label)) for s in state.path]
    sizes = [formatting.length(error) for error in nested.errors]
    ticks = [
        f"{name}: {size}<br>{share_text(nested, i)}" for i, (name, size) in enumerate(zip(names, sizes, strict=True))
    ]
    figure.update_xaxes(ticktext=ticks, tickangle=0, title_text=None)
    figure.update_traces(text=None, selector={"type": "bar"})  # a label would sit on the noise line
    several = len(state.unseen_runs)
    if several > 1:
        beside_the_pool(figure, state, nested, style.theme_of(theme).ink)
    figure.update_layout(height=figure.layout.height - 60)
    made = picture(figure, displayModeBar=False)
    return (
        replace(made, note=f"unseen data: {several} recordings; bars are their error together") if several > 1 else made
    )


def beside_the_pool(figure: Figure, state: State, nested: NestedModels, ink: str) -> None:
    """Beside the error on all held-out data that on each of the recordings, a line each."""
    factor, unit = formatting.prefixed("m", np.array(nested.errors), nested.floor.value)
    for number, run in enumerate(state.unseen_runs):
        errors = [quoted_error(step.heldouts[number], nested.horizon) for step in state.path]
        figure.add_scatter(
            x=list(range(len(errors))),
            y=[error * factor for error in errors],
            mode="lines+markers",
            name=html.escape(run.name),
            line={"dash": "dot", "width": 1.4, "color": ink},
            marker={
                "symbol": SYMBOLS[number % len(SYMBOLS)],
                "size": 10,
                "color": "#ffffff",
                "line": {"width": 1.6, "color": "#1a1a1a"},
            },
            hovertemplate="%{y:.4g} " + unit + "<extra>" + html.escape(run.name) + "</extra>",
        )
    top = max(figure.layout.yaxis.range[1], *(1.1 * max(trace.y) for trace in figure.data[-len(state.unseen_runs) :]))
    figure.update_yaxes(range=[0.0, top])


def overlay(state: State, theme: ThemeName, window: Stretch | None = None, chosen: Stretch | None = None) -> Picture:
    """Measured and simulated on held-out data, for every model on the path, and a stretch that was chosen."""
    seen = [(spelled(step.label), step.heldouts[state.looked_at]) for step in state.path]
    figure = interactive.overlay(seen, window=window, chosen=chosen, theme=theme)
    figure.update_layout(uirevision="overlay")
    return picture(figure)


def residual(state: State, before: Comparison | None, theme: ThemeName) -> Picture:
    """Accelerometer residual on held-out data; in grey that of the previous model, in the same frequency band."""
    assert state.step is not None
    seen = state.step.heldouts[state.looked_at]
    return picture(dimmed(interactive.accel_residual(seen, previous=before, theme=theme)))


def dimmed(figure: Figure) -> Figure:
    """Draw the trace of the previous model in grey, readable in both themes."""
    return figure.update_traces(line={"color": "#8A9099", "dash": "solid"}, opacity=0.5, selector={"name": "before"})


def one_step(state: State, theme: ThemeName) -> Picture:
    """One-step residuals on held-out data; in grey those of the previous model."""
    assert state.step is not None
    before = state.previous.heldouts[state.looked_at] if state.previous is not None else None
    return picture(dimmed(interactive.one_step(state.step.heldouts[state.looked_at], previous=before, theme=theme)))


def coasting(state: State, theme: ThemeName) -> Picture:
    """Unaided drift on held-out data."""
    assert state.step is not None
    return picture(interactive.coasting(state.step.heldouts[state.looked_at], theme=theme))


def live(history: LiveHistory, theme: ThemeName) -> Picture:
    """A running measurement so far."""
    return picture(interactive.live_tracks(history, theme=theme))


def response(found: FrequencyResponse, theme: ThemeName) -> Picture:
    """Sensitivity by frequency, and where the parametric fit deviates."""
    return picture(interactive.sensitivity(found, theme=theme))


def where(found: Diagnosis, theme: ThemeName) -> list[Picture]:
    """Residuals of the model on the fitted data, by variable, frequency and lag."""
    seen = found.where
    return [
        picture(interactive.tiles(seen, theme=theme), displayModeBar=False),
        picture(interactive.regions(seen, theme=theme)),
        picture(interactive.spectrum(found.fit, seen, found.channels, theme=theme)),
        picture(interactive.whiteness_plot(seen, theme=theme)),
        picture(interactive.quantile_plot(seen, theme=theme)),
    ]
