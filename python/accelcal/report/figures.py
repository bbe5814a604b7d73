"""Figures of a report, with section and caption."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from accelcal.plots import interactive
from accelcal.plots.numbers import nested_comparisons
from accelcal.plots.static import closely, diagnosis
from accelcal.plots.static import comparison as static
from accelcal.plots.static.sensitivity import sensitivity
from accelcal.plots.style import ThemeName
from accelcal.report.content import Content

if TYPE_CHECKING:
    from matplotlib.figure import Figure as StaticFigure
    from plotly.graph_objects import Figure


@dataclass(frozen=True, slots=True)
class Entry:
    """One figure of a report."""

    name: str
    section: str
    caption: str
    interactive: Callable[[ThemeName], Figure]
    static: Callable[[ThemeName], StaticFigure] | None = None
    """Static version for pages without script and for PDF; None where only the interactive page shows the figure."""


def entries(content: Content) -> list[Entry]:
    """Every figure that the content allows, in the order of the page."""
    return [
        _overlay(content),
        *_findings(content),
        *_error_reduction(content),
        *_residuals(content),
        *_response(content),
        *_parameters(content),
        *_data(content),
    ]


def use_of(c: Content) -> str:
    """What the fit has used of the data that the model is judged on."""
    if not c.unseen:
        return "the fitted recording"
    return "a part not used in the fit" if c.is_part else "not used in the fit"


def _overlay(c: Content) -> Entry:
    """The first figure: what was measured and what this calibration says."""
    model = [("this calibration", c.judged)]
    return Entry(
        "overlay",
        "first",
        f"{c.judged.recording or 'Recording'}, {use_of(c)}. Residual: measured − simulated.",
        lambda theme: interactive.overlay(model, theme=theme),
        lambda theme: closely.overlay(model, theme=theme),
    )


def _findings(c: Content) -> Iterator[Entry]:
    """Findings: the candidates, and a fitted curve where the model contains one."""
    d, several = c.diagnosis, c.shapes
    yield Entry(
        "candidates",
        "found",
        "Ordered by evidence, free coefficients penalised. Filled: significant; bracketed: confounded on this record.",
        lambda theme: interactive.ranking(d, theme=theme),
        lambda theme: diagnosis.ranking(d, theme=theme),
    )
    if several:
        yield Entry(
            "shape",
            "found",
            "Nonparametric curve of the model, with its pointwise uncertainty.",
            lambda theme: interactive.fitted_curve(several, theme=theme),
        )


def _error_reduction(c: Content) -> Iterator[Entry]:
    """Error reduction by each effect, on unseen data where there are any."""
    nested = c.nested
    caption = f"{c.judged.recording or 'Recording'}: {use_of(c)}."
    if nested is not None:
        yield Entry(
            "falling",
            "falling",
            "" if all(member.in_model for member in nested.models) else "Hatched: effect not in the model yet.",
            lambda theme: interactive.error_reduction(nested, theme=theme),
            lambda theme: diagnosis.error_reduction(nested, theme=theme),
        )
    compared = nested_comparisons(nested) if nested is not None else [("model", c.judged)]
    yield Entry(
        "overlays",
        "falling",
        f"{caption} Every model of the table; shaded: stretches of the largest residual.",
        lambda theme: interactive.overlay(compared, theme=theme),
    )
    yield Entry(
        "coasting",
        "falling",
        caption,
        lambda theme: interactive.coasting(c.judged, theme=theme),
        lambda theme: static.coasting(c.judged, theme=theme),
    )
    yield Entry(
        "simulated",
        "falling",
        caption,
        lambda theme: interactive.simulated(c.judged, theme=theme),
        lambda theme: static.simulated(c.judged, theme=theme),
    )


def _residuals(c: Content) -> Iterator[Entry]:
    """Residuals of the model, all coefficients estimated again on the recording."""
    d, where = c.diagnosis, c.diagnosis.where
    caption = f"All coefficients estimated again on {c.recording.name or 'the recording'}."
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
        f"{caption} Below {where.band:.3g} Hz, the highest frequency at which the reference serves as one.",
        lambda theme: interactive.regions(where, theme=theme),
        lambda theme: static.regions(where, theme=theme),
    )
    yield Entry("residual", "where", caption, lambda theme: interactive.accel_residual(where, theme=theme))
    yield Entry(
        "one_step",
        "where",
        caption,
        lambda theme: interactive.one_step(where, theme=theme),
        lambda theme: static.one_step(where, theme=theme),
    )
    yield Entry("spectrum", "where", caption, lambda theme: interactive.spectrum(d.fit, where, d.channels, theme=theme))
    yield Entry(
        "whiteness",
        "where",
        caption,
        lambda theme: interactive.whiteness_plot(where, theme=theme),
        lambda theme: static.autocorrelation(where, theme=theme),
    )
    yield Entry("quantiles", "where", caption, lambda theme: interactive.quantile_plot(where, theme=theme))


def _response(c: Content) -> Iterator[Entry]:
    """Sensitivity by frequency, where the motion is one of sine steps."""
    found = c.response
    if found is not None:
        yield Entry(
            "sensitivity",
            "response",
            f"{found.recording or 'Recording'}, with U (k = 2). Deviation: measured − parametric fit.",
            lambda theme: interactive.sensitivity(found, theme=theme),
            lambda theme: sensitivity(found, theme=theme),
        )


def _parameters(c: Content) -> Iterator[Entry]:
    """Estimates over time, where they could be tracked."""
    followed = c.track
    if followed is not None:
        yield Entry(
            "tracks",
            "parameters",
            "Estimates from the readings up to each instant; noise and smoothed motion from the whole record.",
            lambda theme: interactive.tracks(followed, theme=theme),
        )


def _data(c: Content) -> Iterator[Entry]:
    """The recording, and the effects that it can detect."""
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
        "In addition to the effects of the model.",
        lambda theme: interactive.detectable_sizes(seen, theme=theme),
    )
    if seen.drift is not None:
        drift = seen.drift
        yield Entry(
            "drift_limits",
            "data",
            "Detectable drift bandwidth: smallest sinusoidal change of bias and scale factor at 5 sigma.",
            lambda theme: interactive.drift_limits(drift, theme=theme),
        )
    yield Entry(
        "signatures",
        "apart",
        "Each effect with the shape parameters at which it is detected best.",
        lambda theme: interactive.signatures(seen, first, theme=theme),
    )
