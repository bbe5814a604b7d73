"""Dead reckoning with effects: motion stepped forward in time from the output alone, from many starts at once.

At nodes t_j the output implies the acceleration a_j = b_j - g E_j: b_j without effects, g = polarity/(1 + k), and
E_j = sum c_i e_i at the simulated motion itself, with the jerk of the output. The effects move velocity and position by

    dv_j = dv_(j-1) - g h (E_(j-1) + E_j)/2,    dp_j = dp_(j-1) + h dv_(j-1) - g h² (2 E_(j-1) + E_j)/6,

exact for E straight between nodes, implicit in E_j and stable for friction of any slope (derivations 6.9). The nodes of
a window are solved together by Newton's method, for all starts at once; a window that does not converge is halved, down
to one node, where the method halves its steps. So the result is that of one node after the other. Effects that follow
the output alone are the same on all paths: they are solved once along the record.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from accelcal import _core
from accelcal.data import GRAVITY, Array, batches
from accelcal.effects import BUILT_IN, is_local
from accelcal.estimation.channel_filters import ChannelFilters
from accelcal.estimation.values import Values
from accelcal.model import Term, evaluate
from accelcal.signals.processing import derivative
from accelcal.signals.signals import Signals

TOLERANCE = 1e-13
"""Change of the effects, as a share of the largest, below which an iteration has converged."""
SETTLED = 1e-12
"""Change of what effects with memory have displaced, as a share of the largest, below which it has too."""
MOST_WORK = 1 << 20
"""Samples on which effects with memory are evaluated for the paths of one call until they converge. A friction that
remembers reversals sticks and slips where the stage hardly moves, and converges in a few nodes at a time only: beyond
this the paths are followed in windows of at least `HURRIED_WINDOW` nodes with `HURRIED_ROUNDS` iterations."""
HURRIED_WINDOW, HURRIED_ROUNDS = 128, 5
STALLS = 3
"""Iterations in which the effects with memory have not come nearer by half, after which they do not converge."""
CYCLING = 1e-3
"""Such a change where they do not converge: a reversal that comes one node earlier or later, in turns."""
ROUNDS = 12
"""Iterations of a window before it is halved."""
FEW = 6
"""Iterations up to which the next window is twice as long."""
SLOPES_HOLD = 1e-3
"""Share of the last change below which an iteration keeps its slopes."""
UNSOLVED = 1e-3
"""Share of the effects that may be left at one node. With more its equation has no solution: the effects have run away
with the motion, and the path ends."""
NEWTON_ROUNDS = 20
"""Iterations at one node."""
TOGETHER = 1 << 15
"""Nodes of all starts that are solved at once: their arrays stay in the cache."""
HELD = 1 << 22
"""Nodes of all starts that are held in memory."""
MEMORY = 10.0
"""Seconds before a start over which effects with memory are evaluated. They are taken from the whole record; what
simulated motion changes in them begins at the start."""
SMALL = 1e-6
"""Step of a numerical derivative, as a share of the variable."""

CORNER = 1e-9
"""Least extent of a motion that slopes are taken on, m."""
EPSILON = 16.0 * float(np.finfo(np.float64).eps)
"""Rounding of a sum, as a share of its largest term."""
TINY = 1e-300
"""Least step of a numerical derivative, m/s²."""

Terms = Sequence[tuple[Term, float]]
Motion = tuple[Array, Array, Array, Array]
"""Position, velocity, acceleration and its derivative."""
Displacement = tuple[Array, Array]
"""Velocity and position that effects have added."""


@dataclass(frozen=True, slots=True)
class Starts:
    """State from which motion is simulated, one path for each, (n,) each."""

    t: Array
    """s"""
    p: Array
    """m, from the model's origin"""
    v: Array
    """m/s"""
    constant: Array
    """Acceleration added to that of the output, m/s²."""
    variances: Array
    """Variance of position, covariance, variance of velocity, (n, 3) in m², m²/s, m²/s²."""

    def part(self, rows: slice) -> Starts:
        """Some of them."""
        return Starts(self.t[rows], self.p[rows], self.v[rows], self.constant[rows], self.variances[rows])


@dataclass(slots=True)
class Paths:
    """What effects do to the motion along simulated paths; the first node is the start, the others lie on the grid."""

    first: NDArray[np.intp]
    """Node of the grid that is the second of each path, (n,)."""
    t: Array
    """Time of each node, (n, m) s."""
    effects: Array
    """Sum of the effects on the output, (n, m) m/s²."""
    dv: Array
    """Velocity that they add, (n, m) m/s."""
    dp: Array
    """Position that they add, (n, m) m."""
    variance: Array
    """Variance of the simulated position from noise and start, (n, m) m²."""


class DeadReckoning:
    """Effects of a model on simulated motion.

    Parameters
    ----------
    values : scale factor and coefficients.
    motion : that over the whole record as far as it is known, with the output's acceleration, effects subtracted.
    bare : acceleration that the output implies without effects at the times of `known`, (n,) m/s².
    carried : velocity and position that this acceleration has added since the first time, (n,) m/s and m.
    density : of the noise on acceleration, (m/s²)²/Hz.
    lost : variance of the velocity that the samples do not hold, accumulated since the first time, (n,) m²/s².
    filters : that readings and effects pass; by default none. What passes one has a memory.
    """

    def __init__(
        self,
        values: Values,
        signals: Signals,
        bare: Array,
        carried: tuple[Array, Array],
        density: float,
        lost: Array,
        filters: ChannelFilters | None = None,
    ) -> None:
        self.density, self.lost = density, lost
        self.filters = filters if filters is not None and filters.acts else None
        self.gain = signals.rig.polarity / values.scale
        self.motion = replace(signals, a_corner=signals.a_width, v_corner=signals.v_width)
        gravity = signals.gravity
        self.bare = bare
        self.jerk = derivative(bare if isinstance(gravity, float) else bare + gravity, signals.step)
        self.carried_v, self.carried_p = carried
        self.local, self.lagging = split(values.additive("output"), signals, self.filters)
        self.local_read, self.lagging_read = split(values.additive("position"), signals, self.filters)
        local = [term for term, _ in self.local]
        self.followers = tuple(following(local, signals, y) for y in "pva")
        # What the output alone determines, no simulated motion changes; nor does it what looks ahead.
        late = [term for term, _ in self.lagging]
        moved = [self.lagging[i] for i in sorted({*following(late, signals, "p"), *following(late, signals, "v")})]
        self.feeds_back = bool(self.followers[0] or self.followers[1] or moved)
        # Differences that slopes are taken on: shares of what a variable changes over.
        widths = max(float(np.ptp(signals.p)), CORNER), 1e3 * self.motion.v_width, 1e3 * self.motion.a_width
        self.small = tuple(SMALL * width for width in widths)
        self.known_effects = np.asarray(total(self.local, self.motion))
        self.lagged_effects = self.remembered(self.lagging, self.motion) if self.lagging else np.empty(0)
        self.lagging = [
            term for term in self.lagging if self.feeds_back and (term in moved or not looks_ahead(term[0], signals))
        ]
        self.read_lagged = self.remembered(self.lagging_read, self.motion) if self.lagging_read else np.empty(0)

    def remembered(self, terms: Terms, s: Signals) -> Array:
        """Sum of terms with memory at uniform times, behind the filters, (n,)."""
        values = total(terms, s)
        return values if self.filters is None else self.filters.behind(values, self.motion.step)

    @property
    def remembers(self) -> bool:
        """Whether effects remember simulated motion."""
        return bool(self.lagging)

    def batches(self, count: int, horizon: float) -> list[slice]:
        """Starts that are simulated together."""
        nodes = horizon / self.motion.step + 3.0
        return batches(count, max(1, int(HELD / nodes)))

    def displacement(
        self, starts: Starts, t: Array, limit: float = math.inf, floor: bool = True
    ) -> tuple[Array, Array]:
        """What the effects add to readings, and the variance of the simulated position.

        Parameters
        ----------
        starts : where the paths begin.
        t : times of the readings, (n, k) s, all behind their starts.
        limit : m; a path that effects move further has ended; where they are the same on all paths, a reading that they
            move further counts as behind its end.
        floor : if False, the variance is not followed, and 0.

        Returns
        -------
        Displacement of readings and variance, (n, k) m and m²; not a number once a path has ended.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            if not floor and self._follows_output_alone(starts):
                return self._shared_displacement(starts, t, limit), np.zeros_like(t)
            paths = Simulation(self, starts, float(np.max(t - starts.t[:, None])), limit).run(floor)
        added, variance = np.empty_like(t), np.empty_like(t)
        for i in range(len(t)):
            node = np.clip(np.searchsorted(paths.t[i], t[i], side="right") - 1, 0, paths.t.shape[1] - 2)
            h = t[i] - paths.t[i, node]
            step = paths.t[i, node + 1] - paths.t[i, node]
            here, rise = paths.effects[i, node], paths.effects[i, node + 1] - paths.effects[i, node]
            added[i] = (
                paths.dp[i, node] + h * paths.dv[i, node] - self.gain * h**2 * (here / 2.0 + rise * h / (6.0 * step))
            )
            variance[i] = np.interp(t[i], paths.t[i], paths.variance[i])
        if self.local_read or self.lagging_read:
            added += self._read(starts, paths, t, added)
        return added, variance

    def _follows_output_alone(self, starts: Starts) -> bool:
        """Whether no simulated motion changes the effects, so that paths of all starts have the same ones."""
        if self.feeds_back or self.local_read or self.lagging_read or np.any(starts.constant):
            return False
        return bool(np.all(np.isfinite(self._along_record.effects)))

    @cached_property
    def _along_record(self) -> Paths:
        """The path from the first node over the whole record, (1, n)."""
        signals, zero = self.motion, np.zeros(1)
        first = Starts(signals.t[:1], signals.p[:1], signals.v[:1], zero, np.zeros((1, 3)))
        paths = Simulation(self, first, float(signals.t[-1] - signals.t[0]), math.inf).run(floor=False)
        whole = [y[:, : len(signals.t)] for y in (paths.t, paths.effects, paths.dv, paths.dp, paths.variance)]
        return Paths(paths.first, *whole)

    def _shared_displacement(self, starts: Starts, t: Array, limit: float) -> Array:
        """What effects that follow the output alone add to readings at times `t`, (n, k) m: up to its second node each
        path has a way of its own, from there on it is the difference of two places on that over the whole record."""
        begun, along, signals = (
            Simulation(self, starts, 0.0, math.inf).run(floor=False),
            self._along_record,
            self.motion,
        )
        second = np.minimum(begun.first, len(signals.t) - 1)[:, None]
        node = np.maximum(np.clip(np.searchsorted(signals.t, t, side="right") - 1, 0, len(signals.t) - 2), second)
        ahead = np.minimum(node + 1, len(signals.t) - 1)
        effects, dv, dp = along.effects[0], along.dv[0], along.dp[0]
        since = signals.t[node] - signals.t[second]
        dv_node = begun.dv[:, [1]] + dv[node] - dv[second]
        dp_node = begun.dp[:, [1]] + since * (begun.dv[:, [1]] - dv[second]) + dp[node] - dp[second]
        before = t < begun.t[:, [1]]
        h = np.where(before, t - begun.t[:, [0]], t - signals.t[node])
        step = np.where(before, begun.t[:, [1]] - begun.t[:, [0]], signals.step)
        here = np.where(before, begun.effects[:, [0]], effects[node])
        rise = np.where(before, begun.effects[:, [1]], effects[ahead]) - here
        added = np.where(before, 0.0, dp_node) + h * np.where(before, 0.0, dv_node)
        added -= self.gain * h**2 * (here / 2.0 + rise * h / (6.0 * step))
        return np.where(np.abs(added) < limit, added, np.nan)

    def _read(self, starts: Starts, paths: Paths, t: Array, dp: Array) -> Array:
        """What effects add to the readings themselves at times `t` of each path, (n, k) m."""
        signals, read = self.motion, np.zeros_like(t)
        for i in range(len(t)):
            motion = self._motion_at(starts, paths, i, t[i], dp[i])
            if self.local_read:
                read[i] += total(self.local_read, motion)
            if not self.lagging_read:
                continue
            nodes = slice(int(paths.first[i]), min(int(paths.first[i]) + paths.t.shape[1] - 1, len(signals.t)))
            simulated = self._motion_at(starts, paths, i, signals.t[nodes], None)
            before = history(signals, nodes.start)
            reference = self.remembered(self.lagging_read, signals.at(slice(before.start, nodes.stop)))
            change = self.remembered(self.lagging_read, joined(signals, before, simulated)) - reference
            change = change[nodes.start - before.start :]
            read[i] += np.interp(t[i], signals.t, self.read_lagged) + np.interp(t[i], signals.t[nodes], change)
        return read

    def _motion_at(self, starts: Starts, paths: Paths, i: int, t: Array, dp: Array | None) -> Signals:
        """Simulated motion of one path at some times; at its nodes on the grid where `dp` is None."""
        bare = Carried.of(self, starts.part(slice(i, i + 1)), t[None, :])
        if dp is None:
            n = len(t)
            dp, dv, added = paths.dp[i, 1 : n + 1], paths.dv[i, 1 : n + 1], paths.effects[i, 1 : n + 1]
        else:
            dv, added = (np.interp(t, paths.t[i], y[i]) for y in (paths.dv, paths.effects))
        return self.signals(t, bare.p[0] + dp, bare.v[0] + dv, bare.a[0] - self.gain * added, bare.jerk[0], bare.side)

    def signals(self, t: Array, p: Array, v: Array, a: Array, jerk: Array, side: dict[str, Array]) -> Signals:
        """Signals of simulated motion, (n,) each; spacing, length and widths are those of the whole record."""
        side = {name: y.reshape(-1) for name, y in side.items()}
        polarity, gravity = self.motion.rig.polarity, side.get(GRAVITY, self.motion.rig.gravity)
        return replace(
            self.motion,
            t=t,
            p=p,
            v=v,
            a=polarity * (a + gravity),
            jerk=polarity * jerk,
            side=side,
            whole=self.motion,
        )


@dataclass(frozen=True, slots=True)
class Carried:
    """Motion without effects at times of several paths, (n, m) each."""

    p: Array
    v: Array
    a: Array
    jerk: Array
    side: dict[str, Array]

    @classmethod
    def of(cls, ahead: DeadReckoning, starts: Starts, t: Array, nodes: NDArray[np.intp] | None = None) -> Carried:
        """At times `t`, (n, m) s, which are those of `nodes` if these are given: between them the acceleration is
        straight."""
        signals = ahead.motion
        begin_p, begin_v = ahead_at(ahead, starts.t)
        since = t - starts.t[:, None]
        position, velocity = ahead_at(ahead, t) if nodes is None else (ahead.carried_p[nodes], ahead.carried_v[nodes])

        def at(y: Array) -> Array:
            return np.interp(t, signals.t, y) if nodes is None else y[nodes]

        constant = starts.constant[:, None]
        v = velocity - begin_v[:, None] + starts.v[:, None]
        p = position - begin_p[:, None] + starts.p[:, None] + since * (starts.v - begin_v)[:, None]
        side = {name: at(y) for name, y in signals.side.items()}
        return cls(p + 0.5 * constant * since**2, v + constant * since, at(ahead.bare) + constant, at(ahead.jerk), side)


def ahead_at(ahead: DeadReckoning, t: Array) -> tuple[Array, Array]:
    """Position and velocity that the bare acceleration has added since the first time, at times `t`."""
    signals, step = ahead.motion, ahead.motion.step
    node = np.clip(((t - signals.t[0]) / step).astype(np.intp), 0, len(signals.t) - 2)
    h = t - signals.t[node]
    b, rise = ahead.bare[node], ahead.bare[node + 1] - ahead.bare[node]
    v = ahead.carried_v[node] + h * b + h**2 * rise / (2.0 * step)
    p = ahead.carried_p[node] + h * ahead.carried_v[node] + h**2 * b / 2.0 + h**3 * rise / (6.0 * step)
    return p, v


class Simulation:
    """Paths of several starts while they are simulated, window by window."""

    def __init__(self, ahead: DeadReckoning, starts: Starts, horizon: float, limit: float) -> None:
        self.ahead, self.starts, self.limit, signals = ahead, starts, limit, ahead.motion
        n, m = len(starts.t), int(horizon / signals.step) + 3
        first = np.searchsorted(signals.t, starts.t, side="right")
        grid = signals.t[0] + signals.step * (first[:, None] + np.arange(m - 1))
        self.paths = Paths(first, np.column_stack([starts.t, grid]), *(np.zeros((n, m)) for _ in range(4)))
        self.steps = np.diff(self.paths.t, axis=1)
        self.variances = starts.variances.copy()
        self.motion = tuple(np.zeros((n, m)) for _ in range(4)) if ahead.lagging else ()
        self.reference = [self._reference(i) for i in range(n)] if ahead.lagging else []
        self.largest: Array = np.zeros((n, 1))
        self.work = 0

    @property
    def hurried(self) -> bool:
        """Whether effects with memory have taken so much work that they are not followed until they converge."""
        return self.work > MOST_WORK

    def run(self, floor: bool) -> Paths:
        """Simulate to the end, the variance too where a `floor` is asked for."""
        paths, ahead = self.paths, self.ahead
        n, m = paths.t.shape
        most = m if ahead.lagging else max(1, TOGETHER // n)
        self._advance(slice(0, 1))
        paths.variance[:, 0] = self.variances[:, 0]
        begin, width, failed = 1, min(most, m), False
        while begin < m:
            if self.hurried and not failed:
                width = max(width, HURRIED_WINDOW)
            window = slice(begin, min(begin + width, m))
            rounds = self._advance(window)
            if rounds is None:
                width, failed = max(1, (window.stop - begin) // 2), True
                continue
            failed = False
            if floor:
                self._spread(window)
            begin = window.stop
            if rounds <= FEW or ahead.lagging:  # what has a memory costs the same in a wider window
                width = min(2 * width, most)
        return paths

    def _advance(self, window: slice) -> int | None:
        """Solve the nodes of a window; number of iterations, None where they do not converge."""
        bare, effects = self._bare(window), self._guess(window)
        guess, slopes, before, last = effects, None, np.inf, None
        rounding: Array | float = 0.0
        remembered: Array | float | None = None
        stalled, n_nodes = 0, window.stop - window.start
        for count in range(ROUNDS):
            motion, displacement = self._motion(window, bare, effects)
            columns = self._local(window, bare, motion)
            # What lies behind a node where a path ends changes nothing before it.
            ended = np.logical_or.accumulate(~(np.abs(displacement[1]) < self.limit), axis=1)
            after = np.where(ended, 0.0, self._effects(window, motion, columns))
            change = np.where(ended, 0.0, np.abs(after - effects))
            largest = np.maximum(self.largest, largest_of(after))
            final = count == ROUNDS - 1 or stalled == STALLS
            settled = self.ahead.lagging and last is not None and has_settled(displacement, last, final)
            last = displacement
            spent = self.hurried and count + 1 >= HURRIED_ROUNDS
            if spent or settled or np.all(change <= TOLERANCE * largest + rounding):
                self._keep(window, bare, np.where(ended, np.nan, after))
                return count + 1
            if not np.all(np.isfinite(after)) or (stalled >= STALLS and not self.hurried and n_nodes > 1):
                break
            left = float(np.max(change / (largest + TINY)))
            stalled = stalled + 1 if self.ahead.lagging and left > 0.5 * before else 0
            if slopes is None or left > SLOPES_HOLD * before:
                slopes = [self._slope(window, bare, motion, columns, row) for row in range(3)]
                if remembered is None:
                    remembered = self._slope_with_memory(window, motion)
                slopes[2] = slopes[2] + remembered
                rounding = self._rounding(bare, slopes)
            before = left
            effects = self._corrected(window, displacement, effects, after, slopes)
        if n_nodes > 1:
            return None
        after = self._at_node(window, bare, guess)
        unsolved = np.abs(self._missing(window, bare, after)) > UNSOLVED * np.maximum(self.largest, np.abs(after))
        self._keep(window, bare, np.where(unsolved, np.nan, after))
        return ROUNDS

    def _nodes(self, window: slice) -> NDArray[np.intp] | None:
        """Nodes of the whole record that a window stands for, (n, w); None where it begins with the starts, or reaches
        beyond the record."""
        if window.start == 0 or int(np.max(self.paths.first)) + window.stop - 2 >= len(self.ahead.motion.t):
            return None
        return self.paths.first[:, None] + np.arange(window.start - 1, window.stop - 1)

    def _along(self, window: slice, y: Array) -> Array:
        """What is known over the whole record, over a window, (n, w)."""
        nodes = self._nodes(window)
        return np.interp(self.paths.t[:, window], self.ahead.motion.t, y) if nodes is None else y[nodes]

    def _bare(self, window: slice) -> Carried:
        """Motion without effects over a window."""
        return Carried.of(self.ahead, self.starts, self.paths.t[:, window], self._nodes(window))

    def _guess(self, window: slice) -> Array:
        """Effects to begin with: they change as along the known motion, (n, w) m/s²."""
        along = self._along(window, self.ahead.known_effects)
        if window.start == 0:
            return along
        last = slice(window.start - 1, window.start)
        return along + (self.paths.effects[:, last] - self._along(last, self.ahead.known_effects))

    def _slope(self, window: slice, bare: Carried, motion: Motion, columns: list[Array], row: int) -> Array | float:
        """How the effects change with position, velocity or acceleration (`row`), (n, w); 0 where none follows it."""
        following, size = self.ahead.followers[row], self.ahead.small[row]
        if not following:
            return 0.0
        other = [*motion]
        other[row] = motion[row] + size
        moved = self._local(window, bare, other, following)
        return np.asarray(sum(y - columns[i] for i, y in zip(following, moved, strict=True)) / size)

    def _slope_with_memory(self, window: slice, motion: Motion) -> Array | float:
        """How effects with memory change at a node with the acceleration there, (n, 1), from the last node of a window.

        What a node changes at those behind it is left to the iteration, which it can only delay.
        """
        if not self.ahead.lagging or window.start == 0:
            return 0.0
        p, v, a, jerk = motion
        size = self.ahead.small[2]
        moved = a.copy()
        moved[:, -1] += size
        change = self._changes(window, (p, v, moved, jerk)) - self._changes(window, motion)
        return np.asarray(change[:, -1:] / size)

    def _rounding(self, bare: Carried, slopes: Sequence[Array | float]) -> Array | float:
        """What rounding of the motion alone makes of the effects, (n, 1) m/s²; 0 on a path that has ended."""
        gain = abs(self.ahead.gain)
        total: Array | float = 0.0
        for slope, y in zip(slopes, (bare.p, bare.v, bare.a), strict=True):
            if not isinstance(slope, float):
                total = total + gain * EPSILON * largest_of(y) * largest_of(slope)
        return np.nan_to_num(total)

    def _corrected(
        self, window: slice, displacement: Displacement, effects: Array, errors: Array, slopes: Sequence[Array | float]
    ) -> Array:
        """The next iterate of the effects, (n, w) m/s²: linear in the motion about the last, where `errors` acted."""
        gain, (on_p, on_v, on_a) = self.ahead.gain, slopes
        if not isinstance(on_a, float):
            # E = found + on_a (-gain) (E - effects) + what position and velocity change
            scale = 1.0 / np.where(np.abs(1.0 + gain * on_a) > 0.1, 1.0 + gain * on_a, 1.0)
            errors = effects + scale * (errors - effects)
            on_p, on_v = (y if isinstance(y, float) else scale * y for y in (on_p, on_v))
        if window.start == 0 or (isinstance(on_p, float) and isinstance(on_v, float)):
            return errors
        falling = [np.ascontiguousarray(np.broadcast_to(gain * slope, errors.shape)) for slope in (on_p, on_v)]
        last, steps = self._before(window)
        return _core.corrected(last, steps, displacement, -gain * errors, (falling[0], falling[1])) / -gain

    def _at_node(self, window: slice, bare: Carried, effects: Array) -> Array:
        """Effects at one node, where no iteration of the path converged: Newton's method with halved steps, (n, 1)
        m/s²."""
        missing = self._missing(window, bare, effects)
        size = np.abs(missing + effects)
        share = np.ones_like(effects)
        for _ in range(NEWTON_ROUNDS):
            small = np.maximum(SMALL * np.abs(missing), TOLERANCE * size + TINY)
            slope = (self._missing(window, bare, effects + small) - missing) / small
            trial = effects - share * missing / np.where(slope == 0.0, -1.0, slope)
            left = self._missing(window, bare, trial)
            better = np.abs(left) < np.abs(missing)
            effects, missing = np.where(better, trial, effects), np.where(better, left, missing)
            share = np.where(better, 1.0, 0.5 * share)
            if not np.any(np.abs(missing) > TOLERANCE * size):
                break
        return effects

    def _missing(self, window: slice, bare: Carried, effects: Array) -> Array:
        """What the effects at the motion that follows from given effects exceed these by, (n, w) m/s²."""
        motion, _ = self._motion(window, bare, effects)
        return self._effects(window, motion, self._local(window, bare, motion)) - effects

    def _before(self, window: slice) -> tuple[Array, Array]:
        """What the effects have added up to the node before a window, (n, 3), and the steps to its nodes, (n, w) s."""
        last, paths = window.start - 1, self.paths
        before = np.column_stack([-self.ahead.gain * paths.effects[:, last], paths.dv[:, last], paths.dp[:, last]])
        return before, np.ascontiguousarray(self.steps[:, last : window.stop - 1])

    def _motion(self, window: slice, bare: Carried, effects: Array) -> tuple[Motion, Displacement]:
        """Simulated motion under given effects, and the velocity and position that they add, (n, w) each."""
        gain = self.ahead.gain
        if window.start == 0:
            zero = np.zeros_like(effects)
            return (bare.p, bare.v, bare.a - gain * effects, bare.jerk), (zero, zero)
        dv, dp = _core.displaced(*self._before(window), -gain * effects)
        return (bare.p + dp, bare.v + dv, bare.a - gain * effects, bare.jerk), (dv, dp)

    def _effects(self, window: slice, motion: Motion, columns: list[Array]) -> Array:
        """Effects at given motion, of which those without memory are `columns`, (n, w) m/s²."""
        sums = sum(columns, np.zeros_like(motion[0]))
        if len(self.ahead.lagged_effects):
            sums += self._along(window, self.ahead.lagged_effects)
        if self.ahead.lagging and window.start > 0:
            sums += self._changes(window, motion)
        return sums

    def _local(
        self, window: slice, bare: Carried, motion: Sequence[Array], rows: Sequence[int] | None = None
    ) -> list[Array]:
        """Effects without memory, or some of them, at given motion, (n, w) m/s² each."""
        ahead, shape = self.ahead, motion[0].shape
        terms = ahead.local if rows is None else [ahead.local[i] for i in rows]
        t, p, v, a, jerk = (np.ascontiguousarray(y).reshape(-1) for y in (self.paths.t[:, window], *motion))
        return [y.reshape(shape) for y in contributions(terms, ahead.signals(t, p, v, a, jerk, bare.side))]

    def _changes(self, window: slice, motion: Motion) -> Array:
        """What simulated motion has changed in the effects with memory, (n, w) m/s²."""
        ahead, signals = self.ahead, self.ahead.motion
        changes = np.zeros_like(motion[0])
        for i, (first, reference) in enumerate(zip(self.paths.first, self.reference, strict=True)):
            nodes = slice(int(first), int(first) + window.stop - 1)
            so_far = (
                np.concatenate([y[i, 1 : window.start], new[i]]) for y, new in zip(self.motion, motion, strict=True)
            )
            inside = signals.t[nodes]
            p, v, a, jerk = (y[: len(inside)] for y in so_far)
            side = {name: y[nodes] for name, y in signals.side.items()}
            before = history(signals, nodes.start)
            path = joined(signals, before, ahead.signals(inside, p, v, a, jerk, side))
            self.work += len(path.t)
            change = ahead.remembered(ahead.lagging, path)[len(path.t) - len(inside) :] - reference[: len(inside)]
            row = change[window.start - 1 :]
            changes[i, : len(row)] = row
        return changes

    def _reference(self, i: int) -> Array:
        """Effects with memory along the known motion from a start on, evaluated like those of simulated motion."""
        first = int(self.paths.first[i])
        before = history(self.ahead.motion, first)
        rows = slice(before.start, first + self.paths.t.shape[1] - 1)
        return self.ahead.remembered(self.ahead.lagging, self.ahead.motion.at(rows))[before.stop - before.start :]

    def _keep(self, window: slice, bare: Carried, effects: Array) -> None:
        """Take the effects of a window as solved."""
        paths = self.paths
        motion, (paths.dv[:, window], paths.dp[:, window]) = self._motion(window, bare, effects)
        paths.effects[:, window] = effects
        self.largest = np.fmax(self.largest, largest_of(effects))
        for old, new in zip(self.motion, motion, strict=False):
            old[:, window] = new

    def _spread(self, window: slice) -> None:
        """Variance of the simulated position over a window: noise, and what effects make of errors of the motion.

        Slopes are differences over one standard deviation to either side, which a corner does not dominate.
        """
        ahead, paths = self.ahead, self.paths
        t = np.ascontiguousarray(paths.t[:, window.start - 1 : window.stop])
        slopes = np.zeros((2, *t.shape))
        if ahead.feeds_back:
            around = slice(window.start - 1, window.stop)
            bare = self._bare(around)
            effects = paths.effects[:, around]
            motion = (
                bare.p + paths.dp[:, around],
                bare.v + paths.dv[:, around],
                bare.a - ahead.gain * effects,
                bare.jerk,
            )
            for row, following in enumerate(ahead.followers[:2]):
                size = np.maximum(np.sqrt(np.maximum(self.variances[:, [2 * row]], 0.0)), 1e-12)
                high, low = [*motion], [*motion]
                high[row], low[row] = motion[row] + size, motion[row] - size
                sides = (self._local(around, bare, other, following) for other in (high, low))
                for above, below in zip(*sides, strict=True):
                    slopes[row] += (above - below) / (2.0 * size)
        lost = np.diff(self._along(slice(window.start - 1, window.stop), ahead.lost), axis=1)
        paths.variance[:, window] = _core.dead_reckoning_variance(
            self.variances, np.diff(t, axis=1), ahead.gain * slopes[0], ahead.gain * slopes[1], lost, ahead.density
        )


def largest_of(y: Array) -> Array:
    """Largest magnitude on each path, (n, 1)."""
    return np.asarray(np.max(np.abs(y), axis=1, keepdims=True, initial=0.0))


def has_settled(displacement: Displacement, last: Displacement, final: bool) -> bool:
    """Whether effects with memory move no path any more; after the `final` iteration, the position by hardly anything.

    Rounding moves the instant of a reversal, and with it all that remembers it; a path that has ended is settled.
    """
    pairs = (
        [(displacement[1], last[1], CYCLING)]
        if final
        else [(*both, SETTLED) for both in zip(displacement, last, strict=True)]
    )
    return not any(
        bool(np.any(np.abs(y - was) > share * np.nanmax(np.abs(y), axis=1, keepdims=True, initial=0.0)))
        for y, was, share in pairs
    )


def contributions(terms: Terms, s: Signals) -> list[Array]:
    """What each of some terms contributes at the times of `s`, (n,) each."""
    return [c * column for (_, c), column in zip(terms, evaluate([term for term, _ in terms], s), strict=True)]


def total(terms: Terms, s: Signals) -> Array:
    """Sum of some terms at the times of `s`, (n,)."""
    return sum(contributions(terms, s), np.zeros(len(s.t)))


def split(
    terms: Iterable[tuple[Term, float]], signals: Signals, filters: ChannelFilters | None = None
) -> tuple[list[tuple[Term, float]], list[tuple[Term, float]]]:
    """Terms without memory, and those with: all that pass filters."""
    local: list[tuple[Term, float]] = []
    lagging: list[tuple[Term, float]] = []
    for term, c in terms:
        at_once = filters is None and (is_local(term.effect) or seems_local(term, signals))
        (local if at_once else lagging).append((term, c))
    return local, lagging


def seems_local(term: Term, signals: Signals) -> bool:
    """Whether a user's effect has the values on parts of the record that it has on the whole."""
    if term.effect in BUILT_IN:
        return False
    whole, n = term.column(signals), len(signals.t)
    parts = [slice(n * k // 7, n * (k + 1) // 7 + 1) for k in range(1, 6)]
    return all(np.array_equal(term.column(signals.part(rows)), whole[rows], equal_nan=True) for rows in parts)


def following(terms: Sequence[Term], signals: Signals, letter: str) -> list[int]:
    """Which of some terms depend on position ("p"), velocity ("v") or acceleration ("a")."""
    y = getattr(signals, letter)
    other = replace(signals, **{letter: np.mean(y) - 0.7 * (y - np.mean(y)) + 0.1 * np.ptp(y)})
    pairs = enumerate(zip(evaluate(terms, signals), evaluate(terms, other), strict=True))
    return [i for i, (here, there) in pairs if not np.array_equal(here, there, equal_nan=True)]


def looks_ahead(term: Term, signals: Signals) -> bool:
    """Whether an effect depends on later motion, as a difference to either side does."""
    rows = slice(0, 2 * len(signals.t) // 3)
    return not np.array_equal(term.column(signals)[rows], term.column(signals.at(rows)), equal_nan=True)


def history(signals: Signals, node: int) -> slice:
    """Nodes before one over which effects with memory are evaluated."""
    return slice(max(0, node - int(MEMORY / signals.step)), node)


def joined(signals: Signals, before: slice, simulated: Signals) -> Signals:
    """Known motion with simulated motion behind it."""

    def continued(y: Array, ahead: Array) -> Array:
        return np.concatenate([y[before], ahead])

    return replace(
        simulated,
        t=continued(signals.t, simulated.t),
        p=continued(signals.p, simulated.p),
        v=continued(signals.v, simulated.v),
        a=continued(signals.a, simulated.a),
        jerk=continued(signals.jerk, simulated.jerk),
        side={name: continued(y, simulated.side[name]) for name, y in signals.side.items()},
    )
