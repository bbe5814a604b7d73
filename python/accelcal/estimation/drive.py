"""Encoder readings, and the integrals of acceleration between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from accelcal.data.arrays import Array, Flags

HOLE = 8.0
"""A spacing of accelerometer samples beyond this many periods is a hole; the replay starts anew behind it."""


@dataclass(frozen=True, slots=True)
class DriveIntegrals:
    """Encoder readings and the integrals of acceleration between them."""

    t: Array
    z: Array
    first: Array
    """Velocity gained over the interval that ends at each reading, m/s."""
    second: Array
    """Position gained over it beyond v h, m."""
    restart: Flags
    """Where the accelerometer record does not reach across the interval."""

    @property
    def arrays(self) -> tuple[Array, Array, Array, Array, Flags]:
        """In the order that the core takes them."""
        return self.t, self.z, self.first, self.second, self.restart

    def settled(self, wait: float) -> Flags:
        """Readings later than `wait` behind the last start; of a short stretch at least the last four fifths."""
        wait = min(wait, 0.2 * float(self.t[-1] - self.t[0]))
        begins = np.flatnonzero(self.restart)
        last = begins[np.searchsorted(begins, np.arange(len(self.t)), side="right") - 1]
        return np.asarray(self.t > self.t[last] + wait)

    def part(self, rows: slice) -> DriveIntegrals:
        """A stretch of it, starting anew."""
        restart = self.restart[rows].copy()
        restart[0] = True
        return DriveIntegrals(self.t[rows], self.z[rows], self.first[rows], self.second[rows], restart)
