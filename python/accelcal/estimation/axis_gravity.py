"""Specific force at rest along the axis of a run: one number, or a channel where the axis turns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from accelcal import _core
from accelcal.data.arrays import Array
from accelcal.data.recording import Channel
from accelcal.estimation.channel_filters import HOLE, ChannelFilters, uniform
from accelcal.signals.processing import low_pass, resample


@dataclass(frozen=True, eq=False)
class AxisGravity:
    """What an ideal sensor on the axis reads while the position does not accelerate, with the sign of the stage."""

    constant: float
    """Of the declared axis, m/s²; used where nothing is recorded."""
    channel: Channel | None
    """On the clock of the position, m/s²."""
    filters: ChannelFilters

    def at(self, t: Array) -> Array | float:
        """At times t, (n,) m/s²; a number where it is constant."""
        return self.constant if self.channel is None else resample(self.channel, t)

    def within(self, t: Array, step: float, cutoff: float) -> Array | float:
        """At uniform times `step` s apart, up to a bandwidth in Hz, (n,) m/s²."""
        if self.channel is None:
            return self.constant
        return low_pass(resample(self.channel, t), 1.0 / step, cutoff)

    def behind_high_passes(self, t: Array, step: float, cutoff: float) -> Array | float:
        """The same as the output shows it, behind its high-passes."""
        if self.channel is None:
            return self.constant * self.filters.at_rest
        return self.filters.behind_high_passes(np.asarray(self.within(t, step, cutoff)), step)

    def integrals(self, t: Array) -> tuple[Array, Array]:
        """Velocity (m/s) and, beyond it, position (m) gained over the interval that ends at each of the times, (n,)."""
        h = np.diff(t, prepend=t[0])
        if self.channel is None:
            level = self.constant * self.filters.at_rest
            return level * h, level * h**2 / 2.0
        known = self._covering(t)
        once, twice, covered = _core.drive(
            known.t - t[0], known.y, t - t[0], how="cubic", tau=0.0, delay=0.0, hole=HOLE * float(t[-1] - t[0])
        )
        once[~covered] = twice[~covered] = 0.0
        return once, twice

    def _covering(self, t: Array) -> Channel:
        """The channel behind the filters of both channels, held beyond its ends where the times reach farther."""
        assert self.channel is not None
        known, step = self.channel, float(np.median(np.diff(self.channel.t)))
        if self.filters.acts:
            at, y = uniform(known.t, known.y, step)
            known = Channel(known.name, at, self.filters.behind(y, step), known.unit)
        before = np.array([t[0] - 2.0 * step, t[0] - step]) if known.t[0] > t[0] else t[:0]
        after = np.array([t[-1] + step, t[-1] + 2.0 * step]) if known.t[-1] < t[-1] else t[:0]
        stamps = np.concatenate([before, known.t, after])
        return Channel(known.name, stamps, np.interp(stamps, known.t, known.y), known.unit)
