"""Which figures a report shows, in which section, and under which caption."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from accelcal.plots import interactive
from accelcal.plots.static import comparison as still
from accelcal.plots.static import diagnosis
from accelcal.plots.style import ThemeName
from accelcal.report.content import Content

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Still
    from plotly.graph_objects import Figure


@dataclass(frozen=True, slots=True)
class Entry:
    """One figure of a report."""

    name: str
    section: str
    caption: str
    interactive: Callable[[ThemeName], Figure]
    still: Callable[[ThemeName], Still] | None = None
    """For pages without script and for paper; None where only the interactive page shows it."""


def entries(content: Content) -> list[Entry]:
    """Every figure that the content allows, in the order of the page."""
    c, d = content, content.diagnosis
    where = c.diagnosis.where
    on_run = f"Model profiled anew on {c.recording.name or 'the recording'}."
    on_judged = f"{c.judged.recording or 'Recording'}: {'unseen by the fit' if c.unseen else 'the fitted recording'}."
    if d.verdict != "adequate":
        on_judged += " Noise is what this model takes for noise, what it lacks included."
    found = [
        Entry(
            "candidates",
            "found",
            "By evidence, which charges for freedom. Filled: significant; in brackets: what cannot be told apart.",
            lambda theme: interactive.ranking(d, theme=theme),
            lambda theme: diagnosis.ranking(d, theme=theme),
        )
    ]
    if c.shapes:
        several = c.shapes
        found.append(
            Entry(
                "shape",
                "found",
                "A function that was fitted, with its pointwise uncertainty.",
                lambda theme: interactive.shape(several, theme=theme),
            )
        )
    if c.nested is not None:
        nested = c.nested
        found.append(
            Entry(
                "falling",
                "falling",
                "Hatched: an effect that the model does not hold yet.",
                lambda theme: interactive.falling(nested, theme=theme),
                lambda theme: diagnosis.falling(nested, theme=theme),
            )
        )
    found += [
        Entry(
            "coasting",
            "falling",
            on_judged,
            lambda theme: interactive.coasting(c.judged, theme=theme),
            lambda theme: still.coasting(c.judged, theme=theme),
        ),
        Entry(
            "simulated",
            "falling",
            on_judged,
            lambda theme: interactive.simulated(c.judged, theme=theme),
            lambda theme: still.simulated(c.judged, theme=theme),
        ),
        Entry(
            "tiles",
            "where",
            on_run,
            lambda theme: interactive.tiles(where, theme=theme),
            lambda theme: diagnosis.tiles(where, theme=theme),
        ),
        Entry(
            "regions",
            "where",
            f"{on_run} Below the frequency to which the encoder can judge, {where.band:.3g} Hz.",
            lambda theme: interactive.regions(where, theme=theme),
            lambda theme: still.regions(where, theme=theme),
        ),
        Entry("residual", "where", on_run, lambda theme: interactive.accel_side(where, theme=theme)),
        Entry(
            "one_step",
            "where",
            on_run,
            lambda theme: interactive.one_step(where, theme=theme),
            lambda theme: still.one_step(where, theme=theme),
        ),
        Entry("spectrum", "where", on_run, lambda theme: interactive.spectrum(d.fit, where, d.channels, theme=theme)),
        Entry(
            "whiteness",
            "where",
            on_run,
            lambda theme: interactive.white(where, theme=theme),
            lambda theme: still.autocorrelation(where, theme=theme),
        ),
        Entry("quantiles", "where", on_run, lambda theme: interactive.quantile_plot(where, theme=theme)),
    ]
    if c.track is not None:
        followed = c.track
        found.append(
            Entry(
                "tracks",
                "parameters",
                "Noise and smoothed motion from the whole record; readings up to each instant.",
                lambda theme: interactive.tracks(followed, theme=theme),
            )
        )
    found.append(
        Entry(
            "timeline",
            "data",
            "The whole recording.",
            lambda theme: interactive.timeline(c.recording, c.marks, theme=theme),
        )
    )
    if c.power is not None:
        seen = c.power
        first = [candidate.effect for candidate in d.scan.candidates[:6]]
        found += [
            Entry(
                "power",
                "data",
                "Beyond what the model holds already.",
                lambda theme: interactive.power_of(seen, theme=theme),
            ),
            Entry(
                "signatures",
                "apart",
                "Each effect at the shape at which it is seen best.",
                lambda theme: interactive.signatures(seen, first, theme=theme),
            ),
        ]
    return found
