"""Declared filters as transfer functions: frequency response, noise bandwidth, application to uniform samples.

A filter is applied by multiplication in the frequency domain with its complex response (Oppenheim and Schafer 2010,
section 8.7), so that magnitude and phase are those of the filter itself, analog or digital, at any rate. What came
before the first sample is taken as that sample held; the samples are continued until the response has died away.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from accelcal.data import Array, ChannelFilter

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


def group_delay(filters: Sequence[ChannelFilter], rate: float) -> float:
    """Delay of slow motion behind the filters, s."""
    f = 1e-6 * rate
    return float(-np.angle(response(filters, rate)(np.array([f]))[0]) / (2.0 * math.pi * f)) if filters else 0.0


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
