"""The filter of a live view: its settings, rows in the order of events, bias by noise, alarms of its innovations."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Literal, TypeVar

import numpy as np

from accelcal._support.errors import AccelcalError
from accelcal._support.result import Storable
from accelcal.data import Array, RecordingError, Rig, unsupported
from accelcal.effects import find
from accelcal.estimation.engines import PARAMETER_OF, PRIOR_STD
from accelcal.estimation.estimate import Fit
from accelcal.filters.choice import PARAMETERS, FilterChoice, GaussMarkov, spread_start, to_stage
from accelcal.filters.stream import LiveFilter
from accelcal.io.stream import Rows
from accelcal.model import BASE, Estimate

TRACKED = (*BASE, *PARAMETER_OF.values(), "lowpass_error")
"""Effects of a model that a live view takes: it estimates the parameters of its filter and keeps the rest."""
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
        """Parameters of the sensor, by their public names, from all states (N,) and their covariance (N, N)."""
        T = np.linalg.inv(to_stage(self.names, self.rig.polarity, self.rig.gravity))
        values, spread = T @ states[2:], T @ covariance[2:, 2:] @ T.T
        estimates = []
        for i, name in enumerate(self.names):
            effect = find(PARAMETER_OF[name])
            std = math.sqrt(max(0.0, float(spread[i, i])))
            estimates.append(Estimate(effect.name, effect.symbol, effect.unit, float(values[i]), std, effect.owner))
        return tuple(estimates)


def settings_of(rig: Rig, fit: Fit | None = None) -> LiveSettings:
    """Settings for a rig, and for the parameters, their uncertainty, noise and time offset of a fit.

    Without a fit the parameters start at zero, as wide as any working sensor, and the noise is that of the sidecar.

    Raises
    ------
    RecordingError
        For a filter that a live filter does not undo, for noise that is not declared, and for a model with effects that
        it does not track. The sentence says what to do.
    """
    refused = unsupported(rig.filters, "a live view")
    if refused:
        raise RecordingError(refused)
    tau = rig.lowpass.tau if rig.lowpass is not None else 0.0
    walk = rig.sensor.random_walk
    parameters = {"K0": GaussMarkov(walk**2)} if walk else {}
    if fit is None:
        q, r = declared_noise(rig)
        choice = _choice("linear")
        spread = np.diag([PRIOR_STD[name] ** 2 for name in PARAMETERS["linear"]])
        return LiveSettings(choice, rig, q, r, np.zeros(len(spread)), spread, tau, 0.0, parameters)
    theta, spread, choice = _of_fit(fit)
    A = to_stage(PARAMETERS[choice.model], rig.polarity, rig.gravity)
    values, noise = fit.values(), fit.noise().usual
    tau = max(0.0, tau + values.lowpass_error)
    return LiveSettings(
        choice,
        rig,
        noise.q * values.scale**2,
        noise.r,
        A @ theta,
        A @ spread @ A.T,
        tau,
        values.by_name.get("time_offset", 0.0),
        parameters,
    )


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
    """Exact integrals, straight lines between outputs, and UD factors, which no rate and no prior makes indefinite."""
    return FilterChoice("aci", "cubic" if model == "cubic" else "linear", interpolation="linear", carrier="factored")


def _of_fit(fit: Fit) -> tuple[Array, Array, FilterChoice]:
    """Parameters of a fit and their covariance, in the order of the filter that tracks them."""
    other = [name for name in fit.model.effects if name not in TRACKED]
    if other:
        raise RecordingError(
            f"live: {', '.join(other)} cannot be tracked from time, output and position alone; a live view tracks "
            f"{', '.join(PARAMETER_OF.values())}: drop the rest with accelcal drop"
        )
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
SETTLING = 50
"""First readings, which are not judged: the filter still learns where it is."""
RUNNING = 1000
"""Readings of the running NIS."""
CONFIDENCE = 0.99
"""Of the interval of the running NIS."""


@dataclass(frozen=True, slots=True)
class Alarm(Storable):
    """A block of innovations that the model does not explain."""

    derived: ClassVar[tuple[str, ...]] = ("sentence",)

    t: float
    """End of the block, s."""
    kind: Literal["nis", "mean"]
    """Mean of e²/S, or of e/sqrt(S)."""
    value: float
    low: float
    high: float
    readings: int
    since: float
    """End of the first block of those in a row that raised an alarm, s."""

    @property
    def sentence(self) -> str:
        """What was found, what was expected, and what it may be."""
        expected = f"expected {self.low:.3g} to {self.high:.3g} over {self.readings} readings"
        if self.kind == "mean":
            return (
                f"t = {self.t:.6g} s: the innovations have a mean of {self.value:.3g} standard deviations, {expected}; "
                "the bias or the scale factor has changed, or the model lacks an effect"
            )
        cause = (
            "the sensor has changed, the model lacks an effect, or less noise is declared than there is"
            if self.value > self.high
            else "more noise is declared than there is"
        )
        return f"t = {self.t:.6g} s: NIS {self.value:.3g}, {expected}; {cause}"


@dataclass(frozen=True, slots=True)
class Interval:
    """A running mean and where it lies with a probability while the model holds."""

    value: float
    low: float
    high: float
    readings: int


class InnovationMonitor:
    """Tests normalised innovations, block by block, against the standard normal distribution.

    In a block of n readings the sum of e²/S is chi-square with n degrees of freedom and the mean of e/sqrt(S) has the
    variance 1/n. Either test has half of `false_alarm`; both let the true variance be off by `tolerance`.

    Parameters
    ----------
    false_alarm : probability of an alarm in one block while the model holds.
    tolerance : relative error of the expected variance that still counts as holding.
    least_readings, least_time : a block ends when both are reached; readings, s.
    settling : first readings, which are not judged.

    Examples
    --------
    >>> monitor = InnovationMonitor(least_readings=100, least_time=0.0, settling=0)
    >>> alarms = [monitor.add(0.01 * i, (-1.0) ** i) for i in range(100)]
    >>> alarms[-1] is None
    True
    >>> [monitor.add(1.0 + 0.01 * i, 2.0) for i in range(100)][-1].kind
    'mean'
    """

    def __init__(
        self,
        *,
        false_alarm: float = FALSE_ALARM,
        tolerance: float = TOLERANCE,
        least_readings: int = LEAST_READINGS,
        least_time: float = LEAST_TIME,
        settling: int = SETTLING,
    ) -> None:
        self.false_alarm, self.tolerance = false_alarm, tolerance
        self.least_readings, self.least_time = least_readings, least_time
        self.blocks, self.alarms = 0, 0
        """Blocks that were judged, and those that raised an alarm."""
        self.holds: bool | None = None
        """Whether the newest block is what the model expects; None before the first."""
        self._settling = settling
        self._recent: deque[float] = deque(maxlen=RUNNING)
        self._count, self._sum, self._square = 0, 0.0, 0.0
        self._began = 0.0
        self._since: float | None = None

    def add(self, t: float, normalised: float) -> Alarm | None:
        """Take in an innovation at `t` (s) in standard deviations; the alarm of the block that it ends, if any."""
        square = normalised * normalised
        self._recent.append(square)
        if self._settling > 0:
            self._settling -= 1
            return None
        if self._count == 0:
            self._began = t
        self._count += 1
        self._sum += normalised
        self._square += square
        if self._count < self.least_readings or t - self._began < self.least_time:
            return None
        alarm = self._judged(t)
        self.blocks += 1
        self.alarms += alarm is not None
        self.holds = alarm is None
        self._since = None if alarm is None else alarm.since
        self._count, self._sum, self._square = 0, 0.0, 0.0
        return alarm

    @property
    def nis(self) -> Interval | None:
        """Mean e²/S of the last `RUNNING` readings with its interval of 99 %; None before the first reading."""
        n = len(self._recent)
        if n == 0:
            return None
        low, high = chi_square_bounds(n, 1.0 - CONFIDENCE)
        return Interval(math.fsum(self._recent) / n, low, high, n)

    def _judged(self, t: float) -> Alarm | None:
        """The alarm of the block that ends here: of the mean first, which names a cause."""
        n, off = self._count, 1.0 + self.tolerance
        since = t if self._since is None else self._since
        bound = normal_bound(self.false_alarm / 2.0) * math.sqrt(off / n)
        mean = self._sum / n
        if not abs(mean) <= bound:
            return Alarm(t, "mean", mean, -bound, bound, n, since)
        low, high = chi_square_bounds(n, self.false_alarm / 2.0)
        nis = self._square / n
        if not low / off <= nis <= high * off:
            return Alarm(t, "nis", nis, low / off, high * off, n, since)
        return None


def chi_square_bounds(n: int, alpha: float) -> tuple[float, float]:
    """Where the mean of n squared standard normal numbers lies but for the probability `alpha`, half on each side."""
    from scipy.special import chdtri

    return float(chdtri(n, 1.0 - alpha / 2.0)) / n, float(chdtri(n, alpha / 2.0)) / n


def normal_bound(alpha: float) -> float:
    """What the size of a standard normal number exceeds with probability `alpha`."""
    from scipy.special import ndtri

    return -float(ndtri(alpha / 2.0))


NOTICEABLE = 1.0
"""Standard deviations of the filter above which the bias is said."""
MOST_SAVED = 3.0
"""The same above which the parameters are not saved: the value is wrong, not only less sure."""


@dataclass(frozen=True, slots=True)
class RegressorBias(Storable):
    """Expected error of the scale factor by noise of the output, and by straight lines between its samples."""

    derived: ClassVar[tuple[str, ...]] = ("sigma", "sentence")

    value: float
    """Estimate less truth, 1."""
    std: float
    """Standard deviation that the filter has for it, 1."""

    @property
    def sigma(self) -> float:
        """The error in standard deviations of the filter, at least 0."""
        return abs(self.value) / self.std if self.std > 0.0 else 0.0

    @property
    def sentence(self) -> str:
        """What is wrong and what to do, where it is above one standard deviation; else empty."""
        if self.sigma <= NOTICEABLE:
            return ""
        return (
            f"the noise of the output biases scale_factor by about {self.value:.2g}, {self.sigma:.2g} standard "
            "deviations of the live filter; its uncertainty contains that. Record with -o and fit the recording, which "
            "smooths the output: accelcal fit"
        )


class OutputMoments:
    """Running moments of output and readings: a few numbers, however long it runs.

    Products of samples one and two apart hold motion alone, since the noise is white.
    """

    def __init__(self) -> None:
        self.outputs, self.readings = 0, 0
        self._from: Array = np.zeros(2)
        self._to: Array = np.zeros(2)
        """First and last stamp of outputs and of readings, s."""
        self._zero = 0.0
        self._last: Array = np.empty(0)
        """The last two samples less the first of all, m/s²."""
        self._sum = 0.0
        self._products: Array = np.zeros(2)

    def add(self, rows: Rows) -> None:
        """Take rows in."""
        finite = np.isfinite(rows.accel)
        self.outputs = self._counted(0, self.outputs, rows.t[finite])
        self.readings = self._counted(1, self.readings, rows.t[np.isfinite(rows.position)])
        u = rows.accel[finite]
        if not len(u):
            return
        if self.outputs == len(u):
            self._zero = float(u[0])
        before = len(self._last)
        y = np.concatenate([self._last, u - self._zero])
        self._sum += float(np.sum(y[before:]))
        for k in (1, 2):
            begin = max(before, k)
            self._products[k - 1] += float(y[begin:] @ y[begin - k : len(y) - k])
        self._last = y[-2:]

    def _counted(self, channel: int, count: int, t: Array) -> int:
        """Number of samples of a channel so far, with those at `t` (s)."""
        if len(t):
            self._from[channel] = self._from[channel] if count else t[0]
            self._to[channel] = t[-1]
        return count + len(t)

    def bias(self, settings: LiveSettings, variance: float) -> RegressorBias | None:
        """What the scale factor is biased by, where the filter has a `variance` for it; None before there is motion.

        A filter that began with a model shares the bias only as far as the new readings count.
        """
        if self.outputs < 3 or self.readings < 3:
            return None
        step, apart = (self._to - self._from) / (np.array([self.outputs, self.readings]) - 1)
        first, two = self._products / (self.outputs - np.array([1, 2])) - (self._sum / self.outputs) ** 2
        slowed = max((first - two) / 1.5, 0.0)  # <a²> <w²> dt²; products k apart are <a²> (1 - k² <w²> dt²/2)
        motion = max(first + 0.5 * slowed, 0.0)
        crossover = (settings.q / (settings.r_position * apart)) ** 0.25 / (2.0 * math.pi)
        noise = 2.0 * settings.q * min(1.11 * crossover, 1.0 / (3.0 * step))
        row = settings.names.index("k")
        begun = float(settings.covariance[row, row])
        share = max(0.0, 1.0 - variance / begun) if begun > 0.0 else 0.0
        return RegressorBias(share * (noise - slowed / 12.0) / (motion + noise), math.sqrt(max(variance, 0.0)))


OUTPUT, READING = 0, 1
"""Kinds of events; at a tie the output comes first."""
MOST_BETWEEN = 63
"""Readings between two outputs that the filter has room for, beside the output itself."""
Event = tuple[float, int, float]
"""Time in s, kind, value in SI."""


@dataclass(frozen=True, slots=True)
class Innovation:
    """One reading that the filter took in."""

    t: float
    """s"""
    e: float
    """Reading minus expectation, m."""
    variance: float
    """That the model expects, m²."""


class Tracker:
    """A `LiveFilter` on rows of a stream.

    It starts at the last output before the first reading. What comes out equals `filters.run` on the same rows with the
    same settings, bit for bit: stamps of the output minus `settings.offset`, `settings.stage_output` of its values.

    Parameters
    ----------
    settings : of the filter.
    """

    def __init__(self, settings: LiveSettings) -> None:
        self.settings = settings
        self.filter: LiveFilter | None = None
        """None before the first reading."""
        self.outputs, self.readings = 0, 0
        self.untested = 0
        """Readings taken in whose innovation is not known: all but the last of those between two outputs."""
        self.refused = 0
        """Events that the filter refused; its state is as it was before them."""
        self.refusal = ""
        """What it said of the last of them."""
        self.moments = OutputMoments()
        self._scale = 2 + settings.names.index("k")
        self._first: tuple[float, float] | None = None
        self._waiting: list[tuple[float, float]] = []
        """Time and expected variance of the readings that wait for the next output."""
        self._held_back: list[Event] = []
        self._output = 0.0

    def feed(self, rows: Rows) -> list[Innovation]:
        """Take rows in; return the innovations that they led to, which lag by one output."""
        self.moments.add(rows)
        return self._take(self._released(rows))

    def finish(self) -> list[Innovation]:
        """Take in what still waits, as at the end of a record."""
        innovations = self._take(iter(sorted(self._held_back)))
        self._held_back = []
        if self.filter is not None:
            try:
                self._settle(self.filter.finish(), innovations)
            except (ValueError, ArithmeticError) as error:
                self._refuse(error)
        return innovations

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """Parameters of the sensor with standard deviations, which contain the bias by noise of the output; before the
        first reading those of the start."""
        if self.filter is None:
            return self.settings.estimates(*self.settings.start(0.0, 0.0))
        return self.settings.estimates(self.filter.estimate, self.covariance)

    @property
    def covariance(self) -> Array:
        """Covariance of all states of the filter, (N, N), with the square of what noise of the output biases the scale
        factor by."""
        assert self.filter is not None
        P = self.filter.covariance.copy()
        bias = self.regressor_bias
        P[self._scale, self._scale] += 0.0 if bias is None else bias.value**2
        return P

    @property
    def regressor_bias(self) -> RegressorBias | None:
        """What noise of the output biases the scale factor by; None before there is motion."""
        if self.filter is None:
            return None
        return self.moments.bias(self.settings, float(self.filter.covariance[self._scale, self._scale]))

    def _released(self, rows: Rows) -> Iterator[Event]:
        """Events of the rows in time order, kept back as long as one before them may still come."""
        offset = self.settings.offset
        cells = zip(rows.t.tolist(), rows.accel.tolist(), rows.position.tolist(), strict=True)
        if offset == 0.0:
            for t, u, z in cells:
                if u == u:
                    yield t, OUTPUT, u
                if z == z:
                    yield t, READING, z
            return
        for t, u, z in cells:
            if u == u:
                self._held_back.append((t - offset, OUTPUT, u))
            if z == z:
                self._held_back.append((t, READING, z))
        if len(rows):
            newest = float(rows.t[-1])
            settled = min(newest, newest - offset)
            self._held_back.sort()
            ready = sum(event[0] <= settled for event in self._held_back)
            yield from self._held_back[:ready]
            del self._held_back[:ready]

    def _take(self, events: Iterator[Event]) -> list[Innovation]:
        innovations: list[Innovation] = []
        for t, kind, value in events:
            try:
                if kind == OUTPUT:
                    self._take_output(t, self.settings.stage_output(value), innovations)
                else:
                    self._take_reading(t, value)
            except (ValueError, ArithmeticError) as error:
                self._refuse(error)
        return innovations

    def _take_output(self, t: float, u: float, innovations: list[Innovation]) -> None:
        self.outputs += 1
        if self.filter is None:
            self._first = t, u
            return
        self._output = u
        self._settle(self.filter.step(t, accel=u), innovations)

    def _take_reading(self, t: float, z: float) -> None:
        if self.filter is None:
            self._start(t, z)
        assert self.filter is not None
        if len(self._waiting) == MOST_BETWEEN:
            raise AccelcalError(f"more than {MOST_BETWEEN} readings without an output between them")
        variance = self._expected_variance(t)
        self.filter.step(t, position=z)
        self._waiting.append((t, variance))
        self.readings += 1

    def _settle(self, e: float | None, innovations: list[Innovation]) -> None:
        """The filter took in all that waited; `e` is the innovation of the last reading of it."""
        if e is not None and self._waiting:
            t, variance = self._waiting[-1]
            if len(self._waiting) == 1:
                innovations.append(Innovation(t, e, variance))
            else:
                self.untested += len(self._waiting)
        self._waiting.clear()

    def _start(self, t: float, z: float) -> None:
        """Begin at the last output before the first reading, or at the reading where there is none."""
        settings = self.settings
        x0, P0 = settings.start(z, t - (t if self._first is None else self._first[0]))
        self.filter = LiveFilter(
            settings.choice,
            q=settings.q,
            r_position=settings.r_position,
            x0=x0,
            P0=P0,
            tau=settings.tau,
            parameters=settings.parameters,
        )
        if self._first is not None:
            self._output = self._first[1]
            self.filter.step(self._first[0], accel=self._first[1])

    def _expected_variance(self, t: float) -> float:
        """Variance of the innovation of a reading at `t` (s), m²: exact at the stamp of an output.

        Between outputs the state is carried on by the motion that the last output drives, to first order in the
        parameters, which is good to a part in a thousand of what they add.
        """
        assert self.filter is not None
        settings, P = self.settings, self.filter.covariance
        time, tau = self.filter.time, settings.tau
        h = 0.0 if time is None else t - time
        if h <= 0.0:
            p, pv, v = float(P[0, 0]), float(P[0, 1]), float(P[1, 1])
            return p + 2.0 * tau * pv + tau**2 * v + settings.r_position
        gradient, slope = self._acceleration_gradient()
        row = np.concatenate([[1.0, h + tau], (h**2 / 2.0 + tau * h) * gradient])
        added = settings.q * ((h + tau) ** 3 - tau**3) / 3.0 / slope**2
        return float(row @ P @ row) + added + settings.r_position

    def _acceleration_gradient(self) -> tuple[Array, float]:
        """Gradient of the acceleration by the parameters at the last output, (m,), and d output / d acceleration."""
        assert self.filter is not None
        theta = dict(zip(self.settings.names, self.filter.estimate[2:].tolist(), strict=True))
        a = (self._output - theta["K0"]) / (1.0 + theta["k"])
        slope = 1.0 + theta["k"] + 2.0 * theta.get("K2", 0.0) * a + 3.0 * theta.get("K3", 0.0) * a * a
        powers = {"k": a, "K0": 1.0, "K2": a * a, "K3": a * a * a}
        return np.array([-powers[name] / slope for name in self.settings.names]), slope

    def _refuse(self, error: Exception) -> None:
        self.refused += 1
        self.refusal = str(error)
        waiting = 0 if self.filter is None else self.filter.waiting
        del self._waiting[: max(0, len(self._waiting) - waiting)]


def normalised(innovation: Innovation) -> float:
    """An innovation in standard deviations."""
    return innovation.e / math.sqrt(innovation.variance)
