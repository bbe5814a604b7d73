"""The error that noise of the sensor alone would give: one floor for all models of a table, with its interval.

Noise is drawn and passed through the start points and the rezeroing of the comparison, so that the scatter of a finite
record and the overlap of its windows are in the interval. The filter is the one for this noise: that of a comparison
whose models lack nothing. A filter for the noise of a model that lacks an effect begins worse, and a floor drawn
through it would be higher, and fall with each effect that is added. Effects that hold simulated motion back lower the
floor of their model by as much as the standard deviation of a drift. 1/f noise is left out: beside motion it looks as
slow effects do that a model lacks, and a rest is too short to show it.

The budget of a drift stands on that floor: noise, set-up, parameters, what another model adds, the rest.
"""

from __future__ import annotations

import math
import pickle
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from accelcal._support.errors import AccelcalError
from accelcal.data import VELOCITY, Array, root_mean_square
from accelcal.effects import find, is_local
from accelcal.estimation.drive import after_readings, run_filter
from accelcal.estimation.estimate import Fit
from accelcal.estimation.run import PreparedRun, Source, prepared, recording_of
from accelcal.estimation.values import Noise
from accelcal.validation.comparison import HORIZONS, ErrorBudget, Evaluation, NoiseFloor, RmsInterval, SensorNoise
from accelcal.validation.prediction import Prediction, values_on


@dataclass(frozen=True, slots=True)
class Ruler:
    """Filter under which several models are compared."""

    noise: Noise
    """Of the filter that makes start states and one-step predictions."""
    cutoff: float
    """Bandwidth of the motion that effects are evaluated on, Hz."""
    remembers: bool = False
    """Whether an effect of one of the models has a memory: all are then run over the history of what is compared."""
    remembering: tuple[Fit, ...] = field(default=(), compare=False)
    """Those models: all are followed from the fewer start points of these."""
    nodes: dict[Hashable, float] = field(default_factory=dict, compare=False, repr=False)
    """Spacing of the nodes of their motion, by recording and part of it, s."""

    @classmethod
    def of(cls, fits: Sequence[Fit]) -> Ruler:
        """The filter of that model of a table whose fitted noise of the sensor is least: a missing effect adds to it.

        Raises
        ------
        ValueError
            If there is no model.
        """
        best = min(fits, key=lambda fit: fit.noise().usual.q, default=None)
        if best is None:
            raise AccelcalError("a comparison of several models needs at least one of them")
        remembering = tuple(fit for fit in fits if not all(is_local(find(name)) for name in fit.model.added))
        return cls(best.noise(), best.validity["frequency"][1], bool(remembering), remembering)

    def held_by(self, fit: Fit) -> Fit:
        """The fit with this filter in place of its own."""
        first, *others = fit.runs
        ruled = replace(first, noise=replace(first.noise, noise=self.noise))
        validity = {**fit.validity, "frequency": (fit.validity["frequency"][0], self.cutoff)}
        return replace(fit, runs=(ruled, *others), validity=validity)


DRAWS, LEAST_DRAWS, MOST_NUMBERS = 100, 12, 20_000_000
"""Records of noise, at least, and random numbers that they may take."""
SEED = 20070601
"""Of the noise: the same record has the same floor."""


def noise_floor(
    ruler: Ruler,
    fit: Fit,
    source: Source,
    *,
    horizons: Sequence[float] = HORIZONS,
    start: float | None = None,
    end: float | None = None,
) -> NoiseFloor:
    """The floor under the errors of all models that are compared under a ruler.

    It is the same for every model of a history, and for a history that grows, as long as the density of the noise is
    that of a rest or the declared one: then nothing of it is taken from a model but its reading noise and its clock,
    both of `fit`. A fitted density is an upper limit, and falls. Noise that grows with the motion is in it as soon as a
    model has an effect for it.

    Parameters
    ----------
    ruler : the filter of the comparison; its noise is the least that was fitted.
    fit : one of the models; the same one gives the same floor.
    source, start, end : what they are compared with, s.
    horizons : of the drifts, s.
    """
    scale, recording = abs(fit.values().scale), recording_of(source)
    sensor = SensorNoise.of(recording, ruler.noise, scale, end)
    run = prepared(source, fit.origins, start=start, end=end)
    encoder = ReadingNoise.of(fit, run)
    noise = _of_filter(ruler, fit, sensor, scale, encoder)

    values, cutoff = values_on(fit, recording), fit.validity["frequency"][1]

    def drawn() -> NoiseFloor:
        return _drawn(Prediction(run, values, noise, cutoff), sensor, scale, encoder, horizons)

    readings = run.inside, len(run.t), run.restarts, recording.position_steps
    model = fit.origins, values.by_name, [(term.name, dict(term.shape)) for term in values.terms], cutoff
    return run.once(pickle.dumps((readings, model, noise, sensor, encoder, tuple(horizons))), drawn)


def _of_filter(ruler: Ruler, fit: Fit, sensor: SensorNoise, scale: float, encoder: ReadingNoise) -> Noise:
    """Noise of the filter that noise of the sensor is drawn through: the drawn noise where its density is known, else
    that of the filter of the comparison."""
    if sensor.is_limit:
        return ruler.noise
    r = encoder.std**2 or fit.noise().r  # in a band the readings have an `r` of its own
    return replace(ruler.noise, q=(sensor.density / scale) ** 2 / 2.0 + encoder.acceleration, r=r)


def _drawn(
    ahead: Prediction, sensor: SensorNoise, scale: float, encoder: ReadingNoise, horizons: Sequence[float]
) -> NoiseFloor:
    """The floor from drawn noise."""
    begins = {horizon: ahead.starts(horizon) for horizon in horizons}
    drifts: dict[float, list[float]] = {horizon: [] for horizon, k in begins.items() if len(k)}
    simulated = []
    for noisy in _records(ahead, sensor, scale, encoder):
        for horizon, errors in drifts.items():
            errors.append(noisy.drift(begins[horizon], horizon))
        simulated.append(noisy.simulated())
    of_horizons = {horizon: _spread(drifts[horizon]) if horizon in drifts else None for horizon in horizons}
    return NoiseFloor(sensor, of_horizons, _spread(simulated))


def _spread(errors: Sequence[float]) -> RmsInterval:
    """Rms of root mean squares, and the interval of the next one; their logarithms are nearly normal."""
    logarithms = np.log(errors)
    n = len(errors)
    reach = scipy.special.stdtrit(n - 1, 0.975) * math.sqrt(1.0 + 1.0 / n) * float(np.std(logarithms, ddof=1))
    middle = float(np.mean(logarithms))
    value = root_mean_square(np.array(errors))
    return RmsInterval(value, math.exp(middle - reach), math.exp(middle + reach))


@dataclass(frozen=True, slots=True)
class _NoisyRecord:
    """The filter over a record that is noise alone."""

    ahead: Prediction
    z: Array
    """Readings, (n,) m."""
    p: Array
    v: Array
    """State after each reading, (n,) m and m/s."""
    evidence: Array
    """Of a constant acceleration, cumulated, (n,)."""

    def drift(self, k: NDArray[np.intp], horizon: float) -> float:
        """Rezeroed rms error at a horizon after the readings `k`, m."""
        t = self.ahead.run.t
        end = np.minimum(np.searchsorted(t, t[k] + horizon), len(t) - 1)
        h, information = t[end] - t[k], self.ahead.information[k]
        constant = np.divide(self.evidence[k], information, out=np.zeros(len(k)), where=information > 0.0)
        reached = self.ahead.unit_p[k] + h * self.ahead.unit_v[k] + h**2 / 2.0
        error = self.z[end] - self.p[k] - h * self.v[k] - constant * reached
        return root_mean_square(error)

    def simulated(self) -> float:
        """Rms error of the simulation from the first settled reading, m."""
        k = int(np.argmax(self.ahead.counts))
        rows = np.flatnonzero(self.ahead.breaks == self.ahead.breaks[k])
        rows = rows[rows > k]
        h = self.ahead.run.t[rows] - self.ahead.run.t[k]
        error = self.z[rows] - self.p[k] - h * self.v[k]
        return root_mean_square(error) if len(rows) else math.nan


@dataclass(frozen=True, slots=True)
class ReadingNoise:
    """Noise of the reference as noise of a position: white, or the integral of white noise, once or twice."""

    std: float
    """Of one reading that is white as a position, m."""
    random_walk: float = 0.0
    """Density of a random walk, m²/s: that of a velocity with white noise."""
    acceleration: float = 0.0
    """Density of white noise of an acceleration, (m/s²)²/Hz."""

    @classmethod
    def of(cls, fit: Fit, run: PreparedRun) -> ReadingNoise:
        """Of the reference that a model was fitted with, read as often as that of a run."""
        report = fit.runs[0].noise
        std, density = report.all.reading, report.all.reading**2 * run.reading_step / run.every
        if report.reference == "position":
            return cls(std)
        return cls(0.0, random_walk=density) if report.reference == VELOCITY else cls(0.0, acceleration=density)


def _records(ahead: Prediction, sensor: SensorNoise, scale: float, encoder: ReadingNoise) -> Iterator[_NoisyRecord]:
    """Records of noise: a motion by white acceleration that the output does not show, and readings of it."""
    rng = np.random.default_rng(SEED)
    d, still = ahead.drive, np.zeros(len(ahead.drive.t))
    h = np.where(d.restart, 0.0, np.diff(d.t, prepend=d.t[0]))
    varying = d.extra_r if len(d.extra_r) else 0.0
    reading = np.sqrt(encoder.std**2 + varying)  # a prescribed band has an `r` of its own
    relative, before = sensor.std / sensor.density, math.nan
    for _ in range(min(DRAWS, max(LEAST_DRAWS, MOST_NUMBERS // (3 * len(h))))):
        density = sensor.density * math.exp(relative * rng.standard_normal()) / scale
        if density != before:  # one that is declared stays
            q, before = density**2 / 2.0 + d.extra_q + encoder.acceleration, density
            of_speed, of_way = np.sqrt(q * h), np.sqrt(q * h**3 / 12.0)
        gained = of_speed * rng.standard_normal(len(h))
        moved = h / 2.0 * gained + of_way * rng.standard_normal(len(h))
        speed = np.cumsum(gained)
        z = np.cumsum(h * (speed - gained) + moved) + reading * rng.standard_normal(len(h))
        if encoder.random_walk:
            z += np.cumsum(np.sqrt(encoder.random_walk * h) * rng.standard_normal(len(h)))
        track = run_filter(ahead.run, replace(d, z=z, first=still, second=still), ahead.noise)
        e, p, v = after_readings(track)
        evidence = np.cumsum(np.where(ahead.counts, ahead.unit_e * e / track.series("S"), 0.0))
        yield _NoisyRecord(ahead, z, p, v, evidence)


DRAWN_PARAMETERS = 1000
"""Draws of the parameters from their covariance, for the interval of their part."""


def error_budgets(
    fits: Sequence[Fit],
    evaluations: Sequence[Evaluation],
    predictions: Sequence[Prediction],
    totals: Sequence[RmsInterval],
    horizon: float,
) -> tuple[ErrorBudget, ...]:
    """Parts of the drift of each model; the last model is the one whose effects the others lack.

    Parameters
    ----------
    fits, evaluations, predictions : models, how they compare with the recording, and what they predict of it.
    totals, horizon : rezeroed rms drift of each model, m, and when, s.
    """
    budgets, whole = [], None
    for fit, evaluation, ahead, total in reversed(list(zip(fits, evaluations, predictions, totals, strict=True))):
        _, plain = evaluation.drifts[horizon]
        followed = ahead.along_measured().at_horizon(horizon).rezeroed  # simulated motion holds noise back
        whole = followed if whole is None else whole
        moved = (moved_by(ahead, fit, size).at_horizon(horizon).rezeroed for size in sizes_of(fit))
        moves = np.stack([other - plain for other in moved])
        draws = np.random.default_rng(SEED).standard_normal((DRAWN_PARAMETERS, len(moves)))
        low, high = np.quantile(np.sqrt(np.mean((draws @ moves) ** 2, axis=1)), [0.025, 0.975])
        parameters = RmsInterval(float(np.sqrt(np.sum(moves**2) / moves.shape[1])), float(low), float(high))
        missing = root_mean_square(followed - whole)
        floor, scale = evaluation.noise_floor, abs(fit.values().scale)
        spread = None if floor is None else floor.at(horizon)
        if floor is None or spread is None:
            raise AccelcalError(f"the recording has no start point {horizon:g} s before its end")
        q, reading = (floor.sensor.density / scale) ** 2 / 2.0, ReadingNoise.of(fit, ahead.run).std
        unheld = spread.value / evaluation.held_back.get(horizon, 1.0)
        after = min(math.sqrt(q * horizon**3 / 3.0 + reading**2) / unheld, 1.0)
        noise, setup = (
            RmsInterval(*(share * y for y in (spread.value, spread.low, spread.high)))
            for share in (after, math.sqrt(1.0 - after**2))
        )
        budgets.append(ErrorBudget(horizon, total, noise, setup, parameters, missing))
    return tuple(reversed(budgets))


def sizes_of(fit: Fit) -> Array:
    """Independent moves of the free estimates by a standard deviation each, (m, m), a row each."""
    std = np.sqrt(np.diag(fit.covariance))
    some = np.where(std > 0.0, std, 1.0)  # of coefficients whose units are many orders apart
    values, vectors = np.linalg.eigh(fit.covariance / np.outer(some, some))
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))).T * std)


def moved_by(ahead: Prediction, fit: Fit, move: Array) -> Prediction:
    """A prediction with the free estimates moved (m,), as far as they reach its recording; starts are the same."""
    by_name = dict(ahead.values.by_name)
    for estimate, step in zip(fit.free, move, strict=True):
        used = ahead.values.by_name[estimate.name]
        if estimate.value == used or (estimate.run is None and used):
            by_name[estimate.name] = used + float(step)
    moved = replace(ahead.values, by_name=by_name)
    other = Prediction(ahead.run, moved, ahead.noise, ahead.cutoff, since=ahead.since)
    other.nodes_apart = ahead.nodes_apart
    return other
