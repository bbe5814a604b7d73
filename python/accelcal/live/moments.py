"""What the states of a live view said over time: a bounded number of moments, however long it runs."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from accelcal.data.arrays import Array
from accelcal.live.monitor import Alarm
from accelcal.live.session import LiveEvent, LiveState
from accelcal.model import Estimate

MOST = 300
"""Moments that are kept; then every second one goes."""
MOST_ALARMS = 20
"""Alarms that are kept; blocks in a row are one."""


@dataclass(frozen=True, slots=True)
class Moment:
    """One state."""

    t: float
    """s"""
    values: tuple[float, ...]
    """Parameters, SI."""
    stds: tuple[float, ...]
    e: float
    """The newest innovation, m; NaN where there is none."""
    std: float
    """That the model expects, m."""
    nis: float
    low: float
    high: float
    """Interval of the running NIS."""


class LiveHistory:
    """Moments of a live view from its events, the newest among them.

    Parameters
    ----------
    most : moments that are kept; they stay evenly spread over the whole run.

    Examples
    --------
    >>> from accelcal.live.session import LiveEvent, LiveState
    >>> history = LiveHistory(most=4)
    >>> for t in range(100):
    ...     history.add(LiveEvent("state", "lines", LiveState(float(t))))
    >>> len(history.moments) <= 5, history.moments[0].t, history.moments[-1].t
    (True, 0.0, 99.0)
    """

    def __init__(self, most: int = MOST) -> None:
        self.most = most
        self.newest: LiveEvent | None = None
        """The newest state, or the end."""
        self.parameters: tuple[Estimate, ...] = ()
        self.alarms: deque[Alarm] = deque(maxlen=MOST_ALARMS)
        """The newest alarms; of blocks in a row the last, whose `since` tells the first."""
        self._kept: list[Moment] = []
        self._last: Moment | None = None
        self._stride, self._count = 1, 0

    def add(self, event: LiveEvent) -> None:
        """Take in a state, an alarm or the end."""
        if event.alarm is not None:
            self._alarm(event.alarm)
            return
        self.newest = event
        t = event.state.t
        if t is None or (self._last is not None and t <= self._last.t):
            return
        self.parameters = event.state.estimates
        self._last = _moment(t, event.state)
        if self._count % self._stride == 0:
            self._kept.append(self._last)
        self._count += 1
        if len(self._kept) > self.most:
            self._kept = self._kept[::2]
            self._stride *= 2

    @property
    def moments(self) -> list[Moment]:
        """The moments that are kept, in order of time, and the newest."""
        kept = list(self._kept)
        return kept if self._last is None or (kept and kept[-1] is self._last) else [*kept, self._last]

    def _alarm(self, alarm: Alarm) -> None:
        if self.alarms and self.alarms[-1].since == alarm.since:
            self.alarms.pop()
        self.alarms.append(alarm)


@dataclass(frozen=True, slots=True)
class Columns:
    """Moments as arrays, (n,) each, or (n, m) for m parameters."""

    t: Array
    values: Array
    stds: Array
    e: Array
    std: Array
    nis: Array
    low: Array
    high: Array

    @classmethod
    def of(cls, moments: list[Moment], parameters: int) -> Columns:
        """From moments of so many parameters."""
        shape = (len(moments), parameters)
        return cls(
            np.array([m.t for m in moments]),
            np.array([m.values for m in moments], dtype=float).reshape(shape),
            np.array([m.stds for m in moments], dtype=float).reshape(shape),
            *(np.array([getattr(m, name) for m in moments]) for name in ("e", "std", "nis", "low", "high")),
        )


def _moment(t: float, state: LiveState) -> Moment:
    innovation, nis = state.innovation, state.nis
    e, std = (math.nan, math.nan) if innovation is None else (innovation.e, math.sqrt(innovation.variance))
    value, low, high = (math.nan,) * 3 if nis is None else (nis.value, nis.low, nis.high)
    values, stds = tuple(e.value for e in state.estimates), tuple(e.std for e in state.estimates)
    return Moment(t, values, stds, e, std, value, low, high)
