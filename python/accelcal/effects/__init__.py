"""The catalogue: an effect is one function, its card and its column are the same place."""

from accelcal.effects import (  # noqa: F401, I001  (importing a file enters its effects, in this order)
    base,
    cross_axis,
    disturbances,
    drift,
    dynamics,
    encoder,
    curves,
    nonlinear,
    stage,
    thermal,
    interactions,
)
from accelcal.effects.cards import card, cards, spelled
from accelcal.effects.registry import CATALOGUE, Effect, Shape, effect, find
from accelcal.effects.side_channels import side_channel, side_channels
from accelcal.effects.formula import ExpressionError, Own, from_expression
from accelcal.effects.user_file import EffectsFileError, load_effects

HOUSE = tuple(CATALOGUE.values())
"""The effects that come with accelcal, without side channels and users' own."""
_BY_NAME = {one.name: one for one in HOUSE}


def is_local(effect: Effect) -> bool:
    """Whether an effect is known to have no memory, so that it can be evaluated on a stretch of a record."""
    return not effect.memory and _BY_NAME.get(effect.name) is effect


__all__ = [
    "CATALOGUE",
    "HOUSE",
    "Effect",
    "EffectsFileError",
    "ExpressionError",
    "Own",
    "Shape",
    "card",
    "cards",
    "effect",
    "find",
    "from_expression",
    "is_local",
    "load_effects",
    "side_channel",
    "side_channels",
    "spelled",
]
