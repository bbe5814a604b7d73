"""Lines and waves: what a noise test names is added where the test found it, and what is left is still named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import accelcal as ac
from accelcal.diagnosis.select import stepwise
from accelcal.estimation.remarks import remark
from accelcal.results import model_file
from accelcal.simulation.sensor import ADXL105_RIG
from accelcal.verbs import barely_shown

DENSITY, RATE = 1.4e-3, 1000.0
LINES = ((0.06, 50.02), (0.03, 73.31))
"""Amplitude, m/s², and frequency, Hz, of two lines that have nothing to do with each other."""
SCALE = (2e-6, 1e-6, 5e-7, 3e-7)
"""Amplitudes of the harmonics of a magnetic scale, m."""
POLES = 1e-3
"""Its period, m."""


def record(seed: int, wave=lambda p: 0.0 * p, lines=(), seconds: float = 16.0) -> ac.Recording:
    """Sines by hand, the encoder and the output with white noise, and what is added to either."""
    rng, t = np.random.default_rng(seed), np.arange(int(seconds * RATE)) / RATE
    omega, size = 2.0 * np.pi * np.array([0.37, 0.91, 1.6, 2.9]), np.array([18e-3, 7e-3, 4e-3, 1e-3])
    turn = omega * t[:, None] + rng.uniform(0.0, 6.3, 4)
    p, a = np.sin(turn) @ size, -np.sin(turn) @ (size * omega**2)
    output = 0.07 + 0.99 * a + DENSITY * np.sqrt(0.5 * RATE) * rng.standard_normal(len(t))
    output += sum(m * np.sin(2.0 * np.pi * f * t + 0.7) for m, f in lines)
    position = p + wave(p) + 4e-7 * rng.standard_normal(len(t))
    units = {"accel": "m/s^2", "position": "m"}
    return ac.Recording.from_arrays(t, output, position, units=units, rig=ac.Rig(ac.Sensor(noise=DENSITY)))


def size(fit: ac.Fit, name: str) -> tuple[float, float]:
    """Amplitude of a wave of a fit, and its standard deviation."""
    parts = [fit[f"{name}.{part}"] for part in ("sin", "cos")]
    return float(np.hypot(*(e.value for e in parts))), max(e.std for e in parts)


@pytest.mark.parametrize("period", [20e-6, 3e-4])
def test_a_wave_that_only_slow_readings_resolve_is_added_where_it_was_found(period):
    amplitude = 2.5e-7
    run = record(51, lambda p: amplitude * np.sin(2.0 * np.pi * p / period + 0.4))
    fit = ac.fit(run)
    assert ac.diagnose(fit, run).effects == ("encoder_cyclic",)
    grown = ac.add(fit, run, "encoder_cyclic")
    (shape,) = grown.shapes
    value, std = size(grown, "encoder_cyclic")
    assert abs(shape.value - period) < 4.0 * shape.std < 1e-3 * period
    assert abs(value - amplitude) < 4.0 * std < 0.5 * amplitude
    assert not grown.remarks
    after = ac.diagnose(grown, run)
    assert after.verdict == "adequate"
    assert f"period {1e6 * period:.4g} µm" in after.sentence


def test_of_a_wave_and_an_effect_the_one_that_explains_more_is_named_first():
    run = record(51, lambda p: 6e-7 * np.sin(2.0 * np.pi * p / 20e-6 + 0.4))
    bent = {c: replace(run, accel=replace(run.accel, y=run.accel.y + c * run.accel.y**3)) for c in (0.03, 0.3)}
    first = {c: ac.diagnose(ac.fit(recording), recording) for c, recording in bent.items()}
    assert first[0.03].effects[0] == "encoder_cyclic"
    assert first[0.03].sentence.startswith("The encoder errs by 590 nm with a period of 20 µm")
    assert len(first[0.03].scan.detected) > 0
    assert first[0.3].effects[0] != "encoder_cyclic"


@pytest.fixture(scope="module")
def hum() -> tuple[ac.Recording, ac.Fit]:
    run = record(52, lines=LINES)
    return run, ac.fit(run)


def test_the_strongest_line_enters_first_and_the_other_one_is_still_named(hum, tmp_path):
    run, fit = hum
    first = ac.diagnose(fit, run)
    assert first.effects == ("tone",)
    assert [test.parts["frequency"] for test in first.channels if test.shape] == pytest.approx(
        [f for _, f in LINES], abs=0.01
    )
    wave = ac.add(fit, run, "tone")
    left = ac.diagnose(wave, run)
    assert left.effects == ("tone_2",)  # the model's own line silences itself alone
    both = ac.add(wave, run, "tone_2")
    for name, (amplitude, frequency) in zip(("tone", "tone_2"), LINES, strict=True):
        shape = next(e for e in both.shapes if e.name == f"{name}.frequency")
        value, std = size(both, name)
        assert abs(shape.value - frequency) < 4.0 * shape.std
        assert abs(value - amplitude) < 4.0 * std
    assert ac.diagnose(both, run).verdict == "adequate"
    model_file.save(both, tmp_path / "both.json")
    assert model_file.load(tmp_path / "both.json").model == both.model


def test_improve_has_a_step_for_each_line_and_a_model_that_holds_both(hum):
    run, _ = hum
    better = ac.improve(run)
    assert [step.effects for step in better.steps] == [(), ("tone",), ("tone", "tone_2")]
    assert better.best.model.added == ("tone", "tone_2")
    assert "frequency 50.02 Hz" in better.sentence


@pytest.mark.parametrize(("sigma", "message"), [(1.5, True), (2.5, False)])
def test_a_coefficient_below_two_standard_deviations_is_said(hum, sigma, message):
    run, _ = hum
    fit = ac.fit(run, ac.Model.linear().add("velocity"))
    estimates = [replace(e, value=sigma * e.std) if e.name == "velocity" else e for e in fit.estimates]
    notes = barely_shown(replace(fit, estimates=tuple(estimates)), ["velocity"])
    assert [f"{sigma} standard deviations from zero" in note.sentence for note in notes] == [True] * message


def test_a_further_line_needs_the_first(hum):
    run, fit = hum
    with pytest.raises(ValueError, match="only beside tone"):
        ac.add(fit, run, "tone_2")


def pairs(fit: ac.Fit, name: str) -> list[tuple[float, float]]:
    """Amplitudes of the harmonics of a wave of a fit, and their standard deviations."""
    own_effects = [e for e in fit.estimates if e.name.startswith(f"{name}.")]
    return [
        (float(np.hypot(a.value, b.value)), max(a.std, b.std))
        for a, b in zip(own_effects[::2], own_effects[1::2], strict=True)
    ]


def scale(*amplitudes: float, period: float = POLES):
    """The error of a magnetic scale at a position."""
    return lambda p: sum(m * np.sin(2.0 * np.pi * n * p / period + 0.4 * n) for n, m in enumerate(amplitudes, 1))


def test_harmonics_of_one_period_enter_together_and_nothing_is_missing_then(tmp_path):
    run = record(53, scale(*SCALE))
    better = ac.improve(run)
    assert [step.effects for step in better.steps] == [(), ("encoder_cyclic",)]
    (shape,) = better.best.shapes
    assert abs(shape.value - POLES) < 4.0 * shape.std
    sizes = pairs(better.best, "encoder_cyclic")
    assert len(sizes) == len(SCALE)
    assert all(abs(value - true) < 4.0 * std for (value, std), true in zip(sizes, SCALE, strict=True))
    assert better.left[0] == "adequate"
    assert "harmonics 4" in better.sentence
    model_file.save(better.best, tmp_path / "scale.json")
    assert model_file.load(tmp_path / "scale.json").model == better.best.model


@pytest.mark.parametrize("period", [POLES, 4e-5])
def test_a_single_wave_has_no_second_harmonic(period):
    """Nor has one of 5 % of its period, which bends itself through the position that contains it."""
    run = record(54, scale(2e-6, period=period))
    grown = ac.add(ac.fit(run), run, "encoder_cyclic")
    assert [e.name for e in grown.estimates if "cyclic" in e.name] == ["encoder_cyclic.sin", "encoder_cyclic.cos"]


def test_harmonics_of_the_mains_are_columns_of_one_line():
    hum = ((0.06, 50.02), (0.03, 100.04))
    run = record(55, lines=hum)
    grown = ac.add(ac.fit(run), run, "tone")
    sizes = pairs(grown, "tone")
    assert len(sizes) == len(hum)
    assert all(abs(value - true) < 4.0 * std for (value, std), (true, _) in zip(sizes, hum, strict=True))
    assert ac.diagnose(grown, run).verdict == "adequate"


def test_a_wave_that_was_kept_out_of_the_model_is_missing_and_not_found(hum, monkeypatch):
    run, _ = hum
    monkeypatch.setattr(
        stepwise, "undetermined", lambda name, solution: remark("undetermined", effect=name, gain=1.0, coefficients=2)
    )
    better = ac.improve(run)
    assert better.effects == better.best.model.added == ()
    assert better.verdict == "unexplained"
    assert better.sentence.startswith("tone would explain more of the record")
    assert "found" not in better.sentence.partition("added")[0]


def test_a_jump_that_is_left_out_is_not_added_elsewhere() -> None:
    jumped = record(5, lambda p: 2e-5 * (np.arange(len(p)) > 9000))
    fit = ac.fit(jumped)
    assert ac.diagnose(fit, jumped).effects == ("encoder_step",)
    with pytest.raises(ValueError, match=r"cannot be added: its jump is accounted for already .* at t = 9\.00"):
        ac.add(fit, jumped, "encoder_step")
    untouched = record(5)
    added = ac.add(ac.fit(untouched), untouched, "encoder_step")
    assert "encoder_step" in added.model.effects  # a twin without a jump is not refused


def test_a_line_beyond_what_the_weak_form_resolves_is_refused() -> None:
    """Those of `LINES`, which it resolves, are added above."""
    rng, t = np.random.default_rng(49), np.arange(30_000) / 1000.0
    omega, size = 2.0 * np.pi * np.array([0.31, 0.67, 1.4, 2.3, 4.2]), np.array([20e-3, 9e-3, 4e-3, 2e-3, 6e-4])
    turn = omega * t[:, None] + rng.uniform(0.0, 6.3, 5)
    output = -np.sin(turn) @ (size * omega**2) + 2.2e-3 * np.sqrt(500.0) * rng.standard_normal(len(t))
    output += 2.2 * np.sin(2.0 * np.pi * 322.01 * t)
    position = np.sin(turn) @ size + 2e-7 * rng.standard_normal(len(t))
    units = {"accel": "m/s^2", "position": "m"}
    line = ac.Recording.from_arrays(t, output, position, units=units, rig=ac.Rig(ac.Sensor(noise=2.2e-3)))
    fit = ac.fit(line)
    assert "tone" in ac.diagnose(fit, line).effects
    with pytest.raises(ac.AccelcalError, match=r"(does not determine its size|with it does not settle)"):
        ac.add(fit, line, "tone")


def test_harmonics_of_a_strong_cubic_are_not_named_as_lines() -> None:
    rng = np.random.default_rng(77)
    simulation = ac.simulate("fast", seconds=60.0, rig=ADXL105_RIG, parameters={"cubic": 1e-3}, rng=rng)
    assert ac.diagnose(ac.fit(simulation.recording), simulation.recording).effects == ("cubic",)
