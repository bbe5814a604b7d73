"""Which names a shape without a name wears out, and which it makes unsure."""

from __future__ import annotations

import pytest

from accelcal.diagnose import Candidate, Finding
from accelcal.diagnose.mended import not_the_whole, rest_of
from accelcal.effects import HOUSE, find
from accelcal.loop import Story

FAMILIES = [effect for effect in HOUSE if effect.family]


def candidate(effect: str, p_raw: float) -> Candidate:
    return Candidate(effect, {}, (0.0,), (1.0,), "m/s²", 1.0, 8, p_raw, 1.0, 0.0, 0.0)


def finding(effect: str) -> Finding:
    return Finding(effect, {}, (effect,), "move twice as far")


@pytest.mark.parametrize("family", FAMILIES, ids=lambda e: e.name)
def test_a_family_covers_named_effects_of_its_own_port_only(family):
    covered = [find(name) for name in family.covers]
    assert not any(one.family for one in covered)
    assert {one.port for one in covered} <= {family.port}
    assert {name for bend in family.bends for name in bend} <= set(family.covers)


@pytest.mark.parametrize(
    ("entering", "gain", "expected"),
    [
        ("cubic", 800.0, ("shape_of_acceleration",)),  # a function of the shape's variable, however large
        ("bias_step", 50.0, ("shape_of_acceleration",)),  # little beside it
        ("bias_step", 800.0, ()),
    ],
)
def test_what_comes_after_a_shape_may_be_the_rest_of_it(entering, gain, expected):
    assert rest_of(entering, gain, {"shape_of_acceleration": 900.0}) == expected


def test_a_shape_that_explains_something_beside_a_name_makes_it_unsure():
    left = [candidate("shape_of_acceleration", 1e-4), candidate("shape_of_position", 1e-4)]
    assert not_the_whole("cubic", left) == ("shape_of_acceleration",)
    assert not_the_whole("cubic", [candidate("shape_of_acceleration", 0.3)]) == ()


def test_a_shape_stands_in_the_place_of_the_names_that_it_wears_out():
    story = Story()
    story.enter(finding("rail_slope"), 400.0)
    story.enter(finding("cubic"), 800.0)
    story.enter(finding("shape_of_acceleration"), 50.0, worn=("cubic", "odd_quadratic"))
    assert story.effects == ("rail_slope", "shape_of_acceleration")
    assert story.gains == {"rail_slope": 400.0, "shape_of_acceleration": 850.0}
    story.enter(finding("bias_step"), 100.0)
    assert story.ties[-1].members == ("bias_step", "shape_of_acceleration")
    story.enter(finding("velocity"), 700.0)
    assert story.ties[-1].members == ("velocity",)
