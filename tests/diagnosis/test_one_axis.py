"""Channels of two motions are told from one axis, whatever that axis suffers from."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import accelcal as ac
from accelcal.data.arrays import Array
from accelcal.data.recording import Channel, Recording, RecordingError
from accelcal.diagnosis.one_axis import coherence_by_band, require_one_axis

RATES = 500.0, 400.0
SECONDS = 20.0


def record(
    seed: int, *, size: float = 5.0, effect: str = "", noise: float = 0.02, rms: float = 1e-6, motion: int | None = None
) -> Recording:
    """Output and position of a sum of tones, 1 to 20 Hz; with `motion` the position is that of another seed."""
    rng = np.random.default_rng(seed)
    t, u = (np.arange(int(SECONDS * rate)) / rate for rate in RATES)

    def tones(number: int, at: Array, order: int) -> Array:
        draw = np.random.default_rng([number, 7])
        f, phase, a = draw.uniform(1.0, 20.0, 12), draw.uniform(0.0, 2.0 * np.pi, 12), draw.uniform(0.3, 1.0, 12)
        w = 2.0 * np.pi * f[:, None]
        return np.asarray(size / 3.0 * a @ (np.sin(w * at + phase[:, None]) / w**order)) * (-1.0) ** (order // 2)

    late = {"delay": 0.4, "small delay": 0.005}.get(effect, 0.0)
    y = tones(seed, t - late, 0)
    if effect == "quadratic":
        y = y + 0.3 * y**2 / size * 3.0
    if effect == "dead zone":
        y = np.sign(y) * np.maximum(0.0, np.abs(y) - 0.2 * size)
    if effect == "hysteresis":
        y = y + 0.3 * size * np.sign(np.gradient(y))
    if effect == "tilt":
        y = y + 2.0 * size * np.sin(2.0 * np.pi * 0.3 * t + np.sin(0.5 * t))
    if effect == "jitter":
        y = np.interp(t + 1e-3 * rng.standard_normal(len(t)), t, y)
    if effect == "half":
        y = np.where(t < 0.4 * SECONDS, y, tones(seed + 1000, t, 0))
    z = tones(seed if motion is None else motion, u, 2) + rms * rng.standard_normal(len(u))
    accel = Channel("accel", t, y + 0.1 + noise * rng.standard_normal(len(t)), "m/s²")
    return Recording(accel=accel, position=Channel("position", u, z, "m"), rig=ac.Rig(), name="run.csv")


# Bonferroni over bands: an honest record is called unrelated by chance less often than once in a thousand.
@pytest.mark.parametrize(
    "effect", ["", "delay", "small delay", "quadratic", "dead zone", "hysteresis", "tilt", "jitter", "half"]
)
@pytest.mark.parametrize("seed", range(3))
def test_an_axis_with_a_large_effect_is_one_axis(effect: str, seed: int) -> None:
    require_one_axis([record(seed, effect=effect)])


@pytest.mark.parametrize("seed", range(12))
def test_two_motions_are_not_one_axis(seed: int) -> None:
    with pytest.raises(RecordingError, match="not one axis of one body"):
        require_one_axis([record(seed, motion=seed + 100)])


@pytest.mark.parametrize("motion", [None, 100])
@pytest.mark.parametrize("size", [1e-3, 1e-2])
def test_a_motion_below_the_noise_says_nothing(size: float, motion: int | None) -> None:
    recording = record(1, size=size, noise=0.06, motion=motion)
    require_one_axis([recording])
    assert all(band.least == 0.0 for band in coherence_by_band(recording))


def test_a_motion_so_far_beyond_the_noise_that_the_coherence_rounds_to_one_is_one_axis() -> None:
    bands = coherence_by_band(record(1, size=1e9))
    assert max(band.expected for band in bands) > 1.0 - 1e-15
    require_one_axis([record(1, size=1e9)])


def test_a_part_is_judged_by_itself_and_a_swapped_sign_is_related() -> None:
    recording = record(2, effect="half")
    with pytest.raises(RecordingError, match="not one axis"):
        require_one_axis([recording], start=0.45 * SECONDS)
    reversed_output = dataclasses.replace(recording.accel, y=-recording.accel.y)
    require_one_axis([dataclasses.replace(recording, accel=reversed_output)], end=0.4 * SECONDS)


def test_every_verb_refuses_before_it_names_a_mount() -> None:
    with pytest.raises(RecordingError, match="not one axis") as refused:
        ac.fit(record(3, motion=103))
    assert "reversed" not in str(refused.value)


@pytest.mark.parametrize(
    ("factor", "noise", "text"),
    [
        (-1.03, 0.02, 'mount = "reversed"'),
        (-0.6, 0.5, 'mount = "reversed"'),
        (-0.1, 0.5, "not one axis of one body"),  # no mount makes a tenth
        (-4.0, 0.02, "not one axis of one body"),
        (-1.0, 30.0, "not one axis of one body"),  # coherence of a tenth
    ],
)
def test_a_mount_is_named_only_where_it_explains_the_factor(factor: float, noise: float, text: str) -> None:
    recording = record(11, noise=0.0)
    y = factor * recording.accel.y + noise * np.random.default_rng(12).standard_normal(len(recording.accel))
    with pytest.raises(RecordingError, match=text):
        ac.fit(dataclasses.replace(recording, accel=dataclasses.replace(recording.accel, y=y)))
