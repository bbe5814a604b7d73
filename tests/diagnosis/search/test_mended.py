"""Which names a shape without a name wears out, and which it makes unsure."""

from __future__ import annotations

import math

import numpy as np
import pytest

import accelcal as ac
from accelcal.diagnosis.search.confounding import Finding
from accelcal.diagnosis.search.scan import Candidate
from accelcal.diagnosis.verdict import Tie, told_apart
from accelcal.effects import HOUSE, find
from accelcal.selection.collinearity import not_the_whole, rest_of, significance, sum_behind, sum_of, wandering_behind
from accelcal.selection.stepwise import Story

FAMILIES = [effect for effect in HOUSE if effect.family]


def candidate(effect: str, p_raw: float, looks: int = 1) -> Candidate:
    return Candidate(effect, {}, (0.0,), (1.0,), "m/s²", 1.0, 8, p_raw, 1.0, 0.0, 0.0, looks=looks)


def finding(effect: str) -> Finding:
    return Finding(effect, {}, (effect,), "move twice as far")


@pytest.mark.parametrize("family", FAMILIES, ids=lambda e: e.name)
def test_a_family_covers_named_effects_of_its_own_port_only(family):
    covered = [find(name) for name in family.covers]
    assert not any(one.family for one in covered)
    assert {one.port for one in covered} <= {family.port}
    assert {name for bend in family.bends for name in bend} <= set(family.covers)


@pytest.mark.parametrize(("gain", "expected"), [(800.0, ("shape_of_acceleration",)), (1000.0, ())])
def test_what_explains_less_than_a_shape_may_be_a_part_or_the_rest_of_it(gain, expected):
    assert rest_of("bias_step", {"bias_step": gain, "shape_of_acceleration": 900.0, "cubic": 2000.0}) == expected


@pytest.mark.parametrize(("gain", "expected"), [(800.0, ("shape_of_position",)), (1000.0, ())])
def test_what_explains_less_than_two_names_of_one_bend_may_be_the_rest_of_their_shape(gain, expected):
    told = {"rail_wave": 500.0, "rail_second_wave": 400.0, "encoder_cyclic": gain}
    assert rest_of("encoder_cyclic", told) == expected
    assert rest_of("encoder_cyclic", {"rail_wave": 500.0, "rail_slope": 400.0, "encoder_cyclic": 10.0}) == ()


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
def test_a_sum_of_functions_of_one_variable_may_be_one_function_of_it(name, model, expected):
    assert sum_of(name, model) == expected


def test_a_shape_that_explains_something_beside_a_name_makes_it_unsure():
    left = [candidate("shape_of_acceleration", 1e-4), candidate("shape_of_position", 1e-4)]
    assert not_the_whole("cubic", left) == ("shape_of_acceleration",)
    assert not_the_whole("cubic", [candidate("shape_of_acceleration", 0.3)]) == ()


def test_a_sum_of_names_that_is_not_the_whole_gives_way_to_a_shape():
    mend = sum_behind(("velocity", "cubic", "coulomb"), [candidate("shape_of_velocity", 1e-3)])
    assert mend is not None
    assert mend.worn == ("velocity", "coulomb")
    assert mend.members == ("shape_of_velocity", "velocity", "coulomb")
    assert sum_behind(("velocity", "cubic"), [candidate("shape_of_velocity", 1e-3)]) is None  # one name is no sum
    assert sum_behind(("velocity", "coulomb"), [candidate("shape_of_velocity", 0.1)]) is None
    ripple = candidate("shape_of_acceleration", 1e-3, looks=60)  # the best of sixty periods is often as good
    assert sum_behind(("cubic", "quadratic"), [ripple]) is None


def test_a_shape_stands_in_the_place_of_the_names_that_it_wears_out():
    story = Story()
    story.enter(finding("rail_slope"), 400.0)
    story.enter(finding("cubic"), 800.0)
    story.enter(finding("shape_of_acceleration"), 50.0, worn=("cubic", "odd_quadratic"))
    assert story.effects == ("rail_slope", "shape_of_acceleration")
    assert story.gains == {"rail_slope": 400.0, "shape_of_acceleration": 850.0}
    story.enter(finding("velocity"), 900.0)
    assert [tie.members for tie in story.told([candidate("encoder_shape_of_position", 1e-4)])] == [
        ("rail_slope", "shape_of_acceleration"),
        ("shape_of_acceleration",),
        ("velocity",),
    ]


def test_a_name_that_may_stand_beside_another_of_its_variable_is_told_with_their_shape():
    story = Story()
    story.enter(finding("coulomb"), 400.0)
    story.enter(Finding("creep", {}, ("creep", "velocity"), "move faster"), 300.0)
    assert [tie.members for tie in story.told([])] == [("coulomb", "shape_of_velocity"), ("creep", "velocity")]


def test_a_thin_finding_is_told_with_what_its_card_confuses_it_with():
    jitter = find("timing_jitter")
    assert jitter.confused == ("vibration",)
    tie = Tie(jitter.name, (jitter.name, *jitter.confused), "push the stage at constant speed")
    assert told_apart(tie, "Noise grows with jerk (180 candidates examined).") == (
        "tied",
        "Noise grows with jerk (180 candidates examined). vibration cannot be told from it on this record: "
        "push the stage at constant speed.",
    )
    assert told_apart(Tie("tone", ("tone",), "a record at rest"), "A line.") == ("named", "A line.")


def test_what_leaves_a_story_takes_what_it_explained_along():
    story = Story()
    story.enter(finding("shape_of_position"), 400.0)
    story.enter(finding("rail_wave"), 300.0)
    assert story.told([])[1].members == ("rail_wave", "shape_of_position")
    assert story.leave("shape_of_position") == 400.0
    assert story.effects == ("rail_wave",)
    assert story.told([])[0].members == ("rail_wave",)


def test_a_bias_that_wanders_may_stand_behind_a_shape_that_is_not_all():
    classes = [("velocity",), ("shape_of_time", "bias_random_walk", "bias_step")]
    behind = wandering_behind(classes, "warm_up")
    assert behind is not None
    assert behind.members == (
        "bias_random_walk",
        "bias_step",
        "shape_of_time",
        "warm_up",
    )  # and what they were tied with
    assert behind.worn == ("shape_of_time", "warm_up")
    assert wandering_behind([("bias_step", "bias_random_walk")], "warm_up") is None  # a name of its own
    assert wandering_behind([("shape_of_position",)], "warm_up") is None


def test_a_bias_that_wanders_may_stand_behind_two_names_that_are_each_tied_with_it():
    classes = [("velocity",), ("temperature_bias", "bias_gauss_markov", "bias_random_walk")]
    behind = wandering_behind(classes, "warm_up", ("warm_up", "bias_gauss_markov"))
    assert behind is not None
    assert behind.members == ("bias_gauss_markov", "bias_random_walk", "temperature_bias", "warm_up")
    both = wandering_behind(classes, "warm_up", ("warm_up", "bias_gauss_markov", "bias_random_walk"))
    assert both is not None
    assert both.members == ("bias_gauss_markov", "bias_random_walk", "temperature_bias", "warm_up")
    itself = wandering_behind(classes, "bias_random_walk", ("bias_random_walk", "bias_gauss_markov"))
    assert itself is not None
    assert itself.worn == ("temperature_bias", "bias_random_walk")
    assert itself.members.count("bias_random_walk") == 1
    assert wandering_behind(classes, "warm_up", ("warm_up", "creep")) is None  # it could be told from the second


def test_an_effect_of_no_size_is_where_it_is_by_chance():
    rng = np.random.default_rng(7)
    run = ac.simulate("interleaved", seconds=20.0, rig=ac.CXL02_RIG, parameters={"quadratic": 1e-3}, rng=rng).recording
    fit = ac.fit(ac.Model.linear().add("quadratic").add("velocity"), run)
    assert significance(fit, "quadratic") < math.log(1e-9)
    assert significance(fit, "velocity") > math.log(1e-3)  # by chance 0.1 %
    z = fit["velocity"].value / fit["velocity"].std
    assert significance(fit, "velocity") == pytest.approx(math.log(math.erfc(abs(z) / math.sqrt(2.0))))
