"""The catalogue: an effect is one function, its card and its column are the same place."""

from accelcal.effects import (  # noqa: F401  (importing a file enters its effects, in this order)
    base,
    cross,
    disturbances,
    drift,
    dynamics,
    encoder,
    families,
    nonlinear,
    stage,
    thermal,
    together,
)
from accelcal.effects.cards import card, cards, spelled
from accelcal.effects.catalogue import CATALOGUE, Effect, Shape, effect, find
from accelcal.effects.channels import side_channel, side_channels
from accelcal.effects.expression import ExpressionError, Own, from_expression
from accelcal.effects.own import EffectsFileError, load_effects

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
