"""The encoder's interpolation error: a wave in position."""

from __future__ import annotations

import math

import numpy as np
import scipy

from accelcal.adjoint import asked_of_readings
from accelcal.channels.finding import ALARM, ChannelFinding
from accelcal.channels.lines import carried, local_level, pair_fit
from accelcal.channels.residuals import Residuals
from accelcal.recording import Array

SHORTEST, LONGEST = 2e-6, 5e-3
"""Periods of the scale that are looked for, m; the shortest is at least three counts."""
PERIODS = 64
"""Neighbouring periods over which the level of the spectrum is taken; rests at few places give a strong line side lobes
over all of them, so the level over sixteen times as many counts where it is lower."""
MOST_CELLS = 2**19
"""Cells of position; a longer travel raises the shortest period."""


def encoder_cyclic(seen: Residuals) -> ChannelFinding:
    """Error periodic in position (physics G2): a spectrum of the innovations over position, not time.

    The score of every period is one transform of the innovations, taken back through the filter, over cells of
    position; the best periods are taken again with exact columns of the replay. Null: twice the log-likelihood gained
    is chi-square with two degrees of freedom, times the number of periods looked at.
    """
    travel = float(np.ptp(seen.smooth_position[seen.state.counts]))
    shortest = max(SHORTEST, 3.0 * seen.run.least_step, 12.0 * travel / MOST_CELLS)
    nothing = ChannelFinding("encoder_cyclic", 0.0, 1.0, 0.0, "m", math.inf, "the travel is too short to tell")
    if travel < 8.0 * shortest or len(seen.readings) < 256:
        return nothing
    cell = shortest / 6.0
    cells = over_position(seen, cell, travel)
    kappa = np.fft.rfftfreq(len(cells), cell)
    rows = slice(*np.searchsorted(kappa, [max(1.0 / LONGEST, 4.0 / travel), 1.0 / shortest]))
    spectrum = np.abs(scipy.fft.rfft(cells)[rows]) ** 2
    if len(spectrum) < PERIODS:
        return nothing
    spectrum /= np.minimum(*(local_level(spectrum, several)[0] for several in (PERIODS, 16 * PERIODS)))
    best = (0.0, 0.0, 0.0, 0.0)
    step = float(kappa[1])
    tops = np.argsort(-spectrum)[:2]
    chance = len(spectrum) * np.exp(-spectrum[tops])
    for k in tops if chance[0] < 0.01 else tops[:1]:
        for shift in (-0.35, 0.0, 0.35) if chance[0] < 0.01 else (0.0,):
            trial = float(kappa[rows][k]) + shift * step
            best = max(best, cyclic_fit(seen, trial), key=lambda f: f[0])
    gained, amplitude, std, at = best
    p_value = min(1.0, len(spectrum) * math.exp(-0.5 * gained))
    found = p_value < ALARM
    text = f"the encoder errs by {amplitude * 1e6:.2g} um with a period of {1e6 / at:.4g} um" if found else "none found"
    parts = {"wavelength": 1.0 / at, "wavelength_std": 0.55 / (math.sqrt(max(gained, 1.0)) * travel * at**2)}
    return ChannelFinding("encoder_cyclic", gained, p_value, amplitude, "m", std, text, parts)


def over_position(seen: Residuals, cell: float, travel: float) -> Array:
    """Innovations, taken back through the filter, over cells of position and a quarter of the travel (m) more."""
    n = scipy.fft.next_fast_len(int(travel / cell) + 2 + int(0.25 * travel / cell), real=True)
    wanted = asked_of_readings(seen.state, seen.readings)
    p = seen.smooth_position[seen.state.counts]
    place = (p - p.min()) / cell
    low = place.astype(np.intp)
    share = place - low
    return np.asarray(np.bincount(low, wanted * (1.0 - share), n) + np.bincount(low + 1, wanted * share, n))


def cyclic_fit(seen: Residuals, kappa: float) -> tuple[float, float, float, float]:
    """Gain of twice the log-likelihood, amplitude, its standard deviation, and 1/period, by exact columns."""
    phase = 2.0 * np.pi * kappa * seen.smooth_position
    X = carried(seen, [], [np.cos(phase), np.sin(phase)], seen.step)
    return (*pair_fit(X, seen.readings), kappa)
