"""Sensitivity at the frequencies of steady sines, with an uncertainty from the noise beside each line."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from accelcal.data.arrays import Array
from accelcal.data.recording import Channel
from accelcal.data.stamps import usual_step
from accelcal.response.points import Point, Reference
from accelcal.response.sine import SineFit, fit_sines, within
from accelcal.response.steps import SineStep
from accelcal.signals.transfer import Spectrum

HARMONICS = (1, 2, 3)
"""Fitted in every step of one sine, as far as they are below the Nyquist frequency."""
NEIGHBOURS = 8
"""Lines on either side whose noise is that of the line."""
NYQUIST_SHARE = 0.45
"""Share of a channel's rate up to which lines are fitted."""
VISIBLE = 10.0
"""Amplitude of the reference over that of the noise beside it, below which a line is none."""


@dataclass(frozen=True, slots=True)
class Harmonics:
    """One step of one sine: amplitudes at 1, 2, 3 times its frequency, and the mean."""

    point: Point
    output: Spectrum
    """(h,) amplitudes of the output, m/s²."""
    acceleration: Spectrum
    """(h,) of the reference's acceleration, m/s²."""
    std: Array
    """(h,) standard uncertainty of the real and of the imaginary part of the output against the reference, m/s²."""
    mean: float
    """Of the output, m/s²."""


def measure_step(output: Channel, reference: Reference, step: SineStep) -> list[Harmonics]:
    """Sensitivity at each frequency of a step.

    Parameters
    ----------
    output : of the accelerometer.
    reference : what it is compared with.
    step : steady sines.

    Returns
    -------
    One for each sine that the reference shows; harmonics beside the first where the step has one sine.
    """
    rate = 1.0 / max(usual_step(output.t), usual_step(reference.channel.t))
    alone = len(step.frequencies) == 1
    multiples = HARMONICS if alone else HARMONICS[:1]
    lines = [h * f for f in step.frequencies for h in multiples if h * f < NYQUIST_SHARE * rate]
    if not lines:
        return []
    parts = within(output, step.start, step.end), within(reference.channel, step.start, step.end)
    if min(map(len, parts)) <= 3 * (3 + 2 * len(lines)):
        return []
    fits = fit_sines(parts[0], lines, step.centre), fit_sines(parts[1], lines, step.centre)
    if alone:
        found = [_harmonics(fits, reference, step, lines, 0, len(lines))]
    else:
        found = [_harmonics(fits, reference, step, lines, i, 1) for i in range(len(lines))]
    return [each for each in found if each is not None]


def _harmonics(
    fits: tuple[SineFit, SineFit], reference: Reference, step: SineStep, lines: Sequence[float], at: int, count: int
) -> Harmonics | None:
    """The line `at` with those behind it, `count` in all; None where the reference does not show the first."""
    chosen = np.asarray(lines[at : at + count], dtype=np.float64)
    y = fits[0].amplitudes[at : at + count]
    a = reference.to_acceleration(chosen) * fits[1].amplitudes[at : at + count]
    value = complex(y[0] / a[0])
    length = step.end - step.start
    scatter, degrees = [], 0
    for i, f in enumerate(chosen):
        near = neighbours(float(f), length, lines)
        if not len(near):
            return None
        if i == 0:
            degrees = 2 * len(near)
            beside = float(np.sqrt(np.mean(np.abs(fits[1].lines(near)) ** 2)))
            if abs(fits[1].amplitudes[at]) < VISIBLE * beside:
                return None
        scatter.append(_noise(fits, reference, value, float(f), near))
    std = np.array(scatter)
    point = Point(
        frequency=float(chosen[0]),
        value=value,
        std=float(std[0] / abs(a[0])),
        degrees=degrees,
        acceleration=complex(a[0]),
        method="sine",
        start=step.start,
        end=step.end,
    )
    return Harmonics(point, y, a, std, fits[0].mean)


def neighbours(frequency: float, length: float, lines: Sequence[float]) -> Array:
    """Frequencies beside a line at multiples of 1/length that hold noise alone, Hz: no drift, no other line."""
    offsets = np.arange(1, 4 * NEIGHBOURS + 1)
    near = frequency + np.concatenate([np.stack([-offsets, offsets], axis=1)]).ravel() / length
    clear = near > 1.9 / length
    for line in lines:
        clear &= np.abs(near - line) > 0.99 / length
    return np.asarray(near[clear][: 2 * NEIGHBOURS])


def _noise(fits: tuple[SineFit, SineFit], reference: Reference, value: complex, frequency: float, near: Array) -> float:
    """Standard deviation of either part of (output - sensitivity times acceleration) at a line, m/s².

    What both channels share beside the line (an amplitude that is not quite steady) cancels. Noise of the reference is
    taken as level in the unit of its channel, that of the output as level in m/s².
    """
    output, moved = fits[0].lines(near), value * reference.to_acceleration(near) * fits[1].lines(near)
    of_output, of_reference = float(np.mean(np.abs(output) ** 2)), float(np.mean(np.abs(moved) ** 2))
    total = of_output + of_reference
    share = of_reference / total if total > 0.0 else 0.0
    level = (frequency / near) ** (reference.order * share)
    return math.sqrt(0.5 * float(np.mean(np.abs(level * (output - moved)) ** 2)))
