"""Which names a shape without a name wears out, and which it makes unsure."""

from __future__ import annotations

import math

import numpy as np
import pytest

import accelcal as ac
from accelcal.diagnosis.search.confounding import DetectedEffect
from accelcal.diagnosis.search.scan import Candidate
from accelcal.diagnosis.verdict import Confounded, sentence_with_rivals
from accelcal.effects import HOUSE, find
from accelcal.selection.collinearity import (
    confounding_families,
    family_replacing_sum,
    not_the_whole,
    random_bias_replacing,
    significance,
    sum_families,
)
from accelcal.selection.stepwise import SelectionHistory

FAMILIES = [effect for effect in HOUSE if effect.family]


def candidate(effect: str, p_raw: float, looks: int = 1) -> Candidate:
    return Candidate(effect, {}, (0.0,), (1.0,), "m/s²", 1.0, 8, p_raw, 1.0, 0.0, 0.0, looks=looks)


def finding(effect: str) -> DetectedEffect:
    return DetectedEffect(effect, {}, (effect,), "move twice as far")


@pytest.mark.parametrize("family", FAMILIES, ids=lambda e: e.name)
def test_a_family_covers_named_effects_of_its_own_port_only(family):
    covered = [find(name) for name in family.covers]
    assert not any(one.family for one in covered)
    assert {one.port for one in covered} <= {family.port}
    assert {name for group in family.groups for name in group} <= set(family.covers)


@pytest.mark.parametrize(("gain", "expected"), [(800.0, ("shape_of_acceleration",)), (1000.0, ())])
def test_what_explains_less_than_a_shape_may_be_a_part_or_the_rest_of_it(gain, expected):
    assert (
        confounding_families("bias_step", {"bias_step": gain, "shape_of_acceleration": 900.0, "cubic": 2000.0})
        == expected
    )


@pytest.mark.parametrize(("gain", "expected"), [(800.0, ("shape_of_position",)), (1000.0, ())])
def test_what_explains_less_than_two_names_of_one_bend_may_be_the_rest_of_their_shape(gain, expected):
    told = {"rail_wave": 500.0, "rail_second_wave": 400.0, "encoder_cyclic": gain}
    assert confounding_families("encoder_cyclic", told) == expected
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
def test_a_sum_of_functions_of_one_variable_may_be_one_function_of_it(name, model, expected):
    assert sum_families(name, model) == expected


def test_a_shape_that_explains_something_beside_a_name_makes_it_unsure():
    left = [candidate("shape_of_acceleration", 1e-4), candidate("shape_of_position", 1e-4)]
    assert not_the_whole("cubic", left) == ("shape_of_acceleration",)
    assert not_the_whole("cubic", [candidate("shape_of_acceleration", 0.3)]) == ()


def test_a_sum_of_names_that_is_not_the_whole_gives_way_to_a_shape():
    mend = family_replacing_sum(("velocity", "cubic", "coulomb"), [candidate("shape_of_velocity", 1e-3)])
    assert mend is not None
    assert mend.worn == ("velocity", "coulomb")
    assert mend.members == ("shape_of_velocity", "velocity", "coulomb")
    assert (
        family_replacing_sum(("velocity", "cubic"), [candidate("shape_of_velocity", 1e-3)]) is None
    )  # one name is no sum
    assert family_replacing_sum(("velocity", "coulomb"), [candidate("shape_of_velocity", 0.1)]) is None
    ripple = candidate("shape_of_acceleration", 1e-3, looks=60)  # the best of sixty periods is often as good
    assert family_replacing_sum(("cubic", "quadratic"), [ripple]) is None


def test_a_shape_stands_in_the_place_of_the_names_that_it_wears_out():
    story = SelectionHistory()
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
    story = SelectionHistory()
    story.enter(finding("coulomb"), 400.0)
    story.enter(DetectedEffect("creep", {}, ("creep", "velocity"), "move faster"), 300.0)
    assert [tie.members for tie in story.told([])] == [("coulomb", "shape_of_velocity"), ("creep", "velocity")]


def test_a_thin_finding_is_told_with_what_its_card_confuses_it_with():
    jitter = find("timing_jitter")
    assert jitter.confused == ("vibration",)
    tie = Confounded(jitter.name, (jitter.name, *jitter.confused), "push the stage at constant speed")
    assert sentence_with_rivals(tie, "Noise grows with jerk (180 candidates examined).") == (
        "tied",
        "Noise grows with jerk (180 candidates examined). vibration cannot be told from it on this record: "
        "push the stage at constant speed.",
    )
    assert sentence_with_rivals(Confounded("tone", ("tone",), "a record at rest"), "A line.") == ("named", "A line.")


def test_what_leaves_a_story_takes_what_it_explained_along():
    story = SelectionHistory()
    story.enter(finding("shape_of_position"), 400.0)
    story.enter(finding("rail_wave"), 300.0)
    assert story.told([])[1].members == ("rail_wave", "shape_of_position")
    assert story.leave("shape_of_position") == 400.0
    assert story.effects == ("rail_wave",)
    assert story.told([])[0].members == ("rail_wave",)


def test_a_bias_that_wanders_may_stand_behind_a_shape_that_is_not_all():
    classes = [("velocity",), ("shape_of_time", "bias_random_walk", "bias_step")]
    behind = random_bias_replacing(classes, "warm_up")
    assert behind is not None
    assert behind.members == (
        "bias_random_walk",
        "bias_step",
        "shape_of_time",
        "warm_up",
    )  # and what they were tied with
    assert behind.worn == ("shape_of_time", "warm_up")
    assert random_bias_replacing([("bias_step", "bias_random_walk")], "warm_up") is None  # a name of its own
    assert random_bias_replacing([("shape_of_position",)], "warm_up") is None


def test_a_bias_that_wanders_may_stand_behind_two_names_that_are_each_tied_with_it():
    classes = [("velocity",), ("temperature_bias", "bias_gauss_markov", "bias_random_walk")]
    behind = random_bias_replacing(classes, "warm_up", ("warm_up", "bias_gauss_markov"))
    assert behind is not None
    assert behind.members == ("bias_gauss_markov", "bias_random_walk", "temperature_bias", "warm_up")
    both = random_bias_replacing(classes, "warm_up", ("warm_up", "bias_gauss_markov", "bias_random_walk"))
    assert both is not None
    assert both.members == ("bias_gauss_markov", "bias_random_walk", "temperature_bias", "warm_up")
    itself = random_bias_replacing(classes, "bias_random_walk", ("bias_random_walk", "bias_gauss_markov"))
    assert itself is not None
    assert itself.worn == ("temperature_bias", "bias_random_walk")
    assert itself.members.count("bias_random_walk") == 1
    assert random_bias_replacing(classes, "warm_up", ("warm_up", "creep")) is None  # it could be told from the second


def test_an_effect_of_no_size_is_where_it_is_by_chance():
    rng = np.random.default_rng(7)
    run = ac.simulate("interleaved", seconds=20.0, rig=ac.CXL02_RIG, parameters={"quadratic": 1e-3}, rng=rng).recording
    fit = ac.fit(ac.Model.linear().add("quadratic").add("velocity"), run)
    assert significance(fit, "quadratic") < math.log(1e-9)
    assert significance(fit, "velocity") > math.log(1e-3)  # by chance 0.1 %
    z = fit["velocity"].value / fit["velocity"].std
    assert significance(fit, "velocity") == pytest.approx(math.log(math.erfc(abs(z) / math.sqrt(2.0))))
