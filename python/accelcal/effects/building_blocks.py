"""What effects with memory are made of: the low-pass, the play operator, the direction of travel, steps and spans."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy

from accelcal import _core
from accelcal.data.arrays import Array
from accelcal.signals.processing import derivative
from accelcal.signals.signals import CORNER_NOISE, TINY, Signals

EDGE = 0.03
"""Share of the record at either end in which no instant is sought."""
SLACK = 1e-4
"""Share of the stroke after which a turn counts as a reversal, so that noise at rest does not."""
MOVING, UNSURE = 5.0, 2.0
"""Standard deviations of the velocity beyond which the stage surely moves, and beyond which it may have begun to."""
STILL = 2e-5
"""Share of the top speed that such a deviation has at least."""


def lagged(y: Array, tau: float, step: float, start: float) -> Array:
    """First-order low-pass tau x' = y - x, exact for straight lines between samples.

    Parameters
    ----------
    y : (n,) uniform samples.
    tau, step : time constant and spacing, s.
    start : x at the first sample.
    """
    decay, old, new = lag_weights(tau, step)
    x, _ = scipy.signal.lfilter([new, old], [1.0, -decay], y, zi=[start - new * y[0]])
    return np.asarray(x, dtype=np.float64)


def lag_weights(tau: float, step: float) -> tuple[float, float, float]:
    """Weights of x, of y before and of y now in the low-pass one `step` on (both s); y is straight in between."""
    decay = float(np.exp(-step / tau))
    mean = -float(np.expm1(-step / tau)) * tau / step
    return decay, mean - decay, 1.0 - mean


def play(x: Array, width: float, start: float) -> Array:
    """What a slack of full `width` lets through of `x`, (n,); it keeps its memory through rests."""
    return _core.play(np.ascontiguousarray(x), width, start)


def direction(s: Signals, width: float | None = None) -> Array:
    """+1 while the stage travels forwards, -1 backwards, kept through rests, straight across a reversal over a travel
    of `width` (by default as little as noise at rest allows), m; 0 before the first move."""
    if width is None:
        width = 2.0 * max(CORNER_NOISE * s.p_std, SLACK * float(np.ptp(s.p)), TINY)
    p = travelled(s)
    return (p - play(p, width, float(p[0]))) / (0.5 * width)


def travelled(s: Signals) -> Array:
    """Position without the noise that it has at rest, which would close and open a slack, (n,) m.

    What the velocity shows to be motion counts from where it began; of all else, what is more than noise.
    """
    speed = np.abs(s.v)
    noise = max(s.v_std, STILL * float(np.max(speed)))
    way = np.where(speed > UNSURE * noise, np.sign(s.v), 0.0)
    begins = np.flatnonzero(np.diff(way, prepend=np.nan) != 0.0)
    moving = np.maximum.reduceat(speed, begins) > MOVING * noise
    steps = np.diff(s.p, prepend=s.p[0])
    surely = np.cumsum(np.where(np.repeat(moving, np.diff(begins, append=len(way))), steps, 0.0))
    other = s.p - surely
    return surely + play(other, 2.0 * CORNER_NOISE * s.p_std, float(other[0]))


def slacks(s: Signals) -> tuple[float, float]:
    """Travel within which a slack may close, from what the noise of the position allows to 1 % of the stroke, m."""
    stroke = float(np.ptp(s.p))
    least = max(CORNER_NOISE * s.p_std, 2e-6 * stroke, TINY)
    return least, max(2.0 * least, 0.01 * stroke)


def held_sign(heading: Array) -> Array:
    """Sign of a direction, changed only where it is at least half sure, so that noise at rest reverses nothing."""
    sure = np.maximum.accumulate(np.where(np.abs(heading) >= 0.5, np.arange(len(heading)), -1))
    return np.where(sure >= 0, np.sign(heading[sure]), 0.0)


def since_reversal(s: Signals) -> Array:
    """Time since the stage last turned round, (n,) s; NaN before it first did."""
    way = held_sign(direction(s))
    turned = np.flatnonzero(way[1:] != way[:-1]) + 1
    last = np.full(len(s.t), -1, dtype=np.intp)
    last[turned] = turned
    last = np.maximum.accumulate(last)
    return np.where(last >= 0, s.t - s.t[last], np.nan)


def since(s: Signals, instant: float) -> Array:
    """0 before `instant` and 1 after it, straight across one spacing so that the instant can be refined."""
    return np.clip((s.t - instant) / max(s.step, TINY) + 0.5, 0.0, 1.0)


def instants(s: Signals) -> tuple[float, float]:
    """Times at which something may change, away from the ends, s."""
    return float(s.t[0]) + EDGE * s.length, float(s.t[-1]) - EDGE * s.length


def slow(low: float, high: float) -> Callable[[Signals], tuple[float, float]]:
    """Time constants between two shares of the record's length, s."""

    def bounds(s: Signals) -> tuple[float, float]:
        return low * s.length, high * s.length

    return bounds


def periods(s: Signals) -> tuple[float, float]:
    """Periods in position that the spacing of the times resolves at top speed, up to the stroke, m."""
    stroke = max(float(np.ptp(s.p)), TINY)
    travel = float(np.max(np.abs(s.v))) * s.step
    return min(max(4.0 * travel, 1e-6 * stroke), 0.5 * stroke), stroke


def waves(s: Signals) -> tuple[float, float]:
    """The same up to four strokes: of a longer wave a part is seen, as a slope or a bow, m."""
    low, stroke = periods(s)
    return low, 4.0 * stroke


def snap(s: Signals) -> Array:
    """Second derivative of the specific force, m/s⁴."""
    return derivative(s.jerk, s.step)
