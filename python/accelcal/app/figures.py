"""Figures of the library for the page: the headline becomes text, the rest goes to the browser as data."""

from __future__ import annotations

import html
import json
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from accelcal import formatting
from accelcal.app.state import State
from accelcal.data.recording import Recording
from accelcal.data.units import instant
from accelcal.diagnosis.verdict import Diagnosis
from accelcal.effects import spelled
from accelcal.live.moments import LiveHistory
from accelcal.plots import interactive
from accelcal.plots.numbers import share_text
from accelcal.plots.style import ThemeName
from accelcal.selection.nested_models import NestedModel, NestedModels
from accelcal.validation.comparison import Comparison

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

LINE, SMALL = 20, 15
"""Heights of lines of a headline and of small print, pixels, as the figures are laid out."""


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


def marked(state: State) -> list[tuple[float, float, str]]:
    """Stretches that are held out or excluded."""
    found = [(a, b, "excluded") for a, b in state.excluded]
    return found + ([(*state.held_out, "held out")] if state.held_out is not None else [])


def arriving(recording: Recording, theme: ThemeName) -> Picture:
    """A recording before its check."""
    return picture(interactive.linked(recording, theme=theme))


def data(state: State, theme: ThemeName, window: tuple[float, float] | None = None) -> Picture:
    """The recording with its marks, ready for brushing."""
    assert state.recording is not None
    figure = interactive.linked(state.recording, window=window, marked=marked(state), theme=theme)
    for at in state.breaks:
        figure.add_vline(x=at, line={"dash": "dash", "width": 2}, annotation_text=f"break at {instant(at)} s")
    figure.update_layout(dragmode="select", selectdirection="h")
    # Plotly selects markers only: two invisible ones make the axes react to brushing.
    low, high = state.recording.position.t[0], state.recording.position.t[-1]
    figure.add_scatter(x=[low, high], y=[None, None], mode="markers", showlegend=False, hoverinfo="skip", row=1, col=1)
    return picture(figure, modeBarButtonsToRemove=["lasso2d", "autoScale2d"], scrollZoom=False)


def linked(
    state: State, seen: Comparison | None, theme: ThemeName, window: tuple[float, float] | None = None
) -> Picture:
    """Position, output, residual and side channels with one time axis."""
    figure = interactive.linked(state.data, seen, window=window, marked=marked(state), theme=theme)
    figure.update_layout(uirevision="linked")
    return picture(figure)


def nested_of(state: State) -> NestedModels:
    """Held-out errors along the path to the current model."""
    models = tuple(NestedModel(s.label, True, s.fit, s.heldout) for s in state.path)
    horizons = [h for h in models[0].heldout.coast_rms if all(r.heldout.coast_rms[h] is not None for r in models)]
    return NestedModels(models, state.other is None, max(horizons, default=None))


def falling(state: State, theme: ThemeName) -> Picture:
    """One bar for each model on the path."""
    nested = nested_of(state)
    figure = interactive.error_reduction(nested, theme=theme)
    names = [html.escape(spelled(s.label)) for s in state.path]
    sizes = [formatting.length(error) for error in nested.errors]
    ticks = [
        f"{name}: {size}<br>{share_text(nested, i)}" for i, (name, size) in enumerate(zip(names, sizes, strict=True))
    ]
    figure.update_xaxes(ticktext=ticks, title_text=None)
    figure.update_traces(text=None, selector={"type": "bar"})  # a label would sit on the noise line
    figure.update_layout(height=figure.layout.height - 60)
    return picture(figure, displayModeBar=False)


def overlay(state: State, theme: ThemeName) -> Picture:
    """Measured and simulated on held-out data, for every model on the path."""
    seen = [(spelled(step.label), step.heldout) for step in state.path]
    return picture(interactive.overlay(seen, theme=theme))


def residual(state: State, before: Comparison | None, theme: ThemeName) -> Picture:
    """Accelerometer residual on held-out data; in grey that of the previous model, in the same frequency band."""
    assert state.step is not None
    return picture(dimmed(interactive.accel_residual(state.step.heldout, previous=before, theme=theme)))


def dimmed(figure: Figure) -> Figure:
    """Draw the trace of the previous model in grey, readable in both themes."""
    return figure.update_traces(line={"color": "#8A9099", "dash": "solid"}, opacity=0.5, selector={"name": "before"})


def one_step(state: State, theme: ThemeName) -> Picture:
    """One-step residuals on held-out data; in grey those of the previous model."""
    assert state.step is not None
    before = state.previous.heldout if state.previous is not None else None
    return picture(dimmed(interactive.one_step(state.step.heldout, previous=before, theme=theme)))


def coasting(state: State, theme: ThemeName) -> Picture:
    """Unaided drift on held-out data."""
    assert state.step is not None
    return picture(interactive.coasting(state.step.heldout, theme=theme))


def live(history: LiveHistory, theme: ThemeName) -> Picture:
    """A running measurement so far."""
    return picture(interactive.live_tracks(history, theme=theme))


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
