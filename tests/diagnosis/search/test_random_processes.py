"""A scale factor that is a random process, on independent worlds: named or in a class with drift and step."""

import numpy as np
import pytest

import accelcal as ac
from accelcal.diagnosis.search import scan
from tests.worlds import Hidden, World

SCALE = {"scale_gauss_markov", "scale_random_walk"}


def recorded(folder, world):
    return ac.load(world.record().write(folder))


@pytest.mark.parametrize(("size", "tau", "seed"), [(5e-3, 0.5, 3), (5e-3, 0.5, 4), (4e-3, 2.0, 5)])
def test_it_is_named_and_the_scale_factor_has_the_error_that_it_states(tmp_path, size, tau, seed):
    world = World("tones", "ADXL105", (Hidden("scale_gauss_markov", size, {"tau": tau}),), seed=seed).settled()
    run = recorded(tmp_path, world)
    linear = ac.fit(run)
    found = ac.diagnose(linear, run)
    assert SCALE & set(found.classes[0].members)
    entering = found.scan.found[0]
    assert entering.effect in SCALE
    fit = ac.fit(run, entering.enter(linear.model))
    assert abs(fit["scale_factor"].value - world.scale_factor) < 3.5 * fit["scale_factor"].std
    if entering.effect == "scale_gauss_markov":  # the mean of a random walk is that of the record, and no less certain
        assert fit["scale_factor"].std > 2.0 * linear["scale_factor"].std
        assert entering.prior_std == pytest.approx(size, rel=0.5)


def test_a_step_that_recurs_gives_way_to_the_process_with_which_it_is_confounded(tmp_path, monkeypatch):
    """The record on which a step leads; with the twin that never replaces it, nothing enters."""
    world = World("tones", "ADXL105", (Hidden("scale_gauss_markov", 2e-3, {"tau": 2.0}),), seed=1701001).settled()
    run = recorded(tmp_path, world)
    fit = ac.fit(run)
    found = ac.diagnose(fit, run)
    assert [each.effect for each in found.scan.found] == ["scale_gauss_markov"]
    assert not found.scan.changing
    monkeypatch.setattr(scan.BestSet, "process_instead", lambda *arguments: None)
    twin = ac.diagnose(fit, run)
    assert not twin.scan.found
    assert [each.effect for each in twin.scan.changing] == ["scale_step"]


def test_a_constant_scale_factor_is_no_process(tmp_path):
    for seed in range(3):
        run = recorded(tmp_path, World("tones", "ADXL105", (), seed=900 + seed))
        found = ac.diagnose(ac.fit(run), run)
        assert not any(SCALE & set(group.members) for group in found.classes)
        assert np.isfinite(found.scan.detection_limits["scale_drift"])
