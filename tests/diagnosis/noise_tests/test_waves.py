"""Waves that noise tests find: which a model has, which comes first, and what forbids that nothing is missing."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from accelcal.diagnosis.evidence import independent_tests, largest_first, own_tests
from accelcal.diagnosis.findings import Confounded, in_noise
from accelcal.diagnosis.noise.noise_test import WHITENESS, NoiseTest
from accelcal.diagnosis.policy import OWN_WAVE_TURNS
from accelcal.diagnosis.search.scan import Scan
from accelcal.diagnosis.verdict import Case, judgement
from accelcal.effects import find, next_name, stem_of, users_own
from accelcal.estimation.shape_parameters import on_bounds
from accelcal.model import Estimate, Model
from tests.effects.motions import sines

S = sines()


def line(
    frequency: float, amplitude: float = 0.02, std: float = 1e-3, p_value: float = 0.0, **parts: float
) -> NoiseTest:
    """A test that found a line."""
    return NoiseTest("tone", 1.0, p_value, amplitude, "m/s²", std, "a line", {"frequency": frequency, **parts})


def wave(period: float) -> NoiseTest:
    """A test that found a wave over position."""
    return NoiseTest("encoder_cyclic", 1.0, 0.0, 4e-7, "m", 1e-8, "a wave", {"period": period, "period_std": 1e-9})


@pytest.mark.parametrize(("turns", "same"), [(0.0, True), (0.9 * OWN_WAVE_TURNS, True), (1.1 * OWN_WAVE_TURNS, False)])
def test_a_wave_is_the_models_own_within_a_few_turns_over_the_record(turns, same):
    model = Model.linear().add("tone", shapes={"tone": {"frequency": 50.0}})
    model = model.add("encoder_cyclic", shapes={"encoder_cyclic": {"period": 2e-5}})
    assert line(50.0 + turns / S.length).in_model(model, S) == same
    stroke = float(S.p.max() - S.p.min())
    assert wave(2e-5 + turns * 4e-10 / stroke).in_model(model, S) == same
    assert not line(50.0).in_model(Model.linear(), S)


def test_a_second_line_of_the_model_explains_its_own_test_and_no_other():
    model = Model.linear().add("tone", "tone_2", shapes={"tone": {"frequency": 50.0}, "tone_2": {"frequency": 100.0}})
    assert [line(f).in_model(model, S) for f in (50.0, 100.0, 150.0)] == [True, True, False]
    assert next_name("tone", model.effects) == "tone_3"


def test_harmonics_of_the_models_wave_explain_their_tests_and_no_other():
    hum, scale = {"frequency": 50.0, "harmonics": 3.0}, {"period": 1e-3, "harmonics": 2.0}
    model = Model.linear().add("tone", "encoder_cyclic", shapes={"tone": hum, "encoder_cyclic": scale})
    assert [line(50.0 * n).in_model(model, S) for n in (1, 2, 3, 4)] == [True, True, True, False]
    assert [wave(1e-3 / n).in_model(model, S) for n in (1, 2, 3)] == [True, True, False]
    assert [term.name for term in model.free[-4:]] == [
        f"encoder_cyclic.{part}" for part in ("sin", "cos", "sin2", "cos2")
    ]


def test_what_is_no_wave_is_in_the_model_by_its_name():
    jump = NoiseTest("encoder_step", 1.0, 0.0, 1e-6, "m", 1e-8, "a jump", {"count": 1.0})
    assert not jump.shape
    assert not jump.in_model(Model.linear(), S)
    assert jump.in_model(Model.linear().add("encoder_step", shapes={"encoder_step": {"instant": 3.0}}), S)


def test_a_further_wave_is_the_same_function_under_another_name():
    second = find("encoder_cyclic_2")
    assert second.function is find("encoder_cyclic").function
    assert (stem_of(second), second.search.beside) == ("encoder_cyclic", "encoder_cyclic")
    assert second not in users_own()
    for name in ("cubic_2", "tone_1", "tone_02"):
        with pytest.raises(ValueError, match="no effect called"):
            find(name)


def test_the_largest_of_several_lines_is_reported_though_another_has_a_smaller_probability():
    tests = [line(100.04, 0.006, p_value=0.0), line(50.02, 0.02, p_value=1e-30)]
    assert [test.parts["frequency"] for test in largest_first(tests)] == [50.02, 100.04]
    result = in_noise(tests, Confounded("tone", ("tone",), ""), {})
    assert result.wave == {"frequency": 50.02}
    assert result.particulars == " (0.02 m/s², frequency 50.02 Hz, 12 sigma)"


def test_a_significant_test_whose_effect_is_not_named_forbids_that_nothing_is_missing():
    driven = [line(4.0, within_motion=1.0, made_by_motion=1.0)]
    assert own_tests(driven) == driven
    assert independent_tests(driven) == ()
    scan, fit = Scan((), (), 100, 50), SimpleNamespace(runs=(), seen_by_runs=(), spreads=(), remarks=())
    assert judgement(Case(fit, scan, ()))[0] == "adequate"
    verdict, sentence = judgement(Case(fit, scan, (), driven))
    assert verdict == "unexplained"
    assert sentence.startswith("A line, where the motion may make one")


@pytest.mark.parametrize(
    ("effects", "named"),
    [(("timing_jitter", "tone"), "timing_jitter"), (("tone", "timing_jitter"), "tone"), ((WHITENESS, "tone"), "tone")],
)
def test_the_first_significant_test_with_a_cause_is_named(effects, named):
    tests = [NoiseTest(effect, 1.0, 0.0, 1.0, "", 0.1, f"the cause is {effect}") for effect in effects]
    groups = [Confounded(effect, (effect, f"rival of {effect}"), "") for effect in effects]
    fit = SimpleNamespace(runs=(), seen_by_runs=(), spreads=(), remarks=())
    verdict, sentence = judgement(Case(fit, Scan((), (), 100, 50), tests, groups=groups))
    assert verdict == "tied"
    assert sentence.startswith(f"The cause is {named} (100 candidates examined).")
    assert f"confounded with rival of {named} " in sentence


@pytest.mark.parametrize("parts", [{"within_motion": 1.0}, {"made_by_motion": 1.0}])
def test_what_may_be_a_harmonic_is_not_named_beside_an_effect_without_one_size(parts):
    harmonic, hum = line(215.0, **parts), line(50.02)
    assert independent_tests([harmonic, hum]) == (harmonic, hum)
    assert independent_tests([harmonic, hum], changing=True) == (hum,)


def test_what_a_vibration_raises_is_no_test_of_its_own():
    shaken = NoiseTest(
        "vibration", 1.0, 0.0, 0.2, "m/s²", 1e-3, "vibration", {"frequency": 230.0, "lowest": 200.0, "highest": 260.0}
    )
    assert own_tests([shaken, line(240.0), line(50.0)]) == [shaken, line(50.0)]


@pytest.mark.parametrize(
    ("effect", "shape", "share", "message"),
    [
        ("creep", "tau", 0.0, True),
        ("creep", "tau", 0.5, False),
        ("creep", "tau", 1.0, True),
        ("encoder_cyclic", "period", 0.0, False),
        ("encoder_cyclic", "period", 1.0, True),
    ],
)
def test_a_shape_that_ended_on_its_bound_is_said(effect, shape, share, message):
    """A wave may be shorter than its trials, which a noise test finds."""
    low, high = find(effect).shapes[shape].span(S)
    value = low * (high / low) ** share
    ended = Estimate(f"{effect}.{shape}", shape, "", value, 0.1 * value, "sensor")
    model = SimpleNamespace(added=(), shapes={}, fixed={})
    notes = on_bounds(SimpleNamespace(states=[SimpleNamespace(signals=S)], shapes=(ended,), model=model))
    assert [f"{effect}.{shape} ended at {value:.4g}" in note for note in notes] == [True] * message


def test_a_line_larger_than_the_converters_step_is_not_of_its_making():
    steps = NoiseTest(
        "quantisation", 3.0, 0.0, 0.01, "m/s²", 0.0, "steps", {"step": 0.01, "noise": 3e-3, "coarse": 1.0}
    )
    small, large = line(50.0, amplitude=5e-3), line(50.0, amplitude=0.02)
    assert own_tests([steps, small]) == [steps]
    assert own_tests([steps, large]) == [steps, large]
