"""Effects that the mean cannot see: noise that follows the motion, lines, outliers, steps of a converter, colour.

Each test takes a fitted state, removes the motion that the model explains, and states its null distribution. What is
left of the output above the motion's bandwidth, `high`, carries vibration, stamp jitter, outliers and lines; the
whitened innovations carry the encoder's cyclic error, lines below that, and whatever has no name.
"""

from __future__ import annotations

from accelcal.diagnosis.noise_tests.cyclic import encoder_cyclic
from accelcal.diagnosis.noise_tests.motion_noise import motion_noise
from accelcal.diagnosis.noise_tests.noise_test import NoiseTest
from accelcal.diagnosis.noise_tests.outliers import accelerometer_outliers, encoder_outliers
from accelcal.diagnosis.noise_tests.quantisation import quantisation
from accelcal.diagnosis.noise_tests.residuals import Residuals
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
    encoder_cyclic, whiteness, and one for each of at most five lines (`tone`; at least one, the loudest).
    """
    seen = Residuals(state)
    lines = tones(seen)
    vibration, jitter = motion_noise(seen, lines)
    seen.release()
    return (
        vibration,
        jitter,
        accelerometer_outliers(seen),
        encoder_outliers(seen),
        quantisation(seen),
        *(line for line in lines if not line.parts["follows_motion"]),
        encoder_cyclic(seen),
        whiteness(seen),
    )


__all__ = ["NoiseTest", "run_noise_tests"]
