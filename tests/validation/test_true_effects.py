"""A true effect lowers its own held-out error: behind a declared high-pass, and where it remembers earlier motion.

The records are made here, with numpy and scipy alone.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline
from scipy.signal import lfilter

import accelcal as ac
from accelcal.data.recording import Channel, Recording
from accelcal.data.rig import ChannelFilter
from accelcal.validation.dead_reckoning import DeadReckoning, total
from accelcal.validation.noise_floor import Ruler
from accelcal.verbs import compare_models

TAU = 0.16
"""Of an AC-coupled sensor, s."""
HEAT, HEAT_TAU, SPLIT = 0.02, 9.0, 42.0
"""Self-heating in 1/(m/s²), its time constant in s, and where the held-out part begins, s."""


def recorded(t: np.ndarray, output: np.ndarray, p: np.ndarray, noise: float, rng: np.random.Generator, **rig):
    """A recording with white noise on the output and 1 µm on the position."""
    u, z = output + noise * rng.standard_normal(len(t)), p + 1e-6 * rng.standard_normal(len(t))
    sensor = ac.Sensor(noise=noise * np.sqrt(2.0 * t[1]), range=50.0)
    digest = f"{rng.integers(1 << 60)}"
    return Recording(
        Channel("accel", t, u, "m/s^2"), Channel("position", t, z, "m"), ac.Rig(sensor, **rig), digest=digest
    )


def coupled(seed: int) -> Recording:
    """A quadratic of 2e-3 behind an RC high-pass, made at eight times the rate of the record."""
    rng, rate, sub = np.random.default_rng(seed), 500.0, 8
    t = np.arange(0.0, 30.0, 1.0 / (rate * sub))
    size, w = np.array([3e-3, 1e-3, 3e-4]), 2.0 * np.pi * np.array([2.3, 4.1, 7.7])
    s = np.sin(w[:, None] * t + rng.uniform(0.0, 6.0, 3)[:, None])
    p, a = size @ s, -(size * w**2) @ s
    c = 2.0 * TAU * rate * sub
    blocked = lfilter([c / (c + 1.0), -c / (c + 1.0)], [1.0, (1.0 - c) / (1.0 + c)], 1.01 * a + 2e-3 * a**2)
    high_pass = ChannelFilter("RC", "highpass", cutoff=1.0 / (2.0 * np.pi * TAU))
    return recorded(t[::sub], blocked[::sub], p[::sub], 1e-3, rng, output_filters=(high_pass,))


def heated(seed: int) -> Recording:
    """A sensor that a motion heats whose intensity comes and goes; at rest before the record."""
    rng, rate = np.random.default_rng(seed), 300.0
    t = np.arange(0.0, 60.0, 1.0 / rate)
    size, w = np.array([0.03, 8e-3, 3e-3]), 2.0 * np.pi * np.array([0.31, 0.87, 1.9])
    s = np.sin(w[:, None] * t + rng.uniform(0.0, 6.0, 3)[:, None])
    p = (0.6 + 0.4 * np.sin(2.0 * np.pi * t / 17.0)) * (size @ s)
    a = make_interp_spline(t, p, k=7).derivative(2)(t)
    decay = np.exp(-1.0 / (rate * HEAT_TAU))
    heat = lfilter([0.0, 1.0 - decay], [1.0, -decay], a**2)
    return recorded(t, 0.05 + 1.01 * a + HEAT * heat, p, 2e-3, rng)


@pytest.fixture(scope="module")
def even() -> tuple[list[ac.Fit], Recording]:
    recording = coupled(41)
    base = ac.fit(recording)
    return [base, ac.add(base, recording, "quadratic")], coupled(42)


def test_an_even_effect_passes_the_high_pass_of_its_sensor(even) -> None:
    (base, added), unseen = even
    before, after = ac.compare([base, added], unseen)
    for horizon in (1.0, 5.0):
        floor = after.noise_floor.at(horizon)
        assert after.coast_rms[horizon] < before.coast_rms[horizon]
        assert after.coast_rms[horizon] < 1.5 * floor.high
    assert after.one_step_rms < before.one_step_rms


def test_the_mean_that_a_high_pass_blocks_would_drive_the_path_away(even, monkeypatch) -> None:
    (base, added), unseen = even
    monkeypatch.setattr(DeadReckoning, "remembered", lambda self, terms, s: total(terms, s))
    before, after = ac.compare([base, added], unseen)
    assert after.coast_rms[1.0] > 3.0 * before.coast_rms[1.0]


def test_an_effect_with_memory_has_the_history_of_its_record() -> None:
    recording = heated(43)
    base = ac.fit(recording, end=SPLIT)
    model = ac.Model.linear().add("self_heating", shapes={"self_heating": {"tau": HEAT_TAU}})
    model = model.freeze(**{"self_heating.tau": HEAT_TAU})  # with tau free the record leaves it and the size 22 %
    added = ac.fit(recording, model, end=SPLIT)
    assert added["self_heating"].value == pytest.approx(HEAT, rel=0.1)
    ruler = Ruler.of([base, added])
    before, after = compare_models([base, added], recording, ruler, start=SPLIT)
    assert before.coast_starts == after.coast_starts
    assert after.residual[0][0] >= SPLIT
    assert after.accel_residual[0][0] >= SPLIT
    assert after.coast_rms[5.0] < 0.5 * before.coast_rms[5.0]
    assert after.accel_rms < before.accel_rms
    # the twin: of another record the history is not known
    anew = replace(recording, digest="another")
    _, without = compare_models([base, added], anew, ruler, start=SPLIT)
    assert without.coast_rms[5.0] > 1.2 * after.coast_rms[5.0]
