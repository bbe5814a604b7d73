"""First-order filters that nobody declared are found by name: of the position sensor, and AC coupling of the output."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.signal

import accelcal as ac
from accelcal.diagnosis.search.scan import scan
from accelcal.diagnosis.verdict import Diagnosis
from accelcal.effects import CATALOGUE, find
from accelcal.estimation.estimate import solve_runs
from tests.regimes.hidden import EFFECTS, FINE
from tests.regimes.motion import Motion, Piecewise
from tests.regimes.regimes import ADXL105, CXL02, TABLE
from tests.regimes.rig import NOTHING, Planted, Reference, Rig
from tests.regimes.slow import build

SECONDS = 15.0
LATE = 318e-6
"""s; an LVDT behind 500 Hz."""
SLOW = 2e-3
"""s; an output behind an RC low-pass of 80 Hz."""
SCALE = 0.01
LVDT = Reference(2e-6, None, 1666.71)


def diagnosed(tmp_path: Path, rig: Rig, profile: str, planted: Planted = NOTHING) -> tuple[Diagnosis, ac.Recording]:
    """The base model on one record of a rig, and the record."""
    regime = replace(TABLE["a-mixed-adxl105"], rig=rig, profile=profile, seconds=SECONDS)
    recording = ac.load(regime.build(6, planted).write(tmp_path))
    return ac.diagnose(ac.fit(recording), recording), recording


def classes(diagnosis: Diagnosis) -> dict[str, tuple[str, ...]]:
    return {group.effect: group.members for group in diagnosis.classes}


@pytest.mark.parametrize("tau", [2.0])
def test_ac_coupling_is_found_with_its_time_constant(tmp_path: Path, tau: float) -> None:
    def output(motion: Motion) -> Piecewise:
        return EFFECTS["ac_coupling"][0](motion.refined(FINE), 1.0 / tau, 0.0)

    result, recording = diagnosed(tmp_path, Rig(CXL02), "mixed", Planted(output=output))
    assert result.effects == ("ac_coupling",)
    fit = ac.add(result.fit, recording, "ac_coupling")
    estimate, start = fit.shapes
    assert (estimate.name, start.name) == ("ac_coupling.tau", "ac_coupling.start")
    assert abs(estimate.value - tau) < 4.0 * estimate.std < tau
    assert abs(start.value) < 4.0 * start.std  # it rested before


@pytest.mark.parametrize(("seed", "tau"), [(1, 18.29), (3, 8.43), (43, 11.51)])
def test_what_a_coupling_carries_over_from_before_the_record_has_no_name(tmp_path: Path, seed: int, tau: float) -> None:
    recording = ac.load(build("coupling", seed, 60.0).write(tmp_path))
    fit = ac.add(ac.fit(recording), recording, "ac_coupling")
    estimates = {e.name: e for e in fit.shapes}
    assert abs(estimates["ac_coupling.tau"].value - tau) < 3.5 * estimates["ac_coupling.tau"].std
    assert abs(estimates["ac_coupling.start"].value) > 5.0 * estimates["ac_coupling.start"].std
    assert ac.diagnose(fit, recording).effects == ()
    # the twin: the same as after a long rest
    rested = ac.fit(recording, fit.model.freeze(**{"ac_coupling.start": 0.0}))
    assert {"warm_up", "creep"} & set(ac.diagnose(rested, recording).effects)


def test_a_lag_of_the_encoder_is_in_the_class_that_is_named(tmp_path: Path) -> None:
    result, recording = diagnosed(tmp_path, Rig(ADXL105, replace(LVDT, lag=LATE)), "shaker")
    assert result.effects
    assert all("encoder_lag" in members for members in classes(result).values())
    fit = ac.add(result.fit, recording, "encoder_lag")
    (estimate,) = fit.shapes
    assert abs(estimate.value - LATE) < 4.0 * estimate.std < LATE
    assert abs(fit["time_offset"].value) < 20e-6 + 4.0 * fit["time_offset"].std  # the rest is the clocks'


def test_neither_is_named_without_a_filter_nor_for_a_lag_of_the_sensor(tmp_path: Path) -> None:
    # The twins: the same rig without a filter, and a lag in the other channel.
    assert diagnosed(tmp_path, Rig(ADXL105, LVDT), "shaker")[0].effects == ()
    late, _ = diagnosed(tmp_path, Rig(ADXL105, LVDT), "shaker", Planted(poles=(complex(-1.0 / LATE),)))
    assert not {"encoder_lag", "ac_coupling"} & set(late.effects)
    assert {"time_offset", "sensor_lag"} & set(late.effects)
    assert np.sign(late.fit["time_offset"].value) == 1.0


def eight_tones(tau: float, delay: float) -> ac.Recording:
    """Twelve seconds of eight tones to 14 Hz, the output behind an RC that SciPy filters at 20 kHz, or only late."""
    rng = np.random.default_rng(1)
    every, fine = 20, 20_000.0
    t = np.arange(-1.0, 12.0, 1.0 / fine)
    f = np.linspace(0.8, 14.0, 8) * (1.0 + 0.03 * rng.uniform(-1.0, 1.0, 8))
    phases, amplitudes = rng.uniform(0.0, 2.0 * np.pi, 8), np.minimum(1.0, (f / 3.0) ** 2)
    a = amplitudes @ np.sin(np.outer(2.0 * np.pi * f, t - delay) + phases[:, None])
    if tau:  # the bilinear transform differs from an RC by (h/tau)²/12 = 5e-5 of its phase
        b, poles = scipy.signal.bilinear([1.0], [tau, 1.0], fs=fine)
        a = scipy.signal.lfilter(b, poles, a)
    used = slice(int(fine), None, every)
    t, output = t[used], 0.05 + (1.0 + SCALE) * a[used]
    output += 0.02 * rng.standard_normal(len(t))
    position = np.full(len(t), np.nan)
    x = -(amplitudes / (2.0 * np.pi * f) ** 2) @ np.sin(np.outer(2.0 * np.pi * f, t[::10]) + phases[:, None])
    position[::10] = x + 2e-6 * rng.standard_normal(len(x))
    return ac.Recording.from_arrays(t, output, position, units={"accel": "m/s^2", "position": "m"})


def test_a_low_pass_of_the_output_that_nobody_declared_is_named_and_undone() -> None:
    # Chance fails it for one record in a thousand: 3.5 standard deviations, twice.
    recording = eight_tones(SLOW, 0.0)
    fit = ac.fit(recording)
    assert abs(fit["scale_factor"].value - SCALE) > 0.0035  # what the low-pass takes looks like scale
    diagnosis = ac.diagnose(fit, recording)
    assert "sensor_lag" in diagnosis.effects
    assert diagnosis.sentence.endswith(
        'if accel passes such a filter, declare it: lowpass = { kind = "RC", tau = ... }.'
    )
    undone = ac.add(fit, recording, "sensor_lag")
    k, (tau,) = undone["scale_factor"], undone.shapes
    assert abs(k.value - SCALE) < 3.5 * k.std < 0.001
    assert abs(tau.value - SLOW) < 3.5 * tau.std < 0.1 * SLOW


def test_an_effect_that_a_fit_with_it_does_not_tell_from_the_base_stops_no_search(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    lag = find("sensor_lag")  # of any gain: the offset takes up what it has left at the smallest time constant
    monkeypatch.setitem(CATALOGUE, lag.name, replace(lag, prior=replace(lag.prior, mean=0.0, scale=1.0)))
    model = ac.Model.linear()
    assert scan(solve_runs(model, [eight_tones(SLOW, 0.0)]).states, model).examined > 0


def test_a_delay_of_the_output_is_no_low_pass() -> None:
    """Over four seeds none was named; a false name comes with 1 % of records at most."""
    recording = eight_tones(0.0, SLOW)
    diagnosis = ac.diagnose(ac.fit(recording), recording)
    assert diagnosis.effects == ("time_offset",)
    assert abs(diagnosis.fit["time_offset"].value - SLOW) < 1e-5
