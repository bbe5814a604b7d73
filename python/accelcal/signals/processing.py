"""Signal processing on uniform samples: declared filters, zero-phase low-pass, derivative, integral, spectra.

A declared filter is applied by multiplication in the frequency domain with its complex response (Oppenheim and Schafer
2010, section 8.7), so that magnitude and phase are those of the filter itself, analog or digital, at any rate. What
came before the first sample is taken as that sample held; the samples are continued until the response has died away.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from accelcal import _core
from accelcal.data import DERIVED, Array, Channel, ChannelFilter, batches, median_step
from accelcal.signals.series import lagrange_weights

Section = tuple[float, float, float]
Pair = tuple[float, float]

ORDER = 8
"""Order of the zero-phase low-pass of motion: flat to 0.5 % at 0.7 of the corner."""
NEARLY_NYQUIST = 0.45
"""Share of a rate up to which frequencies are used: above it, a channel no longer resolves them."""
GRID_PER_CUTOFF = 32.0
"""Grid samples per period of the bandwidth; four-point interpolation then errs by less than 1e-4 there, and by less
than 1e-2 at the third harmonic, which a cubic makes."""


def low_pass(y: Array, rate: float, cutoff: float) -> Array:
    """Low-pass without phase (Butterworth, order 8, forwards and backwards).

    Parameters
    ----------
    y : (n,) samples at `rate`.
    rate, cutoff : Hz. A cutoff at or above 0.45 of the rate leaves `y` as it is.
    """
    if cutoff >= 0.45 * rate or len(y) < 8:
        return y
    padding = int(min(len(y) - 1, 3 * rate / cutoff))
    padded = np.concatenate([2.0 * y[0] - y[padding:0:-1], y, 2.0 * y[-1] - y[-2 : -padding - 2 : -1]])
    for _ in range(2):
        first = padded[0]
        settled = [(b, a, (s0 * first, s1 * first)) for b, a, (s0, s1) in low_pass_sections(rate, cutoff)]
        padded = _core.cascade(settled, padded)[::-1]
    return np.ascontiguousarray(padded[padding : padding + len(y)])


@lru_cache(maxsize=16)
def low_pass_sections(rate: float, cutoff: float) -> list[tuple[Section, Pair, Pair]]:
    """Sections (b, a without a[0] = 1) of second order, and their states for a constant of 1; every round needs them.

    Poles of Butterworth by the bilinear transform, the cutoff prewarped (Oppenheim and Schafer 2010, section 7.2), the
    nearest to the unit circle last. The order of the steps is that of SciPy.
    """
    warped = 4.0 * math.tan(math.pi * (2.0 * cutoff / rate) / 2.0)
    poles = warped * -np.exp(1j * math.pi * np.arange(1 - ORDER, ORDER, 2) / (2.0 * ORDER))
    gain = warped**ORDER * float((1.0 / np.prod(4.0 - poles)).real)
    sections, level = [], 1.0
    for q in sorted(((4.0 + poles) / (4.0 - poles))[: ORDER // 2], key=abs):
        b = (gain, 2.0 * gain, gain)
        a = (-2.0 * q.real, q.real**2 + q.imag**2)
        settled = np.linalg.solve([[1.0 + a[0], -1.0], [a[1], 1.0]], [b[1] - a[0] * b[0], b[2] - a[1] * b[0]])
        sections.append((b, a, (level * float(settled[0]), level * float(settled[1]))))
        level, gain = level * (sum(b) / (1.0 + a[0] + a[1])), 1.0
    return sections


def recursive_filter(
    b: Sequence[float], a: Sequence[float], x: Array, state: tuple[float, float] = (0.0, 0.0)
) -> Array:
    """Samples behind a recursive filter of at most second order, b(z)/a(z) with a[0] = 1, from a state on; (n,).

    The state is that of SciPy's `lfilter`, whose import alone would take as long as a fit.
    """
    (b0, b1, b2), (a1, a2) = section = (*b, 0.0, 0.0)[:3], (*a[1:], 0.0, 0.0)[:2]
    if x.dtype != object:
        return _core.cascade([(*section, state)], x)
    y = np.empty_like(x)  # symbols of an export: the same recursion, written out
    for i in range(len(x)):
        y[i] = b0 * x[i] + state[0]
        state = b1 * x[i] - a1 * y[i] + state[1], b2 * x[i] - a2 * y[i]
    return y


LONG_TRANSFORM = 1 << 20
"""Samples from which on the plan of a transform is not worth its memory."""


def forget_plans() -> None:
    """Free what transforms keep of the last lengths, sixteen each: of a long record as much as the record itself."""
    for n in range(2, 18):
        for transform in (scipy.fft.rfft, scipy.fft.dct, np.fft.rfft):
            transform(np.zeros(n))


def cosine_window(n: int, weights: Sequence[float] = (0.5, 0.5)) -> Array:
    """Periodic window of `n` samples, a sum of cosines; that of Hann (Harris 1978)."""
    at = np.linspace(-math.pi, math.pi, n + 1)[:-1]
    return np.asarray(sum(weight * np.cos(k * at) for k, weight in enumerate(weights)), dtype=np.float64)


def correlated(y: Array, response: Array) -> Array:
    """Sums of y(n + k) response(n) at lags k = 0, 1, ... of samples (n,), by transforms; (n,)."""
    size = scipy.fft.next_fast_len(len(y) + len(response), real=True)
    product = scipy.fft.rfft(y, size) * np.conj(scipy.fft.rfft(response, size))
    return np.asarray(scipy.fft.irfft(product, size)[: len(y)], dtype=np.float64)


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


ABOVE = 1.5
"""Density over that of the sensor's noise above which a frequency still belongs to the motion."""
AROUND = 0.1
"""Share of a frequency to either side over which that is judged."""
HIGHEST = 0.2
"""Largest bandwidth of motion that is accepted beyond what the encoder confirms, in sampling rates."""
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
    window = cosine_window(segment)
    segments = np.lib.stride_tricks.sliding_window_view(y, segment)[:: segment - segment // 2]
    spectra = scipy.fft.rfft((segments - segments.mean(axis=1, keepdims=True)) * window, axis=1)
    density = np.mean(spectra.real**2 + spectra.imag**2, axis=0) / (rate * float(window @ window))
    density[1 : len(density) - 1 + segment % 2] *= 2.0
    return np.asarray(density)


class Bandwidth(NamedTuple):
    """How far a motion goes in frequency."""

    cutoff: float
    """Above 99.99 % of its power, with a margin of 1.4, Hz."""
    reach: float
    """Where the last of it vanishes in the sensor's own noise, with the same margin, Hz."""


def motion_bandwidth(a: Array, rate: float, *, q: float, reading_density: float, crossover: float) -> Bandwidth:
    """Bandwidth that holds the motion and as little noise as possible, and how far its tail goes.

    Parameters
    ----------
    a : (n,) smoothed acceleration at `rate`, m/s².
    q : two-sided density of the process noise, (m/s²)²/Hz.
    reading_density : two-sided density of the encoder noise, m²/Hz.
    crossover : frequency at which both channels determine the acceleration equally well, Hz.

    Notes
    -----
    The noise that smoothing leaves has the density of the two channels in parallel. Power above it up to
    about twice the crossover is motion. Beyond, where the encoder cannot confirm it, power is motion as long as the
    spectrum goes on above the sensor's own noise without a break; what lies apart is vibration. Where nothing is
    confirmed the bandwidth is that of the crossover, and one period in the record at least: less is no band, and a
    crossover that tends to zero would leave none.
    """
    lowest = 0.65 * crossover
    segment = int(min(len(a), max(256, 2 ** int(np.ceil(np.log2(8.0 * rate / lowest))))))
    f, density = spectral_density(a, rate, segment)
    encoder = 2.0 * reading_density * (2.0 * np.pi * f) ** 4
    noise = 2.0 * q * encoder / (2.0 * q + encoder)
    above = np.where(density > 3.0 * noise, density, 0.0)
    above[:2] = 0.0
    confirmed = above / (1.0 + (f / (2.0 * crossover)) ** 8)
    if confirmed.sum() <= 0.0:
        edge = min(max(lowest, float(f[1])), HIGHEST * rate)
        return Bandwidth(edge, edge)
    with np.errstate(over="ignore"):
        ratio = density / np.maximum(noise, 1e-300)
    reach = continued(f, ratio, nearly_all(f, confirmed))
    edge = max(nearly_all(f, np.where(f <= reach, above, 0.0)), nearly_all(f, confirmed))
    return Bandwidth(*(min(1.4 * max(end, float(f[2])), HIGHEST * rate) for end in (edge, reach)))


def nearly_all(f: Array, power: Array) -> float:
    """Frequency below which 99.99 % of some power lies, Hz."""
    return float(f[int(np.argmax(1.0 - np.cumsum(power) / power.sum() < 1e-4))])


def continued(f: Array, ratio: Array, edge: float) -> float:
    """Frequency up to which a spectrum goes on above its noise without a break, from `edge` on, Hz.

    Parameters
    ----------
    f : (m,) evenly spaced frequencies, Hz.
    ratio : (m,) density over that of the noise.
    edge : where to begin, Hz.

    Notes
    -----
    A median over `AROUND` of the frequency to either side has to exceed `ABOVE`: neither a line nor a resonance of
    the sensor's mount that is separate from the motion continues it.
    """
    step = float(f[1])
    begin = int(np.ceil(edge / step))
    for k in range(begin, len(f)):
        half = max(2, int(AROUND * k))
        around = ratio[max(1, k - half) : k + half + 1]
        if k + half >= len(f) or float(np.median(around)) <= ABOVE:
            return float(f[k - 1]) if k > begin else edge
    return float(f[-1])


def even_times(begin: float, end: float, step: float) -> Array:
    """Times from `begin` to before `end`, s. numpy.arange takes the second less the first for the step, which stamps in
    seconds since 1970 leave 4 digits."""
    return np.asarray(begin + step * np.arange(math.ceil((end - begin) / step)))


def resample(channel: Channel, t: Array) -> Array:
    """Values of a side channel at times `t`, straight lines between its samples, held beyond its ends.

    What follows from an orientation is part of the model of the motion, and as smooth: straight lines would cut it
    short by (w h)²/12 at the angular frequency w, which the scale factor shows.
    """
    if channel.name in DERIVED:
        return cubic(channel.t, channel.y, t)
    return np.asarray(np.interp(t, channel.t, channel.y), dtype=np.float64)


CUBIC_STRETCH = 1 << 14
"""Times at which a cubic is worked out at once."""
EVEN = 1.5
"""Mean spacing of the four samples of a cubic over the usual one, from which on a straight line is safer."""


def cubic(t: Array, y: Array, at: Array) -> Array:
    """Values at times `at` (n,) of a series or of several (m, k), by the cubic through four samples, straight lines
    beside a gap and next to the ends, held beyond them."""
    rows = np.atleast_2d(y)
    if len(t) < 4:
        return np.array([np.interp(at, t, row) for row in rows]).reshape(*y.shape[:-1], len(at))
    values = np.empty((len(rows), len(at)))
    most = 3.0 * EVEN * median_step(t[:4096])
    for part in batches(len(at), CUBIC_STRETCH):
        times = at[part]
        first = np.searchsorted(t, times, side="right") - 2
        inside = np.flatnonzero((first >= 0) & (first < len(t) - 3))
        inside = inside[t[first[inside] + 3] - t[first[inside]] < most]
        if len(inside) < len(times):
            for value, row in zip(values, rows, strict=True):
                value[part] = np.interp(times, t, row)
        times, first = times[inside], first[inside]
        if len(first) and np.all(np.diff(first) == 1):  # nothing is gathered where both series go on alike
            four: list[slice | NDArray[np.intp]] = [slice(first[0] + k, first[-1] + 1 + k) for k in range(4)]
        else:
            four = [first + k for k in range(4)]
        weights = lagrange_weights([t[k] - times for k in four])
        values[:, part.start + inside] = sum(weight * rows[:, k] for weight, k in zip(weights, four, strict=True))
    return values.reshape(*y.shape[:-1], len(at))


Curve = Callable[[Array], Array]
"""Values at times, (n,)."""
SPLINE_STRETCH, SPLINE_MARGIN = 1 << 17, 32
"""Samples of a spline that are solved for at a time, and those on either side that no longer matter."""


def quintic(t: Array, y: Array, at: Array) -> Array:
    """Uniform samples (n,) at rising times `at` (m,) by a spline of degree 5; beyond either end it is continued.

    A line at frequency f on samples h apart has an image at 1/h - f, (f h)^6 of its size: of a cubic spline (f h)^4,
    which a periodic motion lifts above the noise of a line (Unser 1999, IEEE Signal Process. Mag. 16(6)).
    """

    def fitted(t: Array, y: Array) -> Curve:
        degree = min(5, len(t) - 1)
        curve: Curve = scipy.interpolate.make_interp_spline(t, y, k=degree - (1 - degree % 2))
        return curve

    return by_stretches(fitted, t, y, at)


def spline(t: Array, y: Array, at: Array) -> Array:
    """Samples (n,) at rising times `at` (m,) by a cubic spline; beyond either end it is continued."""
    return by_stretches(scipy.interpolate.CubicSpline, t, y, at)


def by_stretches(fitted: Callable[[Array, Array], Curve], t: Array, y: Array, at: Array) -> Array:
    """Values at rising times `at` (m,) of a spline through samples (n,), which is solved for stretch by stretch."""
    values = np.empty(len(at))
    for part in batches(len(t), SPLINE_STRETCH):
        rows = slice(max(0, part.start - SPLINE_MARGIN), min(len(t), part.stop + SPLINE_MARGIN))
        low = 0 if part.start == 0 else int(np.searchsorted(at, t[part.start]))
        high = len(at) if part.stop == len(t) else int(np.searchsorted(at, t[part.stop]))
        values[low:high] = fitted(t[rows], y[rows])(at[low:high])
    return values


Spectrum = NDArray[np.complex128]
Response = Callable[[Array], Spectrum]
"""Complex gain at frequencies (n,) in Hz."""

FORGOTTEN = 18.0
"""Time constants of the slowest pole after which a response has died away: exp(-18) = 1.5e-8."""
FREQUENCIES = 4096
"""Frequencies over which the noise bandwidth is summed."""


def response(filters: Sequence[ChannelFilter], rate: float) -> Response:
    """Complex gain of a chain of filters as a function of frequency.

    Parameters
    ----------
    filters : the chain; without any the gain is 1.
    rate : Hz, of the channel: digital filters without a rate of their own run at it.
    """

    def gain(f: Array) -> Spectrum:
        total = np.ones(np.shape(f), dtype=np.complex128)
        for stage in filters:
            total *= _response(stage, np.asarray(f, dtype=np.float64), rate)
        return total

    return gain


def _response(declared: ChannelFilter, f: Array, rate: float) -> Spectrum:
    if declared.kind == "sinc":
        return _averages(declared, f / (declared.rate or rate))
    if declared.digital:
        rate = declared.rate or rate
        z = np.asarray(np.exp(2j * np.pi * f / rate), dtype=np.complex128)
        if declared.cutoff is None:
            b, a = declared.b, declared.a or (1.0,)
            return np.asarray(np.polyval(b[::-1], 1.0 / z) / np.polyval(a[::-1], 1.0 / z))
        zeros, poles, factor = prototype(declared, rate)
        return _rational(z, zeros, poles, factor)
    zeros, poles, factor = prototype(declared)
    return _rational(np.asarray(2j * np.pi * f, dtype=np.complex128), zeros, poles, factor)


def _averages(declared: ChannelFilter, turns: Array) -> Spectrum:
    """`order` averages over `length` samples: (sin(pi f L T)/(L sin(pi f T)))^order, and its delay."""
    L = declared.length
    below = L * np.sin(np.pi * turns)
    whole = np.abs(below) < 1e-12
    average = np.where(whole, 1.0, np.sin(np.pi * L * turns) / np.where(whole, 1.0, below))
    return np.asarray((average * np.exp(-1j * np.pi * (L - 1) * turns)) ** declared.order)


def _rational(x: Spectrum, zeros: Spectrum, poles: Spectrum, factor: float) -> Spectrum:
    total = np.full(x.shape, factor, dtype=np.complex128)
    for zero in zeros:
        total *= x - zero
    for pole in poles:
        total /= x - pole
    return total


def prototype(declared: ChannelFilter, rate: float | None = None) -> tuple[Spectrum, Spectrum, float]:
    """Zeros, poles and factor of a filter with a corner: analog in rad/s, or digital at a rate in Hz.

    The corner lies at -3 dB: SciPy's Butterworth prototype, its Bessel prototype scaled in magnitude.
    """
    analog = rate is None
    corner = 2.0 * math.pi * (declared.cutoff or 0.0) if analog else declared.cutoff
    if declared.kind == "resonance":
        w0 = float(corner or 0.0)
        poles = np.roots([1.0, w0 / (declared.quality or 1.0), w0**2])
        return np.empty(0, dtype=np.complex128), np.asarray(poles, dtype=np.complex128), w0**2
    order = 1 if declared.kind == "RC" else declared.order
    how: dict[str, Any] = {"btype": declared.passes, "output": "zpk", "analog": analog, "fs": rate}
    if declared.kind == "bessel":
        z, p, k = scipy.signal.bessel(order, corner, norm="mag", **how)
    else:
        z, p, k = scipy.signal.butter(order, corner, **how)
    return np.asarray(z, dtype=np.complex128), np.asarray(p, dtype=np.complex128), float(np.real(k))


def memory(filters: Sequence[ChannelFilter], rate: float) -> float:
    """Time after which the responses of all filters have died away, s."""
    total = 0.0
    for stage in filters:
        step = 1.0 / (stage.rate or rate)
        if stage.kind == "sinc":
            total += stage.order * stage.length * step
        elif stage.kind == "fir":
            total += len(stage.b) * step
        elif stage.digital:
            poles = np.roots(stage.a) if stage.cutoff is None else prototype(stage, 1.0 / step)[1]
            slowest = float(np.max(np.abs(poles), initial=0.0))
            total += (len(stage.b) + 1) * step
            total += FORGOTTEN * step / -math.log(slowest) if slowest > 0.0 else 0.0
        else:
            total += FORGOTTEN / float(np.min(-np.real(prototype(stage)[1])))
    return total


def modes(filters: Sequence[ChannelFilter], rate: float) -> list[complex]:
    """Poles of the filters in 1/s: transients of the chain are sums of exp(pole t)."""
    modal: list[complex] = []
    for stage in filters:
        if not stage.digital:
            modal += [complex(p) for p in prototype(stage)[1]]
        elif stage.kind == "biquad" or stage.cutoff is not None:
            omega = stage.rate or rate
            poles = np.roots(stage.a) if stage.cutoff is None else prototype(stage, omega)[1]
            modal += [complex(np.log(complex(p)) * omega) for p in poles if abs(p) > 0.0]
    return modal


def applied(y: Array, step: float, gain: Response, settle: float, before: float | None = None) -> Array:
    """Uniform samples behind a complex gain, (n,).

    Parameters
    ----------
    y : (n,) samples `step` s apart.
    step : s.
    gain : the response.
    settle : s; the samples are continued by this much on both sides, so that neither end reaches the other.
    before : what was there before the first sample; by default the first sample itself.
    """
    n = len(y)
    pad = math.ceil(settle / step) + 2
    length = scipy.fft.next_fast_len(n + 2 * pad, real=True)
    extended = np.empty(length)
    first = float(y[0]) if before is None else before
    extended[:pad] = first
    extended[pad : pad + n] = y
    behind = length - pad - n
    fade = 0.5 + 0.5 * np.cos(np.pi * (np.arange(behind) + 1.0) / (behind + 1.0))
    extended[pad + n :] = first + (y[-1] - first) * fade
    spectrum = scipy.fft.rfft(extended)
    spectrum *= gain(np.fft.rfftfreq(length, step).astype(np.float64))
    return np.ascontiguousarray(scipy.fft.irfft(spectrum, length)[pad : pad + n])


def noise_bandwidth(gain: Response, rate: float) -> float:
    """Two-sided bandwidth of white noise behind a response, sampled at `rate`, Hz: the integral of |F|²."""
    f = np.asarray((np.arange(FREQUENCIES) + 0.5) * (0.5 * rate / FREQUENCIES), dtype=np.float64)
    return float(rate * np.mean(np.abs(gain(f)) ** 2))
