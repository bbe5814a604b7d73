"""Innovation log-likelihood of the two noises over blocks that are spread over a record."""

from __future__ import annotations

import math

import numpy as np

from accelcal import _core
from accelcal.data.arrays import Flags
from accelcal.estimation.drive import DriveIntegrals
from accelcal.estimation.run import PreparedRun
from accelcal.estimation.values import Noise

BLOCKS = 16
"""Number of blocks over which the likelihood is taken, spread over the whole record."""
BLOCK_READINGS = 2048
"""Least number of readings in a block."""
BLOCK_SPAN = 50.0
"""Least length of a block in time constants of the filter."""


class Likelihood:
    """Innovation log-likelihood over blocks spread over a record, as a function of log q and log R."""

    def __init__(self, run: PreparedRun, integrals: DriveIntegrals, near: Noise, counts: Flags | None) -> None:
        self.run = run
        parts = [(integrals.part(rows), count) for rows, count in counted_blocks(run, integrals, near, counts)]
        self.count = int(sum(count.sum() for _, count in parts))
        self.parts = _core.Parts([(part.arrays, count) for part, count in parts])

    def __call__(self, log_q: float, log_r: float) -> float:
        q, r = math.exp(log_q), math.exp(log_r)
        return self.parts.log_likelihood(q=q, r=r, prior=self.run.prior(r))

    def spread(self, at: Noise) -> tuple[float, float]:
        """Standard deviations of log q and log R from the curvature of the likelihood."""
        x, h = np.log([at.q, at.r]), 0.05
        f = {(i, j): self(x[0] + i * h, x[1] + j * h) for i in (-1, 0, 1) for j in (-1, 0, 1)}
        qq = -(f[1, 0] - 2 * f[0, 0] + f[-1, 0]) / h**2
        rr = -(f[0, 1] - 2 * f[0, 0] + f[0, -1]) / h**2
        qr = -(f[1, 1] - f[1, -1] - f[-1, 1] + f[-1, -1]) / (4 * h**2)
        det = qq * rr - qr**2
        if not (qq > 0.0 and rr > 0.0 and det > 0.0):
            return math.inf, math.inf
        return math.sqrt(rr / det), math.sqrt(qq / det)


def blocks(n: int, length: int) -> list[slice]:
    """At most 16 blocks of equal length, evenly spread; one block when the record is short."""
    if n <= BLOCKS * length:
        return [slice(0, n)]
    starts = np.linspace(0, n - length, BLOCKS).astype(int)
    return [slice(int(s), int(s) + length) for s in starts]


def counted_blocks(
    run: PreparedRun, integrals: DriveIntegrals, near: Noise, counts: Flags | None = None
) -> list[tuple[slice, Flags]]:
    """Blocks of readings, and which of each count: those that have settled at a noise, among `counts` (n,) if given."""
    span = BLOCK_SPAN / (2.0 * np.pi * run.crossover(near)) / run.reading_step
    found = []
    for rows in blocks(len(run.t), int(max(BLOCK_READINGS, span))):
        settled = integrals.part(rows).settled(run.wait(near))
        if counts is not None:
            settled = settled & counts[rows]
        if settled.any():
            found.append((rows, np.ascontiguousarray(settled)))
    return found
