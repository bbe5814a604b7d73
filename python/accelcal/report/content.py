"""Everything that a report contains, of one output or of three, computed once through the public functions."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, TypeVar

from accelcal._support.process import one_thread, parts_of, within
from accelcal.calibration.characteristic import Application, Budget, budget, example
from accelcal.data import Recording, RecordingError, describe
from accelcal.diagnosis.experiment.detectability import Power
from accelcal.diagnosis.experiment.power_analysis import detectability_of, with_drift
from accelcal.diagnosis.select.improvement import NestedFits, nested_fits
from accelcal.diagnosis.verdict import Diagnosis
from accelcal.effects import Effect
from accelcal.estimation.estimate import Fit, solve_runs
from accelcal.estimation.tracks import Path, Shape, Track, paths_of, shapes, track_of
from accelcal.plots import comparison, diagnosis, residuals, timeline
from accelcal.plots.figure import Figure
from accelcal.plots.response import sensitivity
from accelcal.plots.timeline import Marks, marks
from accelcal.response import FrequencyResponse, stepped_response
from accelcal.validation.comparison import HELD_OUT, Evaluation
from accelcal.validation.differences import Comparison
from accelcal.verbs import compare, diagnose

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Content:
    """Results that a report shows."""

    fit: Fit
    recording: Recording
    holdout: Recording | None
    diagnosis: Diagnosis
    """Of the model on `recording`."""
    judged: Evaluation
    """Of the model as stored in its file, with unseen data where there are any."""
    unseen: bool
    """Whether `judged` is on data that the fit has not used."""
    marks: Marks
    described: dict[str, Any]
    """Summary of `recording`, from `accelcal.data.quality.describe`."""
    budget: Budget
    applied: Application | None
    """A worked example; None where the model cannot be inverted."""
    nested: Comparison | None
    """Base of the model, then one more effect at a time, then effects that it lacks."""
    lacking: int
    """Number of models at the end of `nested` with effects that the model lacks."""
    power: Power | None
    track: Track | None
    paths: tuple[Path, ...]
    shapes: tuple[Shape, ...]
    response: FrequencyResponse | None
    """Of `recording`; None where its motion is not one of sine steps."""
    remarks: tuple[str, ...]
    """What could not be computed, and why."""
    command: str = ""

    @property
    def is_part(self) -> bool:
        """Whether `judged` is on a part of a recording that the fit has used, or on all of it."""
        session = (self.recording if self.holdout is None else self.holdout).session
        return bool(session) and session in {run.session for run in self.fit.runs}


@dataclass(frozen=True, slots=True)
class AxesContent:
    """Results of each output of a sensor with three, which one page shows side by side."""

    fit: Fit
    by_axis: Mapping[str, Content]
    judged: Mapping[str, Evaluation]
    """As `judged` of each output, in the band in which the reference serves for all of them."""


@one_thread
def gather(
    fit: Fit,
    recording: Recording | Sequence[Recording],
    *,
    holdout: Recording | Sequence[Recording] | None = None,
    extra: Sequence[Effect] | None = None,
    command: str = "",
    diagnosis: Any = None,
    progress: Callable[[float], None] = lambda share: None,
) -> Content | AxesContent:
    """Compute everything that a report contains.

    Parameters
    ----------
    fit : the model, as a model file holds it.
    recording : to evaluate it on, the fitted recording or another; of three outputs all, from `load_axes`.
    holdout : unseen recording for the error reduction; by default the last 30 % of `recording`. Of three outputs all.
    extra : users' effects to consider besides the built-in catalogue; by default all that are registered.
    command : that made the report; printed under provenance.
    diagnosis : of `fit` on `recording`, where there is one already.
    progress : called with the share of the work that is done, 0 to 1.

    Raises
    ------
    NotIdentifiable, RecordingError
        If the model cannot be evaluated on the recording at all, or the outputs held out are others.
    """
    recordings = [recording] if isinstance(recording, Recording) else list(recording)
    several = [holdout] if isinstance(holdout, Recording) else list(holdout or ())
    axes = [run.axis for run in recordings]
    if not axes or len({*axes}) < len(axes) or (several and [run.axis for run in several] != axes):
        raise RecordingError(
            f"report: on {', '.join(run.name for run in recordings) or 'nothing'}, held out "
            f"{', '.join(run.name for run in several) or 'nothing'}; expected one recording with every output, and "
            "at most one held out with the same outputs"
        )
    begun = 0.4 if len(axes) > 1 else 0.0
    if len(axes) > 1 and diagnosis is None:
        diagnosis = diagnose(fit, recordings, extra=extra, progress=within(progress, 0.0, begun))
    contents = [
        gather_output(
            fit.of_axis(run.axis),
            run,
            several[k] if several else None,
            diagnosis[run.axis] if len(axes) > 1 else diagnosis,
            part,
            extra=extra,
            command=command,
        )
        for k, (run, part) in enumerate(zip(recordings, parts_of(progress, len(axes), begun), strict=True))
    ]
    if len(contents) == 1:
        return contents[0]
    alike = compare(fit, several or recordings, band=min(content.judged.band for content in contents)).evaluations
    return AxesContent(
        fit,
        dict(zip(axes, contents, strict=True)),
        {axis: evaluation for axis, (evaluation,) in zip(axes, alike, strict=True)},
    )


def gather_output(
    fit: Fit,
    recording: Recording,
    holdout: Recording | None,
    diagnosis: Diagnosis | None,
    progress: Callable[[float], None],
    *,
    extra: Sequence[Effect] | None,
    command: str,
) -> Content:
    """`gather` for one output."""
    remarks: list[str] = []

    def attempt(what: str, work: Callable[[], T]) -> T | None:
        try:
            return work()
        except ValueError as error:
            remarks.append(f"{what} could not be computed: {error}")
            return None

    verdict_found = diagnosis or diagnose(fit, recording, extra=extra, progress=within(progress, 0.0, 0.35))
    progress(0.35)
    span: dict[str, Any] = dict(zip(("start", "end"), verdict_found.used[0], strict=True))
    whole = recording.part(*verdict_found.used[0]) if verdict_found.breaks else recording
    unseen, judged_in = (recording, span) if holdout is None else (holdout, {})
    judged = compare(fit, unseen, progress=within(progress, 0.35, 0.45), **judged_in)[0]
    reduced = attempt("the error reduction", lambda: error_reduction(fit, recording, holdout, verdict_found))
    progress(0.65)
    solution = attempt(
        "the parameter tracks and the detection limits",
        lambda: solve_runs(fit.model, [recording], origins=fit.origins, engine=fit.engine, **span),
    )
    followed = evaluation = None
    moving = () if solution is None else attempt("the paths of coefficients", lambda: paths_of(solution)) or ()
    if solution is not None:
        state, followed = solution.states[0], attempt("the parameter tracks", lambda: track_of(solution))
        evaluation = attempt("the detection limits", lambda: with_drift(detectability_of(state, fit.model, extra)))
    progress(0.95)
    response = attempt("the frequency response", lambda: stepped_response(whole))
    grown, nested = reduced or (None, None)
    named = shapes(fit) or (shapes(nested.fits[-1]) if nested is not None else ())
    remarks += [] if grown is None else [note.sentence for note in grown.remarks]
    return Content(
        fit=fit,
        recording=recording,
        holdout=holdout,
        diagnosis=verdict_found,
        judged=judged,
        unseen=unseen.digest not in {run.digest for run in fit.runs},
        marks=marks(recording),
        described=describe(recording),
        budget=budget(fit),
        applied=attempt("the worked example", lambda: example(fit)),
        nested=nested,
        lacking=0 if grown is None else grown.lacking,
        power=evaluation,
        track=followed,
        paths=moving,
        shapes=named,
        response=response,
        remarks=tuple(sorted(remarks)),
        command=command,
    )


def error_reduction(
    fit: Fit, recording: Recording, holdout: Recording | None, comparison: Diagnosis
) -> tuple[NestedFits, Comparison]:
    """Base of a model, then one more effect at a time, then those that it lacks, compared on unseen data: the held-out
    recording, or the end of its own, to which none of them is fitted then."""
    start, end = comparison.used[0]
    split = end if holdout is not None else end - HELD_OUT * (end - start)
    grown = nested_fits(fit, [recording], comparison.scan.detected, start=start, end=split, refit=holdout is None)
    if holdout is not None:
        return grown, compare(grown.fits, holdout, names=grown.names)
    return grown, replace(compare(grown.fits, recording, names=grown.names, start=split, end=end), same_run=True)


@dataclass(frozen=True, slots=True)
class Entry:
    """One figure of a report."""

    name: str
    section: str
    caption: str
    figure: Callable[[], Figure]
    still: Callable[[], Figure] | None = None
    """What pages without script and the PDF show; None where only the interactive page has the figure."""


def use_of(c: Content) -> str:
    """What the fit has used of the data that the model is judged on."""
    if not c.unseen:
        return "the fitted recording"
    return "a part not used in the fit" if c.is_part else "not used in the fit"


def _both(name: str, section: str, caption: str, figure: Callable[[], Figure]) -> Entry:
    """A figure that all pages show."""
    return Entry(name, section, caption, figure, figure)


def low(figure: Callable[[], Figure]) -> Figure:
    """A figure of a printed first page, which it shares with all else."""
    return figure().scaled(LOW)


LOW = 0.55
"""Height of the panels of such a figure, over that on a screen."""


def entries(c: Content | AxesContent) -> Iterator[Entry]:
    """Every figure that the content allows, in the order of the page."""
    if isinstance(c, AxesContent):
        residual, drift = partial(comparison.residual_of_axes, c.judged), partial(comparison.coasting_of_axes, c.judged)
        yield from (
            _both("residuals", "axes", "Measured − simulated, in one band.", residual),
            _both("drifts", "axes", "One ordinate for all outputs.", drift),
        )
        for axis, content in c.by_axis.items():
            for entry in entries(content):
                yield replace(entry, name=f"{entry.name}-{axis}", section=f"{entry.section}-{axis}")
        return
    yield from _of_the_model(c)
    yield from _of_errors(c)
    yield from _of_the_data(c)


def _of_the_model(c: Content) -> Iterator[Entry]:
    """The first page, and what was found to be missing."""
    model = [("this calibration", c.judged)]
    caption = f"{c.judged.recording or 'Recording'}, {use_of(c)}. Residual: measured − simulated."
    yield Entry(
        "overlay", "first", caption, partial(timeline.overlay, model), partial(low, partial(timeline.closely, model))
    )
    drawn: Callable[[], Figure] | None = None
    if c.nested is not None and len(c.nested) > 1:
        reading = "Both without what the model before takes up; a right effect lies on a line of slope 1."
        drawn = partial(diagnosis.added_variables, c.nested)
    elif c.diagnosis.verdict in ("named", "tied"):
        reading = "Both without what the model takes up; a right effect lies on a line."
        drawn = partial(diagnosis.added_variable, c.diagnosis)
    if drawn is not None:
        yield Entry("evidence", "first", reading, drawn, partial(low, drawn))
    yield _both(
        "candidates",
        "found",
        "Ordered by evidence, free coefficients penalised. Filled: significant; bracketed: confounded on this record.",
        partial(diagnosis.ranking, c.diagnosis),
    )
    if c.shapes:
        yield Entry(
            "shape",
            "found",
            "Nonparametric curve of the model, with its pointwise uncertainty.",
            partial(timeline.fitted_curve, c.shapes),
        )


def _of_errors(c: Content) -> Iterator[Entry]:
    """How errors fall, and where the model fails."""
    nested, compared = c.nested, [("model", c.judged)]
    caption = f"{c.judged.recording or 'Recording'}: {use_of(c)}."
    if nested is not None:
        yield _both(
            "falling",
            "falling",
            "Hatched: effect not in the model yet." if c.lacking else "",
            partial(diagnosis.error_reduction, nested, lacking=c.lacking),
        )
        compared = list(zip(nested.names, nested, strict=True))
    every = f"{caption} Every model of the table; shaded: stretches of the largest residual."
    d, where = c.diagnosis, c.diagnosis.where
    anew = f"All coefficients estimated again on {c.recording.name or 'the recording'}."
    band = f"{anew} Below {where.band:.3g} Hz, the highest frequency at which the reference serves as one."
    whiteness, lags = partial(residuals.whiteness_plot, where), partial(residuals.autocorrelation, where)
    yield from (
        Entry("overlays", "falling", every, partial(timeline.overlay, compared)),
        _both("coasting", "falling", caption, partial(comparison.coasting, c.judged)),
        _both("simulated", "falling", caption, partial(comparison.simulated, c.judged)),
        _both("tiles", "where", anew, partial(residuals.tiles, where)),
        _both("regions", "where", band, partial(residuals.regions, where)),
        Entry("residual", "where", anew, partial(comparison.accel_residual, where)),
        _both("one_step", "where", anew, partial(comparison.one_step, where)),
        Entry("spectrum", "where", anew, partial(residuals.spectrum, d.fit, where, d.channels)),
        Entry("whiteness", "where", anew, whiteness, lags),
        Entry("quantiles", "where", anew, partial(residuals.quantile_plot, where)),
    )


def _of_the_data(c: Content) -> Iterator[Entry]:
    """Sensitivity, parameters over time, the recording, and what it can show."""
    if c.response is not None:
        yield _both(
            "sensitivity",
            "response",
            f"{c.response.recording or 'Recording'}, with U (k = 2). Deviation: measured − parametric fit.",
            partial(sensitivity, c.response),
        )
    if c.paths:
        yield Entry(
            "paths",
            "parameters",
            "Coefficients that processes and mechanisms of the model move, and what they follow best.",
            partial(timeline.paths, c.paths),
        )
    if c.track is not None:
        yield Entry(
            "tracks",
            "parameters",
            "Estimates from the readings up to each instant; noise and smoothed motion from the whole record.",
            partial(timeline.tracks, c.track),
        )
    yield Entry("timeline", "data", "The whole recording.", partial(timeline.timeline, c.recording, c.marks))
    if c.power is None:
        return
    first = [candidate.effect for candidate in c.diagnosis.scan.candidates[:6]]
    yield Entry(
        "power",
        "data",
        "In addition to the effects of the model.",
        partial(diagnosis.detectable_sizes, c.power),
    )
    if c.power.drift is not None:
        yield Entry(
            "drift_limits",
            "data",
            "Detectable drift bandwidth: smallest sinusoidal change of bias and scale factor at 5 sigma.",
            partial(diagnosis.drift_limits, c.power.drift),
        )
    yield Entry(
        "signatures",
        "apart",
        "Each effect with the shape parameters at which it is detected best.",
        partial(diagnosis.signatures, c.power, first),
    )
