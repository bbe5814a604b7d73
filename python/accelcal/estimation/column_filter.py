"""Columns of one fitted run carried through its gains, whitened samples summed in groups, in bounded memory."""

from __future__ import annotations

import math
from collections.abc import Container, Iterator, Sequence
from functools import cached_property
from itertools import groupby, pairwise

import numpy as np

from accelcal import _core
from accelcal.data.arrays import Array
from accelcal.effects import is_local
from accelcal.estimation.proportional_columns import multiples
from accelcal.estimation.run_state import RunState
from accelcal.model import Term, evaluate
from accelcal.signals.signals import Signals

OVERSAMPLING = 6.0
"""Rate of the sums over the larger of crossover and bandwidth of the motion."""
MOST_SUMS = 1 << 24
"""Sums, all columns together, that are held at a time: 134 MB."""
MOST_READINGS = 1 << 18
"""Readings whose passage through the grid is worked out at a time."""
ABREAST = 8
"""Columns that pass the filter side by side."""


class ColumnFilter:
    """A fitted run that columns are carried through.

    Whitened samples are summed in groups over the square root of their number: white stays white, and below a fraction
    of the rate nothing is lost. Of a long run the sums are handed out stretch by stretch; effects with a memory are
    evaluated over the whole run all the same.
    """

    def __init__(self, one: RunState) -> None:
        assert one.signals is not None, "the fit has not been iterated"
        self.one = one
        self.signals: Signals = one.signals
        rate = 1.0 / one.run.reading_step
        self.group = max(1, int(rate / (OVERSAMPLING * max(self.signals.cutoff, one.run.crossover(one.noise)))))
        self.rows = int(np.sum(one.counts)) // self.group
        self._last: tuple[slice, _core.Bank] | None = None

    @property
    def whitened(self) -> Array:
        """Sums of the whitened innovations, (rows,)."""
        y = self.one.whitened[self.one.counts][: self.rows * self.group]
        return np.asarray(y.reshape(self.rows, self.group).sum(axis=1) / math.sqrt(self.group))

    @property
    def times(self) -> Array:
        """Time of the first reading of each sum, (rows,) s."""
        return self.one.run.t[self.one.counts][: self.rows * self.group : self.group]

    @cached_property
    def at_readings(self) -> Signals:
        """The motion at the times of the readings, where effects of the encoder are evaluated."""
        return self.signals.resampled(self.one.run.t - self.one.run.origins.t)

    def stretches(self, terms: Sequence[Term]) -> Iterator[tuple[slice, Array]]:
        """Sums of the whitened columns, stretch by stretch.

        Yields
        ------
        The rows of the stretch, and the sums (terms, rows of the stretch) in the order of the terms; those of the next
        stretch take their place.
        """
        state, copies = np.zeros((len(terms), 2)), multiples(terms, self.signals)
        factor = -self.one.run.rig.polarity / self.signals.scale
        begin, held = 0, np.empty(0)
        for readings in self._parts(len(terms)):
            bank = self._bank(readings)
            if held.size < len(terms) * bank.rows:
                held = np.empty(len(terms) * bank.rows)
            sums = held[: len(terms) * bank.rows].reshape(len(terms), bank.rows)
            for first, columns, port in self._columns(terms, readings, copies):
                here = slice(first, first + len(columns))
                if port == "output":
                    bank.carry_inputs(columns, factor, state[here], sums[here])
                else:
                    bank.carry_readings(columns, state[here], sums[here])
            for k, (source, times) in copies.items():
                np.multiply(sums[source], times, out=sums[k])
            yield slice(begin, begin + bank.rows), sums
            begin += bank.rows

    def whole(self, terms: Sequence[Term]) -> Array:
        """Sums of a few whitened columns over the whole run, (terms, rows)."""
        sums = np.empty((len(terms), self.rows))
        for rows, part in self.stretches(terms):
            sums[:, rows] = part
        return sums

    def _parts(self, columns: int) -> list[slice]:
        """Readings in stretches that each hold whole groups, few enough for their memory."""
        rows = max(1, min(MOST_SUMS // max(1, columns), MOST_READINGS // self.group))
        counted = np.flatnonzero(self.one.counts)
        begins = counted[rows * self.group : self.rows * self.group : rows * self.group]
        edges = [0, *(int(k) for k in begins), len(self.one.counts)]
        return [slice(a, b) for a, b in pairwise(edges)]

    def _grid(self, readings: slice) -> slice:
        """Grid times that shape the motion over a stretch of readings."""
        s, t = self.signals, self.one.run.t
        start = float(s.t[0]) + self.one.run.origins.t
        low = max(0, int((t[max(readings.start - 1, 0)] - start) / s.step) - 2)
        high = min(len(s.t), int((t[readings.stop - 1] - start) / s.step) + 4)
        return slice(max(0, min(low, high - 4)), high)

    def _bank(self, readings: slice) -> _core.Bank:
        """The gains and the geometry of a stretch; the last one is kept."""
        if self._last is None or self._last[0] != readings:
            one, s, grid = self.one, self.signals, self._grid(readings)
            self._last = None  # gone before the next is made
            bank = _core.Bank(
                one.track,
                one.run.t,
                one.drive.restart,
                one.counts,
                grid=(float(s.t[0]) + one.run.origins.t + grid.start * s.step, s.step, grid.stop - grid.start),
                from_=readings.start,
                to=readings.stop,
                group=self.group,
            )
            self._last = (readings, bank)
        return self._last[1]

    def _columns(
        self, terms: Sequence[Term], readings: slice, copies: Container[int]
    ) -> Iterator[tuple[int, list[Array], str]]:
        """Columns over a stretch, of one port at a time, without `copies`: index of the first, at most `ABREAST` of
        them, the port."""
        first = 0

        def kind(place: tuple[int, Term]) -> tuple[bool, str, bool]:
            k, term = place
            return k in copies, term.port, is_local(term.effect)

        for (copied, port, local), places in groupby(enumerate(terms), key=kind):
            run = [term for _, term in places]
            if copied:
                first += len(run)
                continue
            s, rows = (self.signals, self._grid(readings)) if port == "output" else (self.at_readings, readings)
            if local:
                s, rows = s.part(rows), slice(None)
            waiting: list[Array] = []
            for column in evaluate(run, s):
                waiting.append(np.ascontiguousarray(column) if local else column[rows].copy())  # the whole one goes
                if len(waiting) == ABREAST:
                    yield first, waiting, port
                    first, waiting = first + ABREAST, []
            if waiting:
                yield first, waiting, port
                first += len(waiting)
