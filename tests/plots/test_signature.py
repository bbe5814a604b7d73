"""The pictures on the cards: drawn for every effect, against the variable that the effect is a function of."""

import numpy as np
import pytest

from accelcal.effects import BUILT_IN, find
from accelcal.plots import matplotlib
from accelcal.plots.signature import (
    FOLLOWS,
    caption,
    card_motion,
    contributions,
    dependence,
    explained_share,
    signature,
    typical_shape,
)


def variable(name):
    s = card_motion()
    shape = typical_shape(find(name), s)
    result = dependence(find(name), s, shape, contributions(find(name), s, shape))
    return None if result is None else result[0]


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("cubic", "acceleration"),
        ("coulomb", "velocity"),
        ("rail_slope", "position"),
        ("encoder_cyclic", "position"),
        ("time_offset", "jerk"),
        ("temperature_bias", "temperature"),
        ("cross_axis", "a_y"),
        ("vibration", "velocity"),
        ("bias", None),
        ("bias_drift", None),
        ("warm_up", None),
        ("acceleration_velocity", None),
    ],
)
def test_an_effect_is_drawn_against_what_it_is_a_function_of(name, expected):
    assert variable(name) == expected


def test_share_is_one_for_a_function_zero_for_chance_and_for_a_constant():
    rng = np.random.default_rng(1)
    x = rng.uniform(-1.0, 1.0, 4000)
    assert explained_share(x, np.sin(9.0 * x)) > 0.999
    assert abs(explained_share(x, rng.standard_normal(4000))) < 0.1  # 6 sigma of 1/sqrt(4000)
    assert explained_share(x, np.full(4000, 3.0)) == 0.0
    assert explained_share(x, np.sin(9.0 * x) + rng.standard_normal(4000)) < FOLLOWS


@pytest.mark.parametrize("effect", BUILT_IN, ids=lambda e: e.name)
def test_every_effect_has_a_picture_and_a_caption(effect):
    figure = matplotlib.draw(signature(effect))
    assert len(figure.axes) in (1, 2)
    for axes in figure.axes:
        assert "(" in axes.get_xlabel()  # a unit
        assert "(" in axes.get_ylabel()
        assert all(np.isfinite(line.get_ydata()).any() for line in axes.lines)
    assert f"{effect.prior.typical:g}" in caption(effect)


def test_a_picture_follows_the_theme():
    light, dark = (matplotlib.draw(signature(find("cubic")), theme) for theme in ("light", "dark"))
    assert light.get_facecolor() != dark.get_facecolor()
