"""Noise that is not white: its spectrum is measured, and rows are whitened by it."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest
import scipy

import accelcal as ac
from accelcal.data.arrays import Array
from accelcal.estimation import engines
from accelcal.estimation.engines import spectrum_of
from accelcal.estimation.estimate import solve_runs
from accelcal.estimation.noise import measured_spectrum, whitener
from accelcal.model import Model
from accelcal.simulation import CXL02_RIG

RATE, ROWS = 100.0, 6000
RECORDS = 12
TRUTH = {"bias": 0.05, "scale_factor": 0.01}


def density(f: Array) -> Array:
    """A hump of a factor of 50 at 20 Hz over a floor of 0.2."""
    return np.asarray(0.2 + 10.0 * np.exp(-(((f - 20.0) / 5.0) ** 2)))


def humped(seed: int, rows: int = ROWS) -> Array:
    """Rows with that spectrum over white rows of variance 1, (rows,)."""
    rng = np.random.default_rng(seed)
    spectrum = np.fft.rfft(rng.standard_normal(rows))
    return np.asarray(np.fft.irfft(spectrum * np.sqrt(density(np.fft.rfftfreq(rows, 1.0 / RATE))), rows))


def test_the_spectrum_is_measured_above_and_below_that_of_white_rows() -> None:
    result = measured_spectrum(humped(1), RATE, RATE)
    assert result is not None
    f = np.array([0.5, 3.0, 20.0, 40.0])
    ratio = result(f) / density(f)
    assert np.all((ratio > 0.5) & (ratio < 2.0))
    white = whitener(result, RATE)(humped(1)[None])[0]
    left = measured_spectrum(white, RATE, RATE)
    assert left is not None
    assert np.all(np.abs(left.log_level) < 0.5)


def test_what_fitted_columns_take_is_not_missed() -> None:
    y = np.random.default_rng(2).standard_normal(2000)
    cosines = scipy.fft.idct(np.eye(2000)[:, 1:60:2], norm="ortho", axis=0)  # every second of the lowest lines
    left = y - cosines @ (cosines.T @ y)
    explained = np.sum(scipy.fft.dct(cosines, norm="ortho", axis=0) ** 2, axis=1)
    declared, blind = (measured_spectrum(left, RATE, RATE, share) for share in (explained, None))
    assert declared is not None
    assert blind is not None
    assert abs(np.mean(declared.log_level[:3])) < 1.0  # three standard deviations
    assert blind.log_level[0] < np.mean(declared.log_level[:3]) - 1.0  # the twin: half of its lines are empty


def test_a_few_strong_lines_are_no_level() -> None:
    lines = np.zeros(ROWS)
    lines[600:630:10] = 300.0
    tones = scipy.fft.idct(lines, norm="ortho")
    plain, struck = (measured_spectrum(humped(3) + added, RATE, RATE) for added in (0.0 * tones, tones))
    assert plain is not None
    assert struck is not None
    assert np.max(np.abs(struck.log_level - plain.log_level)) < 0.5


def test_too_few_rows_have_no_spectrum() -> None:
    assert measured_spectrum(np.ones(10), RATE, RATE) is None


def test_above_the_crossover_no_row_counts_more() -> None:
    """There the regressors hold the output's own noise; weight would draw the scale to zero."""
    y = np.random.default_rng(4).standard_normal(ROWS)
    falling = scipy.signal.sosfilt(scipy.signal.butter(2, 10.0, fs=RATE, output="sos"), y)
    result, free = (measured_spectrum(falling, RATE, crossover) for crossover in (8.0, 0.5 * RATE))
    assert result is not None
    assert free is not None
    f = np.array([1.0, 5.0, 20.0, 40.0])
    assert np.allclose(result(f[:2]), free(f[:2]))
    assert np.all(result(f[2:]) >= result(np.array([8.0])))
    assert free(f[3:])[0] < 0.1 * result(f[3:])[0]


def test_a_white_run_has_no_measured_spectrum() -> None:
    rng = np.random.default_rng(5)
    plain = ac.simulate("interleaved", seconds=20.0, rig=CXL02_RIG, parameters=TRUTH, rng=rng).recording
    state = solve_runs(Model.linear(), [plain]).states[0]
    assert state.band is None
    assert state.spectrum is None
    assert spectrum_of(state, Model.linear().free) is None


def test_a_run_at_the_limit_of_white_noise_settles(monkeypatch: pytest.MonkeyPatch) -> None:
    """What counts as white at every other look goes to and fro where the spectrum that was measured is not kept."""
    looks = itertools.count()
    monkeypatch.setattr(engines, "white", lambda spectrum: next(looks) // 2 % 2 == 0)
    record = humming(3)
    assert solve_runs(Model.linear(), [record]).converged
    measured = engines.measure_noise
    monkeypatch.setattr(engines, "measure_noise", lambda state, model, *, search=True: measured(state, model))
    assert not solve_runs(Model.linear(), [record]).converged


def humming(seed: int) -> ac.Recording:
    """A record whose output hums between 2 and 5 Hz, where it moves too, far above its own noise."""
    rng = np.random.default_rng([8, seed])
    plain = ac.simulate("interleaved", seconds=20.0, rig=CXL02_RIG, parameters=TRUTH, rng=rng).recording
    rate = 1.0 / float(np.median(np.diff(plain.accel.t)))
    sections = scipy.signal.butter(4, [2.0, 5.0], "bandpass", fs=rate, output="sos")
    hum = scipy.signal.sosfilt(sections, 2.0 * rng.standard_normal(len(plain.accel.y)))
    return dataclasses.replace(plain, accel=dataclasses.replace(plain.accel, y=plain.accel.y + hum))


def deviations(records: list[ac.Recording]) -> tuple[float, float]:
    """Rms error of the scale factor, and rms of the error over its standard deviation."""
    results = [ac.fit(record)["scale_factor"] for record in records]
    error = np.array([estimate.value - TRUTH["scale_factor"] for estimate in results])
    return float(np.sqrt(np.mean(error**2))), float(
        np.sqrt(np.mean((error / [estimate.std for estimate in results]) ** 2))
    )


def test_a_hum_costs_less_and_its_uncertainty_is_true(monkeypatch: pytest.MonkeyPatch) -> None:
    records = [humming(seed) for seed in range(RECORDS)]
    error, z = deviations(records)
    monkeypatch.setattr(engines, "spectrum_of", lambda state, terms, **_: None)
    blind_error, blind_z = deviations(records)
    print(
        f"{RECORDS} records with a hum: scale wrong by {error:.2e}, z-rms {z:.2f}; "
        f"as white {blind_error:.2e}, {blind_z:.2f}"
    )
    assert z**2 * RECORDS < scipy.special.chdtri(RECORDS, 1e-3)  # one in a thousand by chance
    assert blind_z**2 * RECORDS > scipy.special.chdtri(RECORDS, 1e-3)  # the twin
    assert error < 0.5 * blind_error
