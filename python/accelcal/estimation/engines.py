"""Engines of a fit: the replay, the weak form, and the live filters run over a record, behind one interface."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal, Protocol, TypeVar

import numpy as np
import scipy

from accelcal.data import DERIVED, POSITION_ORDER, Array, Channel, LowPass, RecordingError, Rig, unsupported
from accelcal.effects import find, of_one_record, polynomial
from accelcal.estimation.columns import ColumnFilter, whitened_columns
from accelcal.estimation.dwell_rows import DwellRows, Nuisances, dwell_rows, stepped, with_scatter
from accelcal.estimation.noise import (
    MeasuredSpectrum,
    NoiseSearch,
    blocks,
    least_density,
    measured_spectrum,
    most_likely_noise,
    whitener,
)
from accelcal.estimation.remarks import Remark, remark
from accelcal.estimation.run import PreparedRun
from accelcal.estimation.run_state import RunState
from accelcal.estimation.smoothing import output_at, uniform_times
from accelcal.estimation.values import Noise, Values
from accelcal.estimation.weak_form.covariance import NoWeakForm, factor, solved
from accelcal.estimation.weak_form.rows import FEWEST_ROWS, WeakRows
from accelcal.filters.choice import FilterChoice, spread_start, to_stage
from accelcal.filters.live_model import belief, live_terms, state_names
from accelcal.filters.record import FilterRun, ForwardParameters, forward_parameters, run
from accelcal.model import NOMINAL, Estimate, Model, Prior, Term

NEAR_RATE = 0.1
"""Crossover in sampling rates of the output above which the weak form suits a recording better. The replay beside it,
whose innovations are tested, takes thinned readings from there on: what the output does between its samples, which it
assumes, begins to matter."""
Rows = tuple[Array, Array, Array]
"""Times (n,) s, columns (n, m), innovations (n,)."""


class Fitted(Protocol):
    """Fit, as far as an engine reads it and puts its numbers in the place of others."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    @property
    def model(self) -> Model:
        """Model with what it holds."""

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """Parameters in the order of the model."""

    @property
    def free(self) -> tuple[Estimate, ...]:
        """Estimates in the order of the covariance."""

    @property
    def covariance(self) -> Array:
        """(m, m) of the free ones, SI."""

    @property
    def rig(self) -> Rig:
        """Rig of the first recording."""

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """Sentences to be read with the numbers."""

    def values(self) -> Values:
        """Coefficients of the model."""

    def noise(self) -> Noise:
        """Noise of the first run."""


AnyFit = TypeVar("AnyFit", bound=Fitted)


class Engine(Protocol):
    """Way from prepared runs to the numbers of a fit: a class here that `engine_named` gives by its word, a live filter
    by its choice."""

    name: str
    """Word for it in `method=`, and in the fits that it makes."""
    second: str = ""
    """Engine whose estimates are compared with its own."""
    alone: bool = False
    """Whether it takes one recording as it is, with a model of its own."""

    @property
    def model(self) -> Model:
        """Model that is fitted where none is given."""
        return Model.linear()

    def tried(self, runs: Sequence[PreparedRun], band: float | None) -> Sequence[Engine]:
        """Engines to be tried on runs, in this order; the last one has to succeed."""
        return (self,)

    def prepare(self, run: PreparedRun) -> PreparedRun:
        """The run with the readings that the engine uses.

        Raises
        ------
        RecordingError
            If the engine cannot fit it.
        """

    def readings(self, run: PreparedRun) -> int:
        """Number of readings of a prepared run that the engine uses."""

    def sums(self, state: RunState) -> ColumnFilter | WeakRows:
        """Innovations and columns of a run at a rate that its motion needs."""

    def rows(self, state: RunState, terms: Sequence[Term]) -> Iterator[Rows]:
        """Rows of the readings that count, stretch by stretch, those of dwells last, at the time of the last reading.

        A run whose noise is not white is a single stretch of sums.
        """

    def settle(self, state: RunState, model: Model, values: Values | None = None, *, search: bool = True) -> None:
        """Move a run to other coefficients, by default its own, and measure its noise there.

        With `search`, the filter over positions is run at the noise that is most likely.
        """

    def result(self, fit: AnyFit, state: RunState) -> AnyFit:
        """The fit as this engine reports it, from the regression and the state of its first run."""
        return fit


class Replay(Engine):
    """The Kalman filter on position and velocity, run once and driven by the output; it fits positions alone."""

    name = "replay"
    second = "weak"

    def prepare(self, run: PreparedRun) -> PreparedRun:
        return run.but(engine="replay") if run.order == POSITION_ORDER else ENGINES["weak"].prepare(run)

    def readings(self, run: PreparedRun) -> int:
        return len(run.t)

    def sums(self, state: RunState) -> ColumnFilter | WeakRows:
        return ColumnFilter(state)

    def rows(self, state: RunState, terms: Sequence[Term]) -> Iterator[Rows]:
        if state.spectrum is None:
            for readings, columns in whitened_columns(state, terms):
                counts = state.counts[readings]
                yield state.run.t[readings][counts], columns, state.whitened[readings][counts]
        else:
            yield coloured_rows(state.spectrum, ColumnFilter(state), terms)
        yield from last_rows(state, terms)

    def settle(self, state: RunState, model: Model, values: Values | None = None, *, search: bool = True) -> None:
        if values is not None:
            state.refresh(values, search_noise=search)
        measure_noise(state, model, search=search)


class WeakForm(Engine):
    """Integrals against smooth test functions, of a reference of any order (derivations 6.15)."""

    name = "weak"
    second = "replay"

    def prepare(self, run: PreparedRun) -> PreparedRun:
        run = run.but(engine="weak")
        thin = run.order == POSITION_ORDER and run.read is None and run.rounding == 0.0
        return run.thinned(NEAR_RATE) if thin else run

    def readings(self, run: PreparedRun) -> int:
        return len(run.all_readings[0])  # those that the replay leaves out among them

    def sums(self, state: RunState) -> WeakRows:
        state.weak = weak = state.weak if isinstance(state.weak, WeakRows) else weak_form(state)
        return weak

    def rows(self, state: RunState, terms: Sequence[Term]) -> Iterator[Rows]:
        weak = self.sums(state)
        if state.spectrum is None:
            times, y = weak.times, weak.whitened
            for part, columns in weak.stretches(terms):
                yield times[part], columns.T, y[part]
        else:
            yield coloured_rows(state.spectrum, weak, terms)
        yield from last_rows(state, terms)

    def settle(self, state: RunState, model: Model, values: Values | None = None, *, search: bool = True) -> None:
        if values is not None:
            state.refresh(values, search_noise=search, only_growing=True)
        if state.band is None and not state.noise.growth:
            state.weak = weak = with_noise(weak_form(state))
            state.noise = weak.of_positions
            state.search = NoiseSearch(state.noise)
        measure_noise(state, model, search=search)


class Suited(Replay):
    """The weak form where a reference is too good for the replay, which fits all others."""

    name = "auto"

    def tried(self, runs: Sequence[PreparedRun], band: float | None) -> Sequence[Engine]:
        good = band is None and any(run.unpredicted.crossover >= NEAR_RATE for run in runs)
        return (ENGINES["weak"], ENGINES["replay"]) if good else (ENGINES["replay"],)


PARAMETER_OF = {find(name).symbol: name for name in ("scale_factor", "bias", *polynomial(3))}
"""Public name of each filter parameter."""
PRIOR_STD = {"k": 0.3, "K0": 3.0, "K2": 1e-2, "K3": 1e-3}
"""Standard deviations before the first sample, SI: wide for any working sensor."""


READ_OUT_SHARE = 1e-4
"""Reading noise of a filtered output over the variance of its unfiltered noise: the converter, not the sensor."""


@dataclass(frozen=True)
class ForwardFilter(Replay):
    """One of the paper's live filters, ACI or CWPA, run forwards over one recording; noise and ranges are the replay's.

    The output is re-stamped by the time offset that the replay finds, since the filters do not estimate it. A declared
    low-pass is a state in CWPA and reads p + tau v in ACI. CWPA takes its jerk density from the rms change of
    acceleration between samples, q dt = (delta a)² (Bar-Shalom 2001, 6.2.3; derivations 4.1).
    """

    choice: FilterChoice
    alone = True

    @property
    def name(self) -> str:  # type: ignore[override]
        c = self.choice
        return " ".join((c.system, c.form, c.interpolation, c.integrator, f"order {c.order}", c.carrier))

    @property
    def model(self) -> Model:
        return Model.cubic() if self.choice.model == "cubic" else Model.linear()

    def prepare(self, run: PreparedRun) -> PreparedRun:
        self.choice.refuse_consider("a fit by a live filter")
        recording = run.recording
        turning = next((name for name in DERIVED if name in recording.side), None)
        refused = unsupported(recording.rig.filters, "a fit by a live filter")
        if not refused and turning:
            refused = f"{turning}: a fit by a live filter takes gravity along the axis as constant; use the replay"
        if not refused and recording.reference is not None:
            refused = (
                f"a fit by a live filter reads positions, and here is {recording.reference.name}, whose integral has "
                "other noise; fit it by the weak form"
            )
        if refused:
            raise RecordingError(f"{recording.title}: {refused}")
        return super().prepare(run)

    def result(self, fit: AnyFit, state: RunState) -> AnyFit:
        return as_fit(fit, forward_parameters(self.over(fit, state)), self.choice)

    def over(self, fit: Fitted, state: RunState) -> FilterRun:
        """Record of the filter over a run, with a row for each event, beside the fit of the replay.

        Raises
        ------
        FilterError
            If a step fails, among others when RK2 loses positive definiteness.
        """
        prepared, choice, values, noise = state.run, self.choice, fit.values(), fit.noise()
        tau, step = prepared.tau(values), prepared.accel_step
        accel = Channel("accel", prepared.accel.t - values.by_name["time_offset"], stage_output(prepared), "m/s^2")
        position = Channel("position", prepared.t, prepared.z, "m")
        density = noise.q * values.scale**2
        names = choice.states(low_pass=tau > 0.0)
        x0 = np.zeros(len(names))
        x0[0] = prepared.z[0]
        spread = float(np.std(accel.y))
        std = {"p": math.sqrt(noise.r), "v": prepared.speed, "a": spread, "y": spread, **PRIOR_STD}
        P0 = np.diag([std[name] ** 2 for name in names])
        # The filter starts at the output before the first reading, where p is z - v ahead; under ACI, whose motion lags
        # by the low-pass, z - (ahead + tau) v. It is as uncertain as v and a make it.
        first = max(0, int(np.searchsorted(accel.t, position.t[0], side="right")) - 1)
        accel = Channel(accel.name, accel.t[first:], accel.y[first:], accel.unit)
        ahead = max(0.0, float(position.t[0] - accel.t[0]))
        spread_start(P0, v_std=std["v"], a_std=std["a"], ahead=ahead, lag=tau if choice.system == "aci" else 0.0)
        if choice.system == "aci":
            return run(choice, accel, position, q=density, r_position=noise.r, x0=x0, P0=P0, tau=tau)
        smoothed = output_at(prepared, uniform_times(prepared), state.signals.cutoff, tau) / values.scale
        return run(
            choice,
            accel,
            position,
            q=float(np.mean(np.diff(smoothed) ** 2)) / step,
            r_position=noise.r,
            r_accel=READ_OUT_SHARE * density / step if tau > 0.0 else density / step,
            q_accel=density if tau > 0.0 else None,
            x0=x0,
            P0=P0,
            tau=tau,
        )


ENGINES: Mapping[str, Engine] = {engine.name: engine for engine in (Suited(), Replay(), WeakForm())}
"""Engines by name."""
Method = Literal["auto", "replay", "weak"]
"""Names of the engines."""


def engine_named(method: Method | FilterChoice) -> Engine:
    """The engine that `method=` names."""
    return ForwardFilter(method) if isinstance(method, FilterChoice) else ENGINES[method]


MOST_DECLARED, MOST_MEASURED = 0.9, 0.99
"""Largest share of the sensor in the noise of two accelerations, as declared; of either, as measured."""
KNOWN_SHARE = 0.1
"""Standard deviation of the reference's share up to which it is taken as measured."""
FEWEST_BLOCKS = 8
"""Blocks that count alike, least, from whose scatter that is known."""
COMMON_BLOCKS = 64
"""Blocks of a record over which that is measured, most."""
READINGS_KNOWN = math.log(3.0)
"""Standard deviation of what the readings themselves tell of the logarithm of their variance."""
BLOCK_ROWS = 2048
"""Rows of one of the blocks that the likelihood is taken over."""


def with_noise(rows: WeakRows, width: float = 0.3) -> WeakRows:
    """The rows at the noise that is most likely near theirs; first steps in log q and log r are `width`.

    What varies along the record stays as it is. Readings so good that the rows do not show their noise have the one
    that their neighbours do not predict.
    """
    start, reading_std = rows.noise, rows.state.run.unpredicted.reading
    if rows.order == 0:
        return rows.at_noise(shared(rows))
    log_ratio = 2.0 * math.log(reading_std) if reading_std > 0.0 and rows.order == POSITION_ORDER else None
    parts = [(rows.covariance.part(block), rows.raw[block][:, None]) for block in blocks(rows.rows, BLOCK_ROWS)]

    def log_likelihood(log_q: float, log_r: float) -> float:
        total = 0.0 if log_ratio is None else -0.5 * ((log_r - log_ratio) / READINGS_KNOWN) ** 2
        for covariance, y in parts:
            try:
                L = factor(covariance.at(math.exp(log_q), math.exp(log_r)))
            except NoWeakForm:
                return -math.inf
            total -= 0.5 * float(np.sum(solved(L, y) ** 2)) + float(np.sum(np.log(L[0])))
        return total

    least = least_density(rows.state.run)
    noise_found = most_likely_noise(log_likelihood, rows.least_reading_variance, start, width, least)
    return rows.at_noise(replace(start, q=noise_found.q, r=noise_found.r))


def shared(rows: WeakRows) -> Noise:
    """Noise of the output and of a reference that is an acceleration, of which the innovations show the sum alone.

    The sensor has what is declared of it, if that is less than all. Where nothing is, the reference has what its
    readings and the innovations have in common, where that is known to a tenth of the sum: parts at rest tell it; and
    half of the sum where it is not.
    """
    run, step = rows.state.run, rows.reading_step
    both = float(np.mean(rows.whitened**2)) * (rows.noise.q + rows.noise.r * step)
    declared, most = run.rig.sensor.noise, MOST_DECLARED
    q = both / 2.0 if declared is None else 0.5 * (declared / rows.state.values.scale) ** 2
    if declared is None:
        r, std = common_variance(rows)
        if std * step < KNOWN_SHARE * both:
            q, most = max(both - r * step, (1.0 - MOST_MEASURED) * both), MOST_MEASURED
    q = min(q, most * both)
    return replace(rows.noise, q=q, r=(both - q) / step)


def common_variance(rows: WeakRows) -> tuple[float, float]:
    """Variance of a reading that is in the innovations and in the reference, which share its noise and no motion, and
    its standard deviation; blocks count by the inverse of the reference's power."""
    count = max(1, min(COMMON_BLOCKS, rows.rows // FEWEST_ROWS))
    y = np.stack([rows.raw, rows.reference_sums])
    y -= np.median(y, axis=1)[:, None]
    blocks_of = np.array_split(y, count, axis=1)
    moments = np.array([[np.mean(read**2), np.mean(raw * read)] for raw, read in blocks_of])
    power, product = moments.T / float(np.mean(rows.covariance.of_readings[0]))
    if count < 2 or not np.all(power > 0.0):
        return 0.0, math.inf
    weight = 1.0 / (power * np.sum(1.0 / power))
    if np.sum(weight**2) * FEWEST_BLOCKS > 1.0:  # one quiet part alone tells nothing of its own scatter
        return 0.0, math.inf
    r = float(weight @ product)
    return r, math.sqrt(float(np.sum((weight * (product - r)) ** 2)))


def weak_form(state: RunState) -> WeakRows:
    """Weak form of a run that is to hold it.

    Raises
    ------
    NoWeakForm
        If the run has none; the text names it.
    """
    try:
        return WeakRows(state).held()
    except NoWeakForm as error:
        name = state.run.recording.title
        by_replay = "fit it by the replay: accelcal fit RUN --method replay"
        way_out = by_replay if state.run.order == POSITION_ORDER else "use a record that is longer, or whole"
        raise NoWeakForm(f"{name}: no weak form: {error}; {way_out}") from error


def coloured_rows(spectrum: MeasuredSpectrum, sums: ColumnFilter | WeakRows, terms: Sequence[Term]) -> Rows:
    """Sums of the whole run, whitened by a spectrum."""
    whiten = whitener(spectrum, sums.rate)
    of, columns = vars(sums).pop(COLUMNS, ((), None))
    return sums.times, whiten(columns if of == tuple(terms) else whole_columns(sums, terms)).T, whiten(sums.whitened)


COLUMNS = "columns"
"""Attribute of sums: terms and their columns on which a spectrum was measured, until they are fitted."""


def last_rows(state: RunState, terms: Sequence[Term]) -> Iterator[Rows]:
    """Rows of the dwells of a run, at the time of its last reading."""
    rest = rows_of_dwells(state, terms)
    if rest is not None:
        yield np.full(len(rest.y), state.run.t[-1]), rest.columns, rest.y


def rows_of_dwells(state: RunState, terms: Sequence[Term]) -> DwellRows | None:
    """Rows of the dwells that a recording has; None where it has none."""
    dwells = state.run.recording.dwells
    if dwells is None:
        return None
    return dwell_rows(dwells, terms, state.values, state.run.origins, state.of_dwells)


def measure_noise(state: RunState, model: Model, *, search: bool = True) -> None:
    """Measure what is no white noise in what a model leaves of a run: the spectrum of its innovations, and the angle
    zeros of its dwells, a step on, with the scatter between them.

    Without `search` a run that has a spectrum keeps one: at the limit of what is white the estimates would go to and
    fro between those with a spectrum and those without.
    """
    state.spectrum = spectrum_of(state, model.free, keep=not search and state.spectrum is not None)
    settle_dwells(state, model)


def sums_of(state: RunState) -> ColumnFilter | WeakRows:
    """Innovations and columns of a run by its engine."""
    return ENGINES[state.run.engine].sums(state)


def whole_columns(sums: ColumnFilter | WeakRows, terms: Sequence[Term]) -> Array:
    """A few whitened columns over the whole run, (terms, rows)."""
    columns = np.empty((len(terms), sums.rows))
    for rows, part in sums.stretches(terms):
        columns[:, rows] = part
    return columns


def settle_dwells(state: RunState, model: Model, steps: int = 1) -> None:
    """Move the angle zeros of the dwells of a run on by some Newton steps; at first they are 0."""
    dwells, of_dwells = state.run.recording.dwells, state.of_dwells
    if dwells is None:
        return
    at = state.values, state.run.origins
    for _ in range(0 if of_dwells is None and steps == 1 else steps):
        of_dwells = stepped(dwells, *at, replace(of_dwells or Nuisances(), apart=model.per_run))
    state.of_dwells = with_scatter(dwells, model, *at, replace(of_dwells or Nuisances(), apart=model.per_run))


def spectrum_of(state: RunState, terms: Sequence[Term], *, keep: bool = False) -> MeasuredSpectrum | None:
    """Spectrum of what the terms leave of a run's innovations; None where it is white, unless one is to be kept."""
    crossover, sums = state.run.crossover(state.noise), sums_of(state)
    coloured = state.band is not None or keep
    y = sums.whitened
    if not coloured and white(measured_spectrum(y, sums.rate, crossover)):
        return None
    X = whole_columns(sums, terms)
    vars(sums)[COLUMNS] = tuple(terms), X
    size = np.sqrt(np.maximum(np.sum(X**2, axis=1), 1e-300))
    if not len(y) or not np.all(np.isfinite(size)) or not np.isfinite(y @ y):
        return None  # the solve says so
    basis = scipy.linalg.orth((X / size[:, None]).T)
    explained = np.minimum(np.sum(scipy.fft.dct(basis, norm="ortho", axis=0) ** 2, axis=1), 1.0)
    measured = measured_spectrum(y - basis @ (basis.T @ y), sums.rate, crossover, explained)
    return None if not coloured and white(measured) else measured


def white(spectrum: MeasuredSpectrum | None) -> bool:
    """Whether a run needs no spectrum."""
    return spectrum is None or spectrum.white


def stage_output(run: PreparedRun) -> Array:
    """Output as a level, normally mounted sensor would give it, (n,) m/s²."""
    return run.rig.polarity * run.accel.y - run.rig.gravity


def as_fit(replayed: AnyFit, forward: ForwardParameters, choice: FilterChoice) -> AnyFit:
    """The fit with the parameters that a filter found on polarity * output - gravity in the place of its own."""
    order = {PARAMETER_OF[name]: i for i, name in enumerate(forward.names)}
    held = {e.name: e.value for e in replayed.free if e.name in NOMINAL and e.name not in order}
    frozen = replayed.model.freeze(**held)
    T = np.linalg.inv(to_stage(forward.names, replayed.rig.polarity, replayed.rig.gravity))
    values, covariance = T @ forward.values, T @ forward.covariance @ T.T
    rows = [order[e.name] for e in replayed.estimates if e.name in order and e.name not in frozen.fixed]
    estimates = tuple(
        replace(e, value=float(values[order[e.name]]), std=math.sqrt(covariance[order[e.name], order[e.name]]))
        if e.name in order
        else Estimate(e.name, e.symbol, e.unit, e.value, 0.0, e.owner)
        for e in replayed.estimates
    )
    text = (
        f"{' and '.join(f'{name} {value:.3g} s' for name, value in held.items())} and the noise are the replay's; "
        "the filter does not estimate them, and its standard deviations take them as known"
    )
    return replace(
        replayed,
        model=frozen,
        estimates=estimates,
        covariance=covariance[np.ix_(rows, rows)],
        at_shapes=(),
        method=ForwardFilter(choice).name,
        remarks=(remark("live_filter", text=text), *replayed.remarks),
    )


@dataclass(frozen=True, slots=True)
class LiveStart:
    """Start of a filter on another record after a fit."""

    rig: Rig
    """With the fitted time constant of the low-pass."""
    q: float
    """Two-sided density of the noise of the output, (m/s²)² s."""
    r_position: float
    """Variance of a position reading, m²."""
    model: Model
    """The estimates as priors, and nothing left of the error of the low-pass."""
    anew: tuple[str, ...]
    """Coefficients that belong to the fitted record: they begin at zero, as wide as they were large."""

    def spread(self, fit: Fitted, model: Model) -> Array:
        """(m, m) covariance of the states of the model, which may hold more than that of the start."""
        names, (terms, processes) = state_names(model), live_terms(model)
        rows = {e.name: i for i, e in enumerate(fit.free) if find(e.name.split(".")[0]).port != "process"}
        fitted = np.array([name in rows and name not in self.anew for name in names])
        places = [rows.get(name, 0) for name in names]
        spread = np.diag([belief(model, terms[name], processes).std ** 2 for name in names])
        return np.where(np.outer(fitted, fitted), fit.covariance[np.ix_(places, places)], spread)


def live_start(fit: Fitted, rig: Rig) -> LiveStart:
    """Return the start of a filter on a record of a rig after a fit."""
    model, values, noise = fit.model, fit.values(), fit.noise().usual
    tau = max(0.0, values.lowpass_error + rig.lowpass_tau)
    lowpass = LowPass(1.0 / (2.0 * math.pi * tau)) if tau > 0.0 else None
    free = {e.name: e for e in fit.free if find(e.name.split(".")[0]).port != "process"}
    of_record = [term.name for term in model.terms if term.effect.port != "process" and of_one_record(term.effect)]
    anew = {name: Prior(0.0, max(abs(free[name].value), free[name].std)) for name in of_record if name in free}
    priors = dict(model.priors) | {name: Prior(e.value, e.std) for name, e in free.items()} | anew
    fixed = dict(model.fixed) | {name: 0.0 for name in ("lowpass_error",) if name in model.effects}
    priors = {name: prior for name, prior in priors.items() if name not in fixed}
    start = replace(model, priors=priors, fixed=fixed, per_run=())
    return LiveStart(replace(rig, lowpass=lowpass), noise.q * values.scale**2, noise.r, start, tuple(anew))
