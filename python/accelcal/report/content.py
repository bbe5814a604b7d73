"""Everything that a report contains, computed once through the public functions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from accelcal._support.progress import within
from accelcal._support.threads import Report, on_two_threads, one_thread
from accelcal.calibration.apply import Application, example
from accelcal.calibration.budget import Budget, budget
from accelcal.data.recording import Recording
from accelcal.data.summary import describe
from accelcal.diagnosis.verdict import Diagnosis
from accelcal.effects import Effect
from accelcal.estimation.estimate import Fit
from accelcal.estimation.parameter_tracks import Track, track
from accelcal.estimation.shape_functions import Shape, shapes
from accelcal.experiment import Power, power
from accelcal.plots.timeline import Marks, marks
from accelcal.response import FrequencyResponse, stepped_response
from accelcal.selection.nested_models import NestedFits, nested_fits
from accelcal.validation.comparison import HELD_OUT, Evaluation
from accelcal.validation.differences import Comparison
from accelcal.workflow import MOST_AT_ONCE, compare, diagnose

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
    """Summary of `recording`, from `accelcal.data.summary.describe`."""
    budget: Budget
    applied: Application | None
    """A worked example; None where the model cannot be inverted."""
    nested: Comparison | None
    """Base of the model, then one more effect at a time, then effects that it lacks."""
    lacking: int
    """Number of models at the end of `nested` with effects that the model lacks."""
    power: Power | None
    track: Track | None
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


@one_thread
def gather(
    fit: Fit,
    recording: Recording,
    *,
    holdout: Recording | None = None,
    extra: Sequence[Effect] | None = None,
    command: str = "",
    diagnosis: Diagnosis | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> Content:
    """Compute everything that a report contains.

    Parameters
    ----------
    fit : the model, as a model file holds it.
    recording : to evaluate it on, the fitted recording or another.
    holdout : unseen recording for the error reduction; by default the last 30 % of `recording`.
    extra : users' effects to consider besides the built-in catalogue; by default all that are registered.
    command : that made the report; printed under provenance.
    diagnosis : of `fit` on `recording`, where there is one already.
    progress : called with the share of the work that is done, 0 to 1.

    Raises
    ------
    NotIdentifiable, RecordingError
        If the model cannot be evaluated on the recording at all.
    """
    remarks: list[str] = []

    def attempt(what: str, work: Callable[[], T]) -> T | None:
        try:
            return work()
        except ValueError as error:
            remarks.append(f"{what} could not be computed: {error}")
            return None

    def judge(progress: Report) -> Evaluation:
        if holdout is None:
            return compare(fit, recording, start=start, end=end, progress=progress)[0]
        return compare(fit, holdout, progress=progress)[0]

    def see(progress: Report) -> Power | None:
        return attempt(
            "the detection limits",
            lambda: power(fit, recording, extra=extra, start=start, end=end, progress=progress),
        )

    def nest() -> tuple[NestedFits, Comparison]:
        split = end if holdout is not None else end - HELD_OUT * (end - start)
        missing, refit = found.scan.found, holdout is None
        grown = nested_fits(fit, [recording], missing, start=start, end=split, refit=refit)
        if holdout is not None:
            return grown, compare(grown.fits, holdout, names=grown.names)
        seen = compare(grown.fits, recording, names=grown.names, start=split, end=end)
        return grown, replace(seen, same_run=True)

    def reduce(progress: Report) -> tuple[NestedFits, Comparison] | None:
        return attempt("the error reduction", nest)

    def follow(progress: Report) -> Track | None:
        return attempt("the parameter tracks", lambda: track(fit, recording, start=start, end=end))

    def respond(progress: Report) -> FrequencyResponse | None:
        whole = recording.part(start, end) if found.breaks else recording
        return attempt("the frequency response", lambda: stepped_response(whole))

    found = diagnosis or diagnose(fit, recording, extra=extra, progress=within(progress, 0.0, 0.35))
    progress(0.35)
    start, end = found.used[0]
    reduced, seen, followed, response, judged = on_two_threads(
        (reduce, see, follow, respond, judge),
        within(progress, 0.35, 1.0),
        at_once=len(recording.accel) + len(recording.position) <= MOST_AT_ONCE,
    )
    grown, nested = reduced or (None, None)
    named = shapes(fit) or (shapes(nested.fits[-1]) if nested is not None else ())
    remarks += [] if grown is None else [one.sentence for one in grown.remarks]
    digest = (recording if holdout is None else holdout).digest
    return Content(
        fit=fit,
        recording=recording,
        holdout=holdout,
        diagnosis=found,
        judged=judged,
        unseen=digest not in {run.digest for run in fit.runs},
        marks=marks(recording),
        described=describe(recording),
        budget=budget(fit),
        applied=attempt("the worked example", lambda: example(fit)),
        nested=nested,
        lacking=0 if grown is None else grown.lacking,
        power=seen,
        track=followed,
        shapes=named,
        response=response,
        remarks=tuple(sorted(remarks)),
        command=command,
    )
