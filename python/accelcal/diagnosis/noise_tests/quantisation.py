"""Steps of the converter that outweigh the noise."""

from __future__ import annotations

import math

import numpy as np
import scipy

from accelcal.diagnosis.noise_tests.noise_test import STEPS, NoiseTest
from accelcal.diagnosis.noise_tests.residuals import Residuals, sample_noise
from accelcal.diagnosis.policy import COARSE_STEP_RATIO, HELD_SHARE, NOISE_TEST_ALPHA, WHOLE_BITS_TOLERANCE


def quantisation(seen: Residuals) -> NoiseTest:
    """Step of the converter over the noise of one sample, and readings written twice.

    That values lie on a grid is no matter of chance. The p value says whether it matters: the noise of rounding, D²/12,
    would gain twice the log-likelihood sum(r - ln(1 + r)) over the sensor's own noise, r their ratio at each frequency;
    chi-square with one degree of freedom. A fine step that the declared range implies is no news.
    """
    noise = sample_noise(seen)
    ratio = seen.lsb / noise if noise > 0.0 else 0.0
    repeats = float(np.mean(np.diff(seen.u) == 0.0)) if seen.lsb == 0.0 and len(seen.u) > 1 else 0.0
    held = repeats > HELD_SHARE or any(
        f.kind == "held_repeats" and f.channel == seen.run.accel.name for f in seen.run.recording.findings
    )
    p_value = 1.0
    if seen.lsb > 0.0 and (ratio > COARSE_STEP_RATIO or not of_whole_bits(seen)):
        p_value = float(scipy.special.chdtrc(1.0, rounding_gain(seen, noise)))
    p_value = 0.0 if held or ratio > COARSE_STEP_RATIO else p_value
    text = "the output is not on a grid that matters"
    if seen.lsb > 0.0 and p_value < NOISE_TEST_ALPHA:
        text = f"the output comes in steps of {seen.lsb:.3g} m/s², {ratio:.2g} times the noise of a sample"
    elif held:
        text = "readings of the output are written several times: the logger is faster than the sensor"
    parts = {"step": seen.lsb, "noise": noise, "held": max(repeats, float(held))}
    parts["coarse"] = float(ratio > COARSE_STEP_RATIO or held)
    return NoiseTest(STEPS, ratio, p_value, seen.lsb, "m/s²", 0.0, text, parts)


def rounding_gain(seen: Residuals, noise: float) -> float:
    """Twice the log-likelihood that white noise of rounding gains over low-passed noise of a sample's deviation."""
    keep = math.exp(-seen.step / seen.tau) if seen.tau > 0.0 else 0.0
    turn = np.cos(np.pi * (np.arange(64) + 0.5) / 64)
    floor = noise**2 * (1.0 - keep**2) / (1.0 + keep**2 - 2.0 * keep * turn)
    r = seen.lsb**2 / 12.0 / floor
    return len(seen.u) * float(np.mean(r - np.log1p(r)))


def of_whole_bits(seen: Residuals) -> bool:
    """Whether the declared range holds 2^m steps, m whole: the converter that the data sheet implies."""
    limit = seen.run.rig.sensor.range
    if limit is None or seen.lsb <= 0.0:
        return False
    bits = math.log2(limit / seen.lsb)
    return abs(bits - round(bits)) < WHOLE_BITS_TOLERANCE
