"""Lines, vibration, outliers and rounding: what the output contains besides the motion."""

from __future__ import annotations

import numpy as np

from accelcal.data import Array
from accelcal.effects.building_blocks import HIGHEST_HARMONIC, amplitude, half_a_step, harmonics_of, largest
from accelcal.effects.registry import NoiseSource, Shape, Traits, effect
from accelcal.signals.signals import Signals


def _lines(s: Signals) -> tuple[float, float]:
    highest = 0.2 / s.step
    return 0.02 * highest, highest


@effect(
    "tone",
    unit="m/s²",
    owner="rig",
    symbol="ct",
    scale=1e-2,
    source="mains pick-up, no published figure",
    shapes={"frequency": Shape("Hz", _lines, trials=4, spacing="log", width=lambda s, frequency: 1.0 / s.length)}
    | HIGHEST_HARMONIC,
    parts=("sin", "cos"),
    traits=Traits(noise=NoiseSource("line", amplitude)),
)
def tone(s: Signals, frequency: float, harmonics: float = 1.0) -> Array:
    """Narrow-band interference at a fixed frequency: mains, a fan, an alias of either.

    Equation: e = c sin(2 pi f t) + d cos(2 pi f t), and of harmonics n up to 4 that the record shows c_n sin(2 pi n f
    t) + d_n cos(2 pi n f t), of one f. The line is as narrow as 1/record, so f and its harmonics are read off the
    spectrum by the noise test; an unrelated line enters beside it as tone_2.
    Looks like: a peak in the spectrum of the residual that does not depend on motion.
    Easily confused with: vibration, an alias of content above half the sampling rate.
    Separate by: a record at rest; another sampling rate, with which an alias moves.
    """
    return harmonics_of((2.0 * np.pi * frequency) * s.t, harmonics)


@effect(
    "vibration",
    unit="m⁻²",
    port="noise",
    owner="rig",
    symbol="c²",
    scale=4e4,
    source="ball bearings, 200 Hz to 300 Hz: up to 2 m/s² at 0.1 m/s (paper)",
    traits=Traits(positive=True, noise=NoiseSource("noise over speed", amplitude)),
)
def vibration(s: Signals) -> Array:
    """Vibration of the bearings, amplitude c v².

    Equation: variance of the output = c² v⁴/2.
    Looks like: noise that grows with speed.
    Easily confused with: timing_jitter, whose noise follows jerk².
    Separate by: the variance of the output sorted by speed and by jerk; the stage pushed at constant speed.
    """
    return 0.5 * (s.v * s.v) ** 2


@effect(
    "vibration_rectification",
    unit="s²/m³",
    symbol="cr",
    scale=0.3,
    source="1 mg at 2.5 g rms: IIS2ICLX; times the paper's vibration",
)
def vibration_rectification(s: Signals) -> Array:
    """Vibration of the bearings, amplitude c v², is rectified by the nonlinearity of the sensor.

    Equation: e = cr v⁴, cr = K2 c²/2.
    Looks like: a bias that follows the local variance of the output.
    Easily confused with: velocity_squared, quadratic, saturation.
    Separate by: a shaker on and off; isolating the mount; several speeds.
    """
    return (s.v * s.v) ** 2


@effect(
    "accelerometer_outliers",
    unit="(m/s²)²",
    port="noise",
    symbol="ro",
    scale=1e-2,
    source="one sample in a thousand off by 3 m/s²",
    traits=Traits(positive=True, noise=NoiseSource("output outliers", largest, rejects="accel")),
)
def accelerometer_outliers(s: Signals) -> Array:
    """Outliers of the output: bits lost, knocks on the cable.

    Equation: variance of the output = ro, their rate times their mean square height.
    Looks like: few samples far outside the distribution of the rest.
    Easily confused with: vibration, impacts on the stage.
    Separate by: counting them; a repeat, in which real impacts recur at the same place.
    """
    return np.ones_like(s.t)


@effect(
    "quantisation",
    unit="(m/s²)²",
    port="noise",
    symbol="D²",
    scale=1e-4,
    source="step of 1 mg: LIS3DH at ±2 g",
    traits=Traits(positive=True, noise=NoiseSource("output steps", half_a_step, raises=("tone", "whiteness"))),
)
def quantisation(s: Signals) -> Array:
    """Quantisation of the output in steps D.

    Equation: variance of the output = D²/12, white only while the output moves by more than D per sample.
    Looks like: few distinct values; runs of equal samples at rest.
    Easily confused with: dead_zone, held_samples, a high noise density.
    Separate by: the histogram of differences between samples; dither.
    """
    return np.full_like(s.t, 1.0 / 12.0)
