"""Noise of the position that is not white: told from a noisier sensor by where the residual lies in frequency."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
import scipy

from accelcal.data.arrays import Array
from accelcal.diagnosis.evidence import Evidence, noise_ratio
from accelcal.diagnosis.policy import CLEAR_LOG_EVIDENCE, DATA_SHEET_NOISE_RATIO
from accelcal.estimation.remarks import Remark, remark
from accelcal.estimation.run import prepared
from accelcal.signals.processing import ORDER
from accelcal.validation.comparison import Evaluation
from accelcal.validation.evaluation import compare

TRIAL_TIMES = 12
"""Correlation times that are tried, from two readings to a quarter of the record."""
SEGMENTS = 8
"""Segments of the averaged spectrum."""
BAND_SHARE = 0.2
"""Of the rate of the readings: as far as their second derivative is resolved."""


def coloured_position(e: Evidence) -> Iterator[Remark]:
    """Noise of the position that is not white; no remark where a noisier sensor explains the residual as well.

    Notes
    -----
    White noise of the sensor is flat in the residual acceleration, white noise of a reading rises with f⁴, and a
    Gauss-Markov process on the reading with f² above its corner. Two models of that spectrum are compared by Whittle's
    likelihood: a sensor of any noise with white readings, and a sensor as declared with white and Gauss-Markov noise of
    the readings, which must gain `CLEAR_LOG_EVIDENCE` (tests/diagnosis/test_position_noise.py).
    """
    fit, span, declared = e.fit, e.span, e.recording.rig.sensor.noise
    if declared is None or noise_ratio(fit) <= DATA_SHEET_NOISE_RATIO:
        return
    if not e.scan.enough or e.recording.reference is not None:
        return
    step = prepared(e.sources[0], fit.origins, start=span[0], end=span[1]).reading_step  # compare takes the replay
    spectrum = residual_spectrum(compare(fit, e.sources[0], band=BAND_SHARE / step, start=span[0], end=span[1]), step)
    if spectrum is None:
        return
    f, density, averages = spectrum
    w4 = (2.0 * np.pi * f) ** 4
    passed = 1.0 / (1.0 + (f / (BAND_SHARE / step)) ** (2 * ORDER)) ** 2
    flat, reading = np.ones_like(f), 2.0 * step * w4
    start = declared**2, fit.noise().r
    _, by_sensor = most_likely(density / passed, averages, np.zeros_like(f), (flat, reading), start)
    best: tuple[float, float, float] | None = None
    for tau in np.geomspace(2.0 * step, 0.25 * (span[1] - span[0]), TRIAL_TIMES):
        process = 4.0 * tau * w4 / (1.0 + (2.0 * np.pi * f * tau) ** 2)
        sizes, likelihood = most_likely(
            density / passed, averages, declared**2 * flat, (process, reading), (1e-2 * fit.noise().r, fit.noise().r)
        )
        if best is None or likelihood > best[0]:
            best = likelihood, math.sqrt(float(sizes[0])), float(tau)
    if best is not None and best[0] - by_sensor >= CLEAR_LOG_EVIDENCE:
        yield remark("coloured_position", rms=best[1], tau=best[2], log_evidence=best[0] - by_sensor)


def residual_spectrum(seen: Evaluation, step: float) -> tuple[Array, Array, float] | None:
    """Frequencies, density of the residual acceleration, and independent averages in it; None where it is too short."""
    _, residual = seen.accel_residual
    segment = 2 * len(residual) // (SEGMENTS + 1)
    if segment < 64:
        return None
    f, density = scipy.signal.welch(residual, fs=1.0 / step, nperseg=segment)
    inside = (f > 2.5 / (segment * step)) & (f < BAND_SHARE / step)
    # neighbouring ordinates of a Hann window and overlapping segments share a third and a tenth of their power
    return f[inside], density[inside], SEGMENTS / (1.5 * 1.1)


def most_likely(
    density: Array, averages: float, known: Array, parts: tuple[Array, Array], start: tuple[float, float]
) -> tuple[Array, float]:
    """Sizes of two parts of a spectrum beside a known one, and Whittle's log-likelihood at them."""

    def cost(x: Array) -> float:
        model = known + math.exp(x[0]) * parts[0] + math.exp(x[1]) * parts[1]
        return float(averages * np.sum(np.log(model) + density / model))

    best = scipy.optimize.minimize(cost, np.log(start), method="Nelder-Mead", options={"xatol": 1e-3, "fatol": 1e-2})
    return np.exp(best.x), -float(best.fun)
