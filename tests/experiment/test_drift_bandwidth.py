"""Detectable drift bandwidth: against closed forms, a fit of the same change, and its detections."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import accelcal as ac
from accelcal.cli import app, write_recording
from accelcal.diagnosis.experiment import power
from accelcal.diagnosis.experiment.drift_bandwidth import SIGMA, drift_bandwidth, tumble_limit
from accelcal.effects import found_by
from accelcal.model import Model
from accelcal.simulation import ADXL105_RIG

SECONDS = 60.0
LINE = found_by("line").name


@pytest.fixture(scope="module")
def power_of_tones():
    rng = np.random.default_rng(1)
    truth = {"bias": 0.05, "scale_factor": 0.01}
    simulation = ac.simulate("tones", seconds=SECONDS, rig=ADXL105_RIG, parameters=truth, rng=rng)
    return simulation.recording, power(Model.linear(), simulation.recording)


def test_well_inside_its_band_the_limit_is_that_of_white_noise(power_of_tones):
    _, powers = power_of_tones
    drift, state = powers.drift, powers.detection_model.state
    white = SIGMA * np.sqrt(2.0 * state.noise.q / SECONDS) * state.values.scale
    inside = (drift.frequency > 5.0 / SECONDS) & (drift.frequency < 0.2 * state.run.crossover(state.noise))
    assert np.count_nonzero(inside) > 10
    np.testing.assert_allclose(drift.bias[inside], white, rtol=0.03)
    slow = inside & (drift.frequency < 0.3)  # slower than the motion: sidebands do not fold
    rms = float(np.sqrt(np.mean(state.signals.a**2)))
    np.testing.assert_allclose(drift.scale_factor[slow], white / rms, rtol=0.05)


def test_slow_changes_and_those_beyond_the_crossover_are_shown_less(power_of_tones):
    drift = power_of_tones[1].drift
    best = np.argmin(drift.bias)
    assert drift.bias[0] > 4.0 * drift.bias[best]
    assert drift.bias[-1] > 1.2 * drift.bias[best]
    assert np.all(np.diff(drift.bias[drift.frequency < 1.0 / SECONDS]) < 0.0)
    amplitude = 2.0 * float(np.min(drift.scale_factor))
    assert (
        drift.highest("scale_factor", amplitude) == drift.frequency[-1]
        or drift.highest("scale_factor", amplitude) > 1.0
    )
    assert drift.highest("scale_factor", 0.0) == 0.0
    with pytest.raises(ValueError, match="known of bias and scale_factor"):
        drift.highest("time_offset", 1.0)


def test_a_fit_of_the_change_has_the_standard_deviation_of_the_limit(power_of_tones):
    """The other path to the same number: Gauss-Newton at the full rate, the frequency held."""
    run, powers = power_of_tones
    drift = powers.drift
    for index in (8, 16, 24):
        f = float(drift.frequency[index])
        model = Model.linear().add(LINE, shapes={LINE: {"frequency": f}}).freeze(**{f"{LINE}.frequency": f})
        fit = ac.fit(run, model)
        rows = [i for i, item in enumerate(fit.free) if item.name.startswith(LINE)]
        largest = np.linalg.eigvalsh(fit.covariance[np.ix_(rows, rows)])[-1]
        assert SIGMA * np.sqrt(largest) == pytest.approx(drift.bias[index], rel=0.02)


def test_a_change_at_the_limit_is_five_sigma_and_what_was_measured_does_not_count(power_of_tones):
    _, powers = power_of_tones
    drift = powers.drift
    f, size = float(drift.frequency[16]), float(drift.bias[16])
    scores = []
    for seed in range(6):
        rng = np.random.default_rng([5, seed])
        recording = ac.simulate("tones", seconds=SECONDS, rig=ADXL105_RIG, parameters={}, rng=rng).recording
        phase = rng.uniform(0.0, 2.0 * np.pi)
        recording.accel.y[:] += size * np.sin(2.0 * np.pi * f * recording.accel.t + phase)
        model = Model.linear().add(LINE, shapes={LINE: {"frequency": f}}).freeze(**{f"{LINE}.frequency": f})
        fit = ac.fit(recording, model)
        rows = [i for i, item in enumerate(fit.free) if item.name.startswith(LINE)]
        c = np.array([fit.free[i].value for i in rows])
        scores.append(float(c @ np.linalg.solve(fit.covariance[np.ix_(rows, rows)], c)))
    # noncentral chi-square of 2 degrees of freedom and 25: mean 27, variance 104
    print(f"mean gain of 6: {np.mean(scores):.1f}, expected 27 ± {np.sqrt(104 / 6):.1f}")
    assert abs(np.mean(scores) - 27.0) < 4.0 * np.sqrt(104.0 / 6.0)


def test_a_tumble_is_limited_by_its_length_and_by_the_noise(power_of_tones):
    state = power_of_tones[1].detection_model.state
    limit = tumble_limit(state)
    assert limit.frequency == pytest.approx(0.5 / 1800.0)
    # K0 of 24 minutes of white noise at exact angles; the zero of the angles and their errors add little
    assert limit.bias == pytest.approx(SIGMA * np.sqrt(state.noise.q / 1440.0) * state.values.scale, rel=0.3)
    again = drift_bandwidth(state, Model.linear())
    np.testing.assert_allclose(again.bias, power_of_tones[1].drift.bias, rtol=1e-9)


def test_the_command_prints_it_and_json_holds_it(power_of_tones, tmp_path):
    run, _ = power_of_tones
    path = tmp_path / "run.csv"
    write_recording(run, path)
    done = CliRunner().invoke(app, ["power", str(path)])
    assert done.exit_code == 0, done.output
    assert "smallest sinusoidal change that this record shows at 5 sigma" in done.stdout
    assert "a tumble test of 30 min" in " ".join(done.stdout.split())
    content = json.loads(CliRunner().invoke(app, ["power", str(path), "--json"]).stdout)["drift"]
    assert len(content["frequency"]) == len(content["bias"]) == len(content["scale_factor"])
    assert content["tumble"]["seconds"] == 1800.0
