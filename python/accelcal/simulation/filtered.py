"""Samples of a channel behind any chain of declared filters, with white noise in front of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from accelcal.data.arrays import Array
from accelcal.data.channel_filter import ChannelFilter
from accelcal.signals.transfer import applied, memory, response

FINE = 4
"""Steps of the grid of an analog low-pass within one sample: what lies above its Nyquist frequency is not simulated."""


def filtered_samples(
    signal: Callable[[Array], Array],
    t: Array,
    rate: float,
    filters: Sequence[ChannelFilter],
    density: float = 0.0,
    rng: np.random.Generator | None = None,
) -> Array:
    """Samples (n,) of a signal and its noise behind a chain of filters.

    Analog low-passes act on a grid `FINE` times as fine as the samples, every other filter on the samples; the chain
    begins earlier by what it remembers.

    Parameters
    ----------
    signal : its value at instants (m,) s.
    t : (n,) s, at `rate`.
    rate : Hz, of the channel.
    filters : in the order of the signal; they commute.
    density : one-sided density of white noise in front of the filters, unit of the signal per sqrt(Hz).
    rng : where the noise comes from; None = there is none.
    """
    analog = [f for f in filters if f.passes == "lowpass" and not f.digital]
    others = [f for f in filters if f not in analog]
    lead = math.ceil(memory(filters, rate) * rate)
    fine = FINE if analog else 1
    step = 1.0 / (rate * fine)
    at = t[0] - lead / rate + step * np.arange((len(t) + lead) * fine)
    y = signal(at)
    if rng is not None:
        y = y + density * math.sqrt(0.5 / step) * rng.standard_normal(len(at))
    y = applied(y, step, response(analog, rate), memory(analog, rate))[::fine]
    return applied(y, 1.0 / rate, response(others, rate), memory(others, rate))[lead:]
