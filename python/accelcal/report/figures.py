"""Figures of a report, with section and caption."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from accelcal.plots import bins, comparison, diagnosis, limits, residuals, timeline, tracks
from accelcal.plots.figure import Figure
from accelcal.plots.numbers import nested_comparisons
from accelcal.plots.response import sensitivity
from accelcal.report.content import Content


@dataclass(frozen=True, slots=True)
class Entry:
    """One figure of a report."""

    name: str
    section: str
    caption: str
    figure: Figure
    still: Figure | None = None
    """What pages without script and the PDF show; None where only the interactive page has the figure."""


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


def _both(name: str, section: str, caption: str, figure: Figure) -> Entry:
    """A figure that all pages show."""
    return Entry(name, section, caption, figure, figure)


def _overlay(c: Content) -> Entry:
    """The first figure: what was measured and what this calibration says."""
    model = [("this calibration", c.judged)]
    caption = f"{c.judged.recording or 'Recording'}, {use_of(c)}. Residual: measured − simulated."
    return Entry("overlay", "first", caption, timeline.overlay(model), timeline.closely(model))


def _findings(c: Content) -> Iterator[Entry]:
    """Findings: the candidates, and a fitted curve where the model contains one."""
    said = (
        "Ordered by evidence, free coefficients penalised. Filled: significant; bracketed: confounded on this record."
    )
    yield _both("candidates", "found", said, diagnosis.ranking(c.diagnosis))
    if c.shapes:
        said = "Nonparametric curve of the model, with its pointwise uncertainty."
        yield Entry("shape", "found", said, tracks.fitted_curve(c.shapes))


def _error_reduction(c: Content) -> Iterator[Entry]:
    """Error reduction by each effect, on unseen data where there are any."""
    nested, compared = c.nested, [("model", c.judged)]
    caption = f"{c.judged.recording or 'Recording'}: {use_of(c)}."
    if nested is not None:
        said = "" if all(member.in_model for member in nested.models) else "Hatched: effect not in the model yet."
        yield _both("falling", "falling", said, diagnosis.error_reduction(nested))
        compared = nested_comparisons(nested)
    said = f"{caption} Every model of the table; shaded: stretches of the largest residual."
    yield Entry("overlays", "falling", said, timeline.overlay(compared))
    yield _both("coasting", "falling", caption, comparison.coasting(c.judged))
    yield _both("simulated", "falling", caption, comparison.simulated(c.judged))


def _residuals(c: Content) -> Iterator[Entry]:
    """Residuals of the model, all coefficients estimated again on the recording."""
    d, where = c.diagnosis, c.diagnosis.where
    caption = f"All coefficients estimated again on {c.recording.name or 'the recording'}."
    band = f"{caption} Below {where.band:.3g} Hz, the highest frequency at which the reference serves as one."
    yield _both("tiles", "where", caption, bins.tiles(where))
    yield _both("regions", "where", band, bins.regions(where))
    yield Entry("residual", "where", caption, comparison.accel_residual(where))
    yield _both("one_step", "where", caption, comparison.one_step(where))
    yield Entry("spectrum", "where", caption, residuals.spectrum(d.fit, where, d.channels))
    yield Entry("whiteness", "where", caption, residuals.whiteness_plot(where), residuals.autocorrelation(where))
    yield Entry("quantiles", "where", caption, residuals.quantile_plot(where))


def _response(c: Content) -> Iterator[Entry]:
    """Sensitivity by frequency, where the motion is one of sine steps."""
    if c.response is not None:
        said = f"{c.response.recording or 'Recording'}, with U (k = 2). Deviation: measured − parametric fit."
        yield _both("sensitivity", "response", said, sensitivity(c.response))


def _parameters(c: Content) -> Iterator[Entry]:
    """Estimates over time, where they could be tracked."""
    if c.track is not None:
        said = "Estimates from the readings up to each instant; noise and smoothed motion from the whole record."
        yield Entry("tracks", "parameters", said, tracks.tracks(c.track))


def _data(c: Content) -> Iterator[Entry]:
    """The recording, and the effects that it can detect."""
    yield Entry("timeline", "data", "The whole recording.", timeline.timeline(c.recording, c.marks))
    if c.power is None:
        return
    first = [candidate.effect for candidate in c.diagnosis.scan.candidates[:6]]
    said = "In addition to the effects of the model."
    yield Entry("power", "data", said, limits.detectable_sizes(c.power))
    if c.power.drift is not None:
        said = "Detectable drift bandwidth: smallest sinusoidal change of bias and scale factor at 5 sigma."
        yield Entry("drift_limits", "data", said, limits.drift_limits(c.power.drift))
    said = "Each effect with the shape parameters at which it is detected best."
    yield Entry("signatures", "apart", said, limits.signatures(c.power, first))
