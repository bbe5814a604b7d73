"""Verbs of the package: fit, diagnose, add, drop, improve, formulas, nested, compare, coast.

Readings that are known to be wrong are left out and jumps of the position found before anything else, and outliers are
rejected before every fit.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any, Literal, overload

from accelcal._support.arguments import checked
from accelcal._support.errors import AccelcalError
from accelcal._support.process import one_thread, parts_of, within
from accelcal._support.values import listing
from accelcal.data import DERIVED, Dwells, Positions, Recording, RecordingError
from accelcal.data.recording import with_dwells
from accelcal.diagnosis.checks import disturbance, slow_residual, stretches_of
from accelcal.diagnosis.clean_fit import CleanFit, RejectedReadings, clean_fit, run_outlier_tests
from accelcal.diagnosis.dwells import DwellDiagnosis, diagnose_dwells, entered
from accelcal.diagnosis.evidence import Evidence, largest_wave
from accelcal.diagnosis.faults import Examined, TimeSpan, examine
from accelcal.diagnosis.findings import NAMED_SURELY, Confounded, chosen, entry_sigmas, in_model
from accelcal.diagnosis.noise.fitted import noise_scores, require_noise_shown, with_noise_effects
from accelcal.diagnosis.noise.noise_test import POSITION_JUMPS
from accelcal.diagnosis.one_axis import require_motion_above_noise, require_one_axis
from accelcal.diagnosis.policy import FAMILYWISE_ALPHA, HELDOUT_RISE, SHOWN_SIGMA, VALIDATION_SIGMA
from accelcal.diagnosis.runs import RunValues, runs_disagree, values_by_run
from accelcal.diagnosis.search.beam import SearchRules
from accelcal.diagnosis.search.confounding import size_priors
from accelcal.diagnosis.search.hypotheses import hypotheses_for, lacks_its_position, may_be_refined
from accelcal.diagnosis.search.refine import with_likely_processes
from accelcal.diagnosis.search.scan import Scan, scan
from accelcal.diagnosis.select.curve_formulas import FormulaSet, formulas_of
from accelcal.diagnosis.select.improvement import Improvement, Step, contradicted, nested_fits
from accelcal.diagnosis.select.stepwise import SearchBudget, StepwiseSelection, solve
from accelcal.diagnosis.verdict import AxesDiagnosis, Diagnosis, diagnose_axes, verdict_on
from accelcal.effects import Effect, find, side_channels
from accelcal.estimation.engines import Method, engine_named
from accelcal.estimation.estimate import (
    DWELLS_ALONE,
    Fit,
    estimate,
    estimate_dwells,
    restored_states,
    result,
    solve_runs,
)
from accelcal.estimation.gauss_newton import Solution
from accelcal.estimation.remarks import Remark, remark
from accelcal.estimation.run import PreparedRun
from accelcal.estimation.run_fit import SEEN_BY_RUNS, run_to_hold_out
from accelcal.estimation.run_state import RunState
from accelcal.filters.choice import FilterChoice
from accelcal.model import BASE, Model, Prior
from accelcal.signals.signals import Origins
from accelcal.validation import evaluation
from accelcal.validation.comparison import HELD_OUT, HORIZONS, Coast, Evaluation, RmsInterval
from accelcal.validation.differences import Comparison, best_step, drift_spread, headline_horizon, names_of
from accelcal.validation.noise_floor import Ruler, error_budgets, noise_floor
from accelcal.validation.prediction import Prediction
from accelcal.validation.systematic import with_resolved

SETTLED, ROUNDS = 1e-3, 5
"""Gain of twice the log-likelihood below which intensities and time constants of several processes stay; rounds."""
MOST_EFFECTS = 3
"""Effects that `improve` adds at most by default."""


def model_in_motion(fit: Fit) -> Model:
    """The model of a fit for recordings of a motion: a fit to dwells alone holds the timing, which they do not show."""
    held = [name for name in BASE if name in fit.model.fixed and find(name).owner == "timing"]
    return fit.model.release(*held) if fit.method == DWELLS_ALONE else fit.model


def runs_of(recordings: Recording | Dwells | Sequence[Recording | Dwells | Positions]) -> list[Recording]:
    """Recordings of motions, dwells among them given to the first.

    Raises
    ------
    RecordingError
        If there is no motion.
    """
    several = with_dwells(recordings)
    if isinstance(several, Dwells):
        raise RecordingError(
            f"{several.name or 'dwells'}: dwells alone show no motion; only fit, diagnose, add, drop and freeze take "
            "them"
        )
    return several


@overload
def diagnose(fit: Fit, recordings: Dwells, *, alpha: float = FAMILYWISE_ALPHA) -> DwellDiagnosis: ...


@overload
def diagnose(
    fit: Fit,
    recordings: Recording | Sequence[Recording | Dwells | Positions],
    *,
    extra: Sequence[Effect] | None = None,
    alpha: float = FAMILYWISE_ALPHA,
    prior: Mapping[str, Prior] | Literal["none"] | None = None,
    start: float | None = None,
    end: float | None = None,
    progress: Callable[[float], None] = ...,
) -> Diagnosis: ...


@checked
@one_thread
def diagnose(
    fit: Fit,
    recordings: Recording | Dwells | Sequence[Recording | Dwells | Positions],
    *,
    extra: Sequence[Effect] | None = None,
    alpha: float = FAMILYWISE_ALPHA,
    prior: Mapping[str, Prior] | Literal["none"] | None = None,
    start: float | None = None,
    end: float | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> Diagnosis | DwellDiagnosis | AxesDiagnosis:
    """Say which physical effect a model lacks on a recording, or on static dwells alone, if any.

    Parameters
    ----------
    fit : the model; on another recording than its own all coefficients are profiled anew.
    recordings : one or several runs.
    extra : users' effects to consider besides the built-in ones; by default all that are registered (`load_effects`,
        `effect`, `from_expression`), with () none.
    alpha : family-wise false-alarm rate.
    prior : of effect sizes by name, as `Fleet.priors`, before those of the sidecar and of the catalogue; they make the
        second set of weights of confounded effects, which decides no name. With "none" there is no such set.
    start, end : s, optional; only this part is used.
    progress : called with the share of the work that is done, 0 to 1.

    Returns
    -------
    Verdict, ranked candidates, confounded effects and noise tests; its sentence sums them up.

    Raises
    ------
    NotIdentifiable
        If the motion does not excite what the model already contains.

    Examples
    --------
    >>> import numpy as np
    >>> import accelcal as ac
    >>> truth = {"bias": 0.05, "cubic": 1e-3}
    >>> rng = np.random.default_rng(1)
    >>> simulated = ac.simulate("interleaved", seconds=12.0, rig=ac.simulation.CXL02_RIG, parameters=truth, rng=rng)
    >>> fit = ac.fit(simulated.recording)
    >>> ac.diagnose(fit, simulated.recording).effects
    ('cubic',)
    """
    if isinstance(recordings, Dwells):
        return diagnose_dwells(fit, recordings, alpha=alpha)
    several = runs_of(recordings)
    if len({recording.axis for recording in several}) > 1:
        settings = {"extra": extra, "prior": prior, "start": start, "end": end}
        return diagnose_axes(fit, several, diagnose, progress, alpha=alpha, **settings)
    priors = size_priors(several, prior)
    examined = [examine(recording, start, end) for recording in several]
    if "scale_factor" not in fit.model.fixed:
        require_relation(examined)
    runs, stretch, broken = judged_runs(examined)
    progress(0.1)

    def solve(these: Sequence[PreparedRun]) -> Solution:
        return solve_runs(
            model_in_motion(fit),
            these,
            start=stretch.start,
            end=stretch.end,
            origins=fit.origins,
            others_whole=not stretch.chosen,
            engine=fit.engine,
            progress=within(progress, 0.1, 0.3),
        )

    def judge(fitted: CleanFit, stretch: TimeSpan) -> Diagnosis:
        return verdict_on(Evidence(fitted, stretch, extra, alpha, within(progress, 0.35, 1.0), priors=priors))

    fitted = clean_fit(runs, solve)
    judged = judge(fitted, stretch)
    if rest := undisturbed(runs, stretch, judged):
        runs, stretch = rest
        fitted = clean_fit(runs, solve)
        judged = judge(fitted, stretch)
    return replace(judged, dropped=fitted.rejected(runs), remarks=(*judged.remarks, *broken))


@checked
@one_thread
def formulas(
    fit: Fit,
    recording: Recording,
    curve: str,
    *,
    holdout: Recording | None = None,
    alpha: float = FAMILYWISE_ALPHA,
    progress: Callable[[float], None] = lambda share: None,
) -> FormulaSet:
    """Short formulas for what a nonparametric curve shows, and which of them a recording does not separate.

    Parameters
    ----------
    fit : the model; the curve itself is left out of it.
    recording : one run; all coefficients are profiled anew.
    curve : nonparametric function of one variable, such as "shape_of_velocity".
    holdout : a recording that takes no part in the choice; each formula is scored on it.
    alpha : probability by chance below which there is something to describe.
    progress : called with the share of the work that is done, 0 to 1.

    Returns
    -------
    Formulas with units and uncertainties; `Formula.effect` enters one, and `file` of its answer is its Python source.

    Raises
    ------
    ValueError
        If there is no such curve, or its variable does not change.
    NotIdentifiable
        If the motion does not excite what the model contains.

    Examples
    --------
    >>> import numpy as np
    >>> import accelcal as ac
    >>> truth = {"bias": 0.05, "cubic": 1e-3}
    >>> rng = np.random.default_rng(1)
    >>> simulated = ac.simulate("interleaved", seconds=12.0, rig=ac.simulation.CXL02_RIG, parameters=truth, rng=rng)
    >>> fit = ac.fit(simulated.recording)
    >>> ac.formulas(fit, simulated.recording, "shape_of_acceleration").variable
    'acceleration'
    """
    effect, model = find(curve), model_in_motion(fit)
    model = model.drop(curve) if curve in model.added else model

    def fitted(whole: Recording) -> RunState:
        (clear,), part, _ = judged_runs([examine(whole)])

        def solve(these: Sequence[PreparedRun]) -> Solution:
            plain = solve_runs(model, these, start=part.start, end=part.end, origins=fit.origins, engine=fit.engine)
            entered = scan(plain.states, model, only=(effect,)).entered
            if not entered:
                return plain
            grown = entered[0].enter(model)
            return solve_runs(grown, these, start=part.start, end=part.end, origins=fit.origins, engine=fit.engine)

        return clean_fit([clear], solve, test=run_outlier_tests).solution.states[0]

    other = None if holdout is None else (fitted(holdout), model)
    progress(0.0 if holdout is None else 0.3)
    state = fitted(recording)
    progress(0.6)
    return formulas_of(state, model, effect, holdout=other, alpha=alpha)


@checked
@one_thread
def fit(
    recordings: Recording | Dwells | Sequence[Recording | Dwells | Positions],
    model: Model | None = None,
    *,
    start: float | None = None,
    end: float | None = None,
    band: float | None = None,
    origins: Origins | None = None,
    reject_outliers: bool = True,
    method: Method | FilterChoice = "auto",
    progress: Callable[[float], None] = lambda share: None,
) -> Fit:
    """Fit a model to one or several recordings; samples that the noise of their channel does not allow are rejected.

    Parameters
    ----------
    recordings : one run, or several with one sensor; static dwells of it, alone (a tumble test) or with runs; the three
        outputs of `load_axes`, with static positions of all of them (`accelcal.io.load_positions`).
    model : what is to be estimated; by default bias, scale factor and time offset, `Model.linear()`.
    start, end : s, optional; only this part is used.
    band : bandwidth of the smoothed motion, Hz; by default the most likely one.
    origins : zero of time, position and side channels; by default those of the first recording, and the mean of each
        channel over all of them.
    method : "replay", a filter on position and velocity, or "weak", integrals against smooth test functions
        (derivations 6.15); both give the same estimates where the record is what it should be. "auto" takes the weak
        form where the reference is so good that it meets the noise of the output above a tenth of its sampling rate.
        A `FilterChoice` is one of the paper's live filters, run over one recording; it brings its own model.
    reject_outliers : if False, every sample is used, as in :func:`accelcal.estimation.estimate.estimate`.
    progress : called with the share of the work that is done, 0 to 1.

    Returns
    -------
    Estimates with their covariance. Its remarks say how many samples of each channel were rejected, and where the
    relation of the channels breaks: only what lies before is fitted, unless `start` or `end` is given.

    Raises
    ------
    NotIdentifiable
        If the motion does not excite a parameter.
    RecordingError
        If the recordings are of different sensors, or one of them cannot be used.

    Examples
    --------
    >>> import numpy as np
    >>> import accelcal as ac
    >>> truth, rng = {"bias": 0.05}, np.random.default_rng(1)
    >>> simulated = ac.simulate("tones", seconds=20.0, rig=ac.simulation.ADXL105_RIG, parameters=truth, rng=rng)
    >>> fit = ac.fit(simulated.recording)
    >>> abs(fit["bias"].value - 0.05) < 4 * fit["bias"].std
    True
    """
    engine = engine_named(method)
    if engine.alone:
        if not isinstance(recordings, Recording) or model is not None or band is not None or origins is not None:
            raise AccelcalError(
                "a live filter fits one recording with the model of its FilterChoice: leave out model, band and origins"
            )
        return estimate(engine.model, recordings, start=start, end=end, method=method)
    model = engine.model if model is None else model
    several = with_dwells(recordings)
    if isinstance(several, Dwells):
        return remembered(estimate_dwells(model, several, origins), recordings)
    examined = [examine(recording, start, end) for recording in several]
    if "scale_factor" not in model.fixed:
        require_relation(examined)
    runs, broken = used_runs(examined)
    settings = {"start": start, "end": end, "band": band, "origins": origins, "engine": engine}

    def in_agreement(these: Sequence[PreparedRun]) -> tuple[Fit, PreparedRun]:
        fitted_model, solution = fitted(model, these, progress, reject=reject_outliers, **settings)
        values = values_by_run(
            solution.states, fitted_model.model, [choice.instead for choice in fitted_model.seen_by_runs]
        )
        fitted_model = replace(fitted_model, remarks=(*broken, *fitted_model.remarks, *runs_disagree(values)))
        run = solution.states[0].run
        solution.states.clear()  # the prediction filters anew: one set of filters at a time
        return fitted_model, run

    return remembered(undisturbed_fit(runs, in_agreement) if reject_outliers else in_agreement(runs)[0], recordings)


def undisturbed_fit(
    runs: Sequence[PreparedRun], solve: Callable[[Sequence[PreparedRun]], tuple[Fit, PreparedRun]]
) -> Fit:
    """Fit without the stretches that its slow residual names as disturbed; its first remarks are on that residual."""
    fit, run = solve(runs)
    slow, disturbed = next(slow_residual(fit, run), None), None
    if slow is not None and slow.code == "disturbed":
        disturbed = slow
        fit, run = solve(without_stretches(runs, disturbed))
        slow = next(slow_residual(fit, run, stretches=False), None)
    remarks = tuple(remark for remark in (slow, disturbed) if remark is not None)
    tilt = fit.tilt if slow is None else float(slow.values["tilt_deg"])
    return replace(fit, tilt=tilt, remarks=(*remarks, *fit.remarks))


def remembered(fit: Fit, recordings: Recording | Dwells | Sequence[Recording | Dwells | Positions]) -> Fit:
    """The fit, for which `nested` finds its recordings again while both live."""
    several = [recordings] if isinstance(recordings, Recording | Dwells) else recordings
    _fitted_to[id(fit)] = [weakref.ref(recording) for recording in several]
    weakref.finalize(fit, _fitted_to.pop, id(fit), None).atexit = False
    return fit


_fitted_to: dict[int, list[weakref.ref[Recording | Dwells | Positions]]] = {}
"""Recordings of each fit that lives, by its identity."""


def require_relation(examined: Sequence[Examined]) -> None:
    """Refuse recordings at rest, and channels that are not one axis of one body.

    Raises
    ------
    NotIdentifiable, RecordingError
        With what was expected of them.
    """
    runs = [item.run for item in examined]
    require_motion_above_noise(runs)
    for run in runs:
        run.once("one axis", partial(require_one_axis, [run], start=run.asked[0], end=run.asked[1]))


def without_stretches(runs: Sequence[PreparedRun], disturbed: Remark) -> list[PreparedRun]:
    """Runs of which the first lacks the stretches that a remark names."""
    first, *others = runs
    return [first.anew(first.recording.without(*stretches_of(disturbed))), *others]


def undisturbed(
    runs: Sequence[PreparedRun], stretch: TimeSpan, judged: Diagnosis
) -> tuple[list[PreparedRun], TimeSpan] | None:
    """Runs without the stretches that a verdict names as disturbed, and the usable part with the remark on them;
    None where it names none."""
    disturbed = next((note for note in judged.remarks if note.code == "disturbed"), None)
    if disturbed is None:
        return None
    return without_stretches(runs, disturbed), replace(stretch, remarks=(disturbed, *stretch.remarks))


def fitted(
    model: Model,
    runs: Sequence[PreparedRun],
    progress: Callable[[float], None],
    *,
    reject: bool = True,
    **settings: Any,
) -> tuple[Fit, Solution]:
    """A model fitted to runs without outliers, with its effects on noise, and the solution it comes from.

    Parameters
    ----------
    model, runs : what is fitted to what.
    progress : called with the share of the work that is done, 0 to 1.
    reject : whether outliers are rejected.
    settings : of `solve_runs`.
    """
    solution = solve_runs(model, runs, progress=within(progress, 0.0, 0.8 if reject else 1.0), **settings)
    fit = result(solution)
    if reject:
        again = {**settings, "origins": fit.origins, "engine": fit.engine}
        solve = partial(solve_runs, fit.model, **again)
        clean = clean_fit(runs, solve, solved=solution, test=run_outlier_tests)
        solution, rejected = clean.solution, clean.rejected(runs)
        if rejected:
            fit = result(solution)
            fit = replace(fit, remarks=(*(rejection.remark for rejection in rejected), *fit.remarks))
    return with_noise_effects(fit, runs, solution.states), solution


@checked
@one_thread
def add(
    fit: Fit,
    recordings: Recording | Dwells | Sequence[Recording | Dwells | Positions],
    *names: str,
    extra: Sequence[Effect] | None = None,
    progress: Callable[[float], None] = lambda share: None,
) -> Fit:
    """Return a new fit with further effects, outliers rejected; shape parameters are found by likelihood.

    Parameters
    ----------
    fit, recordings : the model, and what it is fitted to again.
    names : effects to add, in this order; those of the base are passed over beside others, so that `diagnosis.effects`
        can be given. A mechanism takes the place of the random processes of its coefficient that it explains.
    extra : users' effects to consider besides the built-in ones; by default all that are registered (`load_effects`,
        `effect`, `from_expression`), with () none.
    progress : called with the share of the work that is done, 0 to 1.

    Raises
    ------
    ValueError
        If an effect is unknown, already in the model, or cannot be evaluated on the recording.

    Examples
    --------
    >>> import accelcal as ac, numpy as np
    >>> truth = {"bias": 0.05, "cubic": 1e-3}
    >>> rng = np.random.default_rng(1)
    >>> simulated = ac.simulate("interleaved", seconds=12.0, rig=ac.simulation.CXL02_RIG, parameters=truth, rng=rng)
    >>> fit = ac.fit(simulated.recording)
    >>> better = ac.add(fit, simulated.recording, "cubic")
    >>> abs(better["cubic"].value - 1e-3) < 4 * better["cubic"].std
    True
    """
    if isinstance(at_rest := with_dwells(recordings), Dwells):
        return remembered(added_at_rest(fit, at_rest, names), recordings)
    runs, broken = used_runs([examine(source) for source in at_rest], fit)
    several = [run.recording for run in runs]
    enter_channels(several)
    names = tuple(find(name).name for name in names)
    model, states, waves = model_in_motion(fit), restored_states(fit, runs), dict[str, float]()
    replaced, unseen = list[Remark](), tuple[str, ...]()
    how: dict[str, Any] = {"origins": fit.origins, "engine": fit.engine}
    # a verdict lists the delay too, which every model has
    for name in (name for name in names if name not in BASE or {*names} <= {*BASE}):
        effect = find(name)
        if name in model.effects and not may_be_refined(model, effect):
            raise AccelcalError(f"{name!r} is already in the model")
        if effect.port == "noise":
            model = model.add(name)
            continue
        if name in SEEN_BY_RUNS and len(several) > 1 and all(need in r.side for need in effect.needs for r in several):
            instead = [choice.instead for choice in fit.seen_by_runs if choice.effect == name]
            model = model.alike(*instead).add(name)  # no single run shows it: the joint fit tells whether all do
            continue
        if processes := explained_by(effect, model, names, partial(solve_runs, sources=runs, **how)):
            model = model.drop(*processes)
            replaced += [remark("replaced", process=process, effect=name) for process in processes]
        if states is None or model is not fit.model:
            states = solve_runs(model, runs, progress=within(progress, 0.0, 0.4), **how).states
        model, size = with_effect(effect, model, states, extra, within(progress, 0.4, 0.6))
        waves |= {name: size} if size else {}
    grown, solution = fitted(model, runs, within(progress, 0.6, 0.9), **how)
    for _ in range(ROUNDS if any(find(name).port == "process" for name in names) else 0):
        model, gained, unseen = with_likely_processes(solution.model, solution.states)
        if gained < SETTLED:
            break
        with suppress(ValueError):  # the fit at hand stays where there is no other
            grown, solution = fitted(model, runs, within(progress, 0.9, 0.95), **how)
    require_distinguished_from_bias(names, solution.model)
    require_noise_shown(grown, names)
    entry = dict[str, float]() if states is None else dict.fromkeys(names, entry_sigma(states, fit.model, extra))
    allowed = chosen(grown, entry | entry_sigmas(fit, grown))
    shown = [*replaced, *barely_shown(grown, names), *allowed, *(remark("beside_others", effect=x) for x in unseen)]
    lost = [name for name in names if find(name).port == "noise" and not solution.converged]
    lost += [name for name, size in waves.items() if max(in_model(grown, Confounded(name, (name,), ""), {}).std) > size]
    if lost:
        why = "the fit does not determine its size" if solution.converged else "the fit with it does not settle"
        raise AccelcalError(f"{lost[0]!r} cannot be added: {why}; `accelcal power` says what the record can show")
    return remembered(replace(grown, remarks=(*broken, *grown.remarks, *shown)), recordings)


def added_at_rest(fit: Fit, dwells: Dwells, names: Sequence[str]) -> Fit:
    """A fit to dwells alone with further effects."""
    grown = estimate_dwells(entered(fit.model, names), dwells, fit.origins)
    return replace(grown, remarks=(*grown.remarks, *barely_shown(grown, names)))


def enter_channels(recordings: Sequence[Recording]) -> None:
    """Make effects of the side channels of recordings, by their names."""
    for recording in recordings:
        side_channels([(name, channel.unit) for name, channel in recording.side.items() if name not in DERIVED])


def with_choice(fit: Fit, scan: Scan, alpha: float, chosen_by: Fit) -> Fit:
    """A fit with the remarks on sizes of effects that a search has named in the fit to a part."""
    entry = SearchRules(scan.examined, scan.blocks, alpha).entry_sigma
    return replace(fit, remarks=(*fit.remarks, *chosen(fit, dict.fromkeys(fit.model.added, entry), chosen_by)))


def entry_sigma(states: Sequence[RunState], model: Model, extra: Sequence[Effect] | None) -> float:
    """Standard deviations above which runs fitted with a model name an effect that it lacks."""
    examined = len(hypotheses_for(states[0], model, extra, others=states[1:]))
    return SearchRules.of(states[0], examined, FAMILYWISE_ALPHA).entry_sigma


def require_distinguished_from_bias(names: Sequence[str], model: Model) -> None:
    """Refuse effects that a fit had to leave out of the model.

    Raises
    ------
    AccelcalError
        Naming the first.
    """
    if lost := [name for name in names if name not in model.effects]:
        raise AccelcalError(f"{lost[0]!r} cannot be added: these recordings do not tell it from the bias")


def with_effect(
    effect: Effect,
    model: Model,
    states: Sequence[RunState],
    extra: Sequence[Effect] | None,
    progress: Callable[[float], None],
) -> tuple[Model, float]:
    """A model with an effect, its shape parameters by likelihood, and the amplitude of a wave that noise tests found.

    Parameters
    ----------
    effect : what is added to `model`.
    states : runs that were fitted with the model.
    extra, progress : as of `add`.

    Returns
    -------
    The model; the amplitude, 0 where it is no wave.

    Raises
    ------
    ValueError
        If the runs do not show the effect.
    """
    name, everywhere = effect.name, effect.name.removesuffix(f"_on_{effect.axis}")
    if effect.axis and everywhere in model.effects:
        raise AccelcalError(f"{name!r} cannot be added: the model has {everywhere} on every axis already")
    jumps = [step for state in states for step in state.run.accounted_steps] if name == POSITION_JUMPS else ()
    if jumps:
        sentence = f"{max(jumps, key=lambda step: abs(step.size)).sentence}; every fit begins anew behind it"
        raise AccelcalError(f"{name!r} cannot be added: its jump is accounted for already ({sentence})")
    wave = largest_wave(effect, model, states)
    if wave is not None and effect.search.beside in ("", *model.effects):
        return model.add(name, shapes={name: wave.shape}), wave.estimate
    of_axis = [state for state in states if effect.axis in ("", state.run.recording.axis)]
    requested = scan(of_axis or states, model, extra=extra, only=(effect,), progress=progress)
    if requested.entered:
        return requested.entered[0].enter(model), 0.0
    lacking = [need for need in effect.needs if need not in states[0].run.recording.side]
    power = f"{separating(effect)} would separate it, and `accelcal power` says what the record can show"
    why = f"this record does not excite it, or not apart from what the model holds; {power}"
    if lacking:
        why = f"it needs the channel {' and '.join(lacking)}; record it, or name its column in the sidecar"
    if lacks_its_position(effect, states):
        why = "it is an error of a position as it is read, and the reference of this record is not a position"
    if effect.search.beside and effect.search.beside not in model.effects:
        why = f"it is searched for only beside {effect.search.beside}; add that first"
    raise AccelcalError(f"{name!r} cannot be added: {why}")


def separating(effect: Effect) -> str:
    """Experiment that separates an effect from its rivals; a longer record where its card names none."""
    return effect.experiment.rstrip(".") or "a longer record"


def explained_by(effect: Effect, model: Model, names: Sequence[str], solve: Callable[[Model], Solution]) -> list[str]:
    """Random processes of a model, but for `names`, that a mechanism explains: they contain it.

    A process that the runs show beside the mechanism stays. `solve` fits a model to them.
    """
    of = effect.mechanism
    others = (find(name) for name in model.added if name not in names)
    processes = [e for e in others if of is not None and e.port == "process" and e.traits.changes == of.carrier]
    if not processes:
        return []
    without = model.drop(*(process.name for process in processes))
    left = scan(solve(without).states, without, only=(effect, *processes)).detected
    true = {process.effect for process in left if effect.name not in process.members}
    return [process.name for process in processes if process.name not in true]


def barely_shown(fit: Fit, names: Sequence[str]) -> list[Remark]:
    """Remarks on effects of a fit that the record hardly tells from zero, whatever their shapes."""
    free = zip(fit.free, fit.naming_stds, strict=True)
    surely = {e.name for e, std in free if abs(e.value) > NAMED_SURELY * std}
    sigmas = {name: in_model(fit, Confounded(name, (name,), ""), {}).sigma for name in names if name not in surely}
    return [
        remark("barely_shown", effect=name, sigma=sigma, expected=SHOWN_SIGMA, experiment=separating(find(name)))
        for name, sigma in sigmas.items()
        if sigma is not None and sigma < SHOWN_SIGMA
    ]


def refit(
    before: Fit,
    recordings: Recording | Dwells | Sequence[Recording | Dwells | Positions],
    model: Model,
    progress: Callable[[float], None] = lambda share: None,
) -> Fit:
    """Fit a model in the manner of an earlier fit, sizes of effects allowing for their choice as there."""
    method: Any = before.engine.name
    again = fit(recordings, model, method=method, origins=before.origins, progress=progress)
    allowed = chosen(again, entry_sigmas(before, again))
    return remembered(replace(again, remarks=(*again.remarks, *allowed)), recordings)


@checked
@one_thread
def drop(
    fit: Fit,
    recordings: Recording | Dwells | Sequence[Recording | Dwells | Positions],
    *names: str,
    progress: Callable[[float], None] = lambda share: None,
) -> Fit:
    """Return a new fit without some effects, outliers rejected.

    `progress` is called with the share of the work that is done, 0 to 1.

    Examples
    --------
    >>> import numpy as np
    >>> import accelcal as ac
    >>> truth = {"bias": 0.05, "cubic": 1e-3}
    >>> rng = np.random.default_rng(1)
    >>> simulated = ac.simulate("interleaved", seconds=12.0, rig=ac.simulation.CXL02_RIG, parameters=truth, rng=rng)
    >>> cubic = ac.fit(simulated.recording, ac.Model.linear().add("cubic"))
    >>> ac.drop(cubic, simulated.recording, "cubic").model.added
    ()
    """
    if isinstance(at_rest := with_dwells(recordings), Dwells):
        return remembered(estimate_dwells(fit.model.drop(*names), at_rest, fit.origins), recordings)
    runs, broken = used_runs([examine(recording) for recording in at_rest], fit)
    model = model_in_motion(fit).drop(*names)
    origins, engine = fit.origins, fit.engine
    left, _ = fitted(model, runs, within(progress, 0.0, 0.9), origins=origins, engine=engine)
    allowed = chosen(left, entry_sigmas(fit, left))
    return remembered(replace(left, remarks=(*broken, *left.remarks, *allowed)), recordings)


@checked
@one_thread
def run_values(fit: Fit, recordings: Sequence[Recording | Dwells | Positions]) -> RunValues:
    """Say whether recordings agree: the parameters that they share, as each would have them alone.

    Parameters
    ----------
    fit : the model.
    recordings : what it is fitted to, two recordings or more; dwells count with the first.

    Raises
    ------
    ValueError
        If there is one recording alone, or the model shares nothing between them.

    Examples
    --------
    >>> import numpy as np
    >>> import accelcal as ac
    >>> from accelcal.verbs import run_values
    >>> settings = {"seconds": 8.0, "rig": ac.simulation.CXL02_RIG, "parameters": {}, "rng": np.random.default_rng(1)}
    >>> first, second = (ac.simulate("tones", **settings).recording for _ in range(2))
    >>> bool(run_values(ac.fit([first, second]), [first, second]).p_values.min() > 1e-4)
    True
    """
    runs, _ = used_runs([examine(recording) for recording in runs_of(recordings)], fit)
    states = restored_states(fit, runs)
    if states is None:
        states = solve_runs(model_in_motion(fit), runs, origins=fit.origins, engine=fit.engine).states
    values = values_by_run(states, fit.model, [choice.instead for choice in fit.seen_by_runs])
    if values is None:
        raise AccelcalError("run_values needs two recordings or more, and a model with parameters that they share")
    return values


@checked
@one_thread
def improve(
    recordings: Recording | Dwells | Sequence[Recording | Dwells | Positions],
    *,
    holdout: Recording | None = None,
    most: int = MOST_EFFECTS,
    extra: Sequence[Effect] | None = None,
    alpha: float = FAMILYWISE_ALPHA,
    prior: Mapping[str, Prior] | Literal["none"] | None = None,
    start: float | None = None,
    end: float | None = None,
    progress: Callable[[float], None] = lambda share: None,
    on_step: Callable[[Fit], None] = lambda fit: None,
) -> Improvement:
    """Fit the base model, diagnose, add the effect that is missing, refit, until nothing is missing.

    Parameters
    ----------
    recordings : one or several runs to learn from.
    holdout : held-out run on which errors are computed, no part in what is added; by default the last of three runs or
        more whose axis and mount another one has, else the last 30 % of the first, to which only `best` is fitted.
    most : most effects to add; waves of one kind count once, and there are at most twice as many in all.
    extra : users' effects to consider besides the built-in ones; by default all that are registered, with () none.
    alpha, prior : family-wise false-alarm rate, and priors of effect sizes, both as of `diagnose`.
    start, end : s, optional; only this part of the recordings is used, of the held-out one as well.
    progress : called with the share of the work that is done.
    on_step : called with each model as soon as it is fitted, to be kept where the work is ended.

    Returns
    -------
    Every step with its fit and its errors on fitted and on held-out data, and the verdict on the last model.

    Raises
    ------
    NotIdentifiable, RecordingError
        From the fit of the base model.

    Examples
    --------
    >>> import accelcal as ac, numpy as np
    >>> truth, rng = {"bias": 0.05, "cubic": 1e-3}, np.random.default_rng(1)
    >>> simulated = ac.simulate("interleaved", seconds=12.0, rig=ac.simulation.CXL02_RIG, parameters=truth, rng=rng)
    >>> ac.improve(simulated.recording, most=1).effects
    ('cubic',)
    """
    several = require_one_output(runs_of(recordings))
    apart = run_to_hold_out(several) if holdout is None else None
    if apart is not None:
        holdout = several.pop(apart)
    budget, priors = SearchBudget(), size_priors(several, prior)
    examined = [examine(recording, start, end) for recording in several]
    require_relation(examined)
    original, stretch, broken = judged_runs(examined)
    begin, finish = stretch.start, stretch.end
    split = finish - HELD_OUT * (finish - begin) if holdout is None else finish
    selection = StepwiseSelection.begin(original, stretch, split, extra, alpha, budget, priors)
    if rest := undisturbed(original, stretch, selection.current.verdict):
        original, stretch = rest
        selection = StepwiseSelection.begin(original, stretch, split, extra, alpha, budget, priors)
    selection.grow(most, on_step, within(progress, 0.3, 0.9))
    unseen = None if holdout is None else examine(holdout, start, end)
    test, span = (original[0], (split, finish)) if unseen is None else (unseen.source, unseen.span)
    if rejected := selection.current.fitted.rejected(original):
        test, more = clean_holdout(selection.steps[0][1].model, test, *span)
        rejected = (*rejected, *more)
    steps, disturbed = uncontradicted_steps(selection, begin, test, *span, clean=unseen is None)
    reason = selection.history.full(most) or "no fit with it is possible"
    if apart is not None and unseen is not None:
        if not selection.current.verdict.scan.detected:
            reason = "the run that is held out takes no part in what is added"
        selection.judge_with(unseen.source if stretch.chosen else unseen.part)
    verdict = selection.final_verdict(reason)
    notes = [*broken, *(unseen.remarks("held out, ") if unseen is not None else ()), *disturbed, *heldout_rises(steps)]
    last = replace(verdict, dropped=rejected, remarks=(*verdict.remarks, *notes))
    best = steps[-1].fit
    if unseen is None:  # the held-out end has done its work: the model is that of the whole record
        whole = clean_fit(original, lambda these: solve(best.model, these, stretch, finish))
        best = replace(with_noise_effects(result(whole.solution), original, whole.solution.states), tilt=best.tilt)
    best = with_choice(best, last.scan, alpha, steps[-1].fit)
    return Improvement(tuple(steps), best, last, tuple(selection.classes), selection.examined, holdout is None)


def require_one_output(recordings: list[Recording]) -> list[Recording]:
    """Recordings, refused where they are several outputs of one sensor, for a model of one is improved.

    Raises
    ------
    AccelcalError
        Naming the recordings, and what takes all outputs together.
    """
    if len({recording.axis for recording in recordings}) > 1:
        raise AccelcalError(
            f"improve: {', '.join(recording.name for recording in recordings)}; expected one output. Use fit, diagnose "
            "and add, which take all outputs together and name the axis: add --effect cubic_on_y"
        )
    return recordings


def uncontradicted_steps(
    selection: StepwiseSelection, begin: float, test: PreparedRun, start: float | None, end: float | None, clean: bool
) -> tuple[list[Step], list[Remark]]:
    """`compared_steps` once the effects that the held-out data contradict are taken out again."""
    steps, disturbed = compared_steps(selection, begin, test, start, end, clean)
    while (note := contradicted(steps)) is not None:
        selection.withdraw(note)
        steps, disturbed = compared_steps(selection, begin, test, start, end, clean)
    return steps, disturbed


def compared_steps(
    selection: StepwiseSelection, begin: float, test: PreparedRun, start: float | None, end: float | None, clean: bool
) -> tuple[list[Step], list[Remark]]:
    """Every model of a selection on the data it was fitted to, from `begin` on, s, and on held-out data in a part,
    without what disturbed them unless they are `clean`; the remark on that."""
    fits = [fit for _, fit in selection.steps]
    ruler, train = Ruler.of(fits), selection.current.fitted.runs[0]
    floor = noise_floor(ruler, fits[0], test, start=start, end=end)
    unseen = [evaluation.compare(fit, test, start=start, end=end, ruler=ruler) for fit in fits]
    unseen = [replace(result, noise_floor=floor.through(result.held_back)) for result in unseen]
    trained = [evaluation.compare(fit, train, start=begin, end=selection.split, ruler=ruler) for fit in fits]
    trained = [*with_resolved(trained, fits, train.recording, ruler)]
    heldout = with_resolved(unseen, fits, test.recording, ruler, floor)
    steps = [Step(*step, *both) for step, *both in zip(selection.steps, trained, heldout, strict=True)]
    if clean or not (disturbed := disturbance(steps[-1].heldout, test.recording, "held out, ")):
        return steps, []
    return compared_steps(selection, begin, without_stretches([test], disturbed)[0], start, end, True)[0], [disturbed]


def heldout_rises(steps: Sequence[Step]) -> list[Remark]:
    """The remark that an earlier step has a smaller held-out error than the last one; empty where none is surely so."""
    rises = best_step([step.heldout for step in steps])
    if rises is None or rises[1].sigma <= VALIDATION_SIGMA or rises[1].percent <= 100.0 * HELDOUT_RISE:
        return []
    number, change = rises
    best = " + ".join(("base", *steps[number].effects))
    return [remark("heldout_rises", measure=change.measure, percent=change.percent, best=best, sigma=change.sigma)]


def clean_holdout(
    model: Model, run: PreparedRun, start: float | None, end: float | None
) -> tuple[PreparedRun, tuple[RejectedReadings, ...]]:
    """Held-out data without their own outliers, so that every step is judged on the same samples; unchanged where no
    fit is possible."""
    try:
        clean = clean_fit([run], lambda these: solve_runs(model, these, start=start, end=end))
    except ValueError:
        return run, ()
    rejected = clean.rejected([run])
    named = (replace(channel, recording=f"held out, {channel.recording or 'recording'}") for channel in rejected)
    return clean.runs[0], tuple(named)


@checked
@one_thread
def nested(
    fit: Fit,
    recordings: Recording | Dwells | Sequence[Recording | Dwells | Positions] | None = None,
    *,
    start: float | None = None,
    end: float | None = None,
) -> tuple[Fit, ...]:
    """Fit a model without its effects: the base, then one more effect at a time, the model itself last.

    Parameters
    ----------
    fit : the largest model, which is returned as it is.
    recordings : one or several that the smaller models are fitted to; by default those of `fit`, as long as they are in
        memory.
    start, end : s, optional; only this part is used.

    Returns
    -------
    Fits that `compare` takes; remarks of the last one name models that could not be fitted.

    Raises
    ------
    NotIdentifiable
        If the motion does not determine even the base.
    RecordingError
        If the recordings of the fit are no longer in memory.

    Examples
    --------
    >>> import numpy as np
    >>> import accelcal as ac
    >>> truth = {"bias": 0.05, "cubic": 1e-3}
    >>> rng = np.random.default_rng(1)
    >>> simulated = ac.simulate("interleaved", seconds=12.0, rig=ac.simulation.CXL02_RIG, parameters=truth, rng=rng)
    >>> fit = ac.fit(simulated.recording, ac.Model.linear().add("cubic"))
    >>> ac.compare(ac.nested(fit), simulated.recording).names
    ('base', 'base + cubic')
    """
    if recordings is None:
        recordings = [
            recording
            for recording in (reference() for reference in _fitted_to.get(id(fit), ()))
            if recording is not None
        ]
    if not recordings:
        raise RecordingError(
            f"{', '.join(name for name, _ in fit.sources)}: no longer in memory; give what the fit was made from: "
            "accelcal.nested(fit, recordings)"
        )
    runs, _ = used_runs([examine(recording, start, end) for recording in runs_of(recordings)], fit)
    grown = nested_fits(fit, runs, start=start, end=end)
    *smaller, last = grown.fits
    return (*smaller, replace(last, remarks=(*last.remarks, *grown.remarks)))


@checked
@one_thread
def compare(
    fits: Fit | Sequence[Fit],
    recordings: Recording | Sequence[Recording],
    *,
    names: Sequence[str] | None = None,
    band: float | None = None,
    horizons: Sequence[float] = HORIZONS,
    start: float | None = None,
    end: float | None = None,
    budget: bool = False,
    progress: Callable[[float], None] = lambda share: None,
) -> Comparison:
    """Compare models with recordings, simulation first; behind a jump of the position it starts anew.

    Where the relation of the channels breaks for good the comparison ends, unless `start` or `end` is given.

    Parameters
    ----------
    fits : one or several models; the others are compared with the first.
    recordings : one or several, preferably such that no model was fitted to.
    names : of the models, for people; by default their effects.
    band : Hz, optional; bandwidth of the accelerometer-side residual, by default the crossover of the two noises.
    horizons : s; when to take the coasting error after position is withheld.
    start, end : s, optional; only readings in [start, end] of each recording are used.
    budget : whether the drift is split into its parts as well; costs a prediction for each parameter.
    progress : called with the share of the work that is done, 0 to 1.

    Returns
    -------
    Comparison
        Evaluation of each model on each recording, errors over all of them, and `differences` from the first model
        with their 95 % intervals.

    Notes
    -----
    All models are run with one filter, that of the model with the least noise, in one band and from the same start
    points, so that their errors share the noise. The interval counts the scatter between stretches of two horizons; it
    is that of these recordings, and says nothing of others under other conditions.

    Raises
    ------
    ValueError
        If there is no model or no recording, or names are no other for each model.
    RecordingError
        If the channels do not overlap.

    Examples
    --------
    >>> import numpy as np
    >>> import accelcal as ac
    >>> truth = {"bias": 0.05, "cubic": 1e-3}
    >>> rng = np.random.default_rng(1)
    >>> simulated = ac.simulate("interleaved", seconds=12.0, rig=ac.simulation.CXL02_RIG, parameters=truth, rng=rng)
    >>> fit = ac.fit(simulated.recording)
    >>> better = ac.add(fit, simulated.recording, "cubic")
    >>> comparison = ac.compare([fit, better], simulated.recording)
    >>> comparison[1].coast_rms[1.0] < comparison[0].coast_rms[1.0]
    True
    """
    models = (fits,) if isinstance(fits, Fit) else tuple(fits)
    several = [recordings] if isinstance(recordings, Recording) else list(recordings)
    named = names_of(models) if names is None else tuple(names)
    if not models or not several:
        raise AccelcalError(
            f"compare: {len(models)} models and {len(several)} recordings; expected at least one of each"
        )
    if len(named) != len(models) or len(set(named)) != len(models):
        raise AccelcalError(
            f"compare: names {list(named)}; expected a name of its own for each of {len(models)} models"
        )
    evaluations = []
    settings: Any = {"band": band, "horizons": horizons, "start": start, "end": end, "budget": budget}
    for recording, part in zip(several, parts_of(progress, len(several)), strict=True):
        of_output = [fit.of_axis(recording.axis) for fit in models]
        evaluations.append(compare_models(of_output, recording, Ruler.of(of_output), part, **settings))
    fitted = {run.session for fit in models for run in fit.runs if run.session}
    same_run = any(recording.session in fitted for recording in several)
    return Comparison(models, named, tuple(row[0].recording for row in evaluations), tuple(evaluations), same_run)


@one_thread
def compare_models(
    fits: Sequence[Fit],
    recording: Recording,
    ruler: Ruler,
    progress: Callable[[float], None] = lambda share: None,
    *,
    base: Fit | None = None,
    band: float | None = None,
    horizons: Sequence[float] = HORIZONS,
    start: float | None = None,
    end: float | None = None,
    budget: bool = False,
) -> tuple[Evaluation, ...]:
    """Compare several models with one recording under one ruler, above one noise floor.

    Parameters
    ----------
    fits, recording, ruler : models, what they are compared with, and the filter.
    progress : called with the share of the work that is done, 0 to 1.
    base : the model whose clock the floor is drawn on, by default the first; the same one gives the same floor.
    band, horizons, start, end, budget : as of `compare`.
    """
    examined = examine(recording, start, end)
    part, (begin, finish) = examined.source, examined.span
    progress(0.1)

    left_out = tuple(note.sentence for note in examined.remarks())
    predictions: dict[int, Prediction] = {}
    shares = parts_of(progress, len(fits), 0.1, 0.8)

    def compared(number: int, fit: Fit) -> Evaluation:
        ahead = evaluation.predicted(fit, part, ruler, start=begin, end=finish)
        result = evaluation.compare(
            fit, part, band=band, horizons=horizons, ruler=ruler, ahead=ahead, progress=shares[number]
        )
        if budget:
            predictions[number] = ahead
        scores = noise_scores(fit, part, start=begin, end=finish)
        return replace(result, noise_scores=scores, breaks=examined.breaks[:1], left_out=left_out)

    evaluations = [compared(number, fit) for number, fit in enumerate(fits)]
    # a model that lacks an effect leaves it here and there
    if disturbed := disturbance(min(evaluations, key=lambda result: result.accel_rms), part.recording):
        part, left_out = without_stretches([part], disturbed)[0], (*left_out, disturbed.sentence)
        evaluations = [compared(number, fit) for number, fit in enumerate(fits)]
    least = noise_floor(ruler, base or fits[0], part, horizons=horizons, start=begin, end=finish)
    evaluations = [replace(result, noise_floor=least.through(result.held_back)) for result in evaluations]
    if budget and (horizon := headline_horizon(*evaluations)) is not None:
        spreads = (drift_spread(result, horizon) for result in evaluations)
        rmses = (result.coast_rms[horizon] or 0.0 for result in evaluations)
        totals = [spread or RmsInterval(size, 0.0, float("inf")) for spread, size in zip(spreads, rmses, strict=True)]
        parts = error_budgets(fits, evaluations, list(predictions.values()), totals, horizon)
        evaluations = [replace(result, budget=of) for result, of in zip(evaluations, parts, strict=True)]
    progress(1.0)
    return with_resolved(evaluations, fits, part.recording, ruler, least)


@checked
def coast(fit: Fit, recording: Recording, start: float, horizon: float) -> Coast:
    """Predict position over `horizon` seconds after the last reading at or before `start`, without using any later one.

    Parameters
    ----------
    fit, recording : model and run.
    start, horizon : s.

    Raises
    ------
    ValueError
        If no reading precedes `start` or the accelerometer record ends before the horizon.

    Examples
    --------
    >>> import numpy as np
    >>> import accelcal as ac
    >>> truth = {"bias": 0.05, "cubic": 1e-3}
    >>> rng = np.random.default_rng(1)
    >>> simulated = ac.simulate("interleaved", seconds=12.0, rig=ac.simulation.CXL02_RIG, parameters=truth, rng=rng)
    >>> fit = ac.fit(simulated.recording)
    >>> ac.verbs.coast(fit, simulated.recording, 2.0, 5.0)
    Coast(from 2 s to 6.999 s: 4167 readings)
    """
    return evaluation.coast(fit.of_axis(recording.axis), examine(recording).source, start, horizon)


def judged_runs(examined: Sequence[Examined]) -> tuple[list[PreparedRun], TimeSpan, list[Remark]]:
    """Runs of which a model is judged on the first: the others up to their first breaks; the part of the first on which
    one model can hold, and the remarks on the others."""
    first, *others = examined
    runs, broken = used_runs(others)
    return [first.judged, *runs], first.stretch, broken


def used_runs(examined: Sequence[Examined], fit: Fit | None = None) -> tuple[list[PreparedRun], list[Remark]]:
    """Runs up to their first breaks, without the stretches that a fit to them has left out as disturbed, and the
    remarks on what was noticed in them."""
    runs, notes = [item.part for item in examined], [note for item in examined for note in item.remarks()]
    disturbed = [note for note in ([] if fit is None else fit.remarks) if note.code == "disturbed"]
    if fit is None or not (disturbed and fit.runs) or fit.runs[0].session != runs[0].recording.session:
        return runs, notes
    return without_stretches(runs, disturbed[0]), [*disturbed[:1], *notes]


__dir__ = listing(globals())
