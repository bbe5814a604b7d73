"""Single readings that are wrong, of the output and of the encoder."""

from __future__ import annotations

import math

import numpy as np

from accelcal.data.arrays import Array
from accelcal.diagnosis.noise_tests.block_spectra import power_fit
from accelcal.diagnosis.noise_tests.noise_test import OUTPUT_OUTLIERS, READING_OUTLIERS, NoiseTest
from accelcal.diagnosis.noise_tests.residuals import Residuals
from accelcal.diagnosis.noise_tests.robust import outliers, spread_of
from accelcal.diagnosis.policy import NOISE_TEST_ALPHA, NOISE_TEST_LEAST_BLOCKS


def course(seen: Residuals, gain: Array) -> Array:
    """Standard deviation that noise which follows the motion, named or not, gives `matched` in its course, (n,) m/s².

    Power of the blocks behind the filter = s² + c1 v² + c2 v⁴ + c3 j², put back to every sample.
    """
    spectra = seen.spectra
    if len(spectra.power) < NOISE_TEST_LEAST_BLOCKS:
        return np.ones(seen.n)
    f = np.linspace(0.0, 0.5 * seen.rate, len(gain))
    power = spectra.power @ np.interp(spectra.f, f, gain**2) * (2.0 / len(spectra.window))
    c, _ = power_fit(power, np.column_stack([np.ones(len(power)), *seen.motion_blocks(spectra)]))
    v, jerk = seen.motion
    v2 = v**2
    behind = c[2] * v2
    behind += c[1]
    behind *= v2
    np.square(jerk, out=v2)
    v2 *= c[3]
    behind += v2
    behind += c[0]
    np.maximum(behind, 0.1 * float(np.median(power)) + 1e-300, out=behind)
    return np.asarray(np.sqrt(behind, out=behind))


def accelerometer_outliers(seen: Residuals) -> NoiseTest:
    """Single samples of the output that its local noise does not allow."""
    y, gain = seen.matched
    usual = course(seen, gain)[seen.taken]
    y = y[seen.taken]
    y /= usual
    spread, dof = spread_of(y)
    spread *= usual
    y *= usual
    del usual
    np.hypot(spread, seen.lsb * math.sqrt(float(np.mean(gain**2)) / 12.0), out=spread)
    found = outliers(y, spread, len(y), dof)
    text = (
        found.sentence("samples of the output", "m/s²") if found.p_value < NOISE_TEST_ALPHA else "the output has none"
    )
    n = len(seen.u)
    at = tuple(float(t) for t in seen.t[seen.taken][found.peaks])
    std = math.sqrt(max(found.count, 1.0)) / n
    return NoiseTest(OUTPUT_OUTLIERS, found.score, found.p_value, found.count / n, "", std, text, found.parts, at)


def encoder_outliers(seen: Residuals) -> NoiseTest:
    """Single readings that the smoothed position does not allow; those that the replay left out count as well."""
    found = seen.loud_readings
    left_out = seen.run.left_out
    n = len(seen.readings) + left_out
    p = 0.0 if left_out else found.p_value
    count = found.count + left_out
    at = tuple(float(t) for t in seen.run.t[seen.state.counts][found.peaks]) if p < NOISE_TEST_ALPHA else ()
    text = (
        f"{count:.0f} readings of the encoder stand out by up to {found.size * 1e6:.2g} um"
        if p < NOISE_TEST_ALPHA
        else "none"
    )
    parts = {**found.parts, "count": count, "left_out": float(left_out)}
    std = math.sqrt(max(count, 1.0)) / max(1, n)
    return NoiseTest(READING_OUTLIERS, found.score, p, count / max(1, n), "", std, text, parts, at)
