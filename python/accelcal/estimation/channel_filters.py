"""Declared filters of both channels in a fit: what is inverted, and what is applied to the other channel instead.

With A the low-passes of the output, H its high-passes and P the filters of the position, output and reading show
A H a and P p. A is inverted where its gain allows (G/A, with G rolled off above); H is applied to the readings and P to
the output. Both then show one motion, that behind P H, and every regressor passes through P H as well (derivations
7.3c).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from accelcal.data import Array, Channel, ChannelFilter, Flags, Rig, high_passes, low_passes
from accelcal.data.orientation import HOLE
from accelcal.signals.processing import Response, Spectrum, applied, memory, modes, response

LEAST_GAIN = 0.02
"""A low-pass is inverted up to the frequency at which its gain falls below this share of that at rest: what enters
behind it, such as rounding, grows fifty times at most."""
ROLL_OFF = 0.7
"""Share of that frequency from which the inverse is rolled off."""
KERNEL = 4.0
"""Length of the inverse's response at either side, in periods of the width of the roll-off."""
LEAST_POWER = 0.8
"""Noise of which declared filters leave less than this share of the power is not taken as white."""
GRID_ERROR = 1e-3
"""Stamps that follow a uniform clock closer than this share of a period are taken as uniform."""
SETTLED = 0.5
"""Share of the memory of a high-pass after which its unknown state at a start is forgotten: nine time constants."""
MOST_TRANSIENTS = 16
"""Gaps of the readings behind which the state of a high-pass is estimated anew."""

Motion = tuple[Array, Array, Array, Array]
"""Position (m), velocity, acceleration and jerk at uniform times, (n,) each."""


@dataclass(frozen=True, eq=False)
class ChannelFilters:
    """Filters of one prepared run beside the one RC that the drive inverts itself."""

    rig: Rig
    rate: float
    """Of the accelerometer, Hz."""
    reading_rate: float
    """Of the readings, Hz."""

    @property
    def inverted(self) -> tuple[ChannelFilter, ...]:
        """Low-passes of the output."""
        return low_passes(self.rig.output_filters)

    @property
    def blocking(self) -> tuple[ChannelFilter, ...]:
        """High-passes of the output."""
        return high_passes(self.rig.output_filters)

    @property
    def acts(self) -> bool:
        """Whether readings and regressors pass through a filter."""
        return bool(self.blocking or self.rig.position_filters)

    @cached_property
    def settle(self) -> float:
        """Time after which every response has died away, s."""
        return memory(self.rig.output_filters, self.rate) + memory(self.rig.position_filters, self.reading_rate)

    @property
    def unsettled(self) -> float:
        """Time behind a start in which a high-pass has not forgotten a state that is not known, s."""
        return 0.0 if self.rig.coupled else SETTLED * self.settle

    @cached_property
    def edge(self) -> float:
        """Frequency up to which the low-passes are inverted, Hz; infinite where there is none."""
        return edge_of(response(self.inverted, self.rate), self.rate) if self.inverted else math.inf

    def colour(self, crossover: float) -> bool:
        """Whether the noise of the sensor is not white up to a crossover, Hz, as the readings show it.

        It never is behind a high-pass, which takes its slowest part; elsewhere its power at the crossover counts, where
        both channels know the acceleration equally well. That of a resonance enters behind it: its inverse colours it.
        """
        f = np.array([crossover])
        resonances = [item for item in self.inverted if item.kind == "resonance"]
        gain = self.common(f) * np.where(f < ROLL_OFF * self.edge, 1.0, 0.0) / response(resonances, self.rate)(f)
        return bool(not self.rig.coupled or not LEAST_POWER <= abs(gain[0]) ** 2 <= 1.0 / LEAST_POWER)

    @property
    def kernel(self) -> float:
        """Time over which the inverse reaches to either side, s."""
        return 0.0 if math.isinf(self.edge) else KERNEL / ((1.0 - ROLL_OFF) * self.edge)

    def inverse(self, f: Array) -> Spectrum:
        """G/A at frequencies in Hz: the inverse of the low-passes of the output, rolled off at the edge."""
        if not self.inverted:
            return np.ones(f.shape, dtype=np.complex128)
        return inverse_of(response(self.inverted, self.rate), self.edge, f)

    @property
    def of_output(self) -> Response:
        """Gain of everything that the output passes but the one RC that the drive inverts."""
        return response(self.rig.output_filters, self.rate)

    @property
    def of_position(self) -> Response:
        """Gain of everything that the readings pass."""
        return response(self.rig.position_filters, self.reading_rate)

    @property
    def of_high_passes(self) -> Response:
        """Gain of the high-passes of the output."""
        return response(self.blocking, self.rate)

    def common(self, f: Array) -> Spectrum:
        """Gain of the filters through which readings, regressors and the filter's own motion are seen."""
        return np.asarray(self.of_position(f) * self.of_high_passes(f))

    @cached_property
    def at_rest(self) -> float:
        """Share of a constant acceleration that passes; 0 behind a high-pass."""
        return float(np.real(self.common(np.zeros(1))[0])) if self.acts else 1.0

    def undone(self, accel: Channel) -> Channel:
        """The output with its low-passes inverted, at uniform times in each stretch without a hole."""
        return self._passed(accel, self.inverse, 0.0) if self.inverted else accel

    def driving(self, accel: Channel) -> Channel:
        """The output that drives the motion: low-passes inverted, filters of the position applied.

        What lies closer to a hole or an end than the inverse reaches is left out.
        """
        if not self.inverted and not self.rig.position_filters:
            return accel

        def gain(f: Array) -> Spectrum:
            return np.asarray(self.inverse(f) * self.of_position(f))

        return self._passed(accel, gain, self.kernel)

    def _passed(self, accel: Channel, gain: Response, left_out: float) -> Channel:
        step = 1.0 / self.rate
        begins = np.flatnonzero(np.diff(accel.t) > HOLE * step) + 1
        times, values = [np.empty(0)], [np.empty(0)]
        for rows in np.split(np.arange(len(accel.t)), begins):
            t, y = accel.t[rows], accel.y[rows]
            if len(t) < 4 or t[-1] - t[0] <= 2.0 * left_out:
                continue
            t, y = uniform(t, y, step)
            y = applied(y, step, gain, self.settle + self.kernel)
            inner = slice(*np.searchsorted(t, [t[0] + left_out, np.nextafter(t[-1] - left_out, np.inf)]))
            times.append(t[inner])
            values.append(y[inner])
        return Channel(accel.name, np.concatenate(times), np.concatenate(values), accel.unit)

    def behind(self, y: Array, step: float) -> Array:
        """A uniform column `step` s apart behind the common filters, (n,)."""
        return applied(y, step, self.common, self.settle) if self.acts else y

    def behind_output(self, y: Array, step: float) -> Array:
        """A uniform signal of the sensing element behind every filter of the output but the one RC, (n,)."""
        return applied(y, step, self.of_output, self.settle) if self.rig.output_filters else y

    def behind_high_passes(self, y: Array, step: float) -> Array:
        """A uniform column behind the high-passes of the output alone, (n,)."""
        return applied(y, step, self.of_high_passes, self.settle) if self.blocking else y

    def behind_position(self, y: Array, step: float) -> Array:
        """A uniform signal of the motion behind the filters of the position alone, (n,)."""
        return applied(y, step, self.of_position, self.settle) if self.rig.position_filters else y

    def behind_at(self, t: Array, y: Array) -> Array:
        """What is known at the readings `t`, behind the common filters, (n,)."""
        return self._at(t, y, self.common) if self.acts else y

    def blocked(self, t: Array, z: Array) -> Array:
        """Part of readings that the high-passes of the output would remove, (n,) m."""
        return self._at(t, z, lambda f: 1.0 - self.of_high_passes(f)) if self.blocking else np.zeros_like(z)

    def before_position(self, y: Array, step: float) -> Array:
        """A uniform signal that the readings show, before the filters of the position, (n,)."""
        if not self.rig.position_filters:
            return y
        edge = edge_of(self.of_position, self.reading_rate)
        return applied(y, step, lambda f: inverse_of(self.of_position, edge, f), self.settle + KERNEL / edge)

    def _at(self, t: Array, y: Array, gain: Response) -> Array:
        step = 1.0 / self.reading_rate
        at, uniformly = uniform(t, y, step)
        passed = applied(uniformly, step, gain, self.settle)
        return passed if at is t else np.asarray(scipy.interpolate.CubicSpline(at, passed)(t))

    def recoupled(self, motion: Motion, blocked: Array, step: float) -> Motion:
        """Position, velocity, acceleration and jerk with what the high-passes removed, (n,) each.

        The part that a high-pass H removes from each derivative is s (1 - H) of the one before, a proper filter of a
        smoothed signal, so that no noise is differentiated and nothing drifts.

        Parameters
        ----------
        motion : p, v, a and jerk behind the high-passes.
        blocked : what was removed from the position, (n,) m.
        step : spacing, s.
        """
        p, v, a, jerk = motion

        def removed(y: Array, before: float) -> Array:
            return applied(y, step, lambda f: 2j * np.pi * f * (1.0 - self.of_high_passes(f)), self.settle, before)

        p = p + blocked
        v = v + removed(p, float(p[0]))
        a = a + removed(v, 0.0)
        return p, v, a, jerk + removed(a, float(a[0]))

    def transients(self, t: Array) -> list[tuple[Array, Array]]:
        """What is unknown behind a high-pass: a constant that enters behind it, and its state at the start.

        Returns
        -------
        Velocity and position gained over the interval that ends at each of the times (n,) s, of one unit each: of a
        constant, and of each mode exp(pole (t - begin)) from the first time and from the ends of the longest gaps on.
        """
        blocking = high_passes(self.rig.filters)
        if not blocking:
            return []
        h = np.diff(t, prepend=t[0])
        pairs = [(h, h**2 / 2.0)]
        gaps = np.flatnonzero(self.gaps(t))
        longest = gaps[np.argsort(-h[gaps])[:MOST_TRANSIENTS]]
        for begin in (0, *longest):
            since = np.maximum(t - t[begin], 0.0)
            for pole in modes(blocking, self.rate):
                if pole.imag < 0.0:
                    continue
                decay = np.exp(pole * since)
                gained = np.diff(decay, prepend=decay[0]) / pole
                moved = (gained - h * np.concatenate([decay[:1], decay[:-1]])) / pole
                moved[: begin + 1] = 0.0
                pairs += [(gained.real, moved.real)] + ([(gained.imag, moved.imag)] if pole.imag > 0.0 else [])
        return pairs

    def gaps(self, t: Array) -> Flags:
        """Readings that end a gap behind which the high-passed readings are not known, (n,)."""
        if self.rig.coupled:
            return np.zeros(len(t), dtype=np.bool_)
        return np.asarray(np.diff(t, prepend=t[0]) > HOLE / self.reading_rate)


def edge_of(gain: Response, rate: float) -> float:
    """Frequency up to which filters at a rate, both in Hz, can be inverted."""
    f = np.linspace(0.0, 0.5 * rate, 8193)
    size = np.abs(gain(f))
    top = int(np.argmax(size))
    low = top + np.flatnonzero(size[top:] < LEAST_GAIN * size[top])
    return float(f[low[0]] if len(low) else f[-1])


def inverse_of(gain: Response, edge: float, f: Array) -> Spectrum:
    """Inverse of a gain at frequencies in Hz: 1/gain up to 0.7 of the edge, rolled off to zero at the edge; zero where
    a high-pass leaves too little."""
    share = np.clip((f / edge - ROLL_OFF) / (1.0 - ROLL_OFF), 0.0, 1.0)
    taper = 0.5 + 0.5 * np.cos(np.pi * share)
    inverse = gain(f)
    size = np.abs(inverse)
    passed = (share < 1.0) & (size >= LEAST_GAIN * np.max(size[share < 1.0], initial=0.0))
    return np.asarray(np.where(passed, taper / np.where(passed, inverse, 1.0), 0.0))


def uniform(t: Array, y: Array, step: float) -> tuple[Array, Array]:
    """Samples at uniform times `step` s apart from the first to the last; the arrays themselves where they are so."""
    n = round(float(t[-1] - t[0]) / step) + 1
    if n == len(t) and float(np.max(np.abs(t - t[0] - np.arange(n) * ((t[-1] - t[0]) / max(n - 1, 1))))) < (
        GRID_ERROR * step
    ):
        return t, y
    at = t[0] + np.arange(n) * ((t[-1] - t[0]) / max(n - 1, 1))
    return at, np.asarray(scipy.interpolate.CubicSpline(t, y)(at))


def names(filters: Sequence[ChannelFilter]) -> str:
    """Filters in words."""
    return " and ".join(f.name for f in filters)
