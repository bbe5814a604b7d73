"""Random processes of any coefficient: made on demand, planted and found, tracked live, refused where there is none."""

from dataclasses import replace

import numpy as np
import pytest

import accelcal as ac
from accelcal.effects import BUILT_IN, CATALOGUE, find, has_time_constant
from accelcal.filters.live_model import LiveModel
from accelcal.model import Model, Prior
from accelcal.results import model_file
from accelcal.simulation import CXL02_RIG

from .motions import sines

SIGMA, TAU = 5e-4, 3.0
NAME = "quadratic_gauss_markov"


@pytest.fixture(scope="module")
def record():
    """A sensor whose K2 = 1e-3 is a Gauss-Markov process, by its exact recursion."""
    rng = np.random.default_rng(3)
    truth = {"bias": 0.05, "scale_factor": 0.01, "quadratic": 1e-3}
    simulation = ac.simulate("tones", seconds=60.0, rig=CXL02_RIG, parameters=truth, rng=rng)
    accel = simulation.recording.accel
    keep = np.exp(-np.median(np.diff(accel.t)) / TAU)
    process = np.zeros(len(accel.t))
    for i, shock in enumerate(SIGMA * np.sqrt(1.0 - keep**2) * rng.standard_normal(len(process) - 1), 1):
        process[i] = keep * process[i - 1] + shock
    y = accel.y + process * simulation.truth.motion.acceleration(accel.t) ** 2
    return replace(simulation.recording, accel=replace(accel, y=y), digest="K2 that varies")


def test_a_process_of_any_coefficient_is_its_column_times_that_of_the_bias():
    s = sines(n=500)
    process, bias = find(NAME), find("bias_gauss_markov")
    given = {"start": 0.0, "length": s.length, "tau": 3.0}
    np.testing.assert_allclose(process.column(s, **given), s.a[:, None] ** 2 * bias.column(s, **given), rtol=1e-12)
    assert process.port == "process"
    assert process not in BUILT_IN
    assert CATALOGUE[NAME] is process is find(NAME)
    for label in ("Equation", "Looks like", "Easily confused with", "Separate by"):
        assert process.line(label)


def test_a_planted_process_is_found_and_the_mean_has_its_uncertainty(record, tmp_path):
    plain = ac.fit(record, Model.cubic())
    grown = ac.add(plain, record, NAME)
    assert grown.model.priors[f"{NAME}.c1"].std == pytest.approx(SIGMA, rel=0.3)
    assert 1.0 < grown.model.shapes[NAME]["tau"] < 9.0
    assert abs(plain["quadratic"].value - 1e-3) > 4.0 * plain["quadratic"].std  # the twin without it is certain
    assert abs(grown["quadratic"].value - 1e-3) < 3.0 * grown["quadratic"].std
    expected = SIGMA * np.sqrt(2.0 * TAU / 60.0)
    assert grown["quadratic"].std == pytest.approx(expected, rel=0.3)
    model_file.save(grown, tmp_path / "m.json")
    again = model_file.load(tmp_path / "m.json")
    assert again.model == grown.model
    live = LiveModel(again.model, CXL02_RIG, rate=1667.0, q=1e-8, r_position=1e-12, position=0.0)
    assert live[NAME].std == pytest.approx(grown.model.priors[f"{NAME}.c1"].std)


def test_the_time_constant_of_a_stem_is_none_of_its_process():
    assert has_time_constant(find("quadratic_gauss_markov"))
    assert not has_time_constant(find("warm_up_random_walk"))
    assert not has_time_constant(find("warm_up"))


@pytest.mark.parametrize("name", ["tone_gauss_markov", "nothing_random_walk", "vibration_random_walk"])
def test_what_has_no_single_coefficient_has_no_process(name):
    with pytest.raises(ValueError, match="there is no effect called"):
        find(name)


def test_a_process_of_an_effect_with_memory_is_tracked_live():
    """The state multiplies what the play gives, which goes on from sample to sample."""
    model = Model.linear().add(
        "hysteresis_random_walk", shapes={"hysteresis_random_walk": {"width": 0.1, "start": 0.0, "length": 9.0}}
    )
    priors = {term.name: Prior(0.0, 1e-2) for term in model.terms if term.effect.port == "process"}
    model = replace(model, priors=priors)
    live = LiveModel(model, CXL02_RIG, rate=1667.0, q=1e-8, r_position=1e-12, position=0.0)
    t = np.arange(400) / 1667.0
    for u, z in zip(3.0 * np.sin(60.0 * t), -3.0 / 60.0**2 * np.sin(60.0 * t), strict=True):
        live.step(float(u), float(z))
    assert live["hysteresis_random_walk"].value != 0.0
    assert live["hysteresis_random_walk"].std > 0.0
