"""Building blocks of effects: low-pass, play operator, direction of travel, steps, spans of shapes, sizes of noise."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextvars import ContextVar

import numpy as np

from accelcal import _core
from accelcal.data import Array
from accelcal.effects.registry import HARMONICS, Shape
from accelcal.signals.processing import derivative, recursive_filter
from accelcal.signals.signals import CORNER_NOISE, TINY, Signals

EDGE = 0.03
"""Share of the record at either end in which no instant is searched for."""
SLACK = 1e-4
"""Share of the stroke after which a turn counts as a reversal, which noise at rest does not reach."""
MOVING, UNSURE = 5.0, 2.0
"""Standard deviations of the velocity beyond which the stage certainly moves, and beyond which it possibly does."""
HIGHEST_HARMONIC = {HARMONICS: Shape("1", (1.0, 1.0), trials=1)}
"""Shape parameter of a wave that a noise test finds; without a test the wave has one sine and one cosine."""
STILL = 2e-5
"""Least standard deviation of the velocity as a share of the top speed."""


_CARRIED: ContextVar[tuple[Iterator[float], list[float]] | None] = ContextVar("carried", default=None)


def carried_on(before: Sequence[float], evaluate: Callable[[], Array]) -> tuple[Array, list[float]]:
    """What an effect gives over the next step of a stream, and what its blocks with memory hold at the end of it.

    Parameters
    ----------
    before : what they held at the end of the step before, in the order of their calls; empty at the first sample.
    evaluate : the effect on the signals of this step alone.
    """
    after: list[float] = []
    token = _CARRIED.set((iter(before), after))
    try:
        return evaluate(), after
    finally:
        _CARRIED.reset(token)


def is_streamed() -> bool:
    """Whether signals are those of one step of a stream."""
    return _CARRIED.get() is not None


def resumed(start: float) -> float:
    """Where a block with memory begins: at `start`, on a stream with what it held at the end of the step before."""
    stream = _CARRIED.get()
    return start if stream is None else next(stream[0], start)


def held(x: Array) -> Array:
    """What a block with memory gives, (n,), whose last value it holds."""
    stream = _CARRIED.get()
    if stream is not None:
        stream[1].append(x[-1])
    return x


def lagged(y: Array, tau: float, step: float, start: float) -> Array:
    """First-order low-pass tau x' = y - x, exact for straight lines between samples.

    Parameters
    ----------
    y : (n,) uniform samples.
    tau, step : time constant and spacing, s.
    start : x at the first sample.
    """
    start = resumed(start)
    if step == 0.0:  # the first sample of a stream
        return held(np.full(len(y), start))
    decay, old, new = lag_weights(tau, step)
    return held(recursive_filter([new, old], [1.0, -decay], y, (start - new * y[0], 0.0)))


def lag_weights(tau: float, step: float) -> tuple[float, float, float]:
    """Weights of x, of y before and of y now in the low-pass one `step` on (both s); y is straight in between."""
    decay = float(np.exp(-step / tau))
    mean = -float(np.expm1(-step / tau)) * tau / step
    return decay, mean - decay, 1.0 - mean


def lagged_at(t: Array, y: Array, tau: float, start: float) -> Array:
    """First-order low-pass as in `lagged`, at times `t` of any spacing.

    Parameters
    ----------
    t, y : (n,) times, s, strictly rising, and samples.
    tau : time constant, s.
    start : x at the first sample.
    """
    return held(_core.lagged_at(np.ascontiguousarray(t), np.ascontiguousarray(y), tau, resumed(start)))


def play(x: Array, width: float, start: float) -> Array:
    """Output of the play operator of full `width` for the input `x`, (n,); its state is kept through rests."""
    before = resumed(start)
    if x.dtype != object:
        return held(_core.play(np.ascontiguousarray(x), width, before))
    y = np.empty_like(x)  # symbols of an export: the same, written out
    for i in range(len(x)):
        y[i] = before = np.minimum(np.maximum(before, x[i] - 0.5 * width), x[i] + 0.5 * width)
    return held(y)


def direction(s: Signals, width: float | None = None) -> Array:
    """+1 while the stage travels forwards, -1 backwards, kept through rests, straight across a reversal over a travel
    of `width` (by default as little as noise at rest allows), m; 0 before the first move."""
    width = slack(s) if width is None else width
    p = travelled(s, width)
    return (p - play(p, width, float(p[0]))) / (0.5 * width)


def slack(s: Signals) -> float:
    """Travel that noise at rest does not reach, m."""
    return 2.0 * max(CORNER_NOISE * s.p_std, SLACK * float(np.ptp((s.whole or s).p)), TINY)


def travelled(s: Signals, width: float) -> Array:
    """Position without its noise at rest, which would close and open a slack of `width`, (n,) m.

    Steps during motion, which the velocity shows, are kept from where it began; of the rest only what exceeds the
    noise and the slack: a reading that hangs in it does not say where the stage rests, and the smoothed position
    drifts there with the noise of the output.
    """
    speed = np.abs(s.v)
    noise = max(s.v_std, STILL * float(np.max(np.abs((s.whole or s).v))))
    way = np.where(speed > UNSURE * noise, np.sign(s.v), 0.0)
    begins = np.flatnonzero(np.diff(way, prepend=np.nan) != 0.0)
    moving = np.maximum.reduceat(speed, begins) > MOVING * noise
    steps = np.diff(s.p, prepend=s.p[0])
    sure = np.where(np.repeat(moving, np.diff(begins, append=len(way))), steps, 0.0)
    surely = held(resumed(0.0) + np.cumsum(sure))
    other = s.p - surely
    return surely + play(other, max(2.0 * CORNER_NOISE * s.p_std, width), float(other[0]))


def slacks(s: Signals) -> tuple[float, float]:
    """Bounds of a slack's width, from the noise of the position to 1 % of the stroke, m."""
    stroke = float(np.ptp(s.p))
    least = max(CORNER_NOISE * s.p_std, 2e-6 * stroke, TINY)
    return least, max(2.0 * least, 0.01 * stroke)


def distances(s: Signals) -> tuple[float, float]:
    """Distances from a few of what counts as a reversal to the stroke, m."""
    least = 4.0 * slack(s)
    return least, max(2.0 * least, float(np.ptp(s.p)))


def held_sign(heading: Array) -> Array:
    """Sign of a direction, changed only where its magnitude is at least 0.5, so that noise at rest reverses nothing."""
    sure = np.maximum.accumulate(np.where(np.abs(heading) >= 0.5, np.arange(len(heading)), -1))
    return held(np.where(sure >= 0, np.sign(heading[sure]), resumed(0.0)))


def since_reversal(s: Signals, heading: Array | None = None) -> Array:
    """Time since the last reversal of the stage, (n,) s; NaN before the first; from its `direction` where that is at
    hand."""
    way = held_sign(direction(s) if heading is None else heading)
    turned = np.flatnonzero(np.diff(way, prepend=resumed(float(way[0]))))
    held(way)
    last = np.full(len(s.t), -1, dtype=np.intp)
    last[turned] = turned
    last = np.maximum.accumulate(last)
    return s.t - held(np.where(last >= 0, s.t[last], resumed(np.nan)))


def since(s: Signals, instant: float) -> Array:
    """0 before `instant` and 1 after it, straight across one spacing so that the instant can be refined."""
    return np.clip((s.t - instant) / max(s.step, TINY) + 0.5, 0.0, 1.0)


def instants(s: Signals, carried: Callable[[Signals], Array] = lambda s: np.ones_like(s.t)) -> tuple[float, float]:
    """Times at which the coefficient of a column may change, s: away from the ends, and not at a rest before or behind
    which the column is noise of the residual alone."""
    power = np.cumsum(carried(s) ** 2)
    low, high = np.searchsorted(power, power[-1] * np.array([EDGE, 1.0 - EDGE]))
    begin, end = max(s.t[0] + EDGE * s.length, s.t[low]), min(s.t[-1] - EDGE * s.length, s.t[high])
    return float(min(begin, end)), float(end)


def slow(low: float, high: float) -> Callable[[Signals], tuple[float, float]]:
    """Time constants between two shares of the record's length, s."""
    return lambda s: (low * s.length, high * s.length)


def periods(s: Signals) -> tuple[float, float]:
    """Periods in position that the spacing of the times resolves at top speed, up to the stroke, m."""
    stroke = max(float(np.ptp(s.p)), TINY)
    travel = float(np.max(np.abs(s.v))) * s.step
    return min(max(4.0 * travel, 1e-6 * stroke), 0.5 * stroke), stroke


def one_turn(s: Signals, period: float) -> float:
    """Change of a period in position that adds one turn over the stroke, m."""
    return period**2 / max(float(np.ptp(s.p)), TINY)


def waves(s: Signals) -> tuple[float, float]:
    """Periods up to four strokes: of a longer wave the record shows a part, as a slope or a bow, m."""
    low, stroke = periods(s)
    return low, 4.0 * stroke


def snap(s: Signals) -> Array:
    """Second derivative of the specific force, m/s⁴."""
    return derivative(s.jerk, max(s.step, TINY))


def wave(x: Array, period: float, low: float, high: float) -> Array:
    """Sine and cosine over a variable, less their means over [low, high] where that is a range, (n, 2)."""
    angle = (2.0 * np.pi / period) * np.array([low, high])
    means = np.array([-np.diff(np.cos(angle)), np.diff(np.sin(angle))]).T / max(angle[1] - angle[0], TINY)
    turn = (2.0 * np.pi / period) * x
    return np.asarray(np.column_stack([np.sin(turn), np.cos(turn)]) - means)


def harmonics_of(angle: Array, harmonics: float) -> Array:
    """Sine and cosine of an angle (n,) and of its multiples up to `harmonics`, (n, 2 harmonics)."""
    turns = angle[:, None] * np.arange(1.0, harmonics + 1.0)
    return np.stack([np.sin(turns), np.cos(turns)], axis=2).reshape(len(angle), -1)


def stroke() -> dict[str, Shape]:
    """The range of positions, as shapes that the record sets; models of earlier versions may lack it."""
    return {
        "low": Shape("m", lambda s: (float(np.min(s.p)),) * 2, trials=1, added=True),
        "high": Shape("m", lambda s: (float(np.max(s.p)),) * 2, trials=1, added=True),
    }


def amplitude(estimate: float, parts: Mapping[str, float], signals: Sequence[Signals]) -> float:
    """The estimate itself, where that is an amplitude."""
    return estimate


def largest(estimate: float, parts: Mapping[str, float], signals: Sequence[Signals]) -> float:
    """The largest of the outliers."""
    return parts["largest"]


def half_a_step(estimate: float, parts: Mapping[str, float], signals: Sequence[Signals]) -> float | None:
    """Half the converter's step, by which rounding errs at most; None where no step was found."""
    return 0.5 * estimate if estimate > 0.0 else None


def jitter_at_top_jerk(estimate: float, parts: Mapping[str, float], signals: Sequence[Signals]) -> float:
    """Standard deviation of the time stamps, s, times the largest jerk of the output."""
    return estimate * max(s.scale * float(np.max(np.abs(s.jerk))) for s in signals)
