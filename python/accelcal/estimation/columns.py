"""Whitened columns: the response of the predicted readings to one unit of each coefficient, through the gains."""

from __future__ import annotations

import math
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from functools import cached_property, partial
from itertools import groupby, pairwise

import numpy as np

from accelcal import _core
from accelcal.data import LEVERS, Array, Places, batches
from accelcal.effects import Effect, is_local
from accelcal.estimation.run import PreparedRun
from accelcal.estimation.run_state import RunState
from accelcal.model import Term, evaluate
from accelcal.signals.processing import recursive_filter
from accelcal.signals.signals import Signals

CHUNK = 4096
"""Readings whose columns are held in memory at a time, at the full rate."""
OVERSAMPLING = 6.0
"""Rate of the sums over the larger of crossover and bandwidth of the motion."""
MOST_SUMS = 10_000_000
"""Sums, all columns together, that are held at a time: 80 MB."""
HELD = 4
"""Sums for each reading of a run, of effects with memory, that are held at a time: these effects are evaluated over the
whole run, and so a few times, whatever its length."""
MOST_READINGS = 1 << 18
"""Readings whose geometry on the grid is held at a time, where sums are taken over groups."""
PARALLEL = 8
"""Columns that pass the filter at a time."""
TIMES = 256
"""Times at which two columns are compared."""

Carry = Callable[[Array, Array], None]
"""Filters the columns of a stretch: response before and after it, (columns, 2), and their sums, (columns, rows)."""


def whitened_columns(state: RunState, terms: Sequence[Term]) -> Iterator[tuple[slice, Array]]:
    """Whitened columns of terms at the full rate, stretch by stretch.

    Yields
    ------
    The readings of the stretch, and the columns of those among them that count, (counted readings, terms).
    """
    columns = evaluated(state, terms)
    response = np.zeros((len(terms), 2))
    for readings in batches(len(state.run.t), CHUNK):
        grid = grid_rows(state, readings)
        bank = bank_of(state, readings, grid_times(state, grid))
        sums = np.empty((len(terms), bank.rows))
        for port, places in groupby(range(len(terms)), key=lambda k: terms[k].port):
            of_port = list(places)
            here, rows = slice(of_port[0], of_port[-1] + 1), grid if port == "output" else readings
            parts = [np.ascontiguousarray(columns[k][rows]) for k in of_port]
            carry(state, bank, port, parts, response[here], sums[here])
        yield readings, np.ascontiguousarray(sums.T)


def carry(state: RunState, bank: _core.Bank, port: str, columns: list[Array], response: Array, sums: Array) -> None:
    """Filter columns of one port through the gains of a stretch."""
    if port == "output":
        bank.carry_inputs(columns, -state.run.rig.polarity / state.signals.scale, response, sums)
    else:
        bank.carry_readings(columns, response, sums)


def remembers(run: PreparedRun, effect: Effect) -> bool:
    """Whether a column of an effect depends on the run before a stretch, by the effect itself or declared filters."""
    return run.filters.acts or not is_local(effect)


def whitened_accelerations(state: RunState, columns: Sequence[Array], step: float) -> Array:
    """Whitened responses to accelerations, (counted readings, columns).

    Parameters
    ----------
    state : the run.
    columns : accelerations from the first reading on, (rows,) each.
    step : their spacing, s.
    """
    grid, inputs = (float(state.run.t[0]), step, len(columns[0])), list(columns)
    banks = (bank_of(state, readings, grid) for readings in batches(len(state.run.t), CHUNK))
    return joined(state, len(inputs), ((bank, partial(bank.carry_inputs, inputs, 1.0)) for bank in banks))


def whitened_reading_errors(state: RunState, columns: Sequence[Array]) -> Array:
    """Whitened responses to errors of the readings, (n,) each, as (counted readings, columns)."""

    def carried(readings: slice) -> tuple[_core.Bank, Carry]:
        bank = bank_of(state, readings, grid_times(state, grid_rows(state, readings)))
        return bank, partial(bank.carry_readings, [column[readings] for column in columns])

    return joined(state, len(columns), map(carried, batches(len(state.run.t), CHUNK)))


def joined(state: RunState, width: int, stretches: Iterable[tuple[_core.Bank, Carry]]) -> Array:
    """Whitened columns of successive stretches as one array, (counted readings, width); the response is carried on."""
    whitened, response = np.empty((int(np.sum(state.counts)), width)), np.zeros((width, 2))
    begin = 0
    for bank, carry in stretches:
        sums = np.empty((width, bank.rows))
        carry(response, sums)
        whitened[begin : begin + bank.rows] = sums.T
        begin += bank.rows
    return whitened


def evaluated(state: RunState, terms: Sequence[Term]) -> list[Array]:
    """Columns of terms over the whole run: of the output on the grid of the signals, of the encoder at the readings."""
    inputs = [k for k, term in enumerate(terms) if term.port == "output"]
    direct = [k for k, term in enumerate(terms) if term.port != "output"]
    signals, run = state.signals, state.run
    filters = run.filters
    columns = {
        k: filters.behind(column, signals.step)
        for k, column in zip(inputs, responses([terms[k] for k in inputs], signals), strict=True)
    }
    at_readings = signals.resampled(run.t - run.origins.t) if direct else signals
    columns |= {
        k: filters.behind_at(run.t, column)
        for k, column in zip(direct, evaluate([terms[k] for k in direct], at_readings), strict=True)
    }
    return [columns[k] for k in range(len(terms))]


def responses(terms: Sequence[Term], s: Signals) -> Iterator[Array]:
    """Derivatives of the output, or of the reading, by the coefficients of terms in turn, (n,) each.

    A lever arm changes the force at the sensor, and so what the effects of that force are.
    """
    for term, column in zip(terms, evaluate(terms, s), strict=True):
        yield column * (1.0 + s.slope / s.scale) if term.effect.needs == LEVERS else column


def grid_rows(state: RunState, readings: slice) -> slice:
    """Rows of the signals that shape the motion over a stretch: two on either side of the cells that it touches."""
    s, t = state.signals, state.run.t
    start = float(s.t[0]) + state.run.origins.t
    low = max(0, int((t[max(readings.start - 1, 0)] - start) / s.step) - 2)
    high = min(len(s.t), int((t[readings.stop - 1] - start) / s.step) + 4)
    return slice(max(0, min(low, high - 4)), high)


def grid_times(state: RunState, rows: slice) -> tuple[float, float, int]:
    """First time on the clock of the readings, spacing and number of some rows of the signals."""
    s = state.signals
    return float(s.t[0]) + state.run.origins.t + rows.start * s.step, s.step, rows.stop - rows.start


def bank_of(state: RunState, readings: slice, grid: tuple[float, float, int], group: int = 1) -> _core.Bank:
    """Gains of a stretch of readings, and their geometry on a grid, ready to filter columns."""
    part = state.filter_over(readings)
    return _core.Bank(
        part.track,
        part.drive.t,
        state.drive.restart[part.over],
        state.counts[part.over],
        grid=grid,
        from_=readings.start - part.over.start,
        to=readings.stop - part.over.start,
        group=group,
    )


class ColumnFilter:
    """Many columns of one run, their whitened samples summed in groups, in bounded memory.

    Sums are divided by the square root of their number: white stays white, and below a fraction of the rate nothing is
    lost. The sums of a long run are yielded stretch by stretch; effects with memory are evaluated over the whole run,
    once for many stretches.
    """

    def __init__(self, state: RunState) -> None:
        self.state = state
        self.signals: Signals = state.signals
        rate, speed = 1.0 / state.run.reading_step, float(np.max(np.abs(self.signals.v)))
        highest = max(self.signals.cutoff, state.run.crossover(state.noise), state.values.fastest(speed))
        self.group = max(1, int(rate / (OVERSAMPLING * highest)))
        self.rows = int(np.sum(state.counts)) // self.group
        self._last: tuple[slice, _core.Bank] | None = None

    @property
    def rate(self) -> float:
        """Of the sums, Hz."""
        return 1.0 / (self.state.run.reading_step * self.group)

    @property
    def whitened(self) -> Array:
        """Sums of the whitened innovations, (rows,)."""
        y = self.state.whitened[self.state.counts][: self.rows * self.group]
        return np.asarray(y.reshape(self.rows, self.group).sum(axis=1) / math.sqrt(self.group))

    @property
    def times(self) -> Array:
        """Time of the first reading of each sum, (rows,) s."""
        return self.state.run.t[self.state.counts][: self.rows * self.group : self.group]

    @cached_property
    def at_readings(self) -> Signals:
        """The motion at the times of the readings, where effects of the encoder are evaluated."""
        return self.signals.resampled(self.state.run.t - self.state.run.origins.t)

    def stretches(self, terms: Sequence[Term]) -> Iterator[tuple[slice, Array]]:
        """Sums of the whitened columns, stretch by stretch.

        Yields
        ------
        The rows of the stretch, and the sums (terms, rows of the stretch) in the order of the terms; those of the next
        stretch overwrite them.
        """
        parts, run = self._stretches(len(terms)), self.state.run
        held = [k for k, term in enumerate(terms) if remembers(run, term.effect)] if len(parts) > 1 else []
        held.sort(key=lambda k: terms[k].port)
        together = max(1, HELD * len(parts) * len(run.t) // max(1, len(held) * self.rows))
        begin, buffer = 0, np.empty(0)
        response, response_held = np.zeros((len(terms), 2)), np.zeros((len(held), 2))
        for number, readings in enumerate(parts):
            if held and number % together == 0:
                first, remembered = begin, np.empty(0)  # frees the last ones first
                remembered = self._held([terms[k] for k in held], parts[number : number + together], response_held)
            bank = self._bank(readings)
            if buffer.size < len(terms) * bank.rows:
                buffer = np.empty(len(terms) * bank.rows)
            sums = buffer[: len(terms) * bank.rows].reshape(len(terms), bank.rows)
            grid = grid_rows(self.state, readings)
            for here, port, columns in self._columns(terms, grid, readings, held):
                carry(self.state, bank, port, columns, response[here], sums[here])
            if held:
                sums[held] = remembered[:, begin - first : begin - first + bank.rows]
            yield slice(begin, begin + bank.rows), sums
            begin += bank.rows

    def _held(self, terms: Sequence[Term], parts: Sequence[slice], response: Array) -> Array:
        """Sums of effects with memory over successive stretches, (terms, rows), each evaluated over the run once."""
        together = slice(parts[0].start, parts[-1].stop)
        grid = grid_rows(self.state, together)
        sums = np.empty((len(terms), int(np.count_nonzero(self.state.counts[together])) // self.group))
        for here, port, columns in self._columns(terms, grid, together, ()):
            begin = 0
            for readings in parts:
                bank, output = self._bank(readings), port == "output"
                near, first = (grid_rows(self.state, readings), grid.start) if output else (readings, together.start)
                cut = [np.ascontiguousarray(column[near.start - first : near.stop - first]) for column in columns]
                part = np.empty((len(columns), bank.rows))
                carry(self.state, bank, port, cut, response[here], part)
                sums[here, begin : begin + bank.rows] = part
                begin += bank.rows
        return sums

    def _columns(
        self, terms: Sequence[Term], grid: slice, readings: slice, held: Container[int]
    ) -> Iterator[tuple[slice, str, list[Array]]]:
        """Columns over a stretch, as `column_parts` yields them."""
        return column_parts(self.state.run, self.signals, terms, grid, readings, lambda: self.at_readings, held)

    def _stretches(self, columns: int) -> list[slice]:
        """Readings in stretches that each hold whole groups, few enough for their memory."""
        rows = max(1, min(MOST_SUMS // max(1, columns), MOST_READINGS // self.group))
        counted = np.flatnonzero(self.state.counts)
        begins = counted[rows * self.group : self.rows * self.group : rows * self.group]
        edges = [0, *(int(k) for k in begins), len(self.state.counts)]
        return [slice(a, b) for a, b in pairwise(edges)]

    def _bank(self, readings: slice) -> _core.Bank:
        """Gains and geometry of a stretch; the last one is kept."""
        if self._last is None or self._last[0] != readings:
            self._last = None  # its memory serves the next
            grid = grid_times(self.state, grid_rows(self.state, readings))
            self._last = readings, bank_of(self.state, readings, grid, self.group)
        return self._last[1]


def column_parts(
    run: PreparedRun,
    signals: Signals,
    terms: Sequence[Term],
    grid: slice,
    readings: slice,
    at_readings: Callable[[], Signals],
    held: Container[int],
) -> Iterator[tuple[slice, str, list[Array]]]:
    """Columns over a stretch, of one port at a time, without those `held`, at most `PARALLEL` of them together.

    Parameters
    ----------
    grid, readings : rows of the signals, and readings, of the stretch.
    at_readings : the motion at the times of all readings.

    Yields
    ------
    Places among the terms, the port, and the columns on the grid or at the readings.
    """
    first, filters = 0, run.filters

    def kind(place: tuple[int, Term]) -> tuple[bool, str, bool]:
        k, term = place
        return k in held, term.port, not remembers(run, term.effect)

    for (elsewhere, port, local), places in groupby(enumerate(terms), key=kind):
        alike = [term for _, term in places]
        if elsewhere:
            first += len(alike)
            continue
        s, rows = (signals, grid) if port == "output" else (at_readings(), readings)
        if local:
            s, rows = s.part(rows), slice(None)
        waiting: list[Array] = []
        for column in responses(alike, s):
            if filters.acts:
                output = port == "output"
                at = s.t + run.origins.t
                column = filters.behind(column, s.step) if output else filters.behind_at(at, column)
            waiting.append(np.ascontiguousarray(column) if local else column[rows].copy())  # frees the whole one
            if len(waiting) == PARALLEL:
                yield slice(first, first + PARALLEL), port, waiting
                first, waiting = first + PARALLEL, []
        if waiting:
            yield slice(first, first + len(waiting)), port, waiting
            first += len(waiting)


def distinct(terms: Sequence[Term], s: Signals) -> tuple[list[Term], Places, Array]:
    """Distinct columns of terms: some are multiples of another column, which is filtered once, whatever its sizes.

    Returns
    -------
    The terms with distinct columns; and for all terms the place of theirs among them and its factor, (terms,) each.
    """
    first: dict[tuple[object, ...], int] = {}
    by_shape: dict[tuple[object, ...], Array] = {}

    def size(term: Term) -> float:
        key = (term.effect.name, *sorted(term.shape.items()))
        if key not in by_shape:
            by_shape[key] = sizes(term.effect, term.shape, s)
        return float(by_shape[key][term.part])

    picked: list[Term] = []
    places, factors = np.empty(len(terms), dtype=np.intp), np.ones(len(terms))
    for k, term in enumerate(terms):
        effect = term.effect
        held = {n: value for n, value in term.shape.items() if not (effect.basis and effect.shapes[n].refined)}
        key = (effect.basis or effect.name, term.port, term.part, *sorted(held.items()))
        places[k] = first.setdefault(key, len(picked))
        if places[k] == len(picked):
            picked.append(term)
        elif effect.basis:
            factors[k] = size(term) / size(picked[places[k]])
    return picked, places, factors


def sizes(effect: Effect, shape: Mapping[str, float], s: Signals) -> Array:
    """Size of each column of an effect with a basis, in a unit that is the same for all shapes, (width,)."""
    few = s.at(slice(None, None, max(1, len(s.t) // TIMES)))
    return np.asarray(np.linalg.norm(effect.column(few, **shape).reshape(len(few.t), -1), axis=0))


def gradient_in_output(state: RunState, y: Array) -> Array:
    """Gradient of the log-likelihood in the output, held over the interval after each reading, up to a factor, (m,).

    Parameters
    ----------
    state : the run.
    y : (m,) whitened innovations of the readings that count.
    """
    T = state.run.reading_step
    return _transposed(state, y, np.array([[T * T / 2.0], [T]]), np.array([[1.0, 0.0]]), 0.0)


def gradient_in_readings(state: RunState, y: Array) -> Array:
    """Gradient of the log-likelihood in an error of each reading, up to a factor, (m,).

    Parameters
    ----------
    state : the run.
    y : (m,) whitened innovations of the readings that count.
    """
    F, K, _ = _steady(state)
    return _transposed(state, y, F @ K, np.array([[-1.0, 0.0]]), 1.0)


def _transposed(state: RunState, y: Array, B: Array, C: Array, D: float) -> Array:
    """Run x(n+1) = F (I - K H) x + B d, e = C x + D d backwards over uniform times; lost readings count as zero."""
    F, K, H = _steady(state)
    t = state.run.t[state.counts]
    place = np.rint((t - t[0]) / state.run.reading_step).astype(np.intp)
    e = np.zeros(int(place[-1]) + 1)
    e[place] = y
    A = F @ (np.eye(2) - K @ H)
    a = np.poly(A)
    b = np.poly(A - B @ C) + (D - 1.0) * a
    return np.asarray(recursive_filter(b.tolist(), a.tolist(), e[::-1])[::-1][place])


def _steady(state: RunState) -> tuple[Array, Array, Array]:
    """Transition, median gains and measurement of the filter for position and velocity."""
    gains = [[float(np.median(state.series(name)))] for name in ("gain_p", "gain_v")]
    return np.array([[1.0, state.run.reading_step], [0.0, 1.0]]), np.array(gains), np.array([[1.0, 0.0]])
