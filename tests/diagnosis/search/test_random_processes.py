"""A scale factor that is a random process, on independent worlds: named or in a class with drift and step."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

import accelcal as ac
from tests.worlds import Hidden, World

SCALE = {"scale_gauss_markov", "scale_random_walk"}


def recorded(folder, world):
    return ac.load(world.record().write(folder))


@pytest.mark.parametrize(("size", "tau", "seed"), [(5e-3, 0.5, 3), (5e-3, 0.5, 4), (4e-3, 2.0, 5)])
def test_it_is_named_and_the_scale_factor_has_the_error_that_it_states(tmp_path, size, tau, seed):
    world = World("tones", "ADXL105", (Hidden("scale_gauss_markov", size, {"tau": tau}),), seed=seed).settled()
    run = recorded(tmp_path, world)
    linear = ac.fit(run)
    diagnosis = ac.diagnose(linear, run)
    assert SCALE & set(diagnosis.classes[0].members)
    entering = diagnosis.scan.detected[0]
    assert entering.effect in SCALE
    fit = ac.fit(run, entering.enter(linear.model))
    assert abs(fit["scale_factor"].value - world.scale_factor) < 3.5 * fit["scale_factor"].std
    if entering.effect == "scale_gauss_markov":  # the mean of a random walk is that of the record, and no less certain
        assert fit["scale_factor"].std > 2.0 * linear["scale_factor"].std
        assert entering.prior_std == pytest.approx(size, rel=0.5)
    assert [finding.effect for finding in ac.diagnose(fit, run).present] == [entering.effect]


def test_a_constant_scale_factor_is_no_process(tmp_path):
    for seed in range(3):
        run = recorded(tmp_path, World("tones", "ADXL105", (), seed=900 + seed))
        fit = ac.fit(run)
        diagnosis = ac.diagnose(fit, run)
        assert not any(SCALE & set(group.members) for group in diagnosis.classes)
        assert np.isfinite(diagnosis.scan.detection_limits["scale_drift"])
    with_process = ac.add(fit, run, "scale_random_walk")
    assert not ac.diagnose(with_process, run).present


@pytest.mark.parametrize(
    ("text", "other"),
    [("bias_gauss_markov", "bias_random_walk"), ("scale_gauss_markov", "scale_random_walk")],
)
def test_two_processes_of_one_coefficient_enter_in_either_order(text: str, other: str) -> None:
    """The second is judged beside the first at its intensity: a first one left free contains it, and the intensity of
    the second is then anything."""
    simulation = ac.simulate(
        "interleaved", seconds=30.0, rig=ac.simulation.CXL02_RIG, parameters={}, rng=np.random.default_rng(71)
    )
    rng, accel = np.random.default_rng(72), simulation.recording.accel
    step = float(np.median(np.diff(accel.t)))
    moving = accel.y if text.startswith("scale") else 1.0
    size = 0.02 if text.startswith("scale") else 0.006
    keep = np.exp(-step / np.array([0.7, 12.0]))
    fast, slow = (lfilter([np.sqrt(1 - k * k)], [1.0, -k], rng.standard_normal(len(accel))) for k in keep)
    y = accel.y + moving * size * (fast + 3.0 * slow)
    recording = replace(simulation.recording, accel=replace(accel, y=y))
    base = ac.fit(recording, ac.Model.linear())
    fits = [ac.add(ac.add(base, recording, a), recording, b) for a, b in ((text, other), (other, text))]
    first, second = fits
    for name in ("bias", "scale_factor", "time_offset"):
        assert abs(first[name].value - second[name].value) < 0.02 * first[name].std
        assert second[name].std == pytest.approx(first[name].std, rel=0.02)
    for name in (text, other):
        intensities = [fit.model.priors[f"{name}.c1"].std for fit in fits]
        assert all(0.0 < intensity < 1.0 for intensity in intensities)
        assert intensities[0] == pytest.approx(intensities[1], rel=0.05)
        assert first.model.shapes[name].get("tau", 1.0) == pytest.approx(
            second.model.shapes[name].get("tau", 1.0), rel=0.05
        )
