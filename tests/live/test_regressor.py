"""Noise of the output in the gradient of a live scale factor: taken out, or the number refused."""

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


def followed(noise: float, rate: float, resolution: float, seconds: float, seed: int, motion: float = 1.0) -> Tracker:
    """A filter behind a slow stage with 1.4 m/s² rms; the sidecar is right."""
    rng, count = np.random.default_rng(seed), 5000
    w = 2.0 * np.pi * np.array([0.11, 0.23, 0.37, 0.59])
    size = motion * np.array([1.4, 1.05, 0.7, 0.49]) / w**2
    live = Tracker(settings_of(ac.Rig(ac.Sensor(noise=noise, range=50.0), resolution=resolution)))
    for begin in range(0, int(seconds * rate), count):
        t = (np.arange(count) + begin) / rate
        s = size * np.sin(w * t[:, None] + np.arange(4))
        u = 0.05 - (1.0 + SCALE) * (s * w**2).sum(1) + rng.standard_normal(count) * noise * np.sqrt(rate / 2.0)
        live.feed(Rows(t, u, np.round(s.sum(1) / resolution) * resolution))
    return live


@pytest.mark.parametrize(
    ("noise", "rate", "resolution", "seconds"),
    [(2.2e-3, 1667.0, 1e-6, 60.0), (2e-3, 50.0, 1e-6, 1200.0), (2e-2, 1000.0, 1e-7, 30.0)],
)
def test_the_scale_factor_is_within_its_uncertainty(noise, rate, resolution, seconds) -> None:
    """The paper's sensor, one at 50 Hz, a noisy one; false-alarm rate: 6e-5 each."""
    live = followed(noise, rate, resolution, seconds, 3409)
    [result] = (e for e in live.estimates if e.name == "scale_factor")
    assert abs(result.value - SCALE) < 4.0 * result.std
    assert live.noise_share.value < 0.15
    assert live.noise_share.sentence == ""


@pytest.mark.parametrize("motion", [1.0, 1e-3, 0.0])
def test_beyond_what_the_correction_holds_no_scale_factor_is_shown(motion: float) -> None:
    """A noisy sensor on a stage that moves, hardly moves, or rests."""
    live = followed(0.2, 1000.0, 1e-7, 60.0, 3410, motion)
    assert live.noise_share.value > 1.0
    assert [e.name for e in live.estimates] == ["bias"]
    assert "times the power of the motion" in live.noise_share.sentence


def test_moments_do_not_depend_on_the_chunks() -> None:
    rng = np.random.default_rng(3411)
    t = np.arange(3000) / 1000.0
    u = np.where(rng.random(3000) < 0.1, np.nan, 9.8 + np.sin(5.0 * t) + 0.1 * rng.standard_normal(3000))
    z = np.where(rng.random(3000) < 0.5, np.nan, -np.sin(5.0 * t) / 25.0)
    settings = settings_of(ac.Rig(ac.Sensor(noise=4.5e-3, range=50.0), resolution=1e-6))
    results = []
    for cuts in ([], np.arange(1, 3000), np.sort(rng.choice(3000, 40))):
        moments = OutputMoments()
        for rows in np.split(np.arange(3000), cuts):
            moments.add(Rows(t[rows], u[rows], z[rows]))
        results.append(moments.noise_share(settings).value)
    assert results[1:] == pytest.approx([results[0]] * 2, rel=1e-9)


def test_a_scale_factor_in_noise_is_not_saved(tmp_path: Path) -> None:
    """A sensor of 0.2 (m/s²)/√Hz beside an encoder of 0.1 µm, declared as they are; its model is that of a fit."""
    rig = ac.Rig(ac.Sensor(noise=0.2, range=50.0), resolution=1e-7)
    rng, rate = np.random.default_rng(3412), 1000.0
    t = np.arange(int(20.0 * rate)) / rate
    w, a = np.array([2.0, 5.0]), np.array([1.5, 1.0])
    p = -np.sin(w * t[:, None]) @ (a / w**2)
    u = 0.05 + 1.01 * (np.sin(w * t[:, None]) @ a) + 0.2 * np.sqrt(rate / 2.0) * rng.standard_normal(len(t))
    z = np.round(p / 1e-7) * 1e-7
    recording = Recording(Channel("accel", t, u, "m/s^2"), Channel("position", t, z, "m"), rig, digest="noisy")
    model_file.save(ac.fit(recording), tmp_path / "m.json")
    lines = "\n".join(f"{a:.12g},{b:.12g},{c:.12g}" for a, b, c in zip(t, u, z, strict=True))
    (tmp_path / "run.txt").write_text(lines + "\n")
    (tmp_path / "rig.toml").write_text(
        '[sensor]\nnoise = "0.2 m/s^2/Hz^0.5"\n[channels]\ntime = { column = "t", unit = "s" }\n'
        'accel = { column = "accel", unit = "m/s^2" }\n'
        'position = { column = "position", unit = "m", resolution = "0.1 um" }\n'
    )
    words = ["--file", "run.txt", "--rig", "rig.toml", "--model", "m.json", "--save", "m2.json", "--json"]
    done = accelcal("live", *words, cwd=tmp_path)
    end = json.loads(done.stdout.splitlines()[-1])
    share = end["state"]["noise_share"]
    assert share["value"] > 0.15
    assert "accelcal fit" in share["sentence"]
    assert done.returncode == 3
    assert "nothing is written" in done.stderr
    assert not (tmp_path / "m2.json").exists()
