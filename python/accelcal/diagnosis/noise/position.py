"""Noise of the encoder: its interpolation error, a wave over position, and innovations that are not white."""

from __future__ import annotations

import math

import numpy as np
import scipy

from accelcal.data import Array, in_usual_unit
from accelcal.diagnosis.noise.noise_test import POSITION_WAVE, WHITENESS, NoiseTest
from accelcal.diagnosis.noise.residuals import Residuals
from accelcal.diagnosis.noise.spectra import local_level, pair_fit
from accelcal.diagnosis.policy import (
    MOST_HARMONICS,
    NOISE_TEST_ALPHA,
    NOISE_TEST_LEAST_BLOCKS,
    RECORD_PARTS,
    REPEATED_LEAST_SHARE,
)
from accelcal.diagnosis.search.beam import block_length, block_sums, shrunk_inflation
from accelcal.diagnosis.search.homogeneity import PartSizes
from accelcal.effects import HARMONICS
from accelcal.effects.building_blocks import harmonics_of
from accelcal.estimation.columns import gradient_in_readings, whitened_reading_errors

SHORTEST, LONGEST = 2e-6, 5e-3
"""Periods that are tested, m; the shortest is at least three counts."""
PERIODS = 64
"""Neighbouring periods over which the level of the spectrum is taken.

Rests at few places give a strong line side lobes over all of them, so the level over sixteen times as many counts where
it is lower.
"""
MOST_CELLS = 2**19
"""Cells of position; a longer travel raises the shortest period."""


def encoder_cyclic(residuals: Residuals) -> NoiseTest:
    """Test for an error periodic in position (derivations 7.4): a spectrum of the innovations over position, not time.

    The score of every period is one transform of the innovations, referred back through the filter, over cells of
    position; the best periods are fitted with exact columns of the replay. Null: twice the log-likelihood gained is
    chi-square with two degrees of freedom, times the number of periods.
    """
    travel = float(np.ptp(residuals.smooth_position[residuals.state.counts]))
    shortest = max(SHORTEST, 3.0 * residuals.run.least_step, 12.0 * travel / MOST_CELLS)
    nothing = NoiseTest(POSITION_WAVE, 0.0, 1.0, 0.0, "m", math.inf, "the travel is too short for this test")
    if travel < 8.0 * shortest or len(residuals.readings) < 256:
        return nothing
    cell = shortest / 6.0
    cells = over_position(residuals, cell, travel)
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
            best = max(best, cyclic_fit(residuals, trial), key=lambda f: f[0])
    gained, amplitude, std, at = best
    phase = 2.0 * np.pi * at * residuals.smooth_position
    columns = whitened_reading_errors(residuals.state, [np.cos(phase), np.sin(phase)])
    scatter, sizes = steadiness(columns, residuals.readings, residuals)
    gained /= scatter
    # an error of the scale is the same whenever the stage comes by; rounding to counts is itself a wave over position,
    # and rests sample it at few places
    possible = sizes.homogeneous and not amplitude < 0.5 * residuals.run.rounding
    p_value = min(1.0, len(spectrum) * math.exp(-0.5 * gained)) if possible else 1.0
    text = "no cyclic error of the encoder"
    parts = {"period": 1.0 / at, "period_std": 0.55 / (math.sqrt(max(gained, 1.0)) * travel * at**2)}
    if p_value < NOISE_TEST_ALPHA:
        text = (
            f"the encoder errs by {in_usual_unit(amplitude, 'm', 2)} with a period of {in_usual_unit(1.0 / at, 'm', 4)}"
        )
        highest, refined = highest_harmonic(residuals, at, 0.2 * step, shortest)
        if highest > 1:
            parts |= {"period": 1.0 / refined, HARMONICS: float(highest)}
            text += f" and harmonics of it up to number {highest}"
    return NoiseTest(POSITION_WAVE, gained, p_value, amplitude, "m", std, text, parts)


def over_position(residuals: Residuals, cell: float, travel: float) -> Array:
    """Innovations, referred back through the filter, over cells of position and a quarter of the travel (m) more."""
    n = scipy.fft.next_fast_len(int(travel / cell) + 2 + int(0.25 * travel / cell), real=True)
    reading_score = gradient_in_readings(residuals.state, residuals.readings)
    p = residuals.smooth_position[residuals.state.counts]
    place = (p - p.min()) / cell
    low = place.astype(np.intp)
    share = place - low
    return np.asarray(
        np.bincount(low, reading_score * (1.0 - share), n) + np.bincount(low + 1, reading_score * share, n)
    )


def highest_harmonic(residuals: Residuals, kappa: float, reach: float, shortest: float) -> tuple[int, float]:
    """The highest significant multiple of a wave, 1 without any, and 1/period where all of them fit best.

    All harmonics are fitted together; what each gains beside the others has, times their number, the null of the wave
    itself. The smoothed position contains the wave, which so makes harmonics of its own: amplitude a times
    (2 pi a kappa)^(n - 1) bounds them from above.

    Parameters
    ----------
    residuals : of the fit without the wave.
    kappa, reach : 1/period, m⁻¹, and how far from it it may lie.
    shortest : period that the test resolves, m.
    """
    most = min(MOST_HARMONICS, int(1.0 / (kappa * shortest)))
    if most < 2:
        return 1, kappa
    y = residuals.readings

    def left(at: float) -> float:
        X, c = harmonic_fit(residuals, at, most)
        return float(np.sum((y - X @ c) ** 2))

    at = min((kappa + reach * np.linspace(-1.0, 1.0, 5)).tolist(), key=left)
    X, c = harmonic_fit(residuals, at, most)
    rest = y - X @ c
    covariance = np.linalg.inv(X.T @ X) * float(np.mean(rest**2))
    sizes = np.hypot(c[::2], c[1::2])

    def significant(n: int) -> bool:
        rows = slice(2 * n - 2, 2 * n)
        scatter, in_parts = steadiness(X[:, rows], rest + X[:, rows] @ c[rows], residuals)
        gain = float(c[rows] @ np.linalg.solve(covariance[rows, rows], c[rows])) / scatter
        p_value = (most - 1) * math.exp(-0.5 * gain)
        least = max(0.5 * residuals.run.rounding, sizes[0] * (2.0 * np.pi * sizes[0] * at) ** (n - 1))
        return p_value < NOISE_TEST_ALPHA and in_parts.homogeneous and bool(sizes[n - 1] > least)

    return next((n for n in range(most, 1, -1) if significant(n)), 1), at


def harmonic_fit(residuals: Residuals, kappa: float, most: int) -> tuple[Array, Array]:
    """Columns of a wave and its harmonics up to `most`, (n, 2 most), and their coefficients, m."""
    columns = harmonics_of(2.0 * np.pi * kappa * residuals.smooth_position, most)
    X = whitened_reading_errors(residuals.state, list(np.ascontiguousarray(columns.T)))
    return X, np.asarray(np.linalg.lstsq(X, residuals.readings, rcond=None)[0], dtype=np.float64)


def steadiness(X: Array, y: Array, residuals: Residuals) -> tuple[float, PartSizes]:
    """How much more the scores of a wave scatter from block to block than white noise, at least 1; its sizes in parts
    of the record.

    Parameters
    ----------
    X, y : its two whitened columns (n, 2), and what they are to explain (n,).
    residuals : whose readings these are.
    """
    c, *_ = np.linalg.lstsq(X, y, rcond=None)
    u, level = X @ c, float(np.mean(y**2))
    scores, information = u * (y - u) / level, u**2 / level
    t = residuals.run.t[residuals.state.counts]
    t = t - t[0]
    (_, by_block), (_, power) = (block_sums(x[None], t, block_length(residuals.state)) for x in (scores, information))
    power = np.maximum(power[0], 1e-300)
    scatter = float(shrunk_inflation(float(by_block[0] @ by_block[0]) / float(np.sum(power)), power))
    part = np.minimum((t * (RECORD_PARTS / max(float(t[-1]), 1e-9))).astype(np.intp), RECORD_PARTS - 1)
    by_part, excited = (np.asarray(np.bincount(part, x, RECORD_PARTS)) / scatter for x in (scores, information))
    return scatter, PartSizes.of(by_part, excited)


def cyclic_fit(residuals: Residuals, kappa: float) -> tuple[float, float, float, float]:
    """Gain of twice the log-likelihood, amplitude, its standard deviation, and 1/period, by exact columns."""
    phase = 2.0 * np.pi * kappa * residuals.smooth_position
    X = whitened_reading_errors(residuals.state, [np.cos(phase), np.sin(phase)])
    return (*pair_fit(X, residuals.readings), kappa)


LAGS = 5
"""Lags on each time scale."""
MEMORIES = 2.0
"""Memories of the filter from which on sums of innovations are compared, behind a coarse encoder."""


def whiteness(residuals: Residuals) -> NoiseTest:
    """Autocorrelation of the whitened innovations, at full rate and over ever longer block sums (Ljung and Box 1978).

    Each lag is scaled by its own sum of squared products, so that noise of varying level does not count as colour.
    Null: chi-square with five degrees of freedom on each scale, times the number of scales.
    """
    if residuals.run.filters.colour(residuals.run.crossover(residuals.state.noise)):
        return NoiseTest(
            WHITENESS,
            0.0,
            1.0,
            0.0,
            "",
            math.inf,
            "declared filters colour the noise; whether it is white is not tested",
        )
    y, step = residuals.innovations
    scales: dict[int, tuple[float, float]] = {}
    length, least = 1, shortest_scale(residuals)
    while length < least:
        length *= 4
    while len(y) // length >= 4 * NOISE_TEST_LEAST_BLOCKS:
        K = len(y) // length
        sums = y[: K * length].reshape(K, length).sum(axis=1)
        scales[length] = portmanteau(sums)
        length *= 4
    if not scales:
        return NoiseTest(WHITENESS, 0.0, 1.0, 0.0, "", math.inf, "too few readings for this test")
    worst = min(scales, key=lambda k: scales[k][1])
    Q, p = scales[worst]
    p = min(1.0, p * len(scales))
    lag = worst * step
    first = float(np.mean(y[1:] * y[:-1]) / np.mean(y**2))
    text = (
        f"innovations are correlated over {lag:.2g} s and longer"
        if p < NOISE_TEST_ALPHA
        else "the innovations are white"
    )
    parts = {"scale": lag, **{f"p_{k}": value[1] for k, value in scales.items()}}
    return NoiseTest(WHITENESS, Q, p, first, "", 1.0 / math.sqrt(len(y)), text, parts)


def shortest_scale(residuals: Residuals) -> float:
    """Readings from which on colour is tested: 1, or more than the filter averages over where a coarse encoder repeats
    its counts while it moves. Its rounding errors then follow the position, and are white over longer times only."""
    run = residuals.run
    moving = np.count_nonzero(np.diff(run.z) == 0.0) / len(run.z) if run.rounding > 0.0 else 0.0
    if moving < REPEATED_LEAST_SHARE:
        return 1.0
    return MEMORIES / (2.0 * math.pi * run.crossover(residuals.state.noise) * run.reading_step)


def portmanteau(y: Array) -> tuple[float, float]:
    """Sum of squared autocorrelations, each over its own variance, and its probability in white noise."""
    y = y - y.mean()
    Q = 0.0
    for lag in range(1, LAGS + 1):
        products = y[lag:] * y[:-lag]
        Q += float(products.sum()) ** 2 / max(float(np.sum(products**2)), 1e-300)
    return Q, float(scipy.special.gammaincc(0.5 * LAGS, 0.5 * Q))
