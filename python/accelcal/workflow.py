"""The loop: fit, diagnose, add, refit, and watch the error fall on data that no fit has seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from accelcal._support.threads import one_thread
from accelcal.data.recording import Recording
from accelcal.diagnosis.noise_tests.run_all import run_noise_tests
from accelcal.diagnosis.outlier_rejection import RejectedReadings, clean_fit, outliers_found
from accelcal.diagnosis.search.hypotheses import finer
from accelcal.diagnosis.search.scan import ALPHA, scan
from accelcal.diagnosis.verdict import Diagnosis, TimeSpan, verdict_on, within
from accelcal.effects import Effect, find
from accelcal.estimation.estimate import Fit, restored_states, result, solve_runs
from accelcal.estimation.estimate import fit as fit_all
from accelcal.estimation.gauss_newton import NotIdentifiable, Solution
from accelcal.model import Model
from accelcal.selection.improvement import History, Improvement, Step
from accelcal.selection.stepwise import StepwiseSelection
from accelcal.signals.signals import Origins
from accelcal.validation.comparison import HELD_OUT
from accelcal.validation.evaluation import compare

MOST_EFFECTS = 3
"""Effects that `improve` adds unless told otherwise."""


@one_thread
def diagnose(
    fit: Fit,
    recordings: Recording | Sequence[Recording],
    *,
    extra: Sequence[Effect] = (),
    alpha: float = ALPHA,
    start: float | None = None,
    end: float | None = None,
    report: Callable[[float], None] = lambda share: None,
) -> Diagnosis:
    """Say which physical effect a model lacks on a recording, if any.

    Parameters
    ----------
    fit : the model; on another recording than its own all coefficients are profiled anew.
    recordings : one or several runs.
    extra : effects of the user's own, beside the catalogue.
    alpha : family-wise false-alarm rate.
    start, end : s, optional; only this part is used.
    report : called with the share of the work that is done, 0 to 1.

    Raises
    ------
    NotIdentifiable
        If the motion does not excite what the model already contains.
    """
    several = [recordings] if isinstance(recordings, Recording) else list(recordings)
    stretch = TimeSpan.of(several[0], start, end)
    report(0.1)

    def solve(these: Sequence[Recording]) -> Solution:
        return solve_runs(
            fit.model, these, start=stretch.start, end=stretch.end, origins=fit.origins, report=within(report, 0.1, 0.3)
        )

    state = clean_fit(several, solve)
    judged = verdict_on(state, stretch, extra, alpha, within(report, 0.35, 1.0))
    return replace(judged, dropped=state.dropped(several))


@one_thread
def fit(
    model: Model,
    recordings: Recording | Sequence[Recording],
    *,
    start: float | None = None,
    end: float | None = None,
    band: float | None = None,
    origins: Origins | None = None,
    report: Callable[[float], None] = lambda share: None,
) -> Fit:
    """Fit a model as `accelcal.fit` does, but without wild readings, which the remarks of the fit count.

    Parameters and errors are those of :func:`accelcal.fit`.
    """
    several = [recordings] if isinstance(recordings, Recording) else list(recordings)
    every = fit_all(model, several, start=start, end=end, band=band, origins=origins, report=within(report, 0.0, 0.8))
    return without_outliers(every, several, start=start, end=end, band=band)


def without_outliers(
    fit: Fit,
    recordings: Sequence[Recording],
    *,
    start: float | None = None,
    end: float | None = None,
    band: float | None = None,
) -> Fit:
    """The fit made again without wild readings; the fit itself where there are none."""
    passes = restored_states(fit, recordings)
    if passes is not None and not any(outliers_found(run_noise_tests(one)) for one in passes):
        return fit

    def solve(these: Sequence[Recording]) -> Solution:
        return solve_runs(fit.model, these, start=start, end=end, band=band, origins=fit.origins)

    state = clean_fit(recordings, solve)
    dropped = state.dropped(recordings)
    if not dropped:
        return fit
    kept = result(state.solution)
    return replace(kept, remarks=(*(f"{one.sentence}." for one in dropped), *kept.remarks))


@one_thread
def add(
    fit: Fit,
    recordings: Recording | Sequence[Recording],
    *names: str,
    extra: Sequence[Effect] = (),
    report: Callable[[float], None] = lambda share: None,
) -> Fit:
    """Return a new fit with further effects, without wild readings; shape parameters are found by likelihood.

    Parameters
    ----------
    fit, recordings : the model, and what it is fitted to again.
    names : effects to add, in this order.
    extra : effects of the user's own.
    report : called with the share of the work that is done, 0 to 1.

    Raises
    ------
    ValueError
        If an effect is unknown, already in the model, or cannot be evaluated on the recording.
    """
    several = [recordings] if isinstance(recordings, Recording) else list(recordings)
    model, passes = fit.model, restored_states(fit, several)
    for name in names:
        effect = find(name)
        if name in model.effects and not finer(model, effect):
            raise ValueError(f"{name!r} is already in the model")
        if passes is None or model is not fit.model:
            passes = solve_runs(model, several, origins=fit.origins, report=within(report, 0.0, 0.4)).passes
        alone = scan(passes, model, extra=extra, only=(effect,), report=within(report, 0.4, 0.6))
        if not alone.entered:
            lacking = [n for n in effect.needs if n not in several[0].side]
            why = "this record does not excite it; `accelcal power` says what it can see"
            if lacking:
                why = f"it needs the channel {' and '.join(lacking)}; record it, or name its column in the sidecar"
            if effect.beside and effect.beside not in model.effects:
                why = f"it is sought beside {effect.beside}; add that first"
            raise ValueError(f"{name!r} cannot be added: {why}")
        model = alone.entered[0].enter(model)
    grown = result(solve_runs(model, several, origins=fit.origins, report=within(report, 0.6, 0.9)))
    return without_outliers(grown, several)


@one_thread
def drop(
    fit: Fit,
    recordings: Recording | Sequence[Recording],
    *names: str,
    report: Callable[[float], None] = lambda share: None,
) -> Fit:
    """Return a new fit without some effects, and without wild readings.

    `report` is called with the share of the work that is done, 0 to 1.
    """
    several = [recordings] if isinstance(recordings, Recording) else list(recordings)
    left = result(solve_runs(fit.model.drop(*names), several, origins=fit.origins, report=within(report, 0.0, 0.9)))
    return without_outliers(left, several)


def history(fits: Sequence[Fit], recording: Recording) -> History:
    """Compare several models with one recording: the falling error.

    Raises
    ------
    ValueError
        If there is no model.
    """
    if not fits:
        raise ValueError("a history needs at least one model; give the fits in the order of their story")
    return History(tuple(fits), tuple(compare(one, recording) for one in fits))


@one_thread
def improve(
    recordings: Recording | Sequence[Recording],
    *,
    holdout: Recording | None = None,
    most: int = MOST_EFFECTS,
    extra: Sequence[Effect] = (),
    alpha: float = ALPHA,
    start: float | None = None,
    end: float | None = None,
    report: Callable[[float], None] = lambda share: None,
) -> Improvement:
    """Fit the base model, diagnose, add the effect that is missing, refit, until nothing is missing.

    Parameters
    ----------
    recordings : one or several runs to learn from.
    holdout : a run to show the falling error on; by default the last 30 % of the first run, which then is not fitted.
    most : most effects to add.
    extra : effects of the user's own.
    alpha : family-wise false-alarm rate.
    start, end : s, optional; only this part of the recordings is used.
    report : called with the share of the work that is done.
    """
    original = [recordings] if isinstance(recordings, Recording) else list(recordings)
    same_run = holdout is None
    stretch = TimeSpan.of(original[0], start, end)
    begin, finish = stretch.start, stretch.end
    split = finish - HELD_OUT * (finish - begin) if same_run else finish
    walk = StepwiseSelection.begin(original, stretch, split, extra, alpha)
    report(0.3)
    for number in range(2 * most):
        room = len(walk.story.effects) < most
        if not (room and walk.step()) and not walk.mend():
            break
        report(min(0.9, 0.3 + 0.6 * (number + 1) / most))
    walk.finish()
    verdict, state = walk.at.verdict, walk.at.state
    dropped = state.dropped(original)
    test = original[0] if holdout is None else holdout
    test_begin, test_end = (split, finish) if same_run else (None, None)
    if dropped:
        test, lost = clean_holdout(walk.fits[0][1].model, test, test_begin, test_end)
        dropped = (*dropped, *lost)
    steps = [
        Step(
            names,
            one,
            compare(one, state.recordings[0], start=begin, end=split),
            compare(one, test, start=test_begin, end=test_end),
        )
        for names, one in walk.fits
    ]
    told = replace(verdict, dropped=dropped)
    return Improvement(tuple(steps), told, tuple(walk.story.ties), walk.examined, same_run)


def clean_holdout(
    model: Model, recording: Recording, start: float | None, end: float | None
) -> tuple[Recording, tuple[RejectedReadings, ...]]:
    """Held-out data without their own wild readings, the same for every step; as they are where no fit is possible."""
    try:
        state = clean_fit([recording], lambda these: solve_runs(model, these, start=start, end=end))
    except (NotIdentifiable, ValueError):
        return recording, ()
    found = state.dropped([recording])
    return state.recordings[0], tuple(replace(d, recording=f"held out, {d.recording or 'recording'}") for d in found)
