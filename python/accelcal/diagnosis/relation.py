"""Relation of output and encoder in bands of frequency, block by block: changes of either show in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from accelcal import _core
from accelcal.data import Array
from accelcal.estimation.drive import DriveIntegrals, drive, run_filter
from accelcal.estimation.run import PreparedRun
from accelcal.estimation.values import Noise, Values

BANDS_PER_DECADE = 4
"""Bands in a decade of frequency in which output and position are compared."""
MOST_BLOCKS = 512
"""Blocks of a scan; longer records have longer blocks."""


class RelationColumns:
    """Columns that drive a filter of any band: encoder, output, its first and second difference, a constant."""

    def __init__(self, run: PreparedRun) -> None:
        self.run = run
        shift = run.accel_step
        late, plain, early = (drive(run, Values({"time_offset": d}), None) for d in (-shift, 0.0, shift))
        gone = late.restart | plain.restart | early.restart
        h: Array = np.where(gone, 0.0, np.diff(plain.t, prepend=plain.t[0]))
        zero = np.zeros_like(h)
        integrals = [
            (plain.first, plain.second),
            (early.first - late.first, early.second - late.second),
            (early.first + late.first - 2.0 * plain.first, early.second + late.second - 2.0 * plain.second),
            (h, h**2 / 2.0),
        ]
        moving, extra = ~gone, plain.extra_q
        self.drives = [
            DriveIntegrals(plain.t, zero, first * moving, second * moving, gone, extra) for first, second in integrals
        ]
        self.drives.append(DriveIntegrals(plain.t, np.ascontiguousarray(plain.z - plain.z[0]), zero, zero, gone, extra))

    def in_band(self, band: float) -> BandRelation:
        """Innovations of each column behind a filter whose crossover is `band`, Hz."""
        run = self.run
        r = run.reading_variance_guess
        noise = Noise((2.0 * np.pi * band) ** 4 * r * run.reading_step, r)
        settled = self.drives[0].settled(run.wait(noise))
        drives = [column.arrays for column in self.drives]
        innovations = _core.innovations(drives, q=noise.q, r=noise.r, prior=run.prior(noise.r))
        rows = innovations[:, settled]
        size = np.sqrt(np.einsum("ik,ik->i", rows, rows) / max(1, rows.shape[1]))
        size = np.where(size > 0.0, size, 1.0)
        rows /= size[:, None]
        return BandRelation(run.t[settled], rows.T, size, band)

    def response(self, band: float, z: NDArray[np.bool_]) -> Array:
        """Innovations caused by readings of this shape, one unit high, from the middle of the shape on; readings are
        even."""
        run = self.run
        r = run.reading_variance_guess
        noise = Noise((2.0 * np.pi * band) ** 4 * r * run.reading_step, r)
        before = 20 * len(z)
        reading = np.concatenate([np.zeros(before), z.astype(np.float64)])
        zero = np.zeros_like(reading)
        begins = zero > 0.0
        begins[0] = True
        t: Array = np.arange(len(reading), dtype=np.float64) * run.reading_step
        return run_filter(run, DriveIntegrals(t, reading, zero, zero, begins, zero), noise).series("e")[
            before + len(z) // 2 :
        ]


@dataclass(frozen=True, slots=True)
class BandRelation:
    """Encoder innovations and the columns that should explain them, in one band."""

    t: Array
    """Times of settled readings, (n,) s."""
    columns: Array
    """(n, 5): output, its first and second difference, constant, encoder; each of unit mean square."""
    size: Array
    """(5,) root mean square by which each column was divided, m."""
    band: float
    """Hz"""

    def blocks(self, most: int) -> tuple[Array, Array]:
        """Sums of products over blocks of at least one period of the band, and their edges.

        Returns
        -------
        (K, 6, 6) products of the columns, the last row and column counting readings; (K + 1,) s.
        """
        span = float(self.t[-1] - self.t[0]) if len(self.t) > 1 else 0.0
        K = int(min(most, span * self.band))
        if K < 1:
            return np.zeros((0, 6, 6)), np.zeros(1)
        edges = np.linspace(self.t[0], self.t[-1], K + 1)
        begin = np.searchsorted(self.t, edges[:-1])
        X = self.columns
        gram = np.zeros((K, 6, 6))
        filled = np.diff(begin, append=len(self.t)) > 0
        for i in range(5):
            for j in range(i + 1):
                sums = np.add.reduceat(X[:, i] * X[:, j], begin[filled])
                gram[filled, i, j] = gram[filled, j, i] = sums
        gram[:, 5, 5] = np.diff(begin, append=len(self.t))
        return gram, edges

    def power(self, gram: Array, c: Array) -> Array:
        """Mean square residual of each block under one relation; empty blocks are skipped."""
        gram = gram[gram[:, 5, 5] > 0]
        X, y, yy = gram[:, :4, :4], gram[:, :4, 4], gram[:, 4, 4]
        total = yy - 2.0 * (y @ c) + np.einsum("kij,i,j->k", X, c, c)
        return np.asarray(np.maximum(total, 0.0) / gram[:, 5, 5])

    def departure(self, c: Array, power: float, interval: tuple[float, float]) -> float:
        """Most likely instant in `interval` from which readings depart from a relation whose residual had this power,
        s."""
        rows = slice(*np.searchsorted(self.t, interval))
        squares = (self.columns[rows, 4] - self.columns[rows, :4] @ c) ** 2
        behind = np.cumsum(squares[::-1])[::-1]
        count = np.arange(len(squares), 0, -1)
        mean_square = np.maximum(behind / count, power)
        gain = 0.5 * (behind / power - count * (1.0 + np.log(mean_square / power)))
        return float(self.t[rows][int(np.argmax(gain))])


def _solve(gram: Array) -> Array:
    """Coefficients of the four columns; a small ridge keeps a column without power from deciding."""
    A = gram[..., :4, :4]
    ridge = 1e-9 * np.trace(A, axis1=-2, axis2=-1)[..., None, None] * np.eye(4) + 1e-300 * np.eye(4)
    return np.asarray(np.linalg.solve(A + ridge, gram[..., :4, 4][..., None])[..., 0])


def unexplained(gram: Array) -> tuple[Array, Array]:
    """Sum of squares that the best relation leaves, and the share of the variance that it explains; (K,)."""
    c = _solve(gram)
    left = np.maximum(gram[:, 4, 4] - np.einsum("ki,ki->k", c, gram[:, :4, 4]), 1e-12 * gram[:, 4, 4] + 1e-300)
    constant = gram[:, 3, 4] ** 2 / np.maximum(gram[:, 3, 3], 1e-300)
    moved = np.maximum(gram[:, 4, 4] - constant, 1e-300)
    return left, 1.0 - left / moved
