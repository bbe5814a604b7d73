"""Quantisation: steps of the converter that exceed the noise."""

from __future__ import annotations

import math

import numpy as np
import scipy

from accelcal.diagnosis.noise_tests.noise_test import STEPS, NoiseTest
from accelcal.diagnosis.noise_tests.residuals import Residuals, sample_noise
from accelcal.diagnosis.policy import COARSE_STEP_RATIO, NOISE_TEST_ALPHA, WHOLE_BITS_TOLERANCE


def quantisation(residuals: Residuals) -> NoiseTest:
    """Test of the converter's step against the noise of one sample.

    That values lie on a grid is no matter of chance. The p value says whether it matters: the noise of rounding, D²/12,
    would gain twice the log-likelihood sum(r - ln(1 + r)) over the sensor's own noise, r their ratio at each frequency;
    chi-square with one degree of freedom. A fine step that the declared range implies is not reported.
    """
    noise = sample_noise(residuals)
    ratio = residuals.lsb / noise if noise > 0.0 else 0.0
    p_value = 1.0
    if residuals.lsb > 0.0 and (ratio > COARSE_STEP_RATIO or not has_whole_bits(residuals)):
        p_value = float(scipy.special.chdtrc(1.0, rounding_gain(residuals, noise)))
    p_value = 0.0 if ratio > COARSE_STEP_RATIO else p_value
    text = "quantisation of the output is negligible"
    if residuals.lsb > 0.0 and p_value < NOISE_TEST_ALPHA:
        text = f"the output is quantised in steps of {residuals.lsb:.3g} m/s², {ratio:.2g} times the noise of a sample"
    parts = {"step": residuals.lsb, "noise": noise, "coarse": float(ratio > COARSE_STEP_RATIO)}
    return NoiseTest(STEPS, ratio, p_value, residuals.lsb, "m/s²", 0.0, text, parts)


def rounding_gain(residuals: Residuals, noise: float) -> float:
    """Twice the log-likelihood that white rounding noise gains over low-passed noise with a sample's standard
    deviation."""
    keep = math.exp(-residuals.step / residuals.tau) if residuals.tau > 0.0 else 0.0
    turn = np.cos(np.pi * (np.arange(64) + 0.5) / 64)
    floor = noise**2 * (1.0 - keep**2) / (1.0 + keep**2 - 2.0 * keep * turn)
    r = residuals.lsb**2 / 12.0 / floor
    return len(residuals.u) * float(np.mean(r - np.log1p(r)))


def has_whole_bits(residuals: Residuals) -> bool:
    """Whether the declared range holds 2^m steps, m whole: the converter that the data sheet implies."""
    limit = residuals.run.rig.sensor.range
    if limit is None or residuals.lsb <= 0.0:
        return False
    bits = math.log2(limit / residuals.lsb)
    return abs(bits - round(bits)) < WHOLE_BITS_TOLERANCE
