"""The filter of a live view, fed row by row in the order of events that a run over the record has."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from accelcal._support.errors import AccelcalError
from accelcal.data.arrays import Array
from accelcal.filters.stream import LiveFilter
from accelcal.io.stream_lines import Rows
from accelcal.live.regressor import OutputMoments, RegressorBias
from accelcal.live.settings import LiveSettings
from accelcal.model import Estimate

OUTPUT, READING = 0, 1
"""Kinds of events; at a tie the output comes first."""
MOST_BETWEEN = 63
"""Readings between two outputs that the filter has room for, beside the output itself."""
Event = tuple[float, int, float]
"""Time in s, kind, value in SI."""


@dataclass(frozen=True, slots=True)
class Innovation:
    """One reading that the filter took in."""

    t: float
    """s"""
    e: float
    """Reading minus expectation, m."""
    variance: float
    """That the model expects, m²."""


class Tracker:
    """A `LiveFilter` on rows of a stream.

    It starts at the last output before the first reading. What comes out equals `filters.run` on the same rows with the
    same settings, bit for bit: stamps of the output minus `settings.offset`, `settings.stage_output` of its values.

    Parameters
    ----------
    settings : of the filter.
    """

    def __init__(self, settings: LiveSettings) -> None:
        self.settings = settings
        self.filter: LiveFilter | None = None
        """None before the first reading."""
        self.outputs, self.readings = 0, 0
        self.untested = 0
        """Readings taken in whose innovation is not known: all but the last of those between two outputs."""
        self.refused = 0
        """Events that the filter refused; its state is as it was before them."""
        self.refusal = ""
        """What it said of the last of them."""
        self.moments = OutputMoments()
        self._scale = 2 + settings.names.index("k")
        self._first: tuple[float, float] | None = None
        self._waiting: list[tuple[float, float]] = []
        """Time and expected variance of the readings that wait for the next output."""
        self._held_back: list[Event] = []
        self._output = 0.0

    def feed(self, rows: Rows) -> list[Innovation]:
        """Take rows in; return the innovations that they led to, which lag by one output."""
        self.moments.add(rows)
        return self._take(self._released(rows))

    def finish(self) -> list[Innovation]:
        """Take in what still waits, as at the end of a record."""
        found = self._take(iter(sorted(self._held_back)))
        self._held_back = []
        if self.filter is not None:
            try:
                self._settle(self.filter.finish(), found)
            except (ValueError, ArithmeticError) as error:
                self._refuse(error)
        return found

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """Parameters of the sensor with standard deviations, which contain the bias by noise of the output; before the
        first reading those of the start."""
        if self.filter is None:
            return self.settings.estimates(*self.settings.start(0.0, 0.0))
        return self.settings.estimates(self.filter.estimate, self.covariance)

    @property
    def covariance(self) -> Array:
        """Covariance of all states of the filter, (N, N), with the square of what noise of the output biases the scale
        factor by."""
        assert self.filter is not None
        found = self.filter.covariance.copy()
        bias = self.regressor_bias
        found[self._scale, self._scale] += 0.0 if bias is None else bias.value**2
        return found

    @property
    def regressor_bias(self) -> RegressorBias | None:
        """What noise of the output biases the scale factor by; None before there is motion."""
        if self.filter is None:
            return None
        return self.moments.bias(self.settings, float(self.filter.covariance[self._scale, self._scale]))

    def _released(self, rows: Rows) -> Iterator[Event]:
        """Events of the rows in time order, kept back as long as one before them may still come."""
        offset = self.settings.offset
        cells = zip(rows.t.tolist(), rows.accel.tolist(), rows.position.tolist(), strict=True)
        if offset == 0.0:
            for t, u, z in cells:
                if u == u:
                    yield t, OUTPUT, u
                if z == z:
                    yield t, READING, z
            return
        for t, u, z in cells:
            if u == u:
                self._held_back.append((t - offset, OUTPUT, u))
            if z == z:
                self._held_back.append((t, READING, z))
        if len(rows):
            newest = float(rows.t[-1])
            settled = min(newest, newest - offset)
            self._held_back.sort()
            ready = sum(event[0] <= settled for event in self._held_back)
            yield from self._held_back[:ready]
            del self._held_back[:ready]

    def _take(self, events: Iterator[Event]) -> list[Innovation]:
        found: list[Innovation] = []
        for t, kind, value in events:
            try:
                if kind == OUTPUT:
                    self._take_output(t, self.settings.stage_output(value), found)
                else:
                    self._take_reading(t, value)
            except (ValueError, ArithmeticError) as error:
                self._refuse(error)
        return found

    def _take_output(self, t: float, u: float, found: list[Innovation]) -> None:
        self.outputs += 1
        if self.filter is None:
            self._first = t, u
            return
        self._output = u
        self._settle(self.filter.step(t, accel=u), found)

    def _take_reading(self, t: float, z: float) -> None:
        if self.filter is None:
            self._start(t, z)
        assert self.filter is not None
        if len(self._waiting) == MOST_BETWEEN:
            raise AccelcalError(f"more than {MOST_BETWEEN} readings without an output between them")
        variance = self._expected_variance(t)
        self.filter.step(t, position=z)
        self._waiting.append((t, variance))
        self.readings += 1

    def _settle(self, e: float | None, found: list[Innovation]) -> None:
        """The filter took in all that waited; `e` is the innovation of the last reading of it."""
        if e is not None and self._waiting:
            t, variance = self._waiting[-1]
            if len(self._waiting) == 1:
                found.append(Innovation(t, e, variance))
            else:
                self.untested += len(self._waiting)
        self._waiting.clear()

    def _start(self, t: float, z: float) -> None:
        """Begin at the last output before the first reading, or at the reading where there is none."""
        settings = self.settings
        began = t if self._first is None else self._first[0]
        x0, P0 = settings.start(z, t - began)
        self.filter = LiveFilter(
            settings.choice,
            q=settings.q,
            r_position=settings.r_position,
            x0=x0,
            P0=P0,
            tau=settings.tau,
            parameters=settings.parameters,
        )
        if self._first is not None:
            self._output = self._first[1]
            self.filter.step(self._first[0], accel=self._first[1])

    def _expected_variance(self, t: float) -> float:
        """Variance of the innovation of a reading at `t` (s), m²: exact at the stamp of an output.

        Between outputs the state is carried on by the motion that the last output drives, to first order in the
        parameters, which is good to a part in a thousand of what they add.
        """
        assert self.filter is not None
        settings, P = self.settings, self.filter.covariance
        time, tau = self.filter.time, settings.tau
        h = 0.0 if time is None else t - time
        if h <= 0.0:
            p, pv, v = float(P[0, 0]), float(P[0, 1]), float(P[1, 1])
            return p + 2.0 * tau * pv + tau**2 * v + settings.r_position
        gradient, slope = self._acceleration_gradient()
        row = np.concatenate([[1.0, h + tau], (h**2 / 2.0 + tau * h) * gradient])
        added = settings.q * ((h + tau) ** 3 - tau**3) / 3.0 / slope**2
        return float(row @ P @ row) + added + settings.r_position

    def _acceleration_gradient(self) -> tuple[Array, float]:
        """Gradient of the acceleration by the parameters at the last output, (m,), and d output / d acceleration."""
        assert self.filter is not None
        theta = dict(zip(self.settings.names, self.filter.estimate[2:].tolist(), strict=True))
        a = (self._output - theta["K0"]) / (1.0 + theta["k"])
        slope = 1.0 + theta["k"] + 2.0 * theta.get("K2", 0.0) * a + 3.0 * theta.get("K3", 0.0) * a * a
        powers = {"k": a, "K0": 1.0, "K2": a * a, "K3": a * a * a}
        return np.array([-powers[name] / slope for name in self.settings.names]), slope

    def _refuse(self, error: Exception) -> None:
        self.refused += 1
        self.refusal = str(error)
        waiting = 0 if self.filter is None else self.filter.waiting
        del self._waiting[: max(0, len(self._waiting) - waiting)]


def normalised(innovation: Innovation) -> float:
    """An innovation in standard deviations."""
    return innovation.e / math.sqrt(innovation.variance)
