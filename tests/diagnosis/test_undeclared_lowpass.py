"""A filter that nothing declares, a slow low-pass or a resonance, is said, and nothing is named in its place; with it,
nothing is missing."""

from dataclasses import replace

import numpy as np
import pytest

import accelcal as ac
from accelcal.data import ChannelFilter, LowPass

FREQUENCIES, SIZES = np.array([0.7, 1.9, 3.1, 4.7]), np.array([0.08, 0.02, 0.012, 0.008])
"""Tones of the motion, Hz and m."""


def recording(seed, tau=0.0, delay=0.0, resonance=0.0, q=0.3**-1):
    """40 s of four tones, the output behind a first-order low-pass, a delay or a resonance, Hz, in closed form."""
    rng = np.random.default_rng(seed)
    phase, w = rng.uniform(0.0, 2.0 * np.pi, 4), 2.0 * np.pi * FREQUENCIES
    t, read = np.arange(0.0, 40.0, 1 / 200), np.arange(0.0, 40.0, 1 / 100)
    gain = np.exp(-1j * w * delay) / (1.0 + 1j * w * tau)
    if resonance:
        ratio = FREQUENCIES / resonance
        gain = gain / (1.0 - ratio**2 + 1j * ratio / q)
    accel = np.imag(-(w**2) * SIZES * gain @ np.exp(1j * (w[:, None] * t + phase[:, None])))
    place = np.imag(SIZES @ np.exp(1j * (w[:, None] * read + phase[:, None])))
    return ac.Recording.from_arrays(
        t,
        1.012 * accel + 0.08 + 0.02 * rng.standard_normal(len(t)),
        place + 2e-5 * rng.standard_normal(len(read)),
        position_t=read,
        units={"accel": "m/s^2", "position": "m"},
    )


def diagnosis_and_remark(run):
    fit = ac.fit(run)
    diagnosis = ac.diagnose(fit, run)
    return diagnosis, next((note for note in diagnosis.remarks if note.code.startswith("undeclared_")), None)


@pytest.mark.parametrize("tau", [0.012, 0.03])
def test_a_slow_low_pass_is_said_and_nothing_is_named_until_it_is_declared(tau):
    run = recording(1, tau)
    diagnosis, note = diagnosis_and_remark(run)
    assert note is not None, diagnosis.sentence
    assert not diagnosis.effects
    assert diagnosis.verdict == "unexplained"
    assert note.values["tau"] == pytest.approx(1e3 * tau, abs=max(4.0 * note.values["std"], 2e-3 * 1e3 * tau))
    assert "declare it in [channels]" in diagnosis.sentence
    assert diagnosis.sentence.endswith("declare it, fit again, and see what is left.")
    corner = LowPass(note.values["corner"], 0.1)
    declared = replace(run, rig=replace(run.rig, lowpass=corner))
    after, none = diagnosis_and_remark(declared)
    assert none is None
    assert after.verdict == "adequate"
    assert abs(after.fit["scale_factor"].value - 0.012) < 4.0 * after.fit["scale_factor"].std


def test_what_is_no_low_pass_is_not_said_to_be():
    diagnosis, note = diagnosis_and_remark(recording(2, delay=0.012))
    assert note is None, diagnosis.sentence


@pytest.mark.parametrize(("f0", "q"), [(25.0, 4.0), (9.0, 8.0)])
def test_a_resonance_near_the_motion_is_said_and_nothing_is_named_until_it_is_declared(f0, q):
    run = recording(3, resonance=f0, q=q)
    diagnosis, note = diagnosis_and_remark(run)
    assert note is not None, diagnosis.sentence
    assert note.code == "undeclared_resonance"
    assert not diagnosis.effects
    assert abs(note.values["f0"] - f0) < max(4.0 * note.values["f0_std"], 2e-3 * f0)
    assert abs(note.values["q"] - q) < max(4.0 * note.values["q_std"], 0.02 * q)
    share = note.values["f0_std"] / note.values["f0"]
    assert f"tolerance = {share:.2g}" in note.values["entry"]
    stds = []
    for tolerance in (None, share):
        resonance = ChannelFilter("resonance", cutoff=note.values["f0"], quality=note.values["q"], tolerance=tolerance)
        after, none = diagnosis_and_remark(replace(run, rig=replace(run.rig, output_filters=(resonance,))))
        assert none is None
        assert after.verdict == "adequate"
        assert abs(after.fit["scale_factor"].value - 0.012) < 4.0 * after.fit["scale_factor"].std
        assert ("sensor_resonance" in after.fit) == (tolerance is not None)
        stds.append(after.fit["scale_factor"].std)
    assert stds[1] > 1.1 * stds[0]  # that of f0 is in it


def test_what_clocks_may_disagree_by_is_in_the_frequency_of_a_resonance():
    """A delay behind it takes part in both coefficients of its inverse."""
    run = recording(3, resonance=25.0, q=5.0, delay=8e-4)
    _, note = diagnosis_and_remark(replace(run, rig=replace(run.rig, offset_tolerance=8e-4)))
    assert note is not None
    assert abs(note.values["f0"] - 25.0) < 3.0 * note.values["f0_std"]
