"""All noise tests: noise that follows the motion, lines, outliers, quantisation, colour. The mean shows none of these.

Each test takes a fitted state, subtracts the motion that the model explains, and states its null distribution. The
residual of the output above the motion's bandwidth carries vibration, time-stamp jitter, outliers and lines; the
whitened innovations carry the encoder's cyclic error, lines below that, and colour of unknown cause.
"""

from __future__ import annotations

import math

from accelcal.diagnosis.noise.counts import held_samples, quantisation, rounded_stamps
from accelcal.diagnosis.noise.motion_noise import motion_noise
from accelcal.diagnosis.noise.noise_test import POSITION_JUMPS, NoiseTest
from accelcal.diagnosis.noise.outliers import accelerometer_outliers, encoder_outliers
from accelcal.diagnosis.noise.position import encoder_cyclic, whiteness
from accelcal.diagnosis.noise.residuals import Residuals
from accelcal.diagnosis.noise.spectra import tones, vibration
from accelcal.estimation.run_state import RunState


def position_jumps(residuals: Residuals) -> NoiseTest:
    """Report the position steps behind which the replay started anew; the innovations do not show them any more.

    The largest is reported with the p value of its detection (`accelcal.diagnosis.faults.position_steps`), which counts
    every reading of the record.
    """
    run = residuals.run
    steps = run.accounted_steps
    if not steps:
        return NoiseTest(POSITION_JUMPS, 0.0, 1.0, 0.0, "m", math.inf, "no jump of the position")
    largest = max(steps, key=lambda step: abs(step.size))
    more = f"; {len(steps)} such jumps in all" if len(steps) > 1 else ""
    return NoiseTest(
        POSITION_JUMPS,
        abs(largest.size),
        min(step.p_value for step in steps),
        abs(largest.size),
        "m",
        math.sqrt(run.reading_variance_guess),
        largest.sentence + more,
        {"count": float(len(steps))},
    )


def run_noise_tests(state: RunState) -> tuple[NoiseTest, ...]:
    """Run every test on a fitted state.

    Parameters
    ----------
    state : after `accelcal.estimation.gauss_newton.iterate`; it is not changed.

    Returns
    -------
    One finding for each of vibration, timing_jitter, accelerometer_outliers, encoder_outliers, quantisation,
    rounded_stamps, held_samples, encoder_cyclic, encoder_step, whiteness, and one for each of at most five lines
    (`tone`; at least one, the most significant). Those of the position only where the reference is one.
    """
    residuals = Residuals(state)
    line_tests = tones(residuals)
    above, jitter = motion_noise(residuals, line_tests)
    strongest = vibration(residuals, line_tests, above)
    residuals.release()
    of_output = accelerometer_outliers(residuals), quantisation(residuals)
    of_stamps = rounded_stamps(residuals), held_samples(residuals)
    of_position = (
        (encoder_outliers(residuals), encoder_cyclic(residuals), position_jumps(residuals))
        if residuals.reads_position
        else ()
    )
    lines = tuple(line for line in line_tests if not line.parts["follows_motion"])
    return (strongest, jitter, *of_output, *of_stamps, *lines, *of_position, whiteness(residuals))


def run_outlier_tests(state: RunState) -> tuple[NoiseTest, ...]:
    """Of these, the tests that reject samples, for a fit that nobody asks for the others.

    Parameters
    ----------
    state : as of `run_noise_tests`.

    Returns
    -------
    accelerometer_outliers and encoder_outliers, equal to those among all.
    """
    residuals = Residuals(state)
    return accelerometer_outliers(residuals), encoder_outliers(residuals)


__all__ = ["NoiseTest", "run_noise_tests", "run_outlier_tests"]
