"""The filter of a live view: its settings, rows in the order of events, bias by noise, alarms of its innovations."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar, Literal, TypeVar, get_args

import numpy as np
from scipy import special

from accelcal._support.errors import AccelcalError
from accelcal._support.result import Storable
from accelcal.data import DERIVED, Array, Flags, RecordingError, Rig, unsupported
from accelcal.data.orientation import HOLE
from accelcal.data.units import concise
from accelcal.effects import BUILT_IN, Effect, begins_rested, find, of_one_record
from accelcal.estimation.engines import PARAMETER_OF, PRIOR_STD, LiveStart, as_fit, live_start
from accelcal.estimation.estimate import Fit
from accelcal.filters.choice import PARAMETERS, FilterChoice, GaussMarkov, spread_start, to_stage
from accelcal.filters.live_model import (
    FALSE_NAMES,
    MOST_SHARE,
    LiveModel,
    Suspicion,
    live_terms,
    noise_in_band,
    refusal,
    state_names,
    suspects_of,
    waited,
)
from accelcal.filters.record import ForwardParameters
from accelcal.filters.stream import MOST_EFFECTS, LiveFilter, Readings
from accelcal.io.stream import Excursions, Rows
from accelcal.model import BASE, NOMINAL, Estimate, Model
from accelcal.signals.signals import Origins

SHIFTED = tuple(name for name in NOMINAL if find(name).unit == "s")
"""Effects that are taken from the stamps and from the low-pass, at their fitted values."""
PAPER = (*BASE, *PARAMETER_OF.values(), *SHIFTED)
"""Effects of a model that a `LiveFilter` takes."""
Scalar = TypeVar("Scalar", float, Array)
SPEED = 10.0
"""Standard deviation of the velocity at the start, m/s."""
ACCELERATION = 100.0
"""Standard deviation of the acceleration between the start and the first reading, m/s²."""


@dataclass(frozen=True, slots=True)
class LiveSettings:
    """A live filter of `accelcal.filters` in full; the start of its motion is left to the first reading."""

    choice: FilterChoice
    rig: Rig
    q: float
    """Two-sided density of the noise of the output, (m/s²)² s."""
    r_position: float
    """Variance of a position reading, m²."""
    theta: Array
    """(m,) parameters at the start, as the filter sees them (`to_stage`), SI."""
    covariance: Array
    """(m, m) SI."""
    tau: float = 0.0
    """Time constant of the declared low-pass, s."""
    offset: float = 0.0
    """What the stamps of the output are late by, s."""
    parameters: Mapping[str, GaussMarkov] = field(default_factory=dict)
    """How parameters move that are not constant."""
    begun: bool = False
    """Whether parameters begin where a fit ended."""
    model: Model | None = None
    """With effects that a `LiveFilter` does not have, its priors those of the start; None without."""
    origins: Origins = field(default_factory=Origins)
    """Of the model."""
    spread: Array = field(default_factory=lambda: np.empty((0, 0)))
    """(m, m) covariance of the coefficients of the model at the start, of those in `state_names`."""
    remarks: tuple[str, ...] = ()
    """Sentences on what the model has and the filter does not estimate."""
    watch: tuple[str, ...] = ()
    """Suspects beside the model."""

    @property
    def needs(self) -> tuple[str, ...]:
        """Side channels that the effects of the model take."""
        names = () if self.model is None else (*self.model.effects, *self.watch)
        return tuple(dict.fromkeys(channel for name in names for channel in find(name).needs))

    @property
    def sharp_resolution(self) -> float:
        """Resolution of an encoder whose other noise does not hide its rounding, m; else zero."""
        resolution = self.rig.resolution or 0.0
        other = self.r_position - resolution**2 / 12.0
        return resolution if other < 0.25 * resolution**2 else 0.0

    @property
    def names(self) -> tuple[str, ...]:
        """(m,) names of the parameters in the filter."""
        return PARAMETERS[self.choice.model]

    def stage_output(self, accel: Scalar) -> Scalar:
        """The output as a level, normally mounted sensor would give it, m/s²."""
        return self.rig.polarity * accel - self.rig.gravity

    def start(self, position: float, ahead: float) -> tuple[Array, Array]:
        """Mean (N,) and covariance (N, N) of all states, `ahead` (s) before the first reading of `position` (m)."""
        x0 = np.concatenate([[position, 0.0], self.theta])
        P0 = np.zeros((len(x0), len(x0)))
        P0[0, 0], P0[1, 1] = self.r_position, SPEED**2
        P0[2:, 2:] = self.covariance
        spread_start(P0, v_std=SPEED, a_std=ACCELERATION, ahead=ahead, lag=self.tau)
        return x0, P0

    def estimates(self, states: Array, covariance: Array) -> tuple[Estimate, ...]:
        """Parameters of the sensor that are estimated, by their public names, from all states (N,) and their covariance
        (N, N)."""
        T = np.linalg.inv(to_stage(self.names, self.rig.polarity, self.rig.gravity))
        begun = np.diag(T @ self.covariance @ T.T)
        values, spread = T @ states[2:], T @ covariance[2:, 2:] @ T.T
        estimates = []
        for i, name in enumerate(self.names):
            if begun[i] <= 0.0 and name not in self.parameters:  # not estimated
                continue
            effect = find(PARAMETER_OF[name])
            std = math.sqrt(max(0.0, float(spread[i, i])))
            estimates.append(Estimate(effect.name, effect.symbol, effect.unit, float(values[i]), std, effect.owner))
        return tuple(estimates)


def settings_of(rig: Rig, fit: Fit | None = None, watch: tuple[str, ...] = ()) -> LiveSettings:
    """Settings for a rig, and for the parameters, their uncertainty, noise and time offset of a fit.

    Without a fit the parameters start at zero, as wide as any working sensor, and the noise is that of the sidecar. A
    watch needs a fit.

    Raises
    ------
    RecordingError
        For a filter that a live filter does not undo, for noise that is not declared, and for a model with effects that
        cannot run on a stream. The sentence says what to do.
    ValueError
        For a suspect that the model has, or that cannot be watched.
    """
    refused = unsupported(rig.filters, "a live view")
    if refused:
        raise RecordingError(refused)
    if rig.arm is not None:
        raise RecordingError(
            "live: an arm on an axle is not followed live; record its angle to a file, then accelcal fit"
        )
    tau = rig.lowpass_tau
    walk = rig.sensor.random_walk
    parameters = {"K0": GaussMarkov(walk**2)} if walk else {}
    if fit is None and watch:
        raise AccelcalError("live: a watch needs a fit, whose model it looks beyond; give a model file")
    if fit is None:
        q, r = declared_noise(rig)
        choice = _choice("linear")
        spread = np.diag([PRIOR_STD[name] ** 2 for name in PARAMETERS["linear"]])
        return LiveSettings(choice, rig, q, r, np.zeros(len(spread)), spread, tau, 0.0, parameters)
    theta, spread, choice = _of_fit(fit)
    A = to_stage(PARAMETERS[choice.model], rig.polarity, rig.gravity)
    start = live_start(fit, rig)
    settings = LiveSettings(
        choice,
        rig,
        start.q,
        start.r_position,
        A @ theta,
        A @ spread @ A.T,
        start.rig.lowpass_tau,
        fit.values().by_name.get("time_offset", 0.0),
        parameters,
        True,
    )
    others = [name for name in fit.model.added if name not in PAPER and find(name).port != "noise"]
    if watch:
        suspects_of(fit.model, watch)
        settings = replace(settings, watch=watch)
    return _with_model(settings, fit, start) if others or watch else settings


ANEW = "its clock is that of the fitted record; it is estimated anew, from nothing and of about the size that it had"
SUBTRACTED = "held at the fitted value, and what it adds is subtracted"
AT_ZERO = "held at zero, as its clock is that of the fitted record"


def _with_model(settings: LiveSettings, fit: Fit, start: LiveStart) -> LiveSettings:
    """Settings for a model with effects that a `LiveFilter` does not have.

    Effects are states that begin where the fit ended, as many as there is room for; others are held at their fitted
    values. Those that belong to one record begin from zero.
    """
    for name in fit.model.added:
        answer = running(find(name), "live", fit.model.shapes.get(name))
        if answer.how == "refused":
            raise RecordingError(f"live: {name} cannot run on a stream: {answer.reason}; drop it with accelcal drop")
    fixed = {**start.model.fixed, **dict.fromkeys((name for name in SHIFTED if name in fit.model.effects), 0.0)}
    priors = {name: prior for name, prior in start.model.priors.items() if name not in fixed}
    model, held = _within_room(replace(start.model, priors=priors, fixed=fixed))
    of_record = {name.split(".")[0] for name in start.anew}
    remarks = [f"{name}: {ANEW}" for name in model.added if name in of_record and name not in held]
    for name in held:
        how = AT_ZERO if name in of_record else SUBTRACTED
        remarks.append(f"{name}: {how}, since a live filter has room for {MOST_EFFECTS} coefficients")
    if rested := begins_rested(model.added):
        remarks.append(rested)
    return replace(
        settings,
        rig=start.rig,
        model=model,
        origins=replace(fit.origins, t=0.0),
        spread=start.spread(fit, model),
        remarks=tuple(remarks),
    )


def _within_room(model: Model) -> tuple[Model, list[str]]:
    """The model with the widest effects held at the means of their priors until a filter has room; their names."""
    held: list[str] = []
    while len(state_names(model)) > len(PARAMETERS["linear"]) + MOST_EFFECTS:
        widths = {name: _width(model, name) for name in model.added}
        widest = max(widths, key=lambda name: widths[name])
        if widths[widest] == 0:
            raise RecordingError(
                f"live: a live filter has room for {MOST_EFFECTS} coefficients beside bias and scale_factor; the model "
                "has more random processes, none of which can be held: drop some with accelcal drop"
            )
        columns = [term.name for term in model.terms if term.effect.name == widest]
        values = {name: model.priors[name].mean for name in columns if name not in model.fixed}
        priors = {name: prior for name, prior in model.priors.items() if name not in columns}
        model = replace(model, priors=priors, fixed={**model.fixed, **values})
        held.append(widest)
    return model, held


def _width(model: Model, name: str) -> int:
    """States of an effect that could be held: those of a process cannot."""
    terms = live_terms(model)[0].values() if find(name).port != "process" else ()
    return sum(term.effect.name == name and term.name not in model.fixed for term in terms)


Place = Literal["LiveModel", "live", "export"]


@dataclass(frozen=True, slots=True)
class Running:
    """Whether an effect runs as a state of a filter, and why not."""

    how: Literal["runs", "held and subtracted", "refused"]
    reason: str = ""


def running(effect: Effect, place: Place, shape: Mapping[str, float] | None = None) -> Running:
    """Whether an effect runs in a `LiveModel`, on a stream, or in exported code, at shape parameters."""
    if (reason := refusal(effect, shape)) is not None:
        return Running("refused", reason)
    if effect.name in {"live": SHIFTED, "export": ("lowpass_error",)}.get(place, ()):
        return Running("held and subtracted", "a stamp or the low-pass is corrected by its fitted value")
    if place == "live" and set(effect.needs) & set(DERIVED):
        return Running("refused", "its channels follow from an orientation, which a live view does not take in")
    if place == "export":
        from accelcal.calibration.export.filter import untraced

        if (reason := untraced(effect)) is not None:
            return Running("refused", f"it {reason}")
    return Running("runs", "in the noise, at its fitted level" if effect.port == "noise" else "")


def markdown() -> str:
    """The effects of the catalogue with what becomes of each in a `LiveModel`, on a stream and in exported code."""
    places = get_args(Place)
    lines = [f"| effect | {' | '.join(f'`{place}`' for place in places)} |", "|---" * (1 + len(places)) + "|"]
    for effect in BUILT_IN:
        cells = [running(effect, place) for place in places]
        texts = [cell.how + (f": {cell.reason}" if cell.reason else "") for cell in cells]
        lines.append(f"| {effect.name} | {' | '.join(texts)} |")
    return "\n".join(lines) + "\n"


def declared_noise(rig: Rig) -> tuple[float, float]:
    """Density of the output's noise and variance of a reading, as the sidecar declares them.

    Raises
    ------
    RecordingError
        If one of them is not declared.
    """
    if not rig.sensor.noise:
        raise RecordingError(
            "live: the sidecar declares no noise of the sensor, and there is no model to tell it; write "
            '[sensor] noise = "250 ug/sqrt(Hz)" from its data sheet, or give --model'
        )
    if not (rig.resolution or rig.reading_noise):
        raise RecordingError(
            "live: the sidecar declares neither noise nor resolution of the position, and there is no model to tell "
            'them; write position = { column = "position", unit = "mm", noise = "2 um" }, or give --model'
        )
    return rig.sensor.noise**2 / 2.0, (rig.reading_noise or 0.0) ** 2 + (rig.resolution or 0.0) ** 2 / 12.0


def _choice(model: str) -> FilterChoice:
    """Exact integrals, cubics between outputs, and UD factors, which no rate and no prior makes indefinite."""
    sensor: Literal["cubic", "linear"] = "cubic" if model == "cubic" else "linear"
    return FilterChoice("aci", sensor, interpolation="cubic", carrier="factored", corrected=True, scores=True)


def _of_fit(fit: Fit) -> tuple[Array, Array, FilterChoice]:
    """Parameters of a fit and their covariance, in the order of the filter that tracks them."""
    by_name = {e.name: e.value for e in fit.estimates}
    choice = _choice("cubic" if {"quadratic", "cubic"} & set(by_name) else "linear")
    names = [PARAMETER_OF[name] for name in PARAMETERS[choice.model]]
    rows = {e.name: i for i, e in enumerate(fit.free)}
    spread = np.zeros((len(names), len(names)))
    for i, parameter in enumerate(names):
        for j, two in enumerate(names):
            if parameter in rows and two in rows:
                spread[i, j] = fit.covariance[rows[parameter], rows[two]]
    return np.array([by_name.get(name, 0.0) for name in names]), spread, choice


FALSE_ALARM = 1e-6
"""Probability of an alarm in one block while the model holds."""
TOLERANCE = 0.2
"""Relative error of the expected variance that counts as holding: what data sheets say of noise is not exact."""
LEAST_READINGS = 200
"""Of a block."""
LEAST_TIME = 1.0
"""Length of a block, s: at most 86 400 blocks, and on average 0.09 false alarms, a day."""
SETTLING = 10
"""First blocks of a filter that begins with nothing, which are not judged: it still learns what the sensor is."""
RUNNING = 1000
"""Readings of the running NIS."""
CONFIDENCE = 0.99
"""Of the interval of the running NIS."""
TESTS = 4
"""Of a block: noise, scale factor and bias, whiteness, the largest reading."""
WHITENESS_TOLERANCE = 0.02
"""Correlation of neighbours that counts as white: of noise that is declared `TOLERANCE` off."""
LEAST_SCORES = 50
"""Of a block, below which neither their noise nor their whiteness is judged."""
POOLED = 4
"""Blocks that are judged together, too, by scale factor and bias: a change stays, and tells as much in each of them."""
CALM = 64
"""Readings before a jump whose noise must be the declared one."""

Cause = Literal["noise", "mean", "whiteness", "jump"]
CAUSES: dict[Cause, str] = {
    "noise": "the innovations have {value:.3g} times the declared variance; the noise of sensor or reference has "
    "grown, or less is declared than there is",
    "mean": "the innovations follow a change of scale factor and bias, {value:.3g} standard deviations away; the "
    "sensor has changed, or the model lacks an effect",
    "whiteness": "neighbouring innovations correlate by {value:.3g}; a vibration, a tone, or an effect that the model "
    "lacks",
    "jump": "a reading lies {value:.3g} standard deviations from what the readings before it predict; lost counts, a "
    "knock, or an outlier",
}
"""What an alarm says of its cause."""


@dataclass(frozen=True, slots=True)
class Alarm(Storable):
    """A block of innovations that the model does not explain."""

    derived: ClassVar[tuple[str, ...]] = ("sentence",)

    t: float
    """End of the block, s."""
    kind: Cause
    value: float
    """Of the statistic that tells: mean square, distance from scale factor and bias, correlation, largest; 1."""
    low: float
    high: float
    readings: int
    since: float
    """End of the first block of those in a row that raised an alarm, s."""

    @property
    def sentence(self) -> str:
        """What was observed, what was expected, and what it may be."""
        expected = f"expected {self.low:.3g} to {self.high:.3g} over {self.readings} readings"
        what, cause = CAUSES[self.kind].format(value=self.value).split("; ", 1)
        return f"t = {self.t:.6g} s: {what}, {expected}; {cause}"


@dataclass(frozen=True, slots=True)
class Naming(Storable):
    """Suspects of which one is there."""

    derived: ClassVar[tuple[str, ...]] = ("sentence",)

    t: float
    """s"""
    suspects: tuple[Suspicion, ...]
    """The likeliest first."""
    count: int
    """Suspects in all."""

    @property
    def sentence(self) -> str:
        """Since when, what, how large, and how often that is said without a cause."""
        first, *others = self.suspects
        names = " or ".join(suspicion.name for suspicion in self.suspects)
        alike = ", which act alike so far; the size is that of the first" if others else ""
        size = f"{concise(first.size, first.std)} {first.unit}".removesuffix(" 1")
        power = (first.log_e - math.log(self.count)) / math.log(10.0)
        return (
            f"since about t = {self.t - first.since:.6g} s: {names}{alike}, {size}, odds 10^{power:.1f} to 1 against "
            f"chance among {self.count} suspects; a false name in one of {1.0 / FALSE_NAMES:.0f} operations"
        )


@dataclass(frozen=True, slots=True)
class Interval:
    """A running mean and where it lies with a probability while the model holds."""

    value: float
    low: float
    high: float
    readings: int


class InnovationMonitor:
    """Tests of the innovations of a live filter, block by block, each by a statistic of known distribution.

    What the innovations before do not predict is white and normal, with a known variance (derivations 6.18): its mean
    square is chi-square, neighbours do not correlate, and its largest is that of as many normal numbers. The slopes of
    the log-likelihood by scale factor and bias are normal, over a block and over `POOLED` of them. Each test has a
    quarter of `false_alarm`, and lets the true variance be off by `tolerance`; less noise than declared is a remark.
    The error of a rounding encoder repeats itself at rest: readings within a count of the last are judged by those
    slopes alone.

    Parameters
    ----------
    false_alarm : probability of an alarm in one block while the model holds.
    tolerance : relative error of the expected variance that still counts as holding.
    least_readings, least_time : a block ends when both are reached; readings, s.
    settling : first blocks, which are not judged, at least one.
    resolution : of an encoder whose rounding is not hidden by other noise, m; zero for none.

    Examples
    --------
    >>> import numpy as np
    >>> monitor = InnovationMonitor(least_readings=100, least_time=0.0, settling=0)
    >>> rows = np.zeros((100, 12))  # columns of `Readings`: t, position, e, S, what is white and its variance, slopes
    >>> rows[:, 0], rows[:, 4], rows[:, 3:6:2] = np.arange(100), np.random.default_rng(1).standard_normal(100), 1.0
    >>> monitor.add(Readings(rows))
    []
    >>> rows[:, 4] *= 1.8
    >>> [alarm.kind for alarm in monitor.add(Readings(rows))]
    ['noise']
    """

    def __init__(
        self,
        *,
        false_alarm: float = FALSE_ALARM,
        tolerance: float = TOLERANCE,
        least_readings: int = LEAST_READINGS,
        least_time: float = LEAST_TIME,
        settling: int = 1,
        resolution: float = 0.0,
    ) -> None:
        self.false_alarm, self.tolerance = false_alarm, tolerance
        self.least_readings, self.least_time = least_readings, least_time
        self.resolution = resolution
        self.blocks, self.alarms = 0, 0
        """Blocks that were judged, and those that raised an alarm."""
        self.holds: bool | None = None
        """Whether the newest block is what the model expects; None before the first."""
        self.p: float | None = None
        """Probability of a block as far from the model as the newest, while the model holds."""
        self.remark = ""
        """Of the newest block, where it has less noise than declared."""
        self._settling = settling
        self._last_position = math.nan
        self._recent = np.empty(0)
        self._waiting = np.empty((0, 13))
        """Readings of the block that has begun, and whether each has left the last count."""
        self._before = np.empty(0)
        """The last scores of the block before."""
        self._sums = deque[Array](maxlen=POOLED)
        """Of the last blocks since an alarm."""
        self._since: float | None = None

    def add(self, readings: Readings) -> list[Alarm]:
        """Take in readings; the alarms of the blocks that they end."""
        rows = readings.table
        if not len(rows):
            return []
        steps = np.abs(np.diff(rows[:, 1], prepend=self._last_position))
        self._last_position = float(rows[-1, 1])
        moved = (steps > 1.5 * self.resolution) | (self.resolution == 0.0)
        squares = rows[:, 4] ** 2 / rows[:, 5]
        self._recent = np.concatenate([self._recent, squares[moved]])[-RUNNING:]
        self._waiting = np.concatenate([self._waiting, np.column_stack([rows, moved])])
        return self._ended()

    def _ended(self) -> list[Alarm]:
        """Alarms of the blocks that have ended."""
        alarms, t, begin = list[Alarm](), self._waiting[:, 0], 0
        while begin < len(t):
            end = int(np.searchsorted(t, t[begin] + self.least_time))
            end = max(end + 1, begin + self.least_readings)
            if end > len(t):
                break
            rows, begin = self._waiting[begin:end], end
            if self._settling > 0:
                self._settling -= 1
                continue
            alarm = self._judged(Readings(rows[:, :-1]), rows[:, -1] > 0.0)
            self.blocks += 1
            self.alarms += alarm is not None
            self.holds = alarm is None
            self._since = None if alarm is None else alarm.since
            alarms += [] if alarm is None else [alarm]
        self._waiting = self._waiting[begin:]
        return alarms

    @property
    def nis(self) -> Interval | None:
        """Mean normalised square of the last `RUNNING` readings, whitened, with its interval of 99 %; None before the
        first reading."""
        n = len(self._recent)
        if n == 0:
            return None
        low, high = chi_square_bounds(n, 1.0 - CONFIDENCE)
        return Interval(float(np.mean(self._recent)), low, high, n)

    def _judged(self, block: Readings, moved: Flags) -> Alarm | None:
        """The alarm of a block, by the cause that explains most."""
        off, alpha = 1.0 + self.tolerance, self.false_alarm / TESTS
        since = float(block.t[-1]) if self._since is None else self._since
        tests = BlockTests(block, moved, self.resolution)
        n, self.p = tests.n, tests.p
        low, high = tests.noise_bounds(alpha)
        self._sums.append(tests.sums)
        means = [(mean, mean.bound(alpha / 2.0, off)) for mean in (tests.mean, MeanTest(np.sum(self._sums, axis=0)))]
        mean, farthest = max(means, key=lambda pair: pair[0].distance / pair[1])
        correlated = normal_bound(alpha) / math.sqrt(max(n, 1)) + WHITENESS_TOLERANCE
        largest = math.sqrt(off) * normal_bound(-math.expm1(math.log1p(-alpha) / max(n, 1)))
        before = np.concatenate([self._before, tests.scores])[: len(self._before) + tests.first_beyond(largest)]
        self._before = tests.scores[-CALM:]
        self.remark = ""
        values = {
            "jump": (tests.largest, -largest, largest),
            "mean": (mean.distance, 0.0, farthest),
            "noise": (tests.power, low / off, high * off),
            "whiteness": (tests.correlation, -correlated, correlated),
        }
        outside = [kind for kind, (value, lowest, highest) in values.items() if not lowest <= value <= highest]
        # What the model lacks adds power: without it, a correlation is that of a filter trusting a channel too little.
        if tests.power < low / off or (outside == ["whiteness"] and tests.power < 1.0):
            self.remark = (
                f"the innovations have {tests.power:.3g} times the declared variance: "
                "more noise is declared than there is"
            )
            outside = [kind for kind in outside if kind == "jump"]  # the others rest on the noise that is declared
        calm = before[-CALM:]
        abrupt = float(calm @ calm) <= len(calm) * off * chi_square_bounds(max(len(calm), 1), 1e-3)[1]
        explained = n * (tests.power - 1.0) <= 1.25 * tests.mean.distance**2 + 3.0 * math.sqrt(2.0 * n)
        order: tuple[tuple[Cause, bool], ...] = (
            ("jump", abrupt), ("mean", explained), ("noise", True), ("jump", True), ("mean", True), ("whiteness", True),
        )  # fmt: skip
        kind = next((kind for kind, likely in order if likely and kind in outside), None)
        if kind is None:
            return None
        self._sums.clear()  # what is not explained is said once
        value, lowest, highest = values[kind]
        readings = mean.readings if kind == "mean" else len(block.t)
        return Alarm(float(block.t[-1]), kind, value, lowest, highest, readings, since)


class MeanTest:
    """The slopes of the log-likelihood by scale factor and bias over some readings, from their sums."""

    def __init__(self, sums: Array) -> None:
        self.distance, self.freedom, spread = _distance(sums[:2], sums[2:5])
        """From scale factor and bias as they are, in standard deviations; how many of them are told, 0 to 2."""
        self.noise_distance = spread * float(sums[5])
        """What the noise of the output in the slope by the scale factor would be away, were it not taken out."""
        self.readings = int(sums[6])

    def bound(self, alpha: float, off: float) -> float:
        """What the distance exceeds with probability `alpha` where the variance is `off` times the expected one."""
        if self.freedom == 0:
            return math.inf
        return math.sqrt(off * float(special.chdtri(self.freedom, alpha))) + (off - 1.0) * self.noise_distance


class BlockTests:
    """Statistics of a block of readings, with what they are while the model holds.

    Of fewer than `LEAST_SCORES` that have `moved` from the last count, the slopes alone.
    """

    def __init__(self, block: Readings, moved: Flags, resolution: float) -> None:
        white = block.white / np.sqrt(block.white_variance)
        self.scores: Array = white[moved] if np.sum(moved) >= LEAST_SCORES else np.empty(0)
        self.n = len(self.scores)
        self.rounding = float(np.mean(block.reading_share)) if resolution else 0.0
        """Share of rounding in the variance, 1."""
        squares = float(self.scores @ self.scores)
        self.power = squares / self.n if self.n else 1.0
        """Mean square, 1."""
        self.correlation = float(self.scores[1:] @ self.scores[:-1]) / squares if squares > 0.0 else 0.0
        """Of neighbours, 1."""
        self.largest = float(self.scores[np.argmax(np.abs(self.scores))]) if self.n else 0.0
        columns = (block.slopes, block.informations, 1.0 - block.reading_share[:, None], np.ones((len(white), 1)))
        self.sums: Array = np.sum(np.hstack(columns), axis=0)
        """Of slopes (2,), their variances and covariance (3,), shares of the output's noise, and readings."""
        self.mean = MeanTest(self.sums)

    @property
    def p(self) -> float:
        """Probability of a statistic as far off as the farthest while the model holds: of all four, or without the
        largest where it is that of a rounding error, which has an end."""
        mean = [float(special.chdtrc(self.mean.freedom, self.mean.distance**2))] if self.mean.freedom else []
        if self.n == 0:
            return mean[0] if mean else 1.0
        noise = 2.0 * min(float(special.gammainc(*self._gamma)), float(special.gammaincc(*self._gamma)))
        white = float(special.erfc(abs(self.correlation) * math.sqrt(self.n / 2.0)))
        single = float(special.erfc(abs(self.largest) / math.sqrt(2.0)))
        largest = [] if self.rounding > 0.0 else [-math.expm1(self.n * math.log1p(-single)) if single < 1.0 else 1.0]
        every = np.minimum([noise, white, *mean, *largest], 1.0)
        return float(1.0 - (1.0 - np.min(every)) ** len(every))

    @property
    def _gamma(self) -> tuple[float, float]:
        """Shape of the gamma distribution of the sum of squares, and the sum in its unit."""
        scale = 2.0 - 1.2 * self.rounding**2  # rounding has the fourth cumulant -1.2 (derivations 6.18)
        return self.n / scale, self.n * self.power / scale

    def noise_bounds(self, alpha: float) -> tuple[float, float]:
        """Where the mean square lies but for the probability `alpha`."""
        if self.n == 0:
            return 0.0, math.inf
        shape, half = self._gamma[0], alpha / 2.0
        return float(special.gammaincinv(shape, half)) / shape, float(special.gammainccinv(shape, half)) / shape

    def first_beyond(self, bound: float) -> int:
        """Readings before the first that is as large."""
        beyond = np.flatnonzero(~(np.abs(self.scores) <= bound))
        return int(beyond[0]) if len(beyond) else self.n


def _distance(slopes: Array, informations: Array) -> tuple[float, int, float]:
    """Root of g' J⁻¹ g for slopes g (2,) with variances and covariance J (3,), the rank of J, and what a unit of the
    first slope adds to it at most."""
    d = np.sqrt(np.maximum(informations[:2], 0.0))
    positive = d > 0.0
    z, unit = slopes[positive] / d[positive], 1.0 / float(d[0]) if positive[0] else 0.0
    if not positive.all():
        return math.sqrt(float(z @ z)), int(positive.sum()), unit
    r = float(informations[2] / (d[0] * d[1]))
    if abs(r) > 1.0 - 1e-6:  # scale factor and bias act alike
        return abs(float(z[np.argmax(np.abs(z))])), 1, unit
    left = 1.0 - r * r
    return math.sqrt(float(z @ z - 2.0 * r * z[0] * z[1]) / left), 2, unit / math.sqrt(left)


def chi_square_bounds(n: int, alpha: float) -> tuple[float, float]:
    """Where the mean of n squared standard normal numbers lies but for the probability `alpha`, half on each side."""
    return float(special.chdtri(n, 1.0 - alpha / 2.0)) / n, float(special.chdtri(n, alpha / 2.0)) / n


def normal_bound(alpha: float) -> float:
    """What the size of a standard normal number exceeds with probability `alpha`."""
    return -float(special.ndtri(alpha / 2.0))


MOST_SAID = 1e3
"""Largest noise over motion that is said: beyond, the stage is at rest."""


@dataclass(frozen=True, slots=True)
class NoiseShare(Storable):
    """Power of the output's noise over that of the motion, in the band in which the filter believes the output."""

    derived: ClassVar[tuple[str, ...]] = ("sentence",)

    value: float
    """N² min(f_c, f_s/2)/<a²>, 1."""

    @property
    def sentence(self) -> str:
        """Why the scale factor is not told, where the share is above `MOST_SHARE`; else empty."""
        if self.value <= MOST_SHARE:
            return ""
        return (
            f"scale_factor: the noise of the output has {self.value:.2g} times the power of the motion in the filter's "
            f"band, and above {MOST_SHARE:g} its estimate leaves its uncertainty. Move the stage with more "
            "acceleration, or record with -o and fit the recording, which smooths the output: accelcal fit"
        )


class Spacing:
    """Samples of a channel and their mean step, in which a hole counts as `HOLE` of the steps before it."""

    def __init__(self) -> None:
        self.samples = 0
        self._last = self._time = 0.0

    @property
    def step(self) -> float:
        """s, of two samples at least."""
        return self._time / (self.samples - 1)

    def add(self, t: Array) -> list[float]:
        """Take stamps (n,) in, s; those behind a hole."""
        behind = list[float]()
        if self.samples > 1 and len(t):  # all at once where there is no hole
            steps = np.diff(t, prepend=self._last)
            time = self._time + np.cumsum(steps)
            if np.all(steps * (self.samples - 1 + np.arange(len(t))) <= HOLE * (time - steps)):
                self.samples, self._last, self._time = self.samples + len(t), float(t[-1]), float(time[-1])
                return behind
        for stamp in t.tolist():
            longest = HOLE * self.step if self.samples > 1 else math.inf
            if stamp - self._last > longest:
                behind.append(stamp)
            if self.samples:
                self._time += min(stamp - self._last, longest)
            self.samples, self._last = self.samples + 1, stamp
        return behind


class OutputMoments:
    """Running moments of output and readings: a few numbers, however long it runs.

    The product of neighbouring samples holds motion alone, since the noise is white.
    """

    def __init__(self) -> None:
        self.outputs, self.readings = Spacing(), Spacing()
        self._zero = 0.0
        self._last: Array = np.empty(0)
        """The last sample less the first of all, m/s²."""
        self._sum = 0.0
        self._product = 0.0

    def add(self, rows: Rows) -> list[float]:
        """Take rows in; the stamps of outputs behind a hole, s."""
        finite = np.isfinite(rows.accel)
        behind = self.outputs.add(rows.t[finite])
        self.readings.add(rows.t[np.isfinite(rows.position)])
        u = rows.accel[finite]
        if not len(u):
            return behind
        if self.outputs.samples == len(u):
            self._zero = float(u[0])
        y = np.concatenate([self._last, u - self._zero])
        self._sum += float(np.sum(y[len(self._last) :]))
        self._product += float(y[1:] @ y[:-1])
        self._last = y[-1:]
        return behind

    def noise_share(self, settings: LiveSettings) -> NoiseShare | None:
        """Noise over motion, at most `MOST_SAID`; None before there are three samples of either."""
        n = self.outputs.samples
        if n < 3 or self.readings.samples < 3:
            return None
        motion = self._product / (n - 1) - (self._sum / n) ** 2
        noise = noise_in_band(settings.q, settings.r_position, self.outputs.step, self.readings.step)
        return NoiseShare(float(noise / max(motion, noise / MOST_SAID)))


@dataclass(frozen=True, slots=True)
class Innovation:
    """One reading that the filter took in."""

    t: float
    """s"""
    e: float
    """Reading minus expectation, m."""
    variance: float
    """That the model expects, m²."""


MOST_TRIES, SURE_SCALE, LEAST_GAIN = 3, 0.1, 0.3
"""Starts that may fail, where the standard deviation of the scale factor is larger at first, and 1 + k that is failure:
below what `judge` calls plausible, and less than half of it."""
OF_START, MOST_OF_START = 100, 10_000
"""Events after which a start is judged, again and again, and with which it ends."""


class Tracker:
    """A `LiveFilter` on rows of a stream.

    It starts at the last output before the first reading. What comes out equals `filters.run` on the same rows with the
    same settings, bit for bit: stamps of the output minus `settings.offset`, `settings.stage_output` of its values.
    Behind a hole of the output another one starts, with the parameters of the one before, and behind a start that has
    failed, which noise brings about once in a hundred times: a gain near zero is a pole of the filter, that does not
    leave it.

    Parameters
    ----------
    settings : of the filter.
    """

    def __init__(self, settings: LiveSettings) -> None:
        self.settings = self._first = settings
        self.filter: LiveFilter | None = None
        """None before the first reading, and the first behind a hole."""
        self.outputs, self.readings = 0, 0
        self.refused = 0
        """Events that the filter refused; its state is as it was before them."""
        self.refusal = ""
        """What it said of the last of them."""
        self.excursions = Excursions()
        self.moments = OutputMoments()
        self._waiting: tuple[Array, Flags, Array] = (np.empty(0), np.empty(0, dtype=bool), np.empty(0))
        """Events that one before them may still join: stamps, which are outputs, values."""
        self._behind = list[float]()
        """Stamps behind holes to come, s."""
        self._scale_begun = self._scale_variance(settings.covariance)
        self._tries = MOST_TRIES if self._scale_begun > SURE_SCALE**2 else 0
        """Starts that may fail yet."""
        self._since_start = 0
        """Events."""

    def feed(self, rows: Rows) -> Readings:
        """Take rows in; the readings that the filter processed then, which lag by two outputs, and by those that wait
        in `excursions`."""
        return self._fed(self.excursions.without(rows))

    def finish(self) -> Readings:
        """Take in what still waits, as at the end of a record."""
        rest = self.excursions.rest()
        waiting = self._fed(rest) if len(rest) else Readings.of(())
        return Readings(np.concatenate([waiting.table, self._finished().table]))

    def _fed(self, rows: Rows) -> Readings:
        offset = self.settings.offset
        self._behind += [t - offset for t in self.moments.add(rows)]
        outputs, readings = np.isfinite(rows.accel), np.isfinite(rows.position)
        stage = self.settings.stage_output(rows.accel[outputs])
        self._waiting = in_order(
            np.concatenate([self._waiting[0], rows.t[outputs] - offset, rows.t[readings]]),
            np.concatenate([self._waiting[1], np.ones(len(stage), dtype=bool), np.zeros(int(readings.sum()), bool)]),
            np.concatenate([self._waiting[2], stage, rows.position[readings]]),
        )
        newest = float(rows.t[-1]) if len(rows) else -math.inf
        return self._accepted(newest - max(0.0, offset))

    def _finished(self) -> Readings:
        last = self._accepted(math.inf)
        if self.filter is None:
            self.outputs += len(self._waiting[0])
            return last
        waiting = self.filter.waiting
        try:
            rest = self.filter.finish()
        except (ValueError, ArithmeticError) as error:  # none of what waited comes out
            self.refused, self.refusal = self.refused + waiting, str(error)
            return last
        return Readings(np.concatenate([last.table, rest.table]))

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """Parameters of the sensor with standard deviations; before the first reading those of the start."""
        return self._held_to(self.settings.estimates(*self._state()))

    def _state(self) -> tuple[Array, Array]:
        """Mean (N,) and covariance (N, N) of all states; those of a start while there is no filter."""
        if self.filter is None:
            return self.settings.start(0.0, 0.0)
        return self.filter.estimate, self.filter.covariance

    def _held_to(self, estimates: tuple[Estimate, ...]) -> tuple[Estimate, ...]:
        """Those of the estimates that hold: beyond what the correction can, none whose gradient is the noisy output."""
        share = self.noise_share
        noisy = self._noisy() if share is not None and share.sentence else set[str]()
        return tuple(e for e in estimates if e.name not in noisy)

    def _noisy(self) -> set[str]:
        """Coefficients whose gradient is the output itself."""
        return {PARAMETER_OF[name] for name in self.settings.names if name != "K0"}

    @property
    def watched(self) -> tuple[Suspicion, ...]:
        """What the readings say for each suspect; empty without a watch."""
        return ()

    def naming(self) -> Naming | None:
        """Suspects of which one is there, where they are others than at the last call."""
        return None

    def fitted(self, fit: Fit) -> Fit:
        """The fit with the parameters as the filter holds them now."""
        if not self.readings:
            return fit
        settings, (x, P) = self.settings, self._state()
        values = ForwardParameters(settings.names, x[2:], P[2:, 2:])
        return replace(as_fit(replace(fit, rig=settings.rig), values, settings.choice), rig=fit.rig)

    @property
    def noise_share(self) -> NoiseShare | None:
        """Noise of the output over motion; None while it is large and the readings have hardly been used yet."""
        share, (begun, now) = self.moments.noise_share(self.settings), self._scale_variances()
        if share is None or not begun > 0.0:
            return None
        worst = (1.0 - now / begun) * share.value / (1.0 + share.value)  # what readings without a correction would give
        return share if share.value <= MOST_SHARE or worst > 0.5 * math.sqrt(now) else None

    def _scale_variance(self, covariance: Array) -> float:
        """That of the scale factor, in the covariance of the parameters."""
        row = self.settings.names.index("k")
        return float(covariance[row, row])

    def _scale_variances(self) -> tuple[float, float]:
        """Variance of the scale factor at the start, and now."""
        now = self.settings.covariance if self.filter is None else self.filter.covariance[2:, 2:]
        return self._scale_begun, self._scale_variance(now)

    def _accepted(self, until: float) -> Readings:
        """Readings that the events up to an instant (s) lead to, in the filter and in those that follow holes."""
        parts = list[Readings]()
        while self._behind and self._behind[0] <= until:
            behind = self._behind.pop(0)
            parts.append(self._take(behind, "left"))
            self._end(behind)
        parts.append(self._take(until, "right"))
        return Readings(np.concatenate([part.table for part in parts]))

    def _end(self, behind: float) -> None:
        """Begin anew at an output behind a hole, s: the motion unknown, the parameters as they are now."""
        if self.filter is None:
            return
        moving = [self.settings.parameters.get(name) for name in self.settings.names]
        gap = behind - (behind if self.filter.time is None else self.filter.time)
        theta, covariance = waited(moving, gap, self.filter.estimate[2:], self.filter.covariance[2:, 2:])
        self.settings = replace(self.settings, theta=theta, covariance=covariance)
        self.filter = None

    def _take(self, until: float, side: Literal["left", "right"]) -> Readings:
        """Hand the events up to an instant (s) to the filter."""
        parts = list[Array]()
        while (part := self._some(until, side)) is not None:
            parts.append(part.table)
        return Readings(np.concatenate(parts)) if parts else Readings.of(())

    def _some(self, until: float, side: Literal["left", "right"]) -> Readings | None:
        """Hand events up to an instant (s), a few of a start, to the filter, which starts at the first reading among
        them; None where there are none."""
        t, output, value = self._waiting
        begin, ready = 0, int(np.searchsorted(t, until, side=side))
        if ready == 0:
            return None
        if self.filter is None:
            first = np.flatnonzero(~output[:ready])
            if not len(first):  # of outputs that no reading has followed yet, the last will do
                dropped = max(0, ready - 1)
                self.outputs += dropped
                self._waiting = t[dropped:], output[dropped:], value[dropped:]
                return None
            # At the last output before the first reading, or at the reading where there is none.
            begin = max(0, int(first[0]) - 1)
            self.outputs += begin
            self._start(float(value[first[0]]), float(t[first[0]] - t[begin]))
        assert self.filter is not None
        end = min(ready, begin + OF_START - self._since_start % OF_START) if self._tries else ready
        readings = self.filter.feed(t[begin:end], output[begin:end], value[begin:end])
        self._waiting = t[end:], output[end:], value[end:]
        self.outputs += int(output[begin:end].sum())
        self.readings += int((~output[begin:end]).sum())
        self.refused += readings.refused
        self.refusal = readings.refusal or self.refusal
        self._since_start += end - begin
        self._judge_start()
        return readings

    def _judge_start(self) -> None:
        """Begin anew where the scale factor has left what a sensor can have; no more once the filter has begun."""
        if not self._tries or self._since_start % OF_START:
            return
        assert self.filter is not None
        if 1.0 + self.filter.estimate[self.filter.names.index("k")] < LEAST_GAIN:
            self._tries, self._since_start = self._tries - 1, 0
            self.settings, self.filter = self._first, None
        elif self._since_start >= MOST_OF_START:
            self._tries = 0

    def _start(self, z: float, ahead: float) -> None:
        settings = self.settings
        x0, P0 = settings.start(z, ahead)
        self.filter = LiveFilter(
            settings.choice,
            q=settings.q,
            r_position=settings.r_position,
            x0=x0,
            P0=P0,
            tau=settings.tau,
            parameters=settings.parameters,
        )


def in_order(t: Array, output: Flags, value: Array) -> tuple[Array, Flags, Array]:
    """Events by their stamps, the output first at a tie."""
    order = np.lexsort((~output, t))
    return t[order], output[order], value[order]


OUTPUT, READING, SIDE = 0, 1, 2
"""Kinds of events, the last of the first side channel; at a tie the output comes first."""
Event = tuple[float, int, float]
"""Time in s, kind, value in SI."""
RATE_OUTPUTS = 50
"""Outputs from which the rate of a stream is taken."""
MOST_WAITING = 252
"""Readings that wait for the next output; of more the newest."""

Row = tuple[float, ...]
"""Of a reading, as in `Readings`."""


class ModelTracker(Tracker):
    """A `LiveModel` on rows of a stream, for a model with more effects than a `LiveFilter` has.

    It runs at the rate of the first outputs. The output at its instants is on the straight line between the two outputs
    around each; a reading is carried by at most half a step to the nearest instant along the motion. Behind a hole of
    the output, and behind a step that was refused, the motion begins anew, and the coefficients stay. Innovations lag
    by one or two outputs more than what waits in `excursions`.

    Parameters
    ----------
    settings : of the filter, with a model.
    """

    def __init__(self, settings: LiveSettings) -> None:
        super().__init__(settings)
        assert settings.model is not None
        self.live: LiveModel | None = None
        """None before the rate and a reading are known."""
        self._channels = tuple(sorted(settings.needs))
        self._held_back: list[Event] = []
        """Events that one before them may still join."""
        self._ahead: list[Event] = []
        """Events until the rate is known."""
        self._outputs: deque[tuple[float, float]] = deque()
        """Outputs around the next instant."""
        self._readings: deque[tuple[float, float]] = deque(maxlen=MOST_WAITING)
        self._side: dict[str, float] = {}
        self._step = self._at = self._zero = 0.0
        """Step between instants, the next of them, and the first, s."""
        self._behind_hole = False
        self._named = set[str]()
        """At the last call of `naming`."""
        self._before: tuple[float, float] | None = None
        """The reading before the one with which the filter begins."""

    def _fed(self, rows: Rows) -> Readings:
        self.moments.add(rows)
        values = (rows.accel, rows.position, *(rows.side[name] for name in self._channels))
        for kind, y in enumerate(values):
            at = np.flatnonzero(~np.isnan(y))
            late = self.settings.offset if kind == OUTPUT else 0.0
            self._held_back += zip((rows.t[at] - late).tolist(), [kind] * len(at), y[at].tolist(), strict=True)
        if not len(rows):
            return Readings.of(())
        self._held_back.sort()
        settled = float(rows.t[-1]) - max(self.settings.offset, 0.0)
        ready = sum(event[0] <= settled for event in self._held_back)
        events, self._held_back = self._held_back[:ready], self._held_back[ready:]
        return Readings.of(self._processed(events))

    def _finished(self) -> Readings:
        events, self._held_back = self._held_back, []
        innovations = self._processed(events, ended=True)
        return Readings.of(innovations + self._stepped(math.inf))

    def _processed(self, events: list[Event], *, ended: bool = False) -> list[Row]:
        innovations: list[Row] = []
        if self._step == 0.0:
            self._ahead += events
            stamps = [t for t, kind, _ in self._ahead if kind == OUTPUT]
            if len(stamps) < (3 if ended else RATE_OUTPUTS):
                self._drop_from_ahead()
                return innovations
            steps = np.diff(stamps)
            self._step = float(np.mean(steps[steps < 1.5 * np.median(steps)]))
            events, self._ahead = self._ahead, []
        for t, kind, value in events:
            if kind == OUTPUT:
                self.outputs += 1
                if self._outputs and t - self._outputs[-1][0] > HOLE * self._step:
                    innovations += self._stepped(math.inf)
                    self._outputs.clear()
                    self._readings.clear()
                    self._behind_hole = True
                if not self._outputs:
                    self._at = t
                self._outputs.append((t, value))
                innovations += self._stepped(t)
            elif kind == READING:
                self.readings += 1
                self._readings.append((t, value))
            else:
                self._side[self._channels[kind - SIDE]] = value
        return innovations

    def _drop_from_ahead(self) -> None:
        """Keep of the events behind the newest output the newest readings, and the last value of each side channel."""
        begin = max((i for i, event in enumerate(self._ahead) if event[1] == OUTPUT), default=-1) + 1
        behind = self._ahead[begin:]
        readings = [event for event in behind if event[1] == READING]
        sides = {event[1]: event for event in behind if event[1] >= SIDE}
        self.readings += max(0, len(readings) - MOST_WAITING)
        self._ahead[begin:] = sorted([*readings[-MOST_WAITING:], *sides.values()])

    def _stepped(self, until: float) -> list[Row]:
        """Go on to the last instant whose readings are all known, before the output at `until` (s)."""
        innovations, half = list[Row](), 0.5 * self._step
        while self._outputs and self._at + half <= until and self._at <= self._outputs[-1][0] + 1e-3 * self._step:
            while len(self._outputs) > 1 and self._outputs[1][0] <= self._at:
                self._outputs.popleft()
            try:
                innovations += self._one_step(self._at, self._output_at(self._at), self._reading_at(self._at, half))
            except (ValueError, ArithmeticError) as error:
                self.refused += 1
                self.refusal = str(error)
                self._behind_hole, self._before = True, None  # the filter has stayed behind
            self._at += self._step
        return innovations

    def _output_at(self, t: float) -> float:
        """The output at an instant, on the line between the outputs around it; close to one of them its own."""
        (before, u), (behind, v) = self._outputs[0], self._outputs[min(1, len(self._outputs) - 1)]
        share = (t - before) / (behind - before) if behind > before else 0.0
        return u if share < 1e-3 else v if share > 1.0 - 1e-3 else u + share * (v - u)

    def _reading_at(self, t: float, half: float) -> tuple[float, float] | None:
        """The reading nearest to an instant, within half a step."""
        near = []
        while self._readings and self._readings[0][0] < t + half:
            near.append(self._readings.popleft())
        near = [reading for reading in near if reading[0] >= t - half]
        return min(near, key=lambda reading: abs(reading[0] - t)) if near else None

    def _one_step(self, t: float, u: float, reading: tuple[float, float] | None) -> list[Row]:
        read, z = (t, None) if reading is None else reading
        if self.live is None or self._behind_hole:
            if z is None or len(self._side) < len(self._channels):
                return []
            before, self._before = self._before, reading
            if before is None:
                return []
            # A reading is carried to its instant along the motion, so the velocity must be known from the first on.
            v = (z - before[1]) / (read - before[0])
            if self.live is None:
                self.live, self._zero = self._begun(1.0 / self._step, z), t
            self.live.restart(z + v * (t - read), v, t - self._zero)
            self._behind_hole, self._before = False, None
        e = self.live.step(u, z, t - read, **self._side)
        if e is None or reading is None or self.live.innovation_variance is None:
            return []
        variance = self.live.innovation_variance
        return [(*reading, e, variance, *(self.live.score or (e, variance, 1.0, *(0.0,) * 5)))]

    def _begun(self, rate: float, position: float) -> LiveModel:
        settings = self.settings
        assert settings.model is not None
        return LiveModel(
            settings.model,
            settings.rig,
            rate=rate,
            q=settings.q,
            r_position=settings.r_position,
            position=position,
            speed=SPEED,
            origins=settings.origins,
            gauss_markov={PARAMETER_OF[name]: moves for name, moves in settings.parameters.items()},
            covariance=settings.spread,
            watch=settings.watch,
        )

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """Coefficients that are estimated, with standard deviations."""
        live = self.live or self._begun(1.0, 0.0)
        return self._held_to(tuple(e for e in live.estimates if e.std > 0.0))

    def _scale_variances(self) -> tuple[float, float]:
        assert self.settings.spread is not None
        begun = float(self.settings.spread[0, 0])  # the scale factor is the first state of a `LiveModel`
        return begun, begun if self.live is None else float(self.live.covariance[0, 0])

    def _noisy(self) -> set[str]:
        return set[str]() if self.live is None else self.live.noisy_names

    @property
    def watched(self) -> tuple[Suspicion, ...]:
        """What the readings say for each suspect; empty without a watch."""
        return () if self.live is None else self.live.watched

    def naming(self) -> Naming | None:
        """Suspects of which one is there, where they are others than at the last call; none while the noise of the
        output is more beside the motion than a correction can allow for."""
        share = self.noise_share
        named = () if self.live is None or (share is not None and share.sentence) else self.live.named()
        names = {suspicion.name for suspicion in named}
        if not names or names == self._named:
            return None
        self._named = names
        return Naming(self._at - self._step, named, len(self.settings.watch))

    def fitted(self, fit: Fit) -> Fit:
        """The fit with the coefficients as the filter holds them, but for those that belong to the fitted record."""
        if self.live is None:
            return fit
        rows = {e.name: i for i, e in enumerate(fit.free) if not of_one_record(find(e.name.split(".")[0]))}
        states = [(j, rows[name]) for j, name in enumerate(self.live.names) if name in rows]
        here, there = (list(places) for places in zip(*states, strict=True))
        covariance = fit.covariance.copy()
        covariance[there, :] = covariance[:, there] = 0.0
        covariance[np.ix_(there, there)] = self.live.covariance[np.ix_(here, here)]
        now = {e.name: e for e in self.estimates if e.name in rows}
        estimates = tuple(
            replace(e, value=now[e.name].value, std=now[e.name].std) if e.name in now else e for e in fit.estimates
        )
        return replace(fit, estimates=estimates, covariance=covariance, at_shapes=())
