"""Noise of the output biases a live scale factor: how much is known, said, and kept out of a model."""

import json
from pathlib import Path

import numpy as np
import pytest

import accelcal as ac
from accelcal.data.recording import Channel, Recording
from accelcal.io.stream import Rows
from accelcal.live import Tracker, settings_of
from accelcal.live.tracker import OutputMoments
from accelcal.results import model_file
from tests.commands import accelcal

SCALE = 0.01


def followed(noise: float, rate: float, resolution: float, seconds: float, seed: int) -> Tracker:
    """A filter behind a slow stage with 1.4 m/s² rms; the sidecar is right."""
    rng, count = np.random.default_rng(seed), 5000
    w = 2.0 * np.pi * np.array([0.11, 0.23, 0.37, 0.59])
    size = np.array([1.4, 1.05, 0.7, 0.49]) / w**2
    live = Tracker(settings_of(ac.Rig(ac.Sensor(noise=noise, range=50.0), resolution=resolution)))
    for begin in range(0, int(seconds * rate), count):
        t = (np.arange(count) + begin) / rate
        s = size * np.sin(w * t[:, None] + np.arange(4))
        u = 0.05 - (1.0 + SCALE) * (s * w**2).sum(1) + rng.standard_normal(count) * noise * np.sqrt(rate / 2.0)
        live.feed(Rows(t, u, np.round(s.sum(1) / resolution) * resolution))
    return live


@pytest.mark.parametrize(
    ("noise", "rate", "resolution", "seconds", "expected"),
    [
        (2.2e-3, 1667.0, 1e-6, 60.0, 2.1e-4),  # the paper's sensor
        (2e-3, 50.0, 1e-6, 1200.0, -4.6e-5),  # what straight lines cut off
        (2e-2, 1000.0, 1e-7, 30.0, 0.066),
    ],
)
def test_the_bias_is_known_and_in_the_uncertainty(noise, rate, resolution, seconds, expected) -> None:
    """False-alarm rate: one normal deviate beyond 4 in each of three, 2e-4."""
    live = followed(noise, rate, resolution, seconds, 3409)
    bias = live.regressor_bias
    assert bias.value == pytest.approx(expected, rel=0.15)
    [found] = (e for e in live.estimates if e.name == "scale_factor")
    assert found.std == pytest.approx(np.hypot(bias.std, bias.value))
    assert abs(found.value - SCALE) < 3.0 * found.std
    assert abs(found.value - SCALE - bias.value) < 4.0 * bias.std + 0.1 * abs(bias.value)
    if noise > 0.01:  # the twin: the filter alone is sure of a wrong value
        assert abs(found.value - SCALE) > 30.0 * bias.std
        assert bias.sigma > 30.0
        assert "biases scale_factor by about 0.06" in bias.sentence


def test_a_good_sensor_is_not_called_biased() -> None:
    live = followed(2e-4, 1000.0, 1e-6, 20.0, 3410)
    assert live.regressor_bias.sigma < 1.0
    assert live.regressor_bias.sentence == ""


def test_moments_do_not_depend_on_the_chunks() -> None:
    rng = np.random.default_rng(3411)
    t = np.arange(3000) / 1000.0
    u = np.where(rng.random(3000) < 0.1, np.nan, 9.8 + np.sin(5.0 * t) + 0.1 * rng.standard_normal(3000))
    z = np.where(rng.random(3000) < 0.5, np.nan, -np.sin(5.0 * t) / 25.0)
    settings = settings_of(ac.Rig(ac.Sensor(noise=4.5e-3, range=50.0), resolution=1e-6))
    found = []
    for cuts in ([], np.arange(1, 3000), np.sort(rng.choice(3000, 40))):
        moments = OutputMoments()
        for rows in np.split(np.arange(3000), cuts):
            moments.add(Rows(t[rows], u[rows], z[rows]))
        found.append(moments.bias(settings, 1e-8).value)
    assert found[1:] == pytest.approx([found[0]] * 2, rel=1e-9)


def test_a_biased_scale_factor_is_not_saved(tmp_path: Path) -> None:
    """A noisy sensor beside an encoder of 0.1 µm, declared as they are; its model is that of a fit."""
    rig = ac.Rig(ac.Sensor(noise=2e-2, range=50.0), resolution=1e-7)
    rng, rate = np.random.default_rng(3412), 1000.0
    t = np.arange(int(20.0 * rate)) / rate
    w, a = np.array([2.0, 5.0]), np.array([1.5, 1.0])
    p = -np.sin(w * t[:, None]) @ (a / w**2)
    u = 0.05 + 1.01 * (np.sin(w * t[:, None]) @ a) + 2e-2 * np.sqrt(rate / 2.0) * rng.standard_normal(len(t))
    z = np.round(p / 1e-7) * 1e-7
    recording = Recording(Channel("accel", t, u, "m/s^2"), Channel("position", t, z, "m"), rig, digest="noisy")
    model_file.save(ac.fit(recording), tmp_path / "m.json")
    lines = "\n".join(f"{a:.12g},{b:.12g},{c:.12g}" for a, b, c in zip(t, u, z, strict=True))
    (tmp_path / "run.txt").write_text(lines + "\n")
    (tmp_path / "rig.toml").write_text(
        '[sensor]\nnoise = "2e-2 m/s^2/Hz^0.5"\n[channels]\ntime = { column = "t", unit = "s" }\n'
        'accel = { column = "accel", unit = "m/s^2" }\n'
        'position = { column = "position", unit = "m", resolution = "0.1 um" }\n'
    )
    words = ["--file", "run.txt", "--rig", "rig.toml", "--model", "m.json", "--save", "m2.json", "--json"]
    done = accelcal("live", *words, cwd=tmp_path)
    end = json.loads(done.stdout.splitlines()[-1])
    bias = end["state"]["regressor_bias"]
    assert bias["sigma"] > 3.0
    assert "accelcal fit" in bias["sentence"]
    assert done.returncode == 3
    assert "nothing is written" in done.stderr
    assert not (tmp_path / "m2.json").exists()
