"""All noise tests: noise that follows the motion, lines, outliers, quantisation, colour. The mean shows none of these.

Each test takes a fitted state, subtracts the motion that the model explains, and states its null distribution. The
residual of the output above the motion's bandwidth carries vibration, time-stamp jitter, outliers and lines; the
whitened innovations carry the encoder's cyclic error, lines below that, and colour of unknown cause.
"""

from __future__ import annotations

from accelcal.diagnosis.noise_tests.cyclic import encoder_cyclic
from accelcal.diagnosis.noise_tests.falling_spectrum import vibration
from accelcal.diagnosis.noise_tests.motion_noise import motion_noise
from accelcal.diagnosis.noise_tests.noise_test import NoiseTest
from accelcal.diagnosis.noise_tests.outliers import accelerometer_outliers, encoder_outliers
from accelcal.diagnosis.noise_tests.position_jumps import position_jumps
from accelcal.diagnosis.noise_tests.quantisation import quantisation
from accelcal.diagnosis.noise_tests.residuals import Residuals
from accelcal.diagnosis.noise_tests.stamps import held_samples, rounded_stamps
from accelcal.diagnosis.noise_tests.tones import tones
from accelcal.diagnosis.noise_tests.whiteness import whiteness
from accelcal.estimation.run_state import RunState


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
