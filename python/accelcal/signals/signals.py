"""Smoothed motion and side channels on one uniform grid: the variables in which effects are written."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from accelcal._support.values import listing
from accelcal.data import GRAVITY, Array, Rig, batches


@dataclass(frozen=True, slots=True)
class Origins:
    """Zero points of time, position and side channels; they belong to the model, never to the record at hand."""

    t: float = 0.0
    """s"""
    p: float = 0.0
    """m"""
    temperature: float = 0.0
    """degC"""
    side: Mapping[str, float] = field(default_factory=dict, hash=False)
    """Mean of each other side channel over the fitted runs, in its unit; a channel without one is taken as recorded."""

    def of(self, channel: str) -> float:
        """Zero point of a side channel, in its unit."""
        return self.temperature if channel == "temperature" else self.side.get(channel, 0.0)


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
    reach: float = 0.0
    """Frequency above which no tail of the motion exceeds the sensor's noise, at least `cutoff`, Hz."""
    side: Mapping[str, Array] = field(default_factory=dict)
    """Side channels by name, in SI units, from the model's origin (temperature in K)."""
    side_origins: Mapping[str, float] = field(default_factory=dict)
    """What was subtracted from the side channels but for temperature: effects of the user's own get it back."""
    p_std: float = 0.0
    """Standard deviation of the noise left in `p`, m."""
    v_std: float = 0.0
    """Standard deviation of the noise left in `v`, m/s."""
    a_std: float = 0.0
    """Standard deviation of the noise left in `a`, m/s²."""
    bias: float = 0.0
    """K0 of the model at hand, m/s²."""
    coefficients: Mapping[str, float] = field(default_factory=dict)
    """Those of the model at hand, for effects that multiply each other."""
    slope: Array | float = 0.0
    """Derivative of the effects of the model at hand by the force at a sensor with a lever arm; 0 without one."""
    axis: str = ""
    """Which output of a sensor with several it is; empty where it has one."""
    whole: Signals | None = None
    """What this is a stretch of; spacing, length and widths are those of the whole."""
    a_corner: float | None = None
    """`a_width` where it is determined beforehand, m/s²."""
    v_corner: float | None = None
    """`v_width` where it is determined beforehand, m/s."""

    def part(self, rows: slice) -> Signals:
        """A stretch; effects without memory have the values on it that they have on the whole."""
        return replace(self.at(rows), whole=self.whole or self)

    def at(self, rows: NDArray[np.bool_] | NDArray[np.intp] | slice) -> Signals:
        """Some of the times only; no longer uniform."""
        return replace(
            self,
            t=self.t[rows],
            p=self.p[rows],
            v=self.v[rows],
            a=self.a[rows],
            jerk=self.jerk[rows],
            slope=self.slope if isinstance(self.slope, float) else self.slope[rows],
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
        copy = replace(self, t=t, p=p, v=v, a=a, jerk=jerk, side=side, slope=0.0)
        for rows in batches(len(t), RESAMPLED):
            self._write(copy.at(rows))
        return copy

    def _write(self, target: Signals) -> None:
        """Write the motion at other times into the arrays of `target`."""
        h = self.step
        u = np.clip((target.t - self.t[0]) / h, 0.0, len(self.t) - 1.0)
        k = np.minimum(u.astype(np.intp), max(0, len(self.t) - 2))
        f = u - k
        end = np.minimum(k + 1, len(self.t) - 1)

        def between(y: Array, slope: Callable[[NDArray[np.intp]], Array]) -> Array:
            rise = y[end] - y[k]
            bend = f * (1.0 - f)
            return np.asarray(
                y[k] + f * rise + bend * ((1.0 - f) * (h * slope(k) - rise) - f * (h * slope(end) - rise))
            )

        target.p[:] = between(self.p, lambda i: self.v[i])
        gravity = self.gravity
        level = (lambda i: gravity) if isinstance(gravity, float) else (lambda i: gravity[i])
        target.v[:] = between(self.v, lambda i: self.rig.polarity * self.a[i] - level(i))
        target.a[:] = between(self.a, lambda i: self.jerk[i])
        target.jerk[:] = self.jerk[k] + f * (self.jerk[end] - self.jerk[k])
        for name, y in self.side.items():
            target.side[name][:] = y[k] + f * (y[end] - y[k])

    @property
    def gravity(self) -> Array | float:
        """Specific force at rest along the axis, with the sign of the stage, m/s²: (n,) where it was recorded."""
        return self.side.get(GRAVITY, self.rig.gravity)

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
        return self.length / max(1, len((self.whole or self).t) - 1)

    @property
    def length(self) -> float:
        """Time from the first sample to the last, s."""
        t = (self.whole or self).t
        return float(t[-1] - t[0])

    @property
    def rest(self) -> float:
        """Specific force along the input axis at rest, m/s²."""
        return self.rig.polarity * self.rig.gravity

    @property
    def jerk_std(self) -> float:
        """Standard deviation of the noise left in `jerk`, m/s³: that of `a`, white up to the bandwidth."""
        return 2.0 * np.pi * self.cutoff * self.a_std / float(np.sqrt(3.0))

    @property
    def a_width(self) -> float:
        """Half-width over which corners at a = 0 are rounded, m/s²."""
        if self.a_corner is not None:
            return self.a_corner
        return corner(self.a, self.a_std) if self.whole is None else self.whole.a_width

    @property
    def v_width(self) -> float:
        """Half-width over which corners at v = 0 are rounded, m/s."""
        if self.v_corner is not None:
            return self.v_corner
        return corner(self.v, self.v_std) if self.whole is None else self.whole.v_width


RESAMPLED = 1 << 16
"""Times at which a function of the motion is worked out at once."""
CORNER_NOISE = 4.0
"""Corners are rounded over at least this many standard deviations, or noise would determine their shape."""
CORNER_SHARE = 0.002
"""And over at least this share of the largest value."""
TINY = 1e-12
"""Least width, so that a division by it is finite, SI."""


def corner(y: Array, std: float) -> float:
    """Half-width over which a corner at zero is rounded, in the unit of `y`."""
    width: float = np.maximum(np.maximum(CORNER_NOISE * std, CORNER_SHARE * np.max(np.abs(y))), TINY)
    return width


__dir__ = listing(globals())
