"""Smoothed motion and side channels on one uniform grid: the words in which effects are written."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
import scipy
from numpy.typing import NDArray

from accelcal.recording import Array, Channel
from accelcal.rig import Rig


@dataclass(frozen=True, slots=True)
class Origins:
    """Zero points of time, position and temperature; they belong to the model, never to the record at hand."""

    t: float = 0.0
    """s"""
    p: float = 0.0
    """m"""
    temperature: float = 0.0
    """degC"""


@dataclass(frozen=True, slots=True)
class Signals:
    """What an effect may use: motion, rig and side channels at uniform times.

    Every array is (n,). Motion is smoothed, so that its errors do not follow the noise of the output.
    """

    t: Array
    """Time since the model's origin, s."""
    p: Array
    """Position from the model's origin, m."""
    v: Array
    """Velocity of the stage, m/s."""
    a: Array
    """Specific force along the sensor's input axis, m/s²: stage acceleration plus gravity, with the mount's sign."""
    jerk: Array
    """da/dt, m/s³."""
    scale: float
    """1 + k of the model at hand."""
    rig: Rig
    cutoff: float = 0.0
    """Bandwidth of the smoothed motion, Hz."""
    side: Mapping[str, Array] = field(default_factory=dict)
    """Side channels by name, in SI units (temperature from the model's origin, K)."""
    p_std: float = 0.0
    """Standard deviation of the noise left in `p`, m."""
    v_std: float = 0.0
    """Standard deviation of the noise left in `v`, m/s."""
    a_std: float = 0.0
    """Standard deviation of the noise left in `a`, m/s²."""
    bias: float = 0.0
    """K0 of the model at hand, m/s²."""
    whole: Signals | None = None
    """What this is a stretch of; spacing, length and widths are those of the whole."""

    def part(self, rows: slice) -> Signals:
        """A stretch, on which an effect without memory has the values that it has there on the whole."""
        return replace(self.at(rows), whole=self.whole or self)

    def at(self, rows: NDArray[np.bool_] | slice) -> Signals:
        """Some of the times only; no longer uniform."""
        return replace(
            self,
            t=self.t[rows],
            p=self.p[rows],
            v=self.v[rows],
            a=self.a[rows],
            jerk=self.jerk[rows],
            side={name: y[rows] for name, y in self.side.items()},
        )

    def resampled(self, t: Array) -> Signals:
        """The same motion at other times, such as those of the readings; no longer uniform.

        Cubic between samples, from value and derivative at both ends: what depends on position stays in step with it
        even where it changes faster than the spacing of the times.

        Parameters
        ----------
        t : (m,) s, rising, on the clock of `self.t`; before the first and after the last time the motion is held.
        """
        side = {name: np.empty_like(t) for name in self.side}
        p, v, a, jerk = (np.empty_like(t) for _ in range(4))
        made = replace(self, t=t, p=p, v=v, a=a, jerk=jerk, side=side)
        for begin in range(0, len(t), RESAMPLED):
            self._write(made.at(slice(begin, begin + RESAMPLED)))
        return made

    def _write(self, made: Signals) -> None:
        """Fill the motion of other times in, where they lie in memory."""
        h = self.step
        u = np.clip((made.t - self.t[0]) / h, 0.0, len(self.t) - 1.0)
        k = np.minimum(u.astype(np.intp), max(0, len(self.t) - 2))
        f = u - k
        end = np.minimum(k + 1, len(self.t) - 1)

        def between(y: Array, slope: Callable[[NDArray[np.intp]], Array]) -> Array:
            rise = y[end] - y[k]
            bend = f * (1.0 - f)
            return np.asarray(
                y[k] + f * rise + bend * ((1.0 - f) * (h * slope(k) - rise) - f * (h * slope(end) - rise))
            )

        made.p[:] = between(self.p, lambda i: self.v[i])
        made.v[:] = between(self.v, lambda i: self.rig.polarity * self.a[i] - self.rig.gravity)
        made.a[:] = between(self.a, lambda i: self.jerk[i])
        made.jerk[:] = self.jerk[k] + f * (self.jerk[end] - self.jerk[k])
        for name, y in self.side.items():
            made.side[name][:] = y[k] + f * (y[end] - y[k])

    @property
    def temperature(self) -> Array:
        """Temperature from the model's origin, K.

        Raises
        ------
        KeyError
            If none was recorded.
        """
        return self.side["temperature"]

    @property
    def step(self) -> float:
        """Spacing of the times, s."""
        if self.whole is not None:
            return self.whole.step
        return float(self.t[-1] - self.t[0]) / max(1, len(self.t) - 1)

    @property
    def length(self) -> float:
        """Time from the first sample to the last, s."""
        if self.whole is not None:
            return self.whole.length
        return float(self.t[-1] - self.t[0])

    @property
    def rest(self) -> float:
        """Specific force along the input axis while the stage stands still, m/s²."""
        return self.rig.polarity * self.rig.gravity

    @property
    def jerk_std(self) -> float:
        """Standard deviation of the noise left in `jerk`, m/s³: that of `a`, white up to the bandwidth."""
        return 2.0 * np.pi * self.cutoff * self.a_std / float(np.sqrt(3.0))

    @property
    def a_width(self) -> float:
        """Half-width over which corners at a = 0 are rounded, m/s²."""
        return corner(self.a, self.a_std) if self.whole is None else self.whole.a_width

    @property
    def v_width(self) -> float:
        """Half-width over which corners at v = 0 are rounded, m/s."""
        return corner(self.v, self.v_std) if self.whole is None else self.whole.v_width


RESAMPLED = 1 << 16
"""Times at which the motion is worked out at once."""
CORNER_NOISE = 4.0
"""Corners are rounded over at least this many standard deviations, or noise would write its own shape into them."""
CORNER_SHARE = 0.002
"""And over at least this share of the largest value."""
TINY = 1e-12
"""Stands for zero where a width divides, SI."""


def corner(y: Array, std: float) -> float:
    """Half-width over which a corner at zero is rounded, in the unit of `y`."""
    return max(CORNER_NOISE * std, CORNER_SHARE * float(np.max(np.abs(y))), TINY)


ORDER = 8
"""Order of the zero-phase low-pass of motion: flat to 0.5 % at 0.7 of the corner."""
GRID_PER_CUTOFF = 16.0
"""Grid samples per period of the bandwidth; four-point interpolation then errs by less than 1e-4."""


def low_pass(y: Array, rate: float, cutoff: float) -> Array:
    """Low-pass without phase (Butterworth, order 8, forwards and backwards).

    Parameters
    ----------
    y : (n,) samples at `rate`.
    rate, cutoff : Hz. A cutoff at or above 0.45 of the rate leaves `y` as it is.
    """
    if cutoff >= 0.45 * rate or len(y) < 8:
        return y
    sections = low_pass_sections(rate, cutoff)
    padding = int(min(len(y) - 1, 3 * rate / cutoff))
    return np.asarray(scipy.signal.sosfiltfilt(sections, y, padlen=padding), dtype=np.float64)


@lru_cache(maxsize=1)
def low_pass_sections(rate: float, cutoff: float) -> Array:
    """Second-order sections of that low-pass; a round of a fit asks for the same ones again."""
    return np.asarray(scipy.signal.butter(ORDER, cutoff, fs=rate, output="sos"), dtype=np.float64)


def derivative(y: Array, step: float) -> Array:
    """First derivative of uniform samples, fourth order inside, second order at the two ends."""
    if len(y) < 5:
        return np.asarray(np.gradient(y, step), dtype=np.float64)
    d = np.asarray(np.gradient(y, step), dtype=np.float64)
    d[2:-2] = (8.0 * (y[3:-1] - y[1:-3]) - (y[4:] - y[:-4])) / (12.0 * step)
    return d


def integral(y: Array, step: float) -> Array:
    """Running integral of uniform samples by the trapezoid rule, zero at the first."""
    total = np.empty_like(y)
    total[0] = 0.0
    np.cumsum((y[1:] + y[:-1]) * (0.5 * step), out=total[1:])
    return total


STRETCH = 1 << 19
"""Samples whose spectrum is taken at a time: all segments of an hour at once would need 400 MB."""


def spectral_density(y: Array, rate: float, segment: int) -> tuple[Array, Array]:
    """One-sided density by Welch's method, stretch by stretch: frequencies (m,) Hz and density (m,) y²/Hz.

    Parameters
    ----------
    y : (n,) samples at `rate`.
    segment : samples in a segment, at most n.
    """
    stretch = max(STRETCH, 8 * segment)
    edges = [*range(0, max(1, len(y) - stretch // 2), stretch), len(y)]
    total = np.zeros(segment // 2 + 1)
    for begin, end in pairwise(edges):
        total += mean_periodogram(y[begin:end], rate, segment) * ((end - begin) / len(y))
    return np.asarray(np.fft.rfftfreq(segment, 1.0 / rate), dtype=np.float64), total


def mean_periodogram(y: Array, rate: float, segment: int) -> Array:
    """Mean density of segments that overlap by half, behind a Hann window, their means taken off, (segment // 2 + 1,).

    All segments in one transform: SciPy's `welch` takes one after the other, at several times the cost.
    """
    window = np.asarray(scipy.signal.windows.hann(segment, sym=False))
    segments = np.lib.stride_tricks.sliding_window_view(y, segment)[:: segment - segment // 2]
    spectra = scipy.fft.rfft((segments - segments.mean(axis=1, keepdims=True)) * window, axis=1)
    density = np.mean(spectra.real**2 + spectra.imag**2, axis=0) / (rate * float(window @ window))
    density[1 : len(density) - 1 + segment % 2] *= 2.0
    return np.asarray(density)


def motion_bandwidth(a: Array, rate: float, *, q: float, reading_density: float, crossover: float) -> float:
    """Bandwidth that holds the motion and as little noise as possible, Hz.

    Parameters
    ----------
    a : (n,) smoothed acceleration at `rate`, m/s².
    q : two-sided density of the process noise, (m/s²)²/Hz.
    reading_density : two-sided density of the encoder noise, m²/Hz.
    crossover : frequency at which both channels know the acceleration equally well, Hz.

    Notes
    -----
    The noise that smoothing leaves has the density of the two channels in parallel. What stands above it, up to about
    twice the crossover, is motion; what lies higher is vibration that the encoder cannot confirm. The band ends above
    99.99 % of the motion, with a margin of 1.4.
    """
    lowest = 0.65 * crossover
    segment = int(min(len(a), max(256, 2 ** int(np.ceil(np.log2(8.0 * rate / lowest))))))
    f, density = spectral_density(a, rate, segment)
    encoder = 2.0 * reading_density * (2.0 * np.pi * f) ** 4
    noise = 2.0 * q * encoder / (2.0 * q + encoder)
    weight = 1.0 / (1.0 + (f / (2.0 * crossover)) ** 8)
    motion = np.where(density > 3.0 * noise, density, 0.0) * weight
    motion[:2] = 0.0
    total = motion.sum()
    if total <= 0.0:
        return float(lowest)
    above = 1.0 - np.cumsum(motion) / total
    edge = f[int(np.argmax(above < 1e-4))]
    return float(min(max(lowest, 1.4 * edge), 0.4 * rate))


def resample(channel: Channel, t: Array) -> Array:
    """Values of a side channel at times `t`, straight lines between its samples, held beyond its ends."""
    return np.asarray(np.interp(t, channel.t, channel.y), dtype=np.float64)
