"""Collinear effects: which a nonparametric curve replaces, and which are confounded with it."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

import accelcal as ac
from accelcal.diagnosis.findings import Confounded
from accelcal.diagnosis.search.confounding import DetectedEffect, Weights
from accelcal.diagnosis.search.scan import Candidate
from accelcal.diagnosis.select.collinearity import (
    confounding_families,
    families_with_remainder,
    family_replacing_sum,
    log_significance,
    random_process_replacing,
    sum_families,
)
from accelcal.diagnosis.select.stepwise import SelectionHistory
from accelcal.diagnosis.verdict import Case
from accelcal.effects import BUILT_IN, find
from accelcal.estimation.estimate import estimate
from accelcal.simulation import CXL02_RIG

FAMILIES = [effect for effect in BUILT_IN if effect.family]


def candidate(effect: str, p_raw: float, comparisons: int = 1) -> Candidate:
    return Candidate(effect, {}, (0.0,), (1.0,), "m/s²", 1.0, 8, p_raw, 1.0, 0.0, 0.0, comparisons=comparisons)


def finding(effect: str) -> DetectedEffect:
    return DetectedEffect(effect, {}, {effect: Weights()}, "move twice as far")


@pytest.mark.parametrize("family", FAMILIES, ids=lambda e: e.name)
def test_a_family_covers_named_effects_of_its_own_port_only(family):
    covered = [find(name) for name in family.covers]
    assert not any(effect.family for effect in covered)
    assert {effect.port for effect in covered} <= {family.port}
    assert {name for group in family.groups for name in group} <= set(family.covers)


@pytest.mark.parametrize(("gain", "expected"), [(800.0, ("shape_of_acceleration",)), (1000.0, ())])
def test_an_effect_that_explains_less_than_a_curve_is_confounded_with_it(gain, expected):
    assert (
        confounding_families("bias_step", {"bias_step": gain, "shape_of_acceleration": 900.0, "cubic": 2000.0})
        == expected
    )


@pytest.mark.parametrize(("gain", "expected"), [(800.0, ("shape_of_position",)), (1000.0, ())])
def test_an_effect_that_explains_less_than_a_collinear_pair_is_confounded_with_their_curve(gain, expected):
    gains = {"rail_wave": 500.0, "rail_second_wave": 400.0, "encoder_cyclic": gain}
    assert confounding_families("encoder_cyclic", gains) == expected
    assert (
        confounding_families("encoder_cyclic", {"rail_wave": 500.0, "rail_slope": 400.0, "encoder_cyclic": 10.0}) == ()
    )


@pytest.mark.parametrize(
    ("name", "model", "expected"),
    [
        ("velocity", ("velocity", "coulomb"), ("shape_of_velocity",)),
        ("coulomb", ("velocity", "coulomb", "cubic"), ("shape_of_velocity",)),
        ("cubic", ("velocity", "coulomb", "cubic"), ()),
        ("cubic", ("cubic", "shape_of_acceleration"), ("shape_of_acceleration",)),
        ("bias_step", ("bias_step", "bias_random_walk"), ("shape_of_time",)),
        ("velocity", ("velocity", "bias_random_walk"), ()),
    ],
)
def test_a_sum_of_functions_of_one_variable_is_confounded_with_its_curve(name, model, expected):
    assert sum_families(name, model) == expected


def test_a_curve_that_explains_a_remainder_of_its_variable_joins_the_class():
    remaining = [candidate("shape_of_acceleration", 1e-4), candidate("shape_of_position", 1e-4)]
    assert families_with_remainder("cubic", remaining) == ("shape_of_acceleration",)
    assert families_with_remainder("cubic", [candidate("shape_of_acceleration", 0.3)]) == ()


def test_an_incomplete_sum_of_effects_is_replaced_by_a_curve():
    replacement = family_replacing_sum(("velocity", "cubic", "coulomb"), [candidate("shape_of_velocity", 1e-3)])
    assert replacement is not None
    assert replacement.replaced == ("velocity", "coulomb")
    assert replacement.members == ("shape_of_velocity", "velocity", "coulomb")
    assert (
        family_replacing_sum(("velocity", "cubic"), [candidate("shape_of_velocity", 1e-3)]) is None
    )  # one name is no sum
    assert family_replacing_sum(("velocity", "coulomb"), [candidate("shape_of_velocity", 0.1)]) is None
    ripple = candidate("shape_of_acceleration", 1e-3, comparisons=60)  # the best of sixty periods is often as good
    assert family_replacing_sum(("cubic", "quadratic"), [ripple]) is None


def test_a_curve_takes_over_the_gains_of_the_effects_that_it_replaces():
    history = SelectionHistory()
    history.enter(finding("rail_slope"), 400.0)
    history.enter(finding("cubic"), 800.0)
    history.enter(finding("shape_of_acceleration"), 50.0, replaced=("cubic", "odd_quadratic"))
    assert history.effects == ("rail_slope", "shape_of_acceleration")
    assert history.gains == {"rail_slope": 400.0, "shape_of_acceleration": 850.0}
    history.enter(finding("velocity"), 900.0)
    assert [group.members for group in history.final_classes([candidate("encoder_shape_of_position", 1e-4)])] == [
        ("rail_slope", "shape_of_acceleration"),
        ("shape_of_acceleration",),
        ("velocity",),
    ]


def test_what_ends_a_search_counts_waves_of_one_kind_once():
    history, message = SelectionHistory(), list[str]()
    for name in ("cubic", "encoder_cyclic", *(f"encoder_cyclic_{n}" for n in range(2, 6))):
        history.enter(finding(name), 400.0)
        message.append(history.full(3))
    assert message == [*[""] * 5, "at most 6 effects and waves are added"]
    history.enter(finding("velocity"), 400.0)
    assert history.full(3) == "at most 3 effects are added"


def test_an_effect_whose_rival_shares_a_variable_with_another_is_confounded_with_the_curve():
    history = SelectionHistory()
    history.enter(finding("coulomb"), 400.0)
    history.enter(DetectedEffect("creep", {}, dict.fromkeys(("creep", "velocity"), Weights()), "move faster"), 300.0)
    assert [group.members for group in history.final_classes([])] == [
        ("coulomb", "shape_of_velocity"),
        ("creep", "velocity"),
    ]


def test_the_sentence_names_rivals_and_the_experiment():
    jitter = find("timing_jitter")
    assert jitter.confused == ("vibration",)
    groups = [Confounded(jitter.name, (jitter.name, *jitter.confused), "push the stage at constant speed")]
    groups.append(Confounded("tone", ("tone",), "a record at rest"))
    case = Case(None, SimpleNamespace(nearest_rival=lambda effect: f" {effect}?"), (), groups=groups)
    assert case.with_rivals("timing_jitter", "Noise grows with jerk (180 candidates examined).") == (
        "tied",
        "Noise grows with jerk (180 candidates examined). It is confounded with vibration on this record; "
        "to separate them: push the stage at constant speed.",
    )
    assert case.with_rivals("tone", "A line.") == ("named", "A line. tone?")


def test_an_effect_that_leaves_the_history_takes_its_gain_along():
    history = SelectionHistory()
    history.enter(finding("shape_of_position"), 400.0)
    history.enter(finding("rail_wave"), 300.0)
    assert history.final_classes([])[1].members == ("rail_wave", "shape_of_position")
    assert history.leave("shape_of_position") == 400.0
    assert history.effects == ("rail_wave",)
    assert history.final_classes([])[0].members == ("rail_wave",)


def test_a_random_process_replaces_an_incomplete_curve_of_time():
    classes = [("velocity",), ("shape_of_time", "bias_random_walk", "bias_step")]
    replacement = random_process_replacing(classes, "warm_up")
    assert replacement is not None
    assert replacement.members == (
        "bias_random_walk",
        "bias_step",
        "shape_of_time",
        "warm_up",
    )  # and what they are confounded with
    assert replacement.replaced == ("shape_of_time", "warm_up")
    assert random_process_replacing([("bias_step", "bias_random_walk")], "warm_up") is None  # a name of its own
    assert random_process_replacing([("shape_of_position",)], "warm_up") is None


def test_a_random_process_replaces_two_effects_that_are_confounded_with_it():
    classes = [("velocity",), ("temperature_bias", "bias_gauss_markov", "bias_random_walk")]
    replacement = random_process_replacing(classes, "warm_up", ("warm_up", "bias_gauss_markov"))
    assert replacement is not None
    assert replacement.members == ("bias_gauss_markov", "bias_random_walk", "temperature_bias", "warm_up")
    both = random_process_replacing(classes, "warm_up", ("warm_up", "bias_gauss_markov", "bias_random_walk"))
    assert both is not None
    assert both.members == ("bias_gauss_markov", "bias_random_walk", "temperature_bias", "warm_up")
    itself = random_process_replacing(classes, "bias_random_walk", ("bias_random_walk", "bias_gauss_markov"))
    assert itself is not None
    assert itself.replaced == ("temperature_bias", "bias_random_walk")
    assert itself.members.count("bias_random_walk") == 1
    assert (
        random_process_replacing(classes, "warm_up", ("warm_up", "creep")) is None
    )  # it is not confounded with the second


def test_an_absent_effect_is_not_significant():
    rng = np.random.default_rng(7)
    run = ac.simulate("interleaved", seconds=20.0, rig=CXL02_RIG, parameters={"quadratic": 1e-3}, rng=rng).recording
    fit = estimate(ac.Model.linear().add("quadratic").add("velocity"), run)
    assert log_significance(fit, "quadratic") < math.log(1e-9)
    assert log_significance(fit, "velocity") > math.log(1e-3)  # by chance 0.1 %
    z = fit["velocity"].value / fit["velocity"].std
    assert log_significance(fit, "velocity") == pytest.approx(math.log(math.erfc(abs(z) / math.sqrt(2.0))))
