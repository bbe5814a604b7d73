"""Effects planted in a regime at matched-filter strength, wrong samples and jitter of a size that can be found.

d is the length of the contribution to z - double integral of u on the first 70 % of the record, whitened by the Kalman
filter of both channels' noise, without what the base columns (1, a, jerk, start state) explain.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.stats import norm

from tests.worlds.numerics import Array, stream
from tests.worlds.strength import whiten

from .motion import Motion, Piecewise
from .noise import stamps
from .regimes import Regime
from .rig import G0, UG, Planted, lowpass

FITTED = 0.7
"""Share of the record that is fitted."""
STRENGTH = 20.0
FULL_SCALE = 0.2
"""Largest share of the sensor's range that a contribution may have."""
HALF = 0.5
"""A nonlinearity that adds more than this share of the largest acceleration is no sensor any more."""
FINE = 1e-3
"""Pieces of a contribution, s; those of a motion are shorter wherever it is curved."""
JITTER = 10e-6
"""s"""
CERTAIN = 1e-3
"""A likelihood-ratio test that knows the truth misses this share."""


class OutOfReach(ValueError):
    """An effect that does not reach its strength in a regime, with the reason."""


Effect = Callable[[Motion, float, float], Piecewise]
"""(motion on fine pieces, magnitude, instant) -> what is added to the output, m/s^2."""


def _pointwise(motion: Motion, function: Callable[[Array], Array]) -> Piecewise:
    a = motion.a
    first, last = function(a.first), function(a.last)
    return Piecewise(a.knots, first, (last - first) / a.lengths)


def _quadratic(motion: Motion, m: float, instant: float) -> Piecewise:
    return _pointwise(motion, lambda f: m * f**2)


def _cubic(motion: Motion, m: float, instant: float) -> Piecewise:
    return _pointwise(motion, lambda f: m * f**3)


def _velocity(motion: Motion, m: float, instant: float) -> Piecewise:
    v = m * np.append(motion.v0, motion.velocity(motion.a.knots[-1:]))
    return Piecewise(motion.a.knots, v[:-1], np.diff(v) / motion.a.lengths)


def _bias_step(motion: Motion, m: float, instant: float) -> Piecewise:
    first = np.where(motion.a.knots[:-1] >= instant, m, 0.0)
    return Piecewise(motion.a.knots, first, np.zeros_like(first))


def _behind(motion: Motion, tau: float) -> Array:
    return motion.a.behind([complex(-1 / tau)])(motion.a.knots)


def _sensor_lag(motion: Motion, m: float, instant: float) -> Piecewise:
    """The element follows with a time constant m: what it does less than the force."""
    y = _behind(motion, m)
    first, last = y[:-1] - motion.a.first, y[1:] - motion.a.last
    return Piecewise(motion.a.knots, first, (last - first) / motion.a.lengths)


def _ac_coupling(motion: Motion, m: float, instant: float) -> Piecewise:
    """A high-pass of corner m in rad/s takes the slow part away; the converter's zero is behind it."""
    y = -_behind(motion, 1 / m)
    return Piecewise(motion.a.knots, y[:-1], np.diff(y) / motion.a.lengths)


EFFECTS: dict[str, tuple[Effect, float]] = {
    "cubic": (_cubic, 1e-3),
    "quadratic": (_quadratic, 1e-3),
    "bias_step": (_bias_step, 1e-3),
    "velocity": (_velocity, 1e-2),
    "sensor_lag": (_sensor_lag, 1e-4),
    "ac_coupling": (_ac_coupling, 1e-2),
}
"""Effects of the mean, with a magnitude to begin at."""
PLANTED = (*EFFECTS, "accelerometer_outliers", "timing_jitter")


def plant(regime: Regime, name: str, seed: int) -> Planted:
    """Return what hides an effect in the record `regime.build(seed)`.

    Raises
    ------
    OutOfReach
        If it does not reach its strength there.
    """
    if regime.rig.sensor.tilt:
        raise OutOfReach("the sensor turns, and nothing may be named")
    if name == "accelerometer_outliers":
        return Planted(wrong=20, wrong_size=wrong_size(regime))
    if name == "timing_jitter":
        gain = jitter_gain(regime, seed)
        if gain < 60.0:  # twice the expected log-likelihood ratio; threshold and scatter take half of it
            raise OutOfReach(f"jitter of 10 us gains {gain:.2g} only")
        return Planted(jitter=JITTER)
    magnitude, instant = at_strength(regime, name, seed)
    if name == "sensor_lag":
        return Planted(poles=(complex(-1 / magnitude),))
    effect = EFFECTS[name][0]
    return Planted(output=lambda motion: effect(motion.refined(FINE), magnitude, instant))


def at_strength(regime: Regime, name: str, seed: int) -> tuple[float, float]:
    """Return magnitude and instant with which an effect has d = STRENGTH within 2 %."""
    if regime.rig.reference.multipath is not None:
        raise OutOfReach("d is not defined here for position noise that is not white")
    if name == "sensor_lag" and regime.rig.sensor.corner_error:
        raise OutOfReach("the declared tolerance of the low-pass takes it up")
    motion = regime.motion(seed).refined(FINE)
    instant = regime.seconds * float(stream(seed, 9).uniform(0.2, 0.5))
    effect, magnitude = EFFECTS[name]
    limit = FULL_SCALE * regime.rig.sensor.range * G0
    for _ in range(12):
        added = effect(motion, magnitude, instant)
        d = strength(regime, motion, name, magnitude, instant)
        if not d > 1e-9:
            raise OutOfReach("leaves no trace on this motion")
        if abs(d - STRENGTH) < 0.02 * STRENGTH:
            reached = float(max(np.max(np.abs(added.first)), np.max(np.abs(added.last))))
            if reached > limit:
                raise OutOfReach(f"needs {reached / limit * FULL_SCALE:.0%} of full scale")
            if name in ("cubic", "quadratic") and reached > HALF * motion.largest():
                raise OutOfReach(f"needs {reached / motion.largest():.0%} of the largest acceleration")
            return magnitude, instant
        magnitude *= float(np.clip(STRENGTH / d, 0.05, 20.0)) if name == "sensor_lag" else STRENGTH / d
        if name == "sensor_lag" and magnitude > 0.1:
            break
    raise OutOfReach("does not reach d = 20")


def displacement_of(motion: Motion, name: str, magnitude: float, instant: float, t: Array) -> Array:
    """Return the double integral of what an effect adds, m; exact for a lag, whose transients are short."""
    if name == "sensor_lag":
        return motion.lagged_position(t, magnitude) - motion.position(t)
    return Motion.of(EFFECTS[name][0](motion, magnitude, instant)).position(t)


def strength(regime: Regime, motion: Motion, name: str, magnitude: float, instant: float = 0.0) -> float:
    """Return d of an effect; of "base", d of a scale factor, which the base explains."""
    reference, density = regime.rig.reference, regime.rig.sensor.density * UG
    t = np.arange(int(FITTED * regime.seconds * reference.rate)) / reference.rate
    added = magnitude * motion.position(t) if name == "base" else displacement_of(motion, name, magnitude, instant, t)
    columns = [t**2 / 2, motion.position(t), motion.velocity(t), added]
    if name == "sensor_lag":  # the base's own delay takes most of it up, and is then what is named
        del columns[2]
    white_share = 1 - regime.rig.clocks.missing_position[0]
    r = (reference.sigma**2 + (reference.resolution or 0.0) ** 2 / 12) / white_share
    white = whiten(np.column_stack(columns), density**2 / 2, r, 1 / reference.rate)
    basis, _ = np.linalg.qr(white[:, :-1] / (np.linalg.norm(white[:, :-1], axis=0) + 1e-300))
    rest = white[:, -1]
    for _ in range(2):
        rest = rest - basis @ (basis.T @ rest)
    return float(np.linalg.norm(rest))


def wrong_size(regime: Regime) -> float:
    """Return the size of a wrong sample that a likelihood-ratio test finds in 99.9 %, at a rate of 0.1 % a record."""
    n = regime.seconds * regime.rig.sensor.rate
    deviation = np.sqrt(1 / np.mean(1 / sample_density(regime)))
    return float((norm.isf(CERTAIN / n / 2) + norm.isf(CERTAIN)) * deviation)


def sample_density(regime: Regime) -> Array:
    """Return the power of the sampled noise at 64 frequencies, (m/s^2)^2; its mean is the variance of a sample."""
    sensor, cycles = regime.rig.sensor, (np.arange(64) + 0.5) / 128
    poles = lowpass(sensor)
    if not poles:
        return np.full(64, (sensor.density * UG) ** 2 * sensor.rate / 2)
    rate = float(np.real(poles[0]))  # the declared RC comes first; others lie far above
    keep = np.exp(rate / sensor.rate)
    variance = (sensor.density * UG) ** 2 * -rate / 4
    return np.asarray(variance * (1 - keep**2) / (1 + keep**2 - 2 * keep * np.cos(2 * np.pi * cycles)))


def jitter_gain(regime: Regime, seed: int) -> float:
    """Return sum (l - ln(1 + l)) over samples and frequencies, l = power of the jitter's error over the noise."""
    motion, sensor = regime.motion(seed), regime.rig.sensor
    t = stamps(sensor.rate, FITTED * regime.seconds, stream(seed, 9))
    motion_seen = motion.a.behind(lowpass(sensor))
    slope = (motion_seen(t + JITTER / 2) - motion_seen(t - JITTER / 2)) / JITTER
    power = (JITTER * slope[::16, None]) ** 2 / sample_density(regime)
    return float(np.mean(power - np.log1p(power)) * len(t))
