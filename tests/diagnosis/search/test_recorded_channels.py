"""Effects of recorded channels, planted in the output by their formulas: named, and nothing without them."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import accelcal as ac
from accelcal.data.recording import Channel
from accelcal.results import model_file
from accelcal.simulation import CXL02_RIG

RATES = {"rate_i": 0.7, "rate_p": 0.4, "alpha_o": 2.0}
"""Amplitude of each rotation, rad/s and rad/s²."""
PLANTED = {
    "cross_axis_z": (3e-3, lambda a, c: c["a_z"]),
    "cross_axis_quadratic_z": (3e-3, lambda a, c: c["a_z"] ** 2),
    "cross_coupling_z": (1e-3, lambda a, c: a * c["a_z"]),
    "cross_axis_product": (3e-3, lambda a, c: c["a_y"] * c["a_z"]),
    "spin": (2e-2, lambda a, c: c["rate_i"] * c["rate_p"]),
    "angular_acceleration": (2e-3, lambda a, c: c["alpha_o"]),
    "supply_scale": (1e-2, lambda a, c: a * c["supply"]),
}
"""Coefficient and formula by effect; `a` is the acceleration, `c` holds the channels."""


def recorded(seed, planted=None):
    """A run whose sensor is shaken sideways and turned a little while its supply moves; one effect in its output."""
    rng = np.random.default_rng(seed)
    truth = {"bias": 0.05, "scale_factor": 0.01}
    simulation = ac.simulate("tones", seconds=20.0, rig=CXL02_RIG, parameters=truth, rng=rng)
    accel = simulation.recording.accel
    t = accel.t

    def swing(size, slow=0.3, fast=3.0):
        lines = rng.uniform(slow, fast, 4)
        waves = [np.sin(2.0 * np.pi * f * t + phase) for f, phase in zip(lines, rng.uniform(0.0, 6.0, 4), strict=True)]
        return size * np.sum(waves, axis=0) / 2.0

    channels = {"a_y": swing(1.0), "a_z": swing(1.0), "supply": swing(0.2, 0.05, 0.3)}
    channels |= {name: swing(size) for name, size in RATES.items()}
    units = {"a_y": "m/s²", "a_z": "m/s²", "supply": "V", "rate_i": "rad/s", "rate_p": "rad/s", "alpha_o": "rad/s²"}
    y = accel.y.copy()
    if planted is not None:
        size, formula = PLANTED[planted]
        y += size * formula(simulation.truth.motion.derivatives(t)[2], channels)
    side = {name: Channel(name, t, values, units[name]) for name, values in channels.items()}
    return replace(simulation.recording, accel=replace(accel, y=y), side=side, digest=f"{seed} {planted}")


@pytest.mark.parametrize("name", PLANTED)
def test_an_effect_of_recorded_channels_is_named_with_its_size(name):
    run = recorded(5, name)
    fit = ac.fit(run)
    diagnosis = ac.diagnose(fit, run)
    assert diagnosis.scan.detected[0].effect == name
    grown = ac.fit(run, diagnosis.scan.detected[0].enter(fit.model))
    assert abs(grown[name].value - PLANTED[name][0]) < 4.0 * grown[name].std
    assert grown[name].std < 0.1 * PLANTED[name][0]


def test_a_model_whose_scale_follows_a_channel_is_saved_and_loaded(tmp_path):
    """In another process, where nothing has entered the channel's effects yet."""
    run = recorded(5, "supply_scale")
    fit = ac.fit(run)
    grown = ac.add(ac.add(fit, run, "supply_scale"), run, "supply")
    model_file.save(grown, tmp_path / "m.json")
    text = f"import accelcal as ac; print(ac.load_model({str(tmp_path / 'm.json')!r}).model.effects[3:])"
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "('supply_scale', 'supply')"


def test_channels_that_do_nothing_are_not_named():
    """6 records: one that is not adequate has probability 0.06 at the rate of 1 % a record; two, 0.0015."""
    wrong = 0
    for seed in range(6):
        run = recorded(100 + seed)
        wrong += ac.diagnose(ac.fit(run), run).verdict != "adequate"
    assert wrong <= 1
