"""Fit a model to one or several recordings: the replay, iterated to its fixed point."""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
import scipy

from accelcal._support.arguments import checked
from accelcal._support.errors import AccelcalError
from accelcal._support.process import one_thread
from accelcal._support.result import Result
from accelcal._support.values import face, immutable
from accelcal.data import (
    ACROSS,
    DERIVED,
    LEVELS,
    LEVERS,
    STANDARD_GRAVITY,
    TILTS,
    TURNED,
    Array,
    Dwells,
    Recording,
    RecordingError,
    Rig,
    high_passes,
    require_same_sensor,
)
from accelcal.data.arrays import VANISHING
from accelcal.data.orientation import ANGLE, LEVEL_AXLE
from accelcal.data.recording import dwells_with_first, listed
from accelcal.effects import BUILT_IN, CATALOGUE, find
from accelcal.estimation.bands import (
    best_band,
    change_with_band,
    needs_band,
    question,
    trial_bands,
    trials_needed,
)
from accelcal.estimation.channel_filters import names
from accelcal.estimation.dwell_fit import DwellFit, left_of, origins_of, seen_in, solve_dwells
from accelcal.estimation.dwell_rows import Nuisances, acts_at_rest, determines, shown
from accelcal.estimation.engines import ENGINES, Engine, Method, engine_named, measure_noise, settle_dwells
from accelcal.estimation.gauss_newton import (
    DWELL_STEPS,
    MAX_ROUNDS,
    TRIAL_SETTLED,
    Agreement,
    BandTrial,
    Layout,
    NotIdentifiable,
    Solution,
    iterate,
    outputs_of,
    rows_of_positions,
)
from accelcal.estimation.noise import NoiseEffect
from accelcal.estimation.plausible import gravity_mistaken, implausible_scale, reversed_or_unrelated
from accelcal.estimation.remarks import Remark, remark
from accelcal.estimation.rows import normal_equations
from accelcal.estimation.run import PreparedRun, Source, prepared, recording_of, side_means
from accelcal.estimation.run_fit import RunFit, differing, run_fit
from accelcal.estimation.run_state import RunState
from accelcal.estimation.run_to_run import REMARK_ALPHA, GoesWith, SeenByRuns, Spread, covariates_of, goes_with
from accelcal.estimation.shape_parameters import at_means, held_shapes, on_bounds, refine_shapes
from accelcal.estimation.values import Noise, Values
from accelcal.estimation.weak_form.covariance import NoWeakForm
from accelcal.filters.choice import FilterChoice
from accelcal.model import Estimate, Model, Prior, Term, plain_name, terms_of
from accelcal.signals.signals import Origins

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure
    from pandas import DataFrame

SEPARATED_BY_TURNING = tuple(effect.name for effect in BUILT_IN if effect.traits.separated_by == "turning")
SEPARATED_BY_ROLLING = tuple(effect.name for effect in BUILT_IN if effect.traits.separated_by == "rolling")
WITH_GYROSCOPE = tuple(effect.name for effect in BUILT_IN if effect.needs == TURNED)
WITH_ATTITUDE = tuple(effect.name for effect in BUILT_IN if effect.needs == LEVERS)
OF_TRIAD = tuple(effect.name for effect in BUILT_IN if effect.needs in (ACROSS, LEVELS))
WITH_ANGLE = tuple(effect.name for effect in BUILT_IN if effect.needs == TILTS)
DWELLS_ALONE = "dwells"
"""Method of a fit to static dwells without a motion."""
ARM_STD = 0.01
"""Relative standard uncertainty of an arm that is taken where none is declared: a ruler's."""
LEAST_ARM_STD = 1e-3
"""Least standard uncertainty of an arm where none is declared, m: that of a short one."""
ACROSS_ARM = 0.01
"""Distance of a sensor from the line of its arm that is ordinary, m."""
AXLE_TILT = 0.02
"""Standard uncertainty of the level of an axle, and of an angle zero, that is taken where none is declared, rad."""
FAR_ZERO = 0.005
"""Error of an angle zero from which on half its square shows in the scale factor, rad."""
ASIDE = 0.1
"""Angle between an axis and where the attitude of its body says that it points, and of the reference's up, that is
ordinary, rad."""
FARTHEST = 0.3
"""Distance of a sensor from the tracked point that is ordinary, m: where a body hardly turns, its motion says less."""
SCALE_STD_LIMIT = 0.5
"""A scale factor less certain than this was not excited at all."""


COUNTERPARTS: Mapping[str, str] = {
    **dict.fromkeys(("params", "coef_", "best_values", "x"), "fit.estimates, or fit[name].value and .std"),
    **dict.fromkeys(("covar", "cov_params", "pcov"), "fit.covariance"),
    **dict.fromkeys(("chisqr", "redchi"), "accelcal.compare(fit, recording)[0].nis, 1 when noise and model agree"),
    **dict.fromkeys(("score", "rsquared", "r2"), "accelcal.compare(fit, recording)[0].fit_percent"),
    **dict.fromkeys(("ci_report", "conf_interval", "conf_int"), "fit.table(), whose rows hold 95 % intervals"),
    **dict.fromkeys(
        ("apply", "correct", "transform", "inverse_transform"),
        "accelcal.calibration.export.calibrate(fit).acceleration(readings)",
    ),
    "eval_uncertainty": "accelcal.report, which draws the uncertainty of every curve",
    "summary": "fit.fit_report()",
    "llf": "fit.log_likelihood",
}
"""Code to write in place of names that fits of other packages have."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """A value with its standard uncertainty and unit."""

    value: float
    std: float
    unit: str


@immutable
@dataclass(frozen=True, slots=True, weakref_slot=True)
class Fit(Result):
    """Estimates of a model with their covariance, and where they come from.

    Examples
    --------
    >>> import numpy as np
    >>> import accelcal as ac
    >>> truth = {"bias": 0.05, "cubic": 1e-3}
    >>> rng = np.random.default_rng(1)
    >>> simulated = ac.simulate("interleaved", seconds=12.0, rig=ac.simulation.CXL02_RIG, parameters=truth, rng=rng)
    >>> fit = ac.fit(simulated.recording)
    >>> fit["scale_factor"].unit, fit["bias"].std > 0.0
    ('1', True)
    """

    derived: ClassVar[tuple[str, ...]] = ("electrical", "stands_for")
    counterparts: ClassVar[Mapping[str, str]] = COUNTERPARTS

    model: Model
    estimates: tuple[Estimate, ...]
    covariance: Array
    """(m, m) of the free estimates, in their order, SI units."""
    runs: tuple[RunFit, ...]
    origins: Origins
    rig: Rig
    """Rig of the first recording."""
    method: str = "replay"
    validity: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Range of a (m/s²), v (m/s), p (m), temperature (degC), frequency (Hz) in the data of the fit."""
    remarks: tuple[Remark, ...] = ()
    """Remarks that must be read with the numbers."""
    shapes: tuple[Estimate, ...] = ()
    """Shape parameters that were estimated (creep.tau); the covariance holds their uncertainty, but no row."""
    spreads: tuple[Spread, ...] = ()
    """Coefficients that differ from run to run; their estimates are the means over runs."""
    seen_by_runs: tuple[SeenByRuns, ...] = ()
    """Effects that no single run shows and that explain how the runs differ."""
    tilt: float = 0.0
    """Turning of the axis that would explain the slow residual, degrees rms; 0 where there is none to explain, or where
    orientation was recorded."""
    goes_with: tuple[GoesWith, ...] = ()
    """Covariates of the coefficients that differ from run to run."""
    dwells: DwellFit | None = None
    """Residuals of the dwells of the fit; None where it has none."""
    noise_effects: tuple[NoiseEffect, ...] = ()
    """Sizes of the effects of the model that act on noise; they are in no row of the covariance."""
    at_mean: tuple[Estimate, ...] = ()
    """Coefficients that mechanisms of the model move, at the mean of each run; in `estimates` they stand where their
    drivers are at zero."""
    at_shapes: tuple[float, ...] = ()
    """Standard deviations of the free estimates, were the shape parameters known exactly, in the order of the
    covariance; empty where no shape was estimated."""

    def __repr__(self) -> str:
        several: tuple[Estimate | NoiseEffect, ...] = (*self.estimates, *self.shapes, *self.noise_effects)
        values = ", ".join(f"{e.name} {e.value:.5g} ± {e.std:.2g} {e.unit}".removesuffix(" 1") for e in several)
        return f"Fit({', '.join(name for name, _ in self.sources)}: {values})"

    def __getitem__(self, name: str) -> Estimate:
        """Return the (first) estimate called `name`."""
        for estimate in (*self.estimates, *self.shapes):
            if estimate.name == name:
                return estimate
        if parts := list(dict.fromkeys(e.name for e in self.estimates if e.name.startswith(f"{name}."))):
            raise KeyError(f"{name!r} has several coefficients: {', '.join(parts)}")
        if name in self.model.effects:
            raise KeyError(f"{name!r} acts on noise and has no coefficient of the mean; see noise_effects of the fit")
        near = difflib.get_close_matches(str(name), self, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise KeyError(f"{name!r} is not a parameter of this fit; it has {', '.join(self)}{hint}")

    def __iter__(self) -> Iterator[str]:
        """Names of parameters, as of a mapping: `"cubic" in fit`."""
        return iter(dict.fromkeys(e.name for e in (*self.estimates, *self.shapes)))

    def _ipython_key_completions_(self) -> list[str]:
        """Names that a notebook offers behind fit[."""
        return list(self)

    def plot(self, *, theme: Literal["light", "dark"] = "light") -> Figure:
        """Draw the parameters with their uncertainties, see `accelcal.plots.parameters`.

        Raises
        ------
        MissingExtra
            If matplotlib is not installed.
        """
        figure: Figure = face("plots").parameters(self, theme=theme)
        return figure

    def save(self, path: str | Path) -> None:
        """Write a model file, whole or not at all; `accelcal.load_model` reads it."""
        face("results.model_file").save(self, path)

    def correlations(self) -> DataFrame:
        """Return the correlations of the free parameters as a pandas DataFrame, names on both sides.

        Raises
        ------
        MissingExtra
            If pandas is not installed.
        """
        frame: DataFrame = face("results.frames").correlations(self)
        return frame

    @property
    def engine(self) -> Engine:
        """Engine that fits the model again: the one that made the fit, or the replay for fits of other kinds."""
        return ENGINES.get(self.method, ENGINES["replay"])

    @property
    def sources(self) -> tuple[tuple[str, str], ...]:
        """Name and SHA-256 of every file that it was made from, of the whole file where a part of it was used."""
        runs = [(run.name or "recording", run.session or run.digest) for run in self.runs]
        return (*runs, *([(self.dwells.name or "dwells", self.dwells.digest)] if self.dwells else []))

    @property
    def electrical(self) -> Mapping[str, Quantity]:
        """Sensitivity and zero-g output where an electrical scale is declared; else none."""
        sensor = self.rig.sensor
        if sensor.scale is None:
            return {}
        unit, k, bias = sensor.scale_unit or "V", self["scale_factor"], self["bias"]
        g, size = STANDARD_GRAVITY, abs(sensor.scale)
        return {
            "sensitivity": Quantity(sensor.scale * (1.0 + k.value) * g, size * k.std * g, f"{unit}/g"),
            "zero_g_output": Quantity((sensor.zero or 0.0) + sensor.scale * bias.value, size * bias.std, unit),
        }

    @property
    def stands_for(self) -> Mapping[str, str]:
        """Sum that each parameter equals on this rig, by name."""
        return {e.name: tied_sum(self, e) for e in self.estimates}

    @property
    def free(self) -> tuple[Estimate, ...]:
        """Estimates in the order of the covariance."""
        return tuple(e for e in self.estimates if e.name not in self.model.fixed)

    @property
    def naming_stds(self) -> tuple[float, ...]:
        """Standard deviations of the free estimates by which their effects are named, in the order of the covariance:
        that there is an effect may be sure where its size depends on a time constant that is not."""
        return self.at_shapes or tuple(e.std for e in self.free)

    def expanded(self, e: Estimate, factor: float) -> float:
        """Expanded uncertainty of one of its estimates: `factor` standard deviations, or half the 95 % interval of a
        mean over few runs if that is more."""
        halves = [spread.mean_half for spread in self.spreads if spread.name == e.name]
        return max([factor * e.std, *halves])

    @property
    def given_choice(self) -> Fit:
        """The fit with the sizes of effects that its own recordings named, allowing for that choice: median-unbiased,
        the other estimates as they follow from those; itself where nothing is allowed for."""
        return allowing_for_choice(self)

    @property
    def log_likelihood(self) -> float:
        """Log-likelihood of the innovations of all runs and of the residuals at dwells."""
        of_dwells = self.dwells.log_likelihood if self.dwells else 0.0
        return sum(run.log_likelihood for run in self.runs) + of_dwells

    @property
    def aic(self) -> float:
        """Akaike's information criterion, of coefficients and the two noises of each run."""
        return 2.0 * (len(self.covariance) + 2 * len(self.runs)) - 2.0 * self.log_likelihood

    @property
    def bic(self) -> float:
        """Bayesian information criterion, of as many readings and dwells as the fit has used."""
        readings = sum(run.readings for run in self.runs) + len(self.dwells.residual if self.dwells else ())
        return math.log(readings) * (len(self.covariance) + 2 * len(self.runs)) - 2.0 * self.log_likelihood

    @checked
    def predict(self, recording: Recording) -> tuple[Array, Array]:
        """Output that the model gives for the motion that the reference tells: times (n,) s, output (n,) m/s².

        It is low-passed to the band in which the reference is better than the sensor; the ends of the recording, which
        the low-pass does not reach, are left out.
        """
        evaluation = face("verbs").compare(self, recording)[0]
        t, residual = evaluation.accel_residual
        return t, evaluation.measured - residual

    @checked
    def residual(self, recording: Recording) -> tuple[Array, Array]:
        """Measured output less what the model gives, in the same band: times (n,) s, residual (n,) m/s²."""
        t, residual = face("verbs").compare(self, recording)[0].accel_residual
        return t, residual

    def paths(self, recording: Recording) -> tuple[Any, ...]:
        """Coefficients over a recording that processes and mechanisms of the model move, each a `Path`: value and
        standard deviation over time, and the drivers that the random part may follow, by the share that each explains.
        """
        moving: tuple[Any, ...] = face("estimation.tracks").paths(self, recording)
        return moving

    def fit_report(self) -> str:
        """The table of the fit as text."""
        return str(self)

    def values(self, run: int | None = None) -> Values:
        """Coefficients as they apply to one run of the fit; by default as far as is known of any other run: the means
        over runs, and the timing of the first."""
        of = self.runs[run or 0] if self.runs else None
        axis, first = ("", run or 0) if of is None or not of.axis else (of.axis, self.first_axis(run or 0))
        by_name = {e.name: e.value for e in self.estimates if e.run in (None, first) and e.axis in ("", axis)}
        of_run = {} if run is None else {spread.name: spread.runs[run] for spread in self.spreads}
        return Values({**by_name, **of_run}, self.model.terms)

    def first_axis(self, run: int) -> int:
        """Number of the first run of the recording that a run is an axis of."""
        outputs = outputs_of(self.runs)
        return next(k for k, output in enumerate(outputs) if output.recording == outputs[run].recording)

    def label(self, e: Estimate) -> str:
        """Name of an estimate in a table: with its axis, or its recording, where each has one of its own."""
        run = None if e.run is None else self.runs[e.run]
        of = [e.axis] if e.axis else []
        return f"{e.name} [{', '.join([*of, *([run.file] if run else [])])}]" if of or run else e.name

    @property
    def axes(self) -> tuple[str, ...]:
        """Outputs of the sensor that it was fitted to together; none of a sensor with one."""
        return tuple(dict.fromkeys(run.axis for run in self.runs if run.axis))

    def of_axis(self, axis: str) -> Fit:
        """Fit of one output of a sensor with several, as of a sensor by itself; itself where it has not that output."""
        return of_output(self, axis) if axis in self.axes else self

    def noise(self, run: int = 0) -> Noise:
        """Noise of one run.

        Raises
        ------
        RecordingError
            If the fit is to dwells alone, which do not show it.
        """
        if not self.runs:
            raise RecordingError(
                f"{self.dwells.name if self.dwells else 'the fit'}: a model of dwells alone knows neither the noise of "
                "the position nor the time offset; fit a motion together with the dwells"
            )
        return self.runs[run].noise.noise


def of_output(fit: Fit, axis: str) -> Fit:
    """Fit of one of the outputs of a joint fit."""
    model, plain = fit.model.of_axis(axis), fit.model.plain_names(axis)
    mine = {e.name for e in fit.estimates if find(e.name.partition(".")[0]).axis in ("", axis)}
    rows = [k for k, e in enumerate(fit.free) if e.axis in ("", axis) and e.name in mine]
    of_axis = [k for k, run in enumerate(fit.runs) if run.axis == axis]
    names, outputs = {fit.runs[k].name for k in of_axis}, outputs_of(fit.runs)
    number = {outputs[k].recording: place for place, k in enumerate(of_axis)}

    def alone(e: Estimate) -> Estimate:
        run = None if e.run is None or len(of_axis) == 1 else number[outputs[e.run].recording]
        return replace(e, name=plain_name(e.name, plain), axis="", run=run)

    return replace(
        fit,
        model=model,
        estimates=tuple(alone(e) for e in fit.estimates if e.axis in ("", axis) and e.name in mine),
        covariance=fit.covariance[np.ix_(rows, rows)],
        runs=tuple(replace(fit.runs[k], axis="") for k in of_axis),
        remarks=tuple(note for note in fit.remarks if note.values.get("recording") in (None, *names)),
        shapes=tuple(alone(e) for e in fit.shapes if find(e.name.rpartition(".")[0]).axis in ("", axis)),
        at_shapes=tuple(fit.at_shapes[k] for k in rows) if fit.at_shapes else (),
    )


@one_thread
def estimate(
    model: Model,
    recordings: Recording | Sequence[Recording],
    *,
    start: float | None = None,
    end: float | None = None,
    band: float | None = None,
    origins: Origins | None = None,
    method: Method | FilterChoice = "auto",
    progress: Callable[[float], None] = lambda share: None,
) -> Fit:
    """Estimate the free parameters of a model by the replay, or the weak form, with smoothed regressors.

    Parameters
    ----------
    model : base and effects.
    recordings : one or several runs. Each is whitened on its own; their information adds up. Parameters of the
        sensor are shared, those of timing belong to each run. Reversed mounts together with normal ones add `tilt`,
        rolled with normal ones `misalignment` and `cross_axis_gravity`; a low-pass with a declared tolerance adds
        `lowpass_error`, a resonance with one `sensor_resonance`, with that tolerance as its prior.
    start, end : s, optional; only readings in [start, end] are used.
    band : Hz, optional; trust the encoder up to this frequency and the accelerometer's share below it, instead of up
        to the crossover of the two noises.
    origins : zero points of t, p and side channels; by default those of the first recording, and the mean of each
        channel over all of them.
    method : "replay", "weak", or "auto": the weak form where a reference is too good for the replay.
    progress : called with the share of the work that is done, 0 to 1.

    Returns
    -------
    Fit

    Raises
    ------
    NotIdentifiable
        If the motion does not excite a parameter of the model.
    RecordingError
        If polarity or axis of the sidecar contradict the data.

    Notes
    -----
    Gauss-Newton about the exact nominal: output re-stamped by `time_offset`, integrals of the output, RTS-smoothed
    motion as regressors, q and R by innovation likelihood in each of the first rounds.
    """
    several = listed(recordings)
    if not several:
        raise AccelcalError("a fit needs at least one recording")
    solution = solve_runs(
        model, several, start=start, end=end, band=band, origins=origins, engine=engine_named(method), progress=progress
    )
    return result(solution)


def most_noise(fit: Fit) -> float:
    """Noise density of the noisiest run, (m/s²)/sqrt(Hz)."""
    return max(run.noise.all.density for run in fit.runs)


def solve_runs(
    model: Model,
    sources: Sequence[Source],
    *,
    start: float | None = None,
    end: float | None = None,
    band: float | None = None,
    origins: Origins | None = None,
    others_whole: bool = False,
    engine: Engine = ENGINES["auto"],
    progress: Callable[[float], None] = lambda share: None,
) -> Solution:
    """The solution of a completed model; where the noise is not white, in the band that determines the scale best.

    Parameters and errors are those of :func:`fit`; `engine` makes the rows of the regression; with `others_whole`,
    `start` and `end` are those of the first recording alone: each has a clock of its own.
    """
    recordings = [recording_of(source) for source in sources]
    require_distinct(recordings)
    recordings = dwells_with_first(recordings)
    requested, model = model, complete(model, recordings)
    several = len({output.recording for output in outputs_of(recordings)}) > 1
    apart = not several and any(recording.positions for recording in recordings)
    if model.per_run and any(recording.axis for recording in recordings) and not apart:
        raise AccelcalError(
            f"{', '.join(model.per_run)}: differs from run to run; expected no such coefficient for three outputs "
            "together. Fit the axis alone, load(..., axis=...), or each recording by itself"
        )
    if not model.free:
        raise AccelcalError(
            "no coefficient of the model is free: set one free to fit it, or compare the model as it is"
        )
    require_shown(model, recordings)
    for recording in recordings:
        require_channels(model, recording)
    require_process_size(model)
    first = prepared(sources[0], origins, start=start, end=end)
    begin, stop = (None, None) if others_whole else (start, end)
    runs = [first, *(prepared(source, first.origins, start=begin, end=stop) for source in sources[1:])]
    if origins is None:
        shared = replace(first.origins, side=side_means(runs))
        runs = [run.but(origins=shared) for run in runs]
    runs = [run.but(recording=recording) for run, recording in zip(runs, recordings, strict=True)]
    for run in runs:
        require_motion(run)
        require_band(run, band)
    *before, last = engine.tried(runs, band)
    for trial in before:
        with suppress(NoWeakForm):
            solution = _solved(requested, model, recordings, [trial.prepare(run) for run in runs], band, progress)
            if solution.converged:
                return solution
    solution = _solved(requested, model, recordings, [last.prepare(run) for run in runs], band, progress)
    return replace(solution, engine=last)


def _solved(
    requested: Model,
    model: Model,
    recordings: Sequence[Recording],
    runs: Sequence[PreparedRun],
    band: float | None,
    progress: Callable[[float], None],
) -> Solution:
    """The solution of prepared runs by their engines; `model` is the completed one that was `requested`.

    A run whose noise needs a band, as is known of the same samples, is fitted in it from the start.
    """

    def iterated(trials: tuple[tuple[BandTrial, ...], ...]) -> Solution:
        bands = tuple(best_band(of_run) for of_run in trials)
        solution = iterate(model, runs, [band or chosen for chosen in bands], progress)
        return replace(solution, chosen=bands, by_band=trials)

    def known_trials() -> tuple[tuple[BandTrial, ...], ...]:
        return tuple(trials_needed(model, run) if band is None else () for run in runs)

    solution = iterated(known_trials())
    unlike, by_runs = differing(solution)
    if unlike:
        model = complete(requested.vary(*unlike), recordings)
        solution = iterated(known_trials())
        _, by_runs = differing(solution)  # one value for runs that differ distorts all that is told beside it
    if band is None:
        if model.shapes and any(map(needs_band, solution.states)):
            refined = refine_shapes(solution)  # what a shape far off leaves is not white either
            if not any(map(needs_band, refined.states)):
                return replace(refined, seen_by_runs=by_runs)
        trials = tuple(
            state.run.once(question(model, state.run), partial(trial_bands, model, state))
            if not of_run and needs_band(state)
            else of_run
            for of_run, state in zip(solution.by_band, solution.states, strict=True)
        )
        if tuple(map(best_band, trials)) != solution.chosen:
            solution = iterated(trials)
        solution = replace(solution, by_band=trials)
    return replace(refine_shapes(solution), seen_by_runs=by_runs)


def require_process_size(model: Model) -> None:
    """Refuse a stationary random process without a standard deviation: its mean would be free beside its parameter.

    Raises
    ------
    NotIdentifiable
        If the model gives it none.
    """
    for term in model.free:
        if term.effect.port == "process" and "tau" in term.effect.shapes and term.name not in model.priors:
            raise NotIdentifiable(
                f"{term.effect.name} needs a standard deviation: `accelcal add` estimates it, or give its coefficients "
                "priors"
            )


SETTLING = 3
"""Times that signals and nominal are made from each other when the states of a fit with effects are restored."""


def restored_states(fit: Fit, sources: Sequence[Source]) -> list[RunState] | None:
    """States of the runs at the values of a fit; None where it was made to other data, or in a band."""
    if len(sources) != len(fit.runs) or any(run.noise.band is not None for run in fit.runs):
        return None
    recordings = dwells_with_first([recording_of(source) for source in sources])
    still = (recordings[0].dwells or recordings[0].positions) if recordings else None
    if (fit.dwells.digest if fit.dwells else None) != (still.digest if still else None):
        return None
    states = []
    for index, (source, recording, fitted) in enumerate(zip(sources, recordings, fit.runs, strict=True)):
        run = fit.engine.prepare(prepared(source, fit.origins).but(recording=recording))
        span = (float(run.t[0]), float(run.t[-1]), ENGINES[run.engine].readings(run), len(run.accel.t))
        of_fit = fitted.digest, (fitted.start, fitted.end, fitted.readings, fitted.samples)
        if not fitted.digest or of_fit != (recording.digest, span):
            return None
        states.append(state_at(fit, index, run))
    return states


@one_thread
def estimate_dwells(model: Model, dwells: Dwells, origins: Origins | None = None) -> Fit:
    """Estimate the parameters of a model from static dwells alone: a tumble test (IEEE 1293).

    Parameters
    ----------
    model : base and effects; the timing is held, since no dwell shows it.
    dwells : means at known attitudes.
    origins : zero of the temperature; by default the mean of the dwells.

    Raises
    ------
    NotIdentifiable
        If the attitudes do not determine the model, or one of its effects does not act at rest.
    """
    origins = origins or origins_of(dwells)
    dwell_solution = solve_dwells(model, dwells, origins)
    x = np.array([dwell_solution.values.by_name[term.name] for term, _ in dwell_solution.layout.slots])
    force = dwells.specific_force(dwells.angle)
    ranges = {"a": (float(np.min(force)), float(np.max(force))), "v": (0.0, 0.0), "p": (0.0, 0.0)}
    if dwells.temperature is not None:
        ranges["temperature"] = (float(np.min(dwells.temperature)), float(np.max(dwells.temperature)))
    return Fit(
        model=dwell_solution.model,
        estimates=dwell_solution.layout.estimates(x, dwell_solution.covariance, dwell_solution.model),
        covariance=dwell_solution.covariance,
        runs=(),
        origins=origins,
        rig=dwells.rig,
        method=DWELLS_ALONE,
        validity={**ranges, "frequency": (0.0, 0.0)},
        remarks=dwell_solution.fit.remarks,
        shapes=tuple(held_shapes(dwell_solution.model)),
        dwells=dwell_solution.fit,
    )


def settled_state(run: PreparedRun, values: Values, noise: Noise, band: float | None = None) -> RunState:
    """State of a run at values and noise that stay, its signals and its nominal settled against each other."""
    state = RunState.at(run, values, noise, band, search_noise=False)
    for _ in range(0 if values.constant and not noise.growth else SETTLING - 1):
        if run.angle_error:
            state.values = replace(values, nuisances=normal_equations(state, ()).nuisances)
        state.refresh(values, search_noise=False)
    return state


def state_at(fit: Fit, index: int, run: PreparedRun) -> RunState:
    """State of a run at the values and the noise that a fit has for its run `index`."""
    state = settled_state(run, fit.values(index), fit.noise(index), fit.runs[index].noise.band)
    measure_noise(state, fit.model)
    settle_dwells(state, fit.model, DWELL_STEPS)
    return state


def result(solution: Solution) -> Fit:
    """The fit that a solution amounts to.

    Raises
    ------
    NotIdentifiable, RecordingError
        If the solution cannot be a sensor on the declared rig.
    """
    model, layout, states = solution.model, solution.layout, solution.states
    x, covariance = solution.x, solution.covariance
    runs = [state.run for state in states]
    estimates, covariance_of_means, spreads, at_shapes = over_runs(solution)
    remarks = [
        *on_bands(solution),
        *judge(layout, x, covariance, states),
        *(
            remark("not_observable", recording=run.recording.title, filters=names(high_passes(run.rig.filters)))
            for run in runs
            if not run.rig.coupled
        ),
        *mostly_prior(layout, covariance, model),
        *against_priors(layout, x, covariance, model),
        *far_zeros(estimates, runs),
        *(remark("on_bound", text=text) for text in on_bounds(solution)),
        *(remark("seen_by_runs", text=choice.sentence, effect=choice.effect) for choice in solution.seen_by_runs),
    ]
    still = [
        seen_in(s.run.recording.dwells, model, s.values, s.run.origins, s.of_dwells or Nuisances())
        for s in states
        if s.run.recording.dwells is not None
    ]
    positions = next((s.run.recording.positions for s in states if s.run.recording.positions), None)
    if solution.agreement is not None and positions is not None:
        at = partial(rows_of_positions, model, layout, states)
        rows = [item for item in (at(), at(scatter=0.0), at(scatter=0.0, white=True)) if item is not None]
        still.append(left_of(positions, *rows))
        remarks.append(agreement_of(solution.agreement, layout, positions.name or "positions"))
    remarks += [note for dwells in still for note in dwells.remarks]
    covariates = covariates_found(solution)
    remarks += run_to_run(covariates, spreads, {e.name: e.value for e in estimates})
    if solution.moving > TRIAL_SETTLED:
        remarks.append(remark("not_settled", rounds=MAX_ROUNDS))
    fits = tuple(run_fit(state, model) for state in states)
    remarks += [
        remark("noise_beyond_declared", recording=f.name or "recording", text=text)
        for f, run in zip(fits, runs, strict=True)
        for text in (f.noise.remark(run.attitude_density), f.noise.remark_on_reading(run.rig))
        if text
    ]
    fit = Fit(
        model=model,
        estimates=estimates,
        covariance=covariance_of_means,
        runs=fits,
        origins=runs[0].origins,
        rig=runs[0].rig,
        method=runs[0].engine,
        validity=validity(states),
        remarks=tuple(remarks),
        shapes=(*solution.shapes, *held_shapes(model)),
        spreads=spreads,
        seen_by_runs=solution.seen_by_runs,
        goes_with=covariates,
        dwells=still[0] if still else None,
        at_mean=at_means(solution),
        at_shapes=at_shapes,
    )
    return solution.engine.result(fit, states[0])


def on_bands(solution: Solution) -> Iterator[Remark]:
    """Bands that were imposed, spectra that were measured, and estimates that change with the band, by recording."""
    called = [state.run.recording.title for state in solution.states]
    for name, b in zip(called, solution.chosen, strict=False):
        if b is not None:
            yield remark("imposed_band", recording=name, band=b)
    for name, state in zip(called, solution.states, strict=True):
        if state.spectrum is not None and state.band is None:
            yield remark("measured_spectrum", recording=name)
    for name, tried in zip(called, solution.by_band, strict=False):
        if text := change_with_band(tried):
            yield remark("changes_with_band", recording=name, text=text)


def agreement_of(agreement: Agreement, layout: Layout, name: str) -> Remark:
    """The remark on whether static positions agree with the motion that they are fitted with."""
    of_slots = zip(agreement.rows, agreement.difference, agreement.std, strict=True)
    term = layout.slots[agreement.rows[0]][0]
    unit = f" {term.unit}".removesuffix(" 1")
    differences = [
        f"{layout.whose(layout.slots[i][1])[1]} {difference:+.2g} ± {std:.1g}{unit}" for i, difference, std in of_slots
    ]
    return remark(
        "positions_disagree" if agreement.p_value < REMARK_ALPHA else "positions_agree",
        positions=name,
        squares=agreement.squares,
        freedom=agreement.freedom,
        p=agreement.p_value,
        alpha=REMARK_ALPHA,
        parameter=term.name,
        differences=", ".join(differences),
    )


def far_zeros(estimates: Sequence[Estimate], runs: Sequence[PreparedRun]) -> Iterator[Remark]:
    """Remarks on angle zeros that are far off, of all runs on arms whose axle is not vertical.

    An error z of the zero turns gravity across the axle, g cos(elevation), by z (derivations 7.9).
    """
    of_zero = f"{WITH_ANGLE[0]}.cos"
    for number, run in enumerate(runs):
        level = math.cos(run.rig.axle or 0.0)
        if run.rig.arm is None or level < LEVEL_AXLE:
            continue
        for e in estimates:
            if e.name == of_zero and e.run in (None, number) and abs(e.value / level) > FAR_ZERO:
                z, scale = e.value / level, run.recording.origin.scales.get(ANGLE)
                counts = "" if scale is None else f" ({z * scale[0]:.6g} {scale[1]})"
                yield remark("angle_zero", recording=run.recording.title, degrees=math.degrees(z), counts=counts)


def over_runs(solution: Solution) -> tuple[tuple[Estimate, ...], Array, tuple[Spread, ...], tuple[float, ...]]:
    """Estimates, in which the mean over runs stands for a coefficient that differs between them, their covariance, how
    much each differs, and their standard deviations at the shapes that were estimated, if any were."""
    layout, model, x = solution.layout, solution.model, solution.x
    listed, spreads = layout.estimates(x, solution.covariance, model), []
    free = [i for term in model.terms for i in layout.rows_of(term.name)]  # in the order of the estimates
    means = np.zeros((len(free), len(x)))
    means[np.arange(len(free)), free] = 1.0
    free_rows, between = np.ones(len(free), dtype=np.bool_), np.zeros(len(free))
    for name, between_runs in solution.between.items():
        rows, D = layout.rows_of(name), between_runs.variance
        first, *others = (k for k, i in enumerate(free) if i in rows)
        means[first] = 0.0
        means[first, rows] = 1.0 / len(rows)
        between[first] = D / len(rows)
        free_rows[others] = False
        term, ends = layout.slots[rows[0]][0], between_runs.interval()
        mean_half, next_half = between_runs.halves()
        spreads.append(
            Spread(
                name=name,
                symbol=term.symbol,
                unit=term.unit,
                value=math.sqrt(D),
                low=math.sqrt(ends[0]),
                high=math.sqrt(ends[1]),
                p_value=between_runs.p_value,
                runs=tuple(x[rows].tolist()),
                mean_half=mean_half,
                next_half=next_half,
            )
        )
    T = means[free_rows]
    covariance = T @ solution.covariance @ T.T + np.diag(between[free_rows])
    value, std = T @ x, np.sqrt(np.diag(covariance))
    estimates, number = [], 0
    for e in listed:
        if e.name in model.fixed:
            estimates.append(e)
        elif e.name not in solution.between or e.run == 0:
            run = None if e.name in solution.between else e.run
            estimates.append(replace(e, value=float(value[number]), std=float(std[number]), run=run))
            number += 1
    if solution.joint is None:
        return tuple(estimates), covariance, tuple(spreads), ()
    at_shapes = np.sqrt(np.diag(T @ solution.at_shapes @ T.T) + between[free_rows])
    return tuple(estimates), covariance, tuple(spreads), tuple(at_shapes.tolist())


def run_to_run(
    covariates: Sequence[GoesWith], spreads: Sequence[Spread], means: Mapping[str, float]
) -> Iterator[Remark]:
    """Remarks on coefficients that differ from run to run, and on what they go with."""
    for covariate in covariates:
        yield remark(
            "goes_with",
            text=covariate.sentence,
            parameter=covariate.parameter,
            covariate=covariate.covariate,
            p=covariate.p_value,
        )
    for spread in spreads:
        mean = means[spread.name]
        numbers = {key: getattr(spread, key) for key in ("low", "high", "next_half")}
        yield remark(
            "run_to_run",
            text=spread.sentence(mean),
            parameter=spread.name,
            mean=mean,
            std=spread.value,
            **numbers,
            p=spread.p_value,
        )


def covariates_found(solution: Solution) -> tuple[GoesWith, ...]:
    """Covariates of the coefficients that differ from run to run."""
    recordings = [state.run.recording for state in solution.states]
    units = {term.name: term.unit for term in solution.model.terms}
    covariates = (
        goes_with(name, between, covariates_of(recordings, units[name]))
        for name, between in solution.between.items()
        if between.p_value < REMARK_ALPHA
    )
    return tuple(covariate for covariate in covariates if covariate is not None)


def complete(model: Model, recordings: Sequence[Recording]) -> Model:
    """The model with the effects that turning or rolling the sensor separates, the tilt that a gyroscope shows, the
    lever arm on a tracked body, and the error of the low-pass.

    Where the tolerance of a low-pass is declared, its time constant is a nuisance with that standard deviation: one
    for all runs, since the filter travels with the sensor. With a declared tolerance of 0, or none, it is exact.
    Behind a high-pass no constant is seen: the bias is held at zero.
    """
    mounts = {r.rig.mount for r in recordings}
    extra: list[str] = []
    if not any(r.rig.coupled for r in recordings) and "bias" not in model.fixed:
        model = model.freeze(bias=0.0)
    turned = {"normal", "reversed"} <= mounts or {"rolled", "reversed"} <= mounts
    tumbled = any(r.dwells is not None and determines(r.dwells, "bias") for r in recordings)
    tumbled = tumbled and any(r.rig.axis == "level" and r.rig.coupled for r in recordings)
    if turned or (tumbled and "bias" not in model.per_run):
        extra += [n for n in SEPARATED_BY_TURNING if n not in model.effects]
    else:  # that of other recordings, from which the model comes
        model = without(model, SEPARATED_BY_TURNING)
    if {"normal", "rolled"} <= mounts:
        extra += [n for n in SEPARATED_BY_ROLLING if n not in model.effects]
    elif not any(r.dwells is not None for r in recordings) and len(recordings) == 1:
        model = without(model, SEPARATED_BY_ROLLING)
    if all(name in r.side for r in recordings for name in TURNED):
        extra += [n for n in WITH_GYROSCOPE if n not in model.effects]
    if all(name in r.side for r in recordings for name in LEVERS):
        away = {term.name: Prior(0.0, FARTHEST) for name in WITH_ATTITUDE for term in terms_of(find(name))}
        missing = [name for name in WITH_ATTITUDE if name not in model.effects]
        require_one_arm(recordings)
        if recordings[0].rig.arm is not None:
            model = on_arms(model, [r.rig for r in recordings], away)
        else:
            model = model.add(*missing, priors=away) if missing else model
            model = of_triad(model) if any(r.axis for r in recordings) else model
    unsure = {
        "lowpass_error": max((r.rig.lowpass_prior for r in recordings), default=0.0),
        "sensor_resonance": max((r.rig.resonance_prior for r in recordings), default=0.0),
    }
    priors = {name: Prior(0.0, std) for name, std in unsure.items() if std > 0.0 and name not in model.effects}
    model = model.add(*priors, priors=priors) if priors else model
    return model.add(*extra) if extra else model


def of_triad(model: Model) -> Model:
    """The model with the directions of three outputs and with that of gravity."""
    names = [name for name in OF_TRIAD if name not in model.effects]
    priors = {term.name: Prior(0.0, ASIDE) for name in names for term in terms_of(find(name))}
    return model.add(*names, priors=priors) if names else model


def require_one_arm(recordings: Sequence[Recording]) -> None:
    """Refuse recordings on different arms or axles in one fit: one error of the length, and one tilt, cannot be that of
    both.

    Raises
    ------
    RecordingError
        Naming two recordings and what differs of their rigs.
    """
    first, *others = recordings
    for other in others:
        for key, unit, by, what in (
            ("arm", "mm", 1e3, "one error of its length (lever_arm.x)"),
            ("axle", "deg", math.degrees(1.0), "one tilt of it (axle_tilt)"),
        ):
            sizes = [getattr(r.rig, key) for r in (first, other)]
            if not math.isclose(*(-9.0 if size is None else size for size in sizes), rel_tol=1e-9, abs_tol=1e-9):
                rigs = [
                    f"{r.title}: {f'no {key}' if size is None else f'{key} = {by * size:.6g} {unit}'}"
                    for r, size in zip((first, other), sizes, strict=True)
                ]
                raise RecordingError(
                    f"{rigs[0]}, but {rigs[1]}; expected the same [rig] {key} in all recordings of a fit, which "
                    f"estimates {what}. Fit each recording alone, and compare the results"
                )


def on_arms(model: Model, rigs: Sequence[Rig], away: Mapping[str, Prior]) -> Model:
    """The model with the error of an arm, the sensor's distance from its line, and the tilt of its axle.

    A turn about one axle shows no distance along it. About a horizontal axle gravity is turned, not scaled. What the
    model has of them stays as it is.
    """
    names = [name for name in (*WITH_ATTITUDE, *WITH_ANGLE) if name not in model.effects]
    if not names:
        return model
    radial, across, along = away
    sine, cosine = (term.name for term in terms_of(find(WITH_ANGLE[0])))
    arm_std = max(rig.arm_std or max(ARM_STD * (rig.arm or 0.0), LEAST_ARM_STD) for rig in rigs)
    level = Prior(0.0, max(rig.uncertainty.level or AXLE_TILT for rig in rigs))
    held = {along: 0.0} | ({sine: 0.0} if all(abs(rig.axle or 0.0) < LEVEL_AXLE for rig in rigs) else {})
    priors = {radial: Prior(0.0, arm_std), across: Prior(0.0, max(ACROSS_ARM, arm_std)), sine: level, cosine: level}
    new = {term.name for name in names for term in terms_of(find(name))}
    model = model.add(*names, priors={n: p for n, p in priors.items() if n in new and n not in held})
    return model.freeze(**{n: y for n, y in held.items() if n in new})


def allowing_for_choice(fit: Fit) -> Fit:
    """A fit whose estimates follow from the sizes of what its own recordings named, given that choice."""
    values = np.array([e.value for e in fit.free])
    names, C = [e.name for e in fit.free], np.array(fit.covariance)
    for note in (note for note in fit.remarks if note.code == "chosen"):
        i = names.index(str(note.values["effect"]))
        size, std = float(note.values["size"]), float(note.values["std"])
        follow, v = C[:, i] / C[i, i], C[i, i]
        values = values + follow * (size - values[i])
        C += np.outer(follow, follow) * (std**2 - v)
    if np.array_equal(C, fit.covariance):
        return fit
    allowed = iter(zip(values.tolist(), np.sqrt(np.diag(C)).tolist(), strict=True))
    estimates = [
        e if e.name in fit.model.fixed else replace(e, **dict(zip(("value", "std"), next(allowed), strict=True)))
        for e in fit.estimates
    ]
    return replace(fit, estimates=tuple(estimates), covariance=C)


def without(model: Model, names: Sequence[str]) -> Model:
    """The model without those of some effects that are free and have no prior."""
    held = {*model.fixed, *model.priors}
    return model.drop(*(n for n in names if n in model.effects and n not in held))


def require_shown(model: Model, recordings: Sequence[Recording]) -> None:
    """Refuse dwells without a channel that an effect of the model needs: what it adds to them is not known.

    Raises
    ------
    RecordingError
        Naming effect, channel and file.
    """
    for dwells in (still for r in recordings for still in (r.dwells, r.positions) if still is not None):
        for term in model.terms:
            if acts_at_rest(term.effect) and not shown(dwells, term.effect):
                raise RecordingError(
                    f"{dwells.name or 'dwells'}: {term.name} needs {' and '.join(term.effect.needs)}, which these "
                    "dwells do not have; add the column, or fit the motion without them"
                )


def require_motion(run: PreparedRun) -> None:
    """Refuse a record in which the position never changes, and gravity along the axis does not either."""
    if float(np.ptp(run.z)) == 0.0 and not run.turns:
        raise NotIdentifiable(
            f"{run.recording.title}: position is {run.z[0] + 0.0:.6g} m throughout; acceleration was not "
            "excited, so scale_factor and time_offset cannot be estimated. Record a run in which the stage moves"
        )


def require_distinct(recordings: Sequence[Recording]) -> None:
    """Refuse a recording that is given twice, for its readings would count twice, and one of another sensor.

    Raises
    ------
    RecordingError
        Naming the recording.
    """
    for number, recording in enumerate(recordings):
        for before in recordings[:number]:
            if recording.digest and (recording.digest, recording.axis) == (before.digest, before.axis):
                raise RecordingError(
                    f"{recording.name} is {before.name} once more: its readings would count twice. Give it once"
                )
        require_same_sensor(recording, recordings[0].rig, recordings[0].name or "the first recording")


def require_band(run: PreparedRun, band: float | None) -> None:
    """Refuse a band that is not positive, below one period in the record, or beyond half the rate of the readings.

    Raises
    ------
    ValueError
        With the limits.
    """
    name, most, least = run.recording.title, 0.5 / run.reading_step, 1.0 / float(run.t[-1] - run.t[0])
    if band is not None and not 0.0 < band < most:
        raise AccelcalError(
            f"{name}: a band of {band:g} Hz; expected more than 0 and less than half the rate of the encoder "
            f"readings, {most:.4g} Hz"
        )
    if band is not None and band < least:
        raise AccelcalError(
            f"{name}: a band of {band:g} Hz is less than one period of the record; take {least:.3g} Hz or more"
        )


def require_channels(model: Model, recording: Recording) -> None:
    """Refuse a recording without a channel that an effect of the model is made of.

    Raises
    ------
    RecordingError
        Naming effect and channel.
    """
    for term in model.terms:
        for name in term.effect.needs:
            if name not in recording.side:
                raise RecordingError(
                    f"{recording.title}: {term.effect.name} of the model needs the channel {name}, which "
                    "was not recorded; declare it or the orientation in the sidecar, or fit a model without it"
                )


def judge(layout: Layout, x: Array, covariance: Array, states: Sequence[RunState]) -> list[Remark]:
    """Refuse what cannot be a sensor; remarks on what is implausible.

    Raises
    ------
    NotIdentifiable
        If the scale factor is not determined.
    RecordingError
        If the output runs against the encoder, or gravity shows on an axis declared level.
    """
    runs = [state.run for state in states]
    rows = {name: layout.rows_of(name) for name in ("scale_factor", "bias")}
    remarks: list[Remark] = []
    scales = [state.values.scale for state in states]
    for i in rows["scale_factor"]:
        first = layout.slots[i][1][0]
        scale, std, name = 1.0 + x[i], math.sqrt(covariance[i, i]), runs[first].recording.title
        if std > SCALE_STD_LIMIT * max(1.0, abs(scale)):
            raise NotIdentifiable(
                f"{name}: 1 + k = {scale:.3g} with a standard deviation of {std:.2g}: acceleration was not excited "
                "enough to estimate scale_factor. Record a run with stronger or longer motion"
            )
        if math.copysign(scale, scale * (runs[first].rig.ratio or 1.0)) < -3.0 * std:
            raise RecordingError(reversed_or_unrelated(runs[first].recording, scale, std))
        remarks += implausible_scale(runs[first], scale)
        scales = [scale if k in layout.slots[i][1] else other for k, other in enumerate(scales)]
    for i in rows["bias"] if not remarks else ():
        first = layout.slots[i][1][0]
        mistaken = gravity_mistaken(runs[first].recording, scales[first], float(x[i]))
        if mistaken:
            raise RecordingError(mistaken)
    return remarks


def against_priors(layout: Layout, x: Array, covariance: Array, model: Model) -> list[Remark]:
    """The remark that the record contradicts the priors of the sensor's coefficients.

    With prior N(m, W) and the estimate x of covariance U given both, x - m has covariance W - U where the prior holds.
    """
    slots = [(k, term.name) for k, (term, _) in enumerate(layout.slots) if of_sensor(term, model)]
    if not slots:
        return []
    rows = [k for k, _ in slots]
    priors = [model.priors[name] for _, name in slots]
    away = x[rows] - np.array([prior.mean for prior in priors])
    S = np.diag([prior.std**2 for prior in priors]) - covariance[np.ix_(rows, rows)]
    squares = float(away @ np.linalg.pinv(S, rcond=1e-9, hermitian=True) @ away)
    p_value = float(scipy.special.chdtrc(len(rows), squares))
    if p_value >= REMARK_ALPHA:
        return []
    sigma = np.abs(away) / np.sqrt(np.maximum(np.diag(S), VANISHING))
    worst = int(np.argmax(sigma))
    names = ", ".join(name for _, name in slots)
    named = {"parameters": names, "parameter": slots[worst][1]}
    return [remark("not_of_type", p_value=p_value, sigma=float(sigma[worst]), **named)]


def of_sensor(term: Term, model: Model) -> bool:
    """Whether a coefficient is one of the sensor for which a type or a data sheet has given a prior."""
    effect = term.effect
    return term.name in model.priors and effect.owner == "sensor" and effect.port != "process" and not effect.prior.mean


BY_DEFINITION = 0.05
"""Relative standard deviation of a prior up to which its coefficient is a number by definition."""


def mostly_prior(layout: Layout, covariance: Array, model: Model) -> list[Remark]:
    """The remark on each coefficient that the prior determines more than the record; not on one that is a number by
    definition, such as the whole of a signal that a low-pass takes."""
    return [
        remark("mostly_prior", parameter=term.name, mean=belief.mean, std=belief.std)
        for k, (term, _) in enumerate(layout.slots)
        if (belief := model.priors.get(term.name))
        and belief.std > BY_DEFINITION * abs(term.effect.prior.mean) > 0.0
        and 2.0 * covariance[k, k] > belief.std**2
    ]


def validity(states: Sequence[RunState]) -> dict[str, tuple[float, float]]:
    """Ranges of motion, frequency and side channels in the data of the fit, over all runs."""
    ranges: dict[str, list[float]] = {}

    def widen(key: str, low: float, high: float) -> None:
        ranges.setdefault(key, [low, high])
        ranges[key] = [min(ranges[key][0], low), max(ranges[key][1], high)]

    for state in states:
        s, origins = state.signals, state.run.origins
        for key, y in (("a", s.a), ("v", s.v), ("p", s.p + origins.p)):
            widen(key, float(np.min(y)), float(np.max(y)))
        widen("frequency", 0.0, s.cutoff)
        for key, y in ((name, y) for name, y in s.side.items() if name not in DERIVED):
            widen(key, float(np.min(y)) + origins.of(key), float(np.max(y)) + origins.of(key))
    return {key: (low, high) for key, (low, high) in ranges.items()}


def tied_sum(fit: Fit, e: Estimate) -> str:
    """The sum that a parameter equals on this rig, as long as no joint fit has separated it."""
    name, base = e.name, CATALOGUE.get(e.name)
    if fit.method == DWELLS_ALONE:  # they show the sensor and no rig
        return e.symbol
    turning = ("gravity along a turning axis",) if fit.tilt > 0.0 and name in ("bias", "scale_factor") else ()
    if base is None or base.traits.lumped is None:
        return e.symbol
    members = [find(member) for member in base.traits.lumped.members]
    inside = [m for m in members if not (m.traits.separated_by and m.name in fit.model.effects)]
    at_mean = [
        f"{effect.name} at the mean of {channel}"
        for effect in (find(added) for added in fit.model.added)
        for channel in effect.needs
        if name in effect.search.includes and channel in fit.origins.side
    ]
    return " + ".join((*(effect.traits.summand for effect in (base, *inside)), *turning, *at_mean))
