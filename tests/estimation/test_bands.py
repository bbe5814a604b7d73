"""The band of a record whose noise is not white, and references without noise of their own."""

from __future__ import annotations

from types import SimpleNamespace
from zlib import crc32

import numpy as np
import pytest

import accelcal as ac
from accelcal.data import POSITION_ORDER
from accelcal.data.recording import Channel, Recording
from accelcal.estimation import gauss_newton
from accelcal.estimation.bands import BandTrial, best_band, change_with_band, needs_band
from accelcal.estimation.estimate import estimate
from accelcal.estimation.noise import NoiseSearch
from accelcal.estimation.run import PreparedRun
from accelcal.estimation.values import Noise
from accelcal.model import Model
from papers.stakkeland2007.rig import shaken
from papers.stakkeland2007.rows import PAPER_SENSOR


def trial(band: float, signal: float = 100.0, scale: float = 1.0, half: float = 0.01, delay: float = 0.0) -> BandTrial:
    return BandTrial(band, 60.0 * band, signal, scale, half, delay, 1e-4)


def test_a_band_needs_signal_and_periods() -> None:
    assert best_band([trial(1.0, signal=0.5, half=1e-5), trial(2.0)]) == 2.0
    assert best_band([trial(0.1, half=1e-5), trial(2.0)]) == 2.0
    assert best_band([trial(0.1, half=1e-5)]) == 0.1  # better than none
    assert best_band([trial(1.0, half=0.02), trial(2.0, half=0.1)]) == 1.0
    assert best_band([trial(1.0, signal=10.0), trial(2.0, half=0.015)]) == 2.0  # few blocks do not tell them apart
    assert best_band([]) is None


def test_coloured_innovations_ask_for_a_band_unless_the_reading_is_better_than_the_output_at_every_frequency() -> None:
    def state(every: int, crossover: float = 100.0, coloured: bool = True, beyond: bool = False) -> SimpleNamespace:
        run = SimpleNamespace(order=POSITION_ORDER, every=every, t=np.array([0.0, 30.0]), crossover=lambda _: crossover)
        return SimpleNamespace(run=run, noise=None, coloured=coloured or beyond, beyond_output=beyond)

    assert needs_band(state(1))  # type: ignore[arg-type]
    assert not needs_band(state(8))  # type: ignore[arg-type]
    assert not needs_band(state(1, coloured=False))  # type: ignore[arg-type]
    assert needs_band(state(8, crossover=1.0))  # type: ignore[arg-type]
    assert needs_band(state(8, beyond=True))  # type: ignore[arg-type]


def test_an_answer_that_changes_with_the_band_is_said() -> None:
    assert change_with_band([trial(1.0), trial(2.0), trial(4.0)]) is None
    change = change_with_band([trial(1.0, scale=1.2), trial(2.0), trial(4.0, delay=3e-3)])
    assert change is not None
    assert "the scale and the delay change with the band" in change
    assert change_with_band([trial(1.0, scale=1.2, signal=0.1), trial(2.0), trial(4.0), trial(8.0)]) is None


def test_noise_within_a_band_has_its_crossover_there_and_the_noise_of_the_output() -> None:
    crossover, noise = PreparedRun.crossover, Noise(q=3e-6, r=2e-12)
    for step, band in ((1e-3, 2.0), (0.02, 0.3)):
        of_run = SimpleNamespace(reading_step=step)
        within = NoiseSearch(noise).within(band, of_run)  # type: ignore[arg-type]
        assert crossover(of_run, within) == pytest.approx(band, rel=1e-12)  # type: ignore[arg-type]
        assert within.q == noise.q
        assert NoiseSearch(noise).within(None, of_run) is noise  # type: ignore[arg-type]


@pytest.mark.parametrize("noise", [0.0, 1e-5])
@pytest.mark.parametrize("rate", [50.0, 100.0])
def test_a_reference_without_noise_is_fitted(noise: float, rate: float) -> None:
    rng = np.random.default_rng(int(rate))
    t = np.arange(0.0, 30.0, 1.0 / rate)
    f, phase, a = rng.uniform(0.2, 3.0, 12), rng.uniform(0.0, 2.0 * np.pi, 12), rng.uniform(0.3, 1.0, 12) / 12.0
    waves = np.sin(2.0 * np.pi * np.outer(f, t) + phase[:, None])
    output = -1.01 * a @ waves + 0.02 + noise * rng.standard_normal(len(t))
    recording = Recording(
        accel=Channel("accel", t, output, "m/s²"),
        position=Channel("position", t, (a / (2.0 * np.pi * f) ** 2) @ waves, "m"),
        rig=ac.Rig(),
        name="smooth.csv",
    )
    fit = ac.fit(recording)  # "innovation variance ... is not positive" without a floor of R
    assert fit["scale_factor"].value == pytest.approx(0.01, abs=2e-4)
    assert fit["bias"].value == pytest.approx(0.02, abs=1e-4)


def test_a_band_whose_steps_end_in_a_small_cycle_has_an_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """A record of Table I whose best bands go on moving by 0.09 standard deviations; without them K3 is 14 off."""
    record = shaken(2.0, np.random.default_rng([100, crc32("replay, 2 m/s²".encode())]).spawn(12)[9]).recording
    model = Model.cubic().add("vibration")
    K3 = estimate(model, record)["cubic"]
    assert abs(K3.value - PAPER_SENSOR["cubic"]) < 4.0 * K3.std
    monkeypatch.setattr(gauss_newton, "TRIAL_SETTLED", gauss_newton.CONVERGED)
    K3 = estimate(model, record)["cubic"]
    assert abs(K3.value - PAPER_SENSOR["cubic"]) > 8.0 * K3.std
