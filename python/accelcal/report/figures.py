"""Which figures a report shows, in which section, and under which caption."""

from __future__ import annotations

from collections.abc import Callable, Iterator
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
    return [*_found(content), *_falling(content), *_where(content), *_parameters(content), *_data(content)]


def _found(c: Content) -> Iterator[Entry]:
    """What was found: the candidates, and a fitted curve where the model holds one."""
    d, several = c.diagnosis, c.shapes
    yield Entry(
        "candidates",
        "found",
        "By evidence, which charges for freedom. Filled: significant; in brackets: what cannot be told apart.",
        lambda theme: interactive.ranking(d, theme=theme),
        lambda theme: diagnosis.ranking(d, theme=theme),
    )
    if several:
        yield Entry(
            "shape",
            "found",
            "A function that was fitted, with its pointwise uncertainty.",
            lambda theme: interactive.fitted_curve(several, theme=theme),
        )


def _falling(c: Content) -> Iterator[Entry]:
    """How the error falls with each effect, on unseen data where there are any."""
    nested = c.nested
    caption = f"{c.judged.recording or 'Recording'}: {'unseen by the fit' if c.unseen else 'the fitted recording'}."
    if c.diagnosis.verdict != "adequate":
        caption += " Noise is what this model takes for noise, what it lacks included."
    if nested is not None:
        yield Entry(
            "falling",
            "falling",
            "Hatched: an effect that the model does not hold yet.",
            lambda theme: interactive.error_reduction(nested, theme=theme),
            lambda theme: diagnosis.error_reduction(nested, theme=theme),
        )
    yield Entry(
        "coasting",
        "falling",
        caption,
        lambda theme: interactive.coasting(c.judged, theme=theme),
        lambda theme: still.coasting(c.judged, theme=theme),
    )
    yield Entry(
        "simulated",
        "falling",
        caption,
        lambda theme: interactive.simulated(c.judged, theme=theme),
        lambda theme: still.simulated(c.judged, theme=theme),
    )


def _where(c: Content) -> Iterator[Entry]:
    """Residuals of the model after all coefficients were estimated anew on the recording."""
    d, where = c.diagnosis, c.diagnosis.where
    caption = f"Model profiled anew on {c.recording.name or 'the recording'}."
    yield Entry(
        "tiles",
        "where",
        caption,
        lambda theme: interactive.tiles(where, theme=theme),
        lambda theme: diagnosis.tiles(where, theme=theme),
    )
    yield Entry(
        "regions",
        "where",
        f"{caption} Below the frequency to which the encoder can judge, {where.band:.3g} Hz.",
        lambda theme: interactive.regions(where, theme=theme),
        lambda theme: still.regions(where, theme=theme),
    )
    yield Entry("residual", "where", caption, lambda theme: interactive.accel_residual(where, theme=theme))
    yield Entry(
        "one_step",
        "where",
        caption,
        lambda theme: interactive.one_step(where, theme=theme),
        lambda theme: still.one_step(where, theme=theme),
    )
    yield Entry("spectrum", "where", caption, lambda theme: interactive.spectrum(d.fit, where, d.channels, theme=theme))
    yield Entry(
        "whiteness",
        "where",
        caption,
        lambda theme: interactive.whiteness_plot(where, theme=theme),
        lambda theme: still.autocorrelation(where, theme=theme),
    )
    yield Entry("quantiles", "where", caption, lambda theme: interactive.quantile_plot(where, theme=theme))


def _parameters(c: Content) -> Iterator[Entry]:
    """Estimates over time, where they could be tracked."""
    followed = c.track
    if followed is not None:
        yield Entry(
            "tracks",
            "parameters",
            "Noise and smoothed motion from the whole record; readings up to each instant.",
            lambda theme: interactive.tracks(followed, theme=theme),
        )


def _data(c: Content) -> Iterator[Entry]:
    """The recording, and which effects it can show."""
    seen = c.power
    yield Entry(
        "timeline",
        "data",
        "The whole recording.",
        lambda theme: interactive.timeline(c.recording, c.marks, theme=theme),
    )
    if seen is None:
        return
    first = [candidate.effect for candidate in c.diagnosis.scan.candidates[:6]]
    yield Entry(
        "power",
        "data",
        "Beyond what the model holds already.",
        lambda theme: interactive.detectable_sizes(seen, theme=theme),
    )
    yield Entry(
        "signatures",
        "apart",
        "Each effect at the shape at which it is seen best.",
        lambda theme: interactive.signatures(seen, first, theme=theme),
    )
