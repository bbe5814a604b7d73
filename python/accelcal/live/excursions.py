"""Samples of a stream that jump and return: damaged numbers, which count as lost before a filter takes them in."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from accelcal.data import Array, Flags
from accelcal.io.stream import Rows

AROUND = 4
"""Samples on either side that one is compared with: a ringing at a quarter of the rate, which passes through its start
at every second sample, has three peaks among them."""
RATIO = 8.0
"""An excursion is this many times as high as the second largest of the samples around it."""
USUAL = 12.0
"""The same over the usual bend; white noise has less than eight."""
MEMORY, STRIDE = 64, 16
"""Bends whose median is the usual one, and from how many to how many it is taken anew."""
LONGEST = 1.5
"""Time that the samples around may take, in usual steps: a sample between two holes is not judged."""
ROUNDING = 1e-12
"""What floating-point numbers bend, over their size."""


class Excursions:
    """Samples far off the curve through those around them, alone or beside one more that is not of the same pulse.

    Motion, ringing and noise have neighbours of their size; a step stays. A shock shorter than two samples has none,
    and its output is not the acceleration over a sample. How the stream is cut into blocks makes no difference.

    Examples
    --------
    >>> import numpy as np
    >>> u = np.sin(0.1 * np.arange(200.0))
    >>> u[100] += 5.0
    >>> excursions = Excursions()
    >>> rows = excursions.without(Rows(np.arange(200.0), u, np.full(200, np.nan)))
    >>> np.flatnonzero(np.isnan(rows.accel)).tolist(), len(rows), excursions.outputs
    ([100], 196, 1)
    """

    def __init__(self) -> None:
        self._output, self._position = _Channel("accel"), _Channel("position")

    @property
    def outputs(self) -> int:
        """Outputs that were left out."""
        return self._output.count

    @property
    def readings(self) -> int:
        """Readings of the position that were left out."""
        return self._position.count

    def without(self, rows: Rows) -> Rows:
        """Rows up to the newest that enough others follow, with lost samples in place of excursions."""
        return self._position.without(self._output.without(rows))

    def rest(self) -> Rows:
        """Rows that still wait at the end of a record."""
        return Rows.joined([self._position.without(self._output.rest()), self._position.rest()])


class _Channel:
    """Excursions of one channel."""

    def __init__(self, name: Literal["accel", "position"]) -> None:
        self.name = name
        self.count = 0
        self._rows: Rows | None = None
        """Rows that wait for the samples behind them."""
        self._t, self._y = np.empty(0), np.empty(0)
        """Samples before and among those rows."""
        self._before = 0
        """How many of them come before."""
        self._bends = np.empty(0)
        """The newest that are not zero."""
        self._taken = 0
        """How many there were, those that were dropped included."""
        self._usual = 0, math.inf
        """The usual bend, and how many there were before it."""

    def without(self, rows: Rows) -> Rows:
        """Rows up to the newest sample that enough others follow, without excursions."""
        rows = rows if self._rows is None else Rows.joined([self._rows, rows])
        y, before = getattr(rows, self.name), self._before
        at = np.flatnonzero(np.isfinite(y))
        self._t = np.concatenate([self._t[:before], rows.t[at]])
        self._y = np.concatenate([self._y[:before], y[at]])
        decided = max(0, len(at) - AROUND)
        lost = at[:decided][self._judged(before, before + decided)] if decided else at[:0]
        while decided < len(at) and self._alone(before + decided, float(rows.t[-1])):
            decided += 1
        until = int(at[decided]) if decided < len(at) else len(rows)
        ready, self._rows = _cut(rows, 0, until), _cut(rows, until, len(rows))
        self._before = min(AROUND, before + decided)
        kept = before + decided - self._before
        self._t, self._y = self._t[kept:], self._y[kept:]
        self.count += len(lost)
        if not len(lost):
            return ready
        y = y[:until].copy()
        y[lost] = np.nan
        return replace(ready, accel=y) if self.name == "accel" else replace(ready, position=y)

    def rest(self) -> Rows:
        """Rows that still wait."""
        rows, self._rows = self._rows, None
        return Rows(np.empty(0), np.empty(0), np.empty(0)) if rows is None else rows

    def _alone(self, i: int, now: float) -> bool:
        """Whether those behind a sample are so late that it will not be judged."""
        first = max(0, i - AROUND)
        before = float(self._t[i] - self._t[first])
        return i > first and (now - float(self._t[i])) * (i - first) > 2.0 * LONGEST * 2 * AROUND * before

    def _judged(self, begin: int, end: int) -> Flags:
        """Which of the samples from `begin` to `end` are excursions; their bends join those before."""
        lost = np.zeros(end - begin, dtype=np.bool_)
        first = max(begin, AROUND)
        if end <= first:
            return lost
        y = self._y
        # The fourth difference, in which a sample counts once: of it smooth motion has next to nothing.
        bend = np.abs(np.diff(y[first - 2 : end + 2], n=4)) / 6.0
        bend[bend < ROUNDING * (np.abs(y[first - 2 : end - 2]) + np.abs(y[first + 2 : end + 2]))] = 0.0
        # A bend of zero says nothing: a coarse channel repeats itself, and a jump by one count is not an excursion.
        bends = np.concatenate([self._bends, bend[bend > 0.0]])
        dropped = self._taken - len(self._bends)
        number = self._taken + np.cumsum(bend > 0.0) - (bend > 0.0)
        self._taken += int(np.sum(bend > 0.0))
        ends = np.arange(number[0] // STRIDE, number[-1] // STRIDE + 1) * STRIDE
        usual = np.array([self._median(int(stop), bends, dropped) for stop in ends])
        self._bends = bends[-(MEMORY + STRIDE) :]
        near = np.flatnonzero(bend > 0.5 * USUAL * usual[number // STRIDE - ends[0] // STRIDE])
        if len(near):
            least = USUAL * usual[number[near] // STRIDE - ends[0] // STRIDE]
            lost[first - begin + near] = self._lonely(first + near, least)
        return lost

    def _median(self, stop: int, bends: Array, dropped: int) -> float:
        """The usual bend of those before number `stop`; no bend is unusual while few are known."""
        if stop != self._usual[0]:
            newest = bends[max(0, stop - MEMORY - dropped) : stop - dropped]
            self._usual = stop, float(np.median(newest))
        return self._usual[1]

    def _lonely(self, at: NDArray[np.intp], least: Array) -> Flags:
        """Which of some samples are off the curve through those around them, by `least` and as no other is."""
        places = at[:, None] + np.arange(-AROUND, AROUND + 1)
        y, t = self._y[places], self._t[places]
        lonely = np.zeros(len(at), dtype=np.bool_)
        for degree in (1, 2):  # a line suits noise, which bends a parabola, and a parabola suits what is smooth
            off = _off(y, degree)
            height = off[:, AROUND]
            second = np.sort(np.abs(np.delete(off, AROUND, axis=1)), axis=1)[:, -2]
            beside = off[:, [AROUND - 1, AROUND + 1]] / np.where(height == 0.0, 1.0, height)[:, None]
            pulse = np.any(beside > 1.0 / RATIO, axis=1)
            lonely |= (np.abs(height) > np.maximum(least, RATIO * second)) & ~pulse
        even = t[:, -1] - t[:, 0] <= LONGEST * 2 * AROUND * np.median(np.diff(t, axis=1), axis=1)
        return np.asarray(lonely & even)


def _off(y: Array, degree: int) -> Array:
    """What samples (n, 2 AROUND + 1) are off a line or parabola whose coefficients two of them do not change much."""
    x = np.arange(-AROUND, AROUND + 1.0)
    if degree == 2:
        y = y - 0.5 * np.median(np.diff(y, n=2, axis=1), axis=1, keepdims=True) * x**2
    y = y - np.median(np.diff(y, axis=1), axis=1, keepdims=True) * x
    return np.asarray(y - np.median(y, axis=1, keepdims=True))


def _cut(rows: Rows, begin: int, end: int) -> Rows:
    part = slice(begin, end)
    return Rows(rows.t[part], rows.accel[part], rows.position[part], {k: y[part] for k, y in rows.side.items()})
