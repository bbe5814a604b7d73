"""Seismometer and accelerometer on one pier during an earthquake, against a regression in one band."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy

import accelcal as ac
from accelcal.data.arrays import Array
from accelcal.data.recording import Recording, RecordingError
from accelcal.diagnosis.one_axis import require_one_axis
from accelcal.effects import side_channels

from .recordings import recording

HALVES = ((135.0, 175.0), (175.0, 240.0))
"""Parts of the earthquake, s: onset with the S wave, and coda."""
BAND = 0.2, 2.6
"""Hz"""
TRUTH = {"e": (-0.009, "bnn", 0.085), "n": (-0.019, "bne", -0.087)}
"""k, cross axis and its coefficient, by axis."""


def in_band(y: Array) -> Array:
    sections = scipy.signal.butter(4, BAND, "bandpass", fs=50.0, output="sos")
    return np.asarray(scipy.signal.sosfiltfilt(sections, y))


def reference(record: Recording) -> Array:
    """Acceleration of the seismometer at its readings, m/s²."""
    t = record.position.t
    return np.asarray(scipy.interpolate.make_interp_spline(t, record.position.y, k=5)(t, 2))


def delayed(t: Array, y: Array, by: float) -> Array:
    """Samples `by` s later; straight lines between them would take 1 % of 2.6 Hz."""
    return np.asarray(scipy.interpolate.make_interp_spline(t, y, k=5)(t - by))


@pytest.mark.parametrize("axis", ["e", "n"])
def test_the_accelerometer_is_late_by_cross_correlation(axis: str) -> None:
    record = recording(f"bpaw_{axis}")
    t, output, motion = record.accel.t, in_band(record.accel.y), in_band(reference(record))
    delays = np.linspace(-0.02, 0.02, 81)
    best = max(delays, key=lambda d: float(output @ delayed(t, motion, d)))
    assert best == pytest.approx(7.4e-3, abs=0.8e-3)


@pytest.mark.parametrize("axis", ["e", "n"])
@pytest.mark.parametrize("half", [0, 1])
def test_each_half_gives_delay_and_cross_axis_and_predicts_the_other(axis: str, half: int) -> None:
    record = recording(f"bpaw_{axis}")
    k, cross, coefficient = TRUTH[axis]
    side_channels([(name, channel.unit) for name, channel in record.side.items()])
    start, end = HALVES[half]
    fit = ac.fit(record, ac.Model.linear().add(cross), start=start, end=end)
    print(axis, half, fit, fit.runs[0].noise.band)
    t, output, motion = record.accel.t, in_band(record.accel.y), in_band(reference(record))
    predicted = fit.values().scale * delayed(t, motion, fit["time_offset"].value)
    predicted += fit[cross].value * in_band(record.side[cross].y)
    other = (t > HALVES[1 - half][0]) & (t < HALVES[1 - half][1] - 2.0)
    share = float(np.std(output[other] - predicted[other]) / np.std(output[other]))
    print(f"held out {share:.4f}")
    assert fit["time_offset"].value == pytest.approx(7.4e-3, abs=0.8e-3)
    assert fit[cross].value == pytest.approx(coefficient, abs=0.012)
    assert fit["scale_factor"].value == pytest.approx(k, abs=0.01)
    assert share <= 0.012


def test_another_axis_of_the_ground_is_not_this_one() -> None:
    east, north = recording("bpaw_e"), recording("bpaw_n")
    require_one_axis([east, north])
    with pytest.raises(RecordingError, match="not one axis of one body"):
        require_one_axis([replace(east, position=north.position)])
