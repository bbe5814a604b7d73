"""The catalogue of effects: each is one function that holds its card and computes its column."""

from collections.abc import Sequence  # noqa: I001  (effects are entered in their own order)

from accelcal._support.values import listing
from accelcal.effects import (  # noqa: F401  (importing a file enters its effects, in this order)
    base,
    disturbances,
    drift,
    dynamics,
    encoder,
    curves,
    nonlinear,
    stage,
    thermal,
    mechanisms,
    interactions,
)
from accelcal.effects.registry import (
    CATALOGUE,
    HARMONICS,
    Effect,
    Lumped,
    NoiseSource,
    NoiseTestKind,
    Search,
    SizePrior,
    Shape,
    Static,
    Traits,
    Variable,
    family,
)
from accelcal.effects.guard import EffectsFileError
from accelcal.effects.mechanisms import side_channel, side_channels
from accelcal.effects.processes import (
    Names,
    card,
    cards,
    find,
    has_time_constant,
    names,
    next_name,
    on_demand,
    spelled,
    stem_of,
)
from accelcal.effects.own import ExpressionError, Own, effect, from_expression, load_effects

BUILT_IN = tuple(CATALOGUE.values())
"""The effects that come with accelcal: without side channels and users' own."""
OF_TIME = frozenset(name for effect in BUILT_IN if effect.function_of == "t" for name in (effect.name, *effect.covers))
"""Effects that are functions of time alone."""

_BY_NAME = {effect.name: effect for effect in BUILT_IN}


def is_local(effect: Effect) -> bool:
    """Whether an effect is known to have no memory, so that it can be evaluated on a part of a record."""
    stem = _BY_NAME.get(stem_of(effect))
    further = stem is not None and stem.name != effect.name and stem.function is effect.function
    return not effect.traits.memory and (stem is effect or further or (stem is None and effect.product is not None))


def of_one_record(effect: Effect) -> bool:
    """Whether an effect belongs to the record that shows it: it lives at one instant or follows a function of time,
    which says nothing of another record."""
    of_time = effect.name in OF_TIME or effect.port == "process"
    return of_time or "instant" in effect.shapes or ("start" in effect.shapes and not effect.shapes["start"].refined)


def begins_rested(of_model: Sequence[str]) -> str:
    """The sentence on effects with a memory, in a model that is carried to another recording; empty without any."""
    anew = [effect.name for effect in map(find, of_model) if not of_one_record(effect) and effect.rested({})]
    return f"{' and '.join(anew)}: begins on this recording as after a long rest" if anew else ""


def users_own() -> tuple[Effect, ...]:
    """Registered effects of the user's own (file, expression or decorator), in the order of entry.

    Effects of channels and processes that were asked for by name are not among them.
    """
    return tuple(
        effect
        for effect in CATALOGUE.values()
        if _BY_NAME.get(effect.name) is not effect and not effect.product and not on_demand(effect)
    )


def static_terms() -> dict[str, Static]:
    """Terms of a sensor's static characteristic by effect: of acceleration alone in rising order, then thermal ones."""
    terms = {effect.name: effect.traits.static for effect in BUILT_IN if effect.traits.static}
    return dict(sorted(terms.items(), key=lambda item: (item[1].thermal, item[1].power, item[1].mirrored)))


def polynomial(degree: int) -> tuple[str, ...]:
    """Effects a², a³, ... up to a degree of the sensor's static characteristic."""
    return tuple(
        name
        for name, term in static_terms().items()
        if 2 <= term.power <= degree and not (term.mirrored or term.thermal)
    )


def found_by(test: NoiseTestKind) -> Effect:
    """The built-in effect that a noise test finds."""
    return next(effect for effect in BUILT_IN if effect.traits.noise and effect.traits.noise.found_by == test)


__all__ = [
    "BUILT_IN",
    "CATALOGUE",
    "HARMONICS",
    "OF_TIME",
    "Effect",
    "EffectsFileError",
    "ExpressionError",
    "Lumped",
    "Names",
    "NoiseSource",
    "Own",
    "Search",
    "Shape",
    "SizePrior",
    "Static",
    "Traits",
    "Variable",
    "begins_rested",
    "card",
    "cards",
    "effect",
    "family",
    "find",
    "found_by",
    "from_expression",
    "has_time_constant",
    "is_local",
    "load_effects",
    "names",
    "next_name",
    "of_one_record",
    "polynomial",
    "side_channel",
    "side_channels",
    "spelled",
    "static_terms",
    "stem_of",
    "users_own",
]


__dir__ = listing(globals())
