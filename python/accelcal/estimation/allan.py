"""A sensor at rest: Allan deviation, noise density, bias instability and random walk, and its bias over temperature.

The three terms and the response to temperature are one model of the output, fitted by restricted likelihood to the
coefficients of its discrete cosine transform. That transform makes white noise and a random walk of any length exactly
independent, and flicker nearly so: no window, no leakage from either end of the spectrum (derivations 6.19). The Allan
deviation is what people compare; nothing is read off it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import scipy
from numpy.typing import NDArray

from accelcal._support.arguments import checked
from accelcal._support.result import Result, Storable
from accelcal._support.values import immutable
from accelcal.data import MICRO_G, Array, Channel, Flags, Recording, RecordingError, instant, median_step
from accelcal.io.dwells import TRIAD

TERMS = ("noise", "bias_instability", "random_walk")
"""Keys of a sidecar, and what they are: one-sided density N, flicker B, rate random walk K."""
USUAL = {
    "noise": ("ug/sqrt(Hz)", MICRO_G),
    "bias_instability": ("ug", MICRO_G),
    "random_walk": ("ug/sqrt(h)", MICRO_G / 60.0),
}
"""Unit of each in a sidecar, and its size in SI."""
FLOOR = math.sqrt(2.0 * math.log(2.0) / math.pi)
"""Allan deviation of flicker over B, 0.664."""
FEWEST = 100
"""Samples below which nothing is estimated."""
SINGLE, WIDTH = 64, 1.03
"""Coefficients from the lowest that are used one by one, and the width of the bins of those above, as a ratio."""
HALF_DEVIANCE = 0.5 * float(scipy.special.chdtri(1.0, 0.05))
"""Fall of the log-likelihood at the ends of a 95 % interval."""
REACH = 30.0
"""Natural logarithm of the variance below its start at which a term is taken to be absent."""
MEDIAN, SCATTER = 0.4549, 1.5
"""Median of chi-square with one degree of freedom, and what that of a bin may err by, as a ratio."""
CHANCE, LINE = 1e-3, 1e-4
"""Probability that anything is called a line, or a spectrum not white, where it is; share of the power from which lines
are reported."""
RESTLESS, WINDOW = 2.0, 64
"""Scatter within a window over the usual one from which the sensor did not rest, ten standard deviations or more, and
samples of such a window at least; it lasts 1 s or more."""
COARSE = 2.0
"""Step of the output over the standard deviation of its differences, divided by the root of two, from which it hides
the noise."""
DETERMINED = 100.0
"""Length of a record over its Allan minimum from which flicker and random walk are determined in 19 of 20 records."""
LAGGING, CURVED, SHORT = 20.0, 12.0, 1024
"""Twice the gain in log-likelihood from which a memory of the temperature is reported (two further parameters, 64
trials), and a further order of the polynomial in it; means over time on which they are sought, for they are slow."""


@dataclass(frozen=True, slots=True)
class NoiseTerm:
    """One term with its 95 % interval."""

    name: str
    """Key of the sidecar."""
    value: float
    """N in (m/s²)/sqrt(Hz), B in m/s², K in (m/s²)/sqrt(s)."""
    low: float
    """0 where the record gives an upper limit alone."""
    high: float

    @property
    def determined(self) -> bool:
        """Whether the interval excludes zero."""
        return self.low > 0.0

    @property
    def line(self) -> str:
        """Line of a sidecar; a comment where there is an upper limit alone."""
        unit, size = USUAL[self.name]
        if self.determined:
            return f'{self.name} = "{self.value / size:.4g} {unit}"'
        return f"# {self.name} is below {self.high / size:.2g} {unit} (95 %)"


@dataclass(frozen=True, slots=True)
class Trend:
    """A form of the bias over temperature."""

    order: int = 1
    """Of the polynomial in the temperature."""
    memory: str = ""
    """"lag" where the bias follows the recorded temperature late, "settling" where it settles beside it, or empty."""
    time: float = 0.0
    """Time constant of that, s; 0 without any."""

    def columns(self, t: Array, warmth: Array) -> Array:
        """Columns (m, n) at times (n,) s, the first at 0, of temperatures (n,) about the middle, K.

        A lag is first order, with a transient of its unknown start; a settling is a transient beside the temperature.
        """
        transient = [np.exp(-t / self.time)] if self.memory else []
        if self.memory == "lag":
            share = -math.expm1(-(t[1] - t[0]) / self.time)
            zi = [(1.0 - share) * warmth[0]]
            warmth = scipy.signal.lfilter([share], [1.0, share - 1.0], warmth, zi=zi)[0]
        return np.stack([*(warmth**power for power in range(1, self.order + 1)), *transient])


@dataclass(frozen=True, slots=True, eq=False)
class WarmUp:
    """Bias over temperature in one record, by least squares with the covariance of the coloured noise."""

    slope: float
    """In the middle of the range, m/s²/K."""
    std: float
    """m/s²/K, type A."""
    trend: Trend
    temperature: Array
    """Means over equal times, at most 60, (k,) degC."""
    bias: Array
    """Output in them, (k,) m/s²."""
    fitted: Array
    """What the temperature explains of it, (k,) m/s²."""


@dataclass(frozen=True, slots=True, eq=False)
class OutputNoise(Storable):
    """Noise of one output at rest."""

    derived: ClassVar[tuple[str, ...]] = ("minimum", "sidecar")

    output: str
    seconds: float
    rate: float
    """Hz"""
    band: float
    """Highest frequency that the fit uses, Hz."""
    terms: tuple[NoiseTerm, ...]
    """In the order of `TERMS`."""
    tau: Array
    """Averaging times, (n,) s."""
    deviation: Array
    """Overlapping Allan deviation, what temperature explains subtracted, (n,) m/s²."""
    low: Array
    """Lower end of its 95 % interval, (n,) m/s²."""
    high: Array
    """(n,) m/s²"""
    warm_up: WarmUp | None
    notes: tuple[str, ...]

    @property
    def sidecar(self) -> str:
        """Lines of a sidecar that declare this noise."""
        return "\n".join((f"[sensor]   # {self.output}", *(term.line for term in self.terms)))

    def allan(self, tau: Array) -> Array:
        """Allan deviations of the three terms alone, (3, n) m/s², at averaging times (n,) s."""
        n, b, k = (term.value for term in self.terms)
        flat = np.full(len(tau), FLOOR * b)
        return np.stack([n / np.sqrt(2.0 * tau), flat, k * np.sqrt(tau / 3.0)])

    @property
    def minimum(self) -> tuple[float, float] | None:
        """Averaging time, s, and Allan deviation, m/s², of the minimum; None where the record does not reach one."""
        n, _, k = (term.value for term in self.terms)
        tau = math.sqrt(1.5) * n / k if k > 0.0 else math.inf
        if tau > 0.5 * self.seconds:
            return None
        return tau, float(np.linalg.norm(self.allan(np.array([tau]))))


@immutable
@dataclass(frozen=True, slots=True, weakref_slot=True, eq=False, repr=False)
class RestNoise(Result):
    """What a record at rest says of each of its outputs."""

    name: str
    outputs: tuple[OutputNoise, ...]


@checked
def rest(recording: Recording) -> RestNoise:
    """Estimate noise density, bias instability and random walk of a sensor from a record at rest, no position needed.

    Parameters
    ----------
    recording : output, or accel_x, accel_y and accel_z among the side channels, and temperature where there is one; of
        `accelcal.load(path, need_position=False, need_accel=False)`.

    Returns
    -------
    RestNoise
        For each output the overlapping Allan deviation with 95 % intervals, the three terms with theirs, the minimum,
        and the slope of the bias with temperature, which is subtracted before the Allan deviation.

    Notes
    -----
    One-sided power density N² + B²/(π f) + K²/(2 π² f²), Allan variance N²/(2 τ) + 2 ln 2/π B² + K² τ/3. The minimum
    lies at τ = sqrt(3/2) N/K.

    Raises
    ------
    RecordingError
        If the record is too short, interrupted, not at rest, saturated, or coarser than its noise; it names the place
        and the next step.

    Examples
    --------
    >>> import numpy as np
    >>> import accelcal as ac
    >>> t, none = np.arange(20_000) / 100.0, np.empty(0)
    >>> y = 0.1 + 0.02 * np.random.default_rng(1).standard_normal(len(t))
    >>> still = ac.Recording(ac.Channel("accel", t, y, "m/s^2"), ac.Channel("position", none, none, "m"), ac.Rig())
    >>> noise, instability, walk = ac.rest(still).outputs[0].terms
    >>> round(noise.value, 5), instability.determined, walk.determined
    (0.00281, False, False)
    """
    if not (outputs := outputs_of(recording)):
        place = recording.title
        raise RecordingError(f"{place}: no output; expected a channel accel, or accel_x, accel_y and accel_z")
    for channel in outputs:
        require_rest(recording, channel)
    return RestNoise(recording.name, tuple(noise_of(y, recording.side.get("temperature")) for y in outputs))


def outputs_of(recording: Recording) -> list[Channel]:
    """Outputs of a triad, or the one output; empty where there is none."""
    triad = [recording.side[name] for name in TRIAD if name in recording.side]
    return triad or [recording.accel] * bool(len(recording.accel))


def require_rest(recording: Recording, channel: Channel) -> None:
    """Check that a channel is an even record at rest.

    Raises
    ------
    RecordingError
        Naming the channel, what is wrong where, and the next step.
    """
    place, t, y = f"{recording.title}: {channel.name}", channel.t, channel.y
    if len(t) < FEWEST:
        raise RecordingError(
            f"{place}: {len(t)} samples, expected at least {FEWEST}; record at rest for an hour or longer"
        )
    if channel.unit != "m/s^2":
        raise RecordingError(
            f"{place} is in {channel.unit}, expected an acceleration; declare scale and zero of this channel in the "
            f'sidecar: {channel.name} = {{ column = "...", unit = "{channel.unit}", scale = "... {channel.unit}/g" }}'
        )
    for finding in recording.findings:
        if finding.channel == channel.name and finding.kind in ("saturated", "constant"):
            raise RecordingError(
                f"{recording.title}: {finding.text.partition('. Every fit')[0]}; expected noise. Check "
                "supply, wiring, range and column, and record at rest anew"
            )
    step, cut = median_step(t), f"accelcal cut {recording.origin.arguments or 'RUN'}"
    pauses = np.flatnonzero(np.diff(t) > 1.5 * step)
    if len(pauses):
        edges = np.concatenate([[-1], pauses, [len(t) - 1]])
        k = int(np.argmax(np.diff(edges)))
        whole = f"{t[edges[k] + 1]:.9g}:{t[edges[k + 1]]:.9g}"
        raise RecordingError(
            f"{place}: {len(pauses)} gaps, the first at t = {instant(t[pauses[0]])} s for "
            f"{t[pauses[0] + 1] - t[pauses[0]]:.3g} s; averages over evenly spaced samples are needed. Use the longest "
            f"part without one: {cut} --only {whole} -o rest_1.csv"
        )
    changes = np.abs(np.diff(y))
    scatter = float(np.sqrt(np.mean(changes**2) / 2.0))
    code = float(np.quantile(changes[changes > 0.0], 0.01)) if scatter > 0.0 else 0.0
    if code >= COARSE * scatter:
        raise RecordingError(
            f"{place}: the output changes in steps of {code:.3g} m/s², coarser than its noise of {scatter:.2g} m/s² "
            "rms, which it hides; record with a smaller range or more bits, or log the mean of many samples"
        )
    size = max(WINDOW, math.ceil(1.0 / step))
    spread = np.std(y[: len(y) // size * size].reshape(-1, size), axis=1)
    moved = np.flatnonzero(spread > RESTLESS * np.median(spread))
    if len(moved):
        longest = max(np.split(np.arange(len(spread)), moved), key=len)
        longest = longest[np.isin(longest, moved, invert=True)] * size
        part = f"{t[longest[0]]:.9g}:{t[longest[-1] + size - 1]:.9g}"
        raise RecordingError(
            f"{place}: the sensor does not rest: from t = {instant(t[moved[0] * size])} s on the output scatters by "
            f"{spread[moved[0]]:.2g} m/s² where {np.median(spread):.2g} m/s² is usual, in {len(moved)} of "
            f"{len(spread)} windows of {size * step:.3g} s. Use the longest part at rest: {cut} --only {part} "
            "-o rest_1.csv"
        )


def noise_of(channel: Channel, temperature: Channel | None) -> OutputNoise:
    """Noise of one output, with what temperature explains of it."""
    t, y = channel.t, np.asarray(channel.y, dtype=np.float64)
    rate = (len(t) - 1) / float(t[-1] - t[0])
    columns, warm_up, notes = np.empty((0, len(y))), None, list[str]()
    warmth = np.zeros(len(y)) if temperature is None else smooth(np.interp(t, temperature.t, temperature.y))
    centred = warmth - 0.5 * (np.min(warmth) + np.max(warmth))
    if warms := bool(np.any(centred)):  # all that may be seen of it, so that none of it is taken for noise
        decays = [np.exp((t[0] - t) / tau) for tau in (t[-1] - t[0]) / np.array([4.0, 16.0, 64.0])]
        columns = np.linalg.qr(np.transpose([centred, centred**2, centred**3, *decays]))[0].T
    used, likelihood = described(y, columns, rate, notes)
    optimum = likelihood.optimum()
    if warms:
        trend = over_temperature(y, t - t[0], centred, np.exp(optimum) @ likelihood.whole, used)
        columns = trend.columns(t - t[0], centred)
        likelihood = Likelihood.of(y, columns, rate, used)
        optimum = likelihood.optimum()
    slopes, covariance = likelihood.response(optimum)
    if warms:
        fitted = np.mean(y) + slopes @ (columns - columns.mean(axis=1, keepdims=True))
        parts = np.array_split(np.stack([warmth, y, fitted]), min(60, len(y)), axis=1)
        means = np.stack([part.mean(axis=1) for part in parts], axis=1)
        warm_up = WarmUp(float(slopes[0]), math.sqrt(float(covariance[0, 0])), trend, *means)
    tau, deviation = allan_deviation(y - slopes @ columns, rate)
    band, terms = 0.5 * rate * float(np.flatnonzero(used)[-1] + 1) / len(used), likelihood.terms(optimum)
    whole = (tau, deviation, deviation, deviation)  # the ends of the interval follow
    result = OutputNoise(channel.name, len(y) / rate, rate, band, terms, *whole, warm_up, tuple(notes))
    edf = np.choose(np.argmax(result.allan(tau), axis=0), degrees_of_freedom(len(y), np.rint(tau * rate)))
    low, high = (deviation * np.sqrt(edf / scipy.special.chdtri(edf, tail)) for tail in (0.025, 0.975))
    return replace(result, low=low, high=high)


def transform(rows: Array) -> Array:
    """Coefficients (..., n - 1) of the orthonormal cosine transform of rows (..., n), the mean left out."""
    return np.asarray(scipy.fft.dct(rows, norm="ortho")[..., 1:])


def smooth(y: Array) -> Array:
    """A slow signal without its noise: the coefficients of its cosine transform that stand clearly above it."""
    c = scipy.fft.dct(y, norm="ortho")
    noise = float(np.median(np.abs(c[len(c) // 2 :]))) / math.sqrt(MEDIAN)
    c[np.abs(c) <= 4.0 * noise] = 0.0
    return np.asarray(scipy.fft.idct(c, norm="ortho"))


def described(y: Array, columns: Array, rate: float, notes: list[str]) -> tuple[Flags, Likelihood]:
    """Coefficients (n - 1,) that three terms describe, and their likelihood: no lines, and none above the frequency
    from which the noise is not white. What is left out is added to the notes."""
    power, count, edges = transform(y) ** 2, len(y) - 1, bin_edges(len(y) - 1)
    level = np.repeat([np.median(part) / MEDIAN for part in np.split(power, edges[1:])], np.diff([*edges, count]))
    limit = SCATTER * float(scipy.special.chdtri(1.0, CHANCE / count))
    used = (power <= limit * level) | (np.arange(count) < SINGLE / (WIDTH - 1.0))
    if np.sum(power[~used]) > LINE * np.sum(power):
        peak = int(np.argmax(np.where(used, 0.0, power)))
        notes.append(
            f"lines of the spectrum are left out of the fit: {math.sqrt(float(np.sum(power[~used])) / len(y)):.2g} "
            f"m/s² rms in all, the largest at {0.5 * rate * (peak + 1) / len(y):.4g} Hz (hum, vibration); the Allan "
            "deviation contains them"
        )
    top = count
    while True:
        likelihood = Likelihood.of(y, columns, rate, used)
        octave, whole = likelihood.probabilities(likelihood.optimum())
        if octave > CHANCE or top < 4 * FEWEST:
            break
        top //= 2
        used[top:] = False
    if top < count:  # an octave below, where a first-order fall is a quarter of what shows
        top //= 2
        used[top:] = False
        likelihood = Likelihood.of(y, columns, rate, used)
        notes.append(
            f"above {0.5 * rate * top / count:.3g} Hz the noise is not white (a low-pass, vibration): the fit uses "
            "frequencies below"
        )
    if whole < CHANCE:
        notes.append(f"three terms do not describe the spectrum (p = {whole:.1g}): their intervals do not hold")
    return used, likelihood


def bin_edges(count: int) -> NDArray[np.intp]:
    """First coefficient of each bin."""
    high = np.geomspace(SINGLE, max(count, SINGLE), 1 + math.ceil(math.log(max(count / SINGLE, 1.0)) / math.log(WIDTH)))
    edges = np.unique(np.concatenate([np.arange(SINGLE), high.astype(np.intp)]))
    return edges[edges < count]


@dataclass(frozen=True, slots=True, eq=False)
class Likelihood:
    """Restricted likelihood of the three variances, from the products of coefficients in each bin."""

    variances: Array
    """Of a coefficient per unit of N², B² and K², mean of each bin, (3, bins)."""
    counts: Array
    """Coefficients in each bin, (bins,)."""
    gram: Array
    """Products of the columns and the output, the output last, (bins, m + 1, m + 1)."""
    whole: Array
    """As `variances`, of every coefficient, (3, n - 1)."""

    @classmethod
    def of(cls, y: Array, columns: Array, rate: float, used: Flags) -> Likelihood:
        """From an output (n,), columns (m, n) and which coefficients are used."""
        k = np.arange(1.0, len(y))
        sine = 2.0 * np.sin(0.5 * np.pi * k / len(y))
        flicker = len(y) / (np.pi * k) * (1.0 - 2.0 / (np.pi**2 * k))  # the last term: it is not quite diagonal
        whole = np.stack([np.full(len(k), 0.5 * rate), flicker, 1.0 / (rate * sine**2)])
        c = transform(np.vstack([columns, y])) * used
        edges = bin_edges(len(k))
        counts = np.add.reduceat(used.astype(np.float64), edges)
        rows = counts > 0.0
        variances = np.add.reduceat(whole * used, edges, axis=1)[:, rows] / counts[rows]
        gram = np.array([[np.add.reduceat(a * b, edges) for a in c] for b in c])[..., rows]  # no cube of coefficients
        return cls(variances, counts[rows], np.moveaxis(gram, 2, 0), whole)

    def response(self, x: Array) -> tuple[Array, Array]:
        """Coefficients of the columns, (m,), and their covariance, by the logarithms (3,) of the variances."""
        weighted = np.tensordot(1.0 / (np.exp(x) @ self.variances), self.gram, 1)
        covariance = np.linalg.pinv(weighted[:-1, :-1], hermitian=True)
        return np.asarray(covariance @ weighted[:-1, -1]), np.asarray(covariance)

    def residuals(self, x: Array) -> tuple[Array, Array]:
        """Sum of squares in each bin beyond the columns, (bins,), and what a unit of it costs their determinant."""
        slopes, covariance = self.response(x)
        c = np.append(-slopes, 1.0)
        return np.einsum("i,bij,j->b", c, self.gram, c), np.einsum("ij,bij->b", covariance, self.gram[:, :-1, :-1])

    def __call__(self, x: Array) -> tuple[float, Array]:
        """Negative logarithm and its gradient."""
        s = np.exp(x) @ self.variances
        squares, spent = self.residuals(x)
        weighted = np.tensordot(1.0 / s, self.gram[:, :-1, :-1], 1)
        value = 0.5 * float(np.sum(self.counts * np.log(s) + squares / s) + np.linalg.slogdet(weighted)[1])
        return value, 0.5 * np.exp(x) * (self.variances @ (self.counts / s - (squares + spent) / s**2))

    @property
    def start(self) -> Array:
        """Logarithms (3,) of variances that each explain one part of the spectrum alone."""
        power = self.gram[:, -1, -1] / self.counts
        parts = [power[-20:], power[16:SINGLE], power[:8]]
        unit = [self.variances[0, -20:], self.variances[1, 16:SINGLE], self.variances[2, :8]]
        return np.log([float(np.median(p / u)) for p, u in zip(parts, unit, strict=True)])

    def optimum(self, near: Array | None = None, **held: float) -> Array:
        """Logarithms (3,) of the most likely variances, of which some are held by their names."""
        start = self.start
        bounds = [(held.get(name, x - REACH), held.get(name, x + REACH)) for name, x in zip(TERMS, start, strict=True)]
        begin = np.clip(start if near is None else near, *np.transpose(bounds))
        options = {"maxiter": 500, "ftol": 1e-13, "gtol": 1e-7}
        return np.asarray(scipy.optimize.minimize(self, begin, jac=True, bounds=bounds, options=options).x)

    def terms(self, x: Array) -> tuple[NoiseTerm, ...]:
        """Each term with the interval within which its profile likelihood falls by no more than 1.92."""
        most = self(x)[0] + HALF_DEVIANCE
        terms = []
        for name, at, start in zip(TERMS, x, self.start, strict=True):

            def beyond(v: float, name: str = name) -> float:
                return self(self.optimum(x, **{name: v}))[0] - most

            least, base = start - REACH, max(at, start - 8.0)
            low = scipy.optimize.brentq(beyond, least, at, xtol=1e-3) if beyond(least) > 0.0 else -math.inf
            reach = next(r for r in (0.02 * 2.0**k for k in range(40)) if beyond(base + r) > 0.0)
            high = scipy.optimize.brentq(beyond, base, base + reach, xtol=1e-3) if beyond(base) < 0.0 else base
            value = 0.0 if at < least + 1.0 else math.exp(0.5 * at)
            terms.append(NoiseTerm(name, value, math.exp(0.5 * low), math.exp(0.5 * high)))
        return tuple(terms)

    def probabilities(self, x: Array) -> tuple[float, float]:
        """Of a power in the highest octave, and of one in all of them, as far from that of the three terms."""
        ratio = self.residuals(x)[0] / (np.exp(x) @ self.variances)
        octave = np.floor(np.log2(self.counts.sum() / np.cumsum(self.counts) + 1e-9))
        groups = [(ratio[octave == k].sum(), self.counts[octave == k].sum()) for k in np.unique(octave)]
        tails = [2.0 * min(scipy.special.chdtr(n, r), scipy.special.chdtrc(n, r)) for r, n in groups if n >= SINGLE]
        return (tails[0], min(1.0, len(tails) * min(tails))) if tails else (1.0, 1.0)


def over_temperature(y: Array, t: Array, warmth: Array, spectrum: Array, used: Flags) -> Trend:
    """The form with the largest likelihood less what its parameters cost, on means over time."""
    size = max(1, len(y) // SHORT)
    y, t, warmth = (x[: len(x) // size * size].reshape(-1, size).mean(axis=1) for x in (y, t, warmth))
    weight = np.sqrt(used[: len(y) - 1] / spectrum[: len(y) - 1] * size)
    target = transform(y) * weight

    def gain(trend: Trend) -> float:
        basis = np.linalg.qr((transform(trend.columns(t - t[0], warmth)) * weight).T)[0]
        return float(np.sum((target @ basis) ** 2)) - LAGGING * bool(trend.memory) - CURVED * (trend.order - 1)

    times = [float(tau) for tau in np.geomspace(8.0 * (t[1] - t[0]), 0.5 * (t[-1] - t[0]), 32)]
    memories = [("", 0.0), *((memory, tau) for memory in ("lag", "settling") for tau in times)]
    return max((Trend(order, *memory) for order in (1, 2, 3) for memory in memories), key=gain)


def allan_deviation(y: Array, rate: float) -> tuple[Array, Array]:
    """Averaging times, s, in octaves up to a third of the record, and the overlapping Allan deviation of y (n,)."""
    m = 2 ** np.arange(int(math.log2(len(y) // 3)) + 1)
    x = np.concatenate([[0.0], np.cumsum(y - np.mean(y))])
    variance = [np.mean((x[2 * k :] - 2.0 * x[k:-k] + x[: -2 * k]) ** 2) / (2.0 * k**2) for k in m]
    return m / rate, np.sqrt(variance)


def degrees_of_freedom(n: int, m: Array) -> Array:
    """Equivalent degrees of freedom (3, taus) of overlapping Allan variances of n samples, m to a mean, in white noise,
    flicker and a random walk of the output (Stein 1985; NIST SP 1065, table 5)."""
    phases = n + 1.0  # of which there is one more than samples
    white = (1.5 * n / m - 2.0 * (n - 1.0) / phases) * 4.0 * m**2 / (4.0 * m**2 + 5.0)
    single, several = 2.0 * (n - 1.0) ** 2 / (2.3 * phases - 4.9), 5.0 * phases**2 / (4.0 * m * (phases + 3.0 * m))
    drift = (n - 1.0) / m * (n**2 - 3.0 * m * n + 4.0 * m**2) / (n - 2.0) ** 2
    return np.stack([white, np.where(m > 1.0, several, single), drift])
