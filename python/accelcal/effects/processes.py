"""Effects entered when they are asked for: processes of a coefficient, further waves, side channels; found by name.

`quadratic_gauss_markov` is a process of any coefficient; `tone_2` is a second line, `encoder_cyclic_2` a second wave.
Pickles hold the name of an effect, no code.
"""

from __future__ import annotations

import copyreg
import re
from collections.abc import Callable, Container, Iterable
from dataclasses import replace
from itertools import count
from pickle import PicklingError

import numpy as np

from accelcal._support.errors import AccelcalError
from accelcal.data import ANGULAR_ACCELERATION, Array
from accelcal.effects import registry
from accelcal.effects.curves import RECORD, cosines
from accelcal.effects.drift import BIAS_COSINES, STATIONARY, stationary
from accelcal.effects.registry import CATALOGUE, Effect, Search, Shape, Traits, enter
from accelcal.signals.signals import Signals

MADE = "a tenth of {}"
"""Where the typical size of a process that is made on demand comes from."""
KINDS = re.compile(r"(?P<stem>\w+)_(?P<kind>gauss_markov|random_walk)")

FURTHER = re.compile(r"(?P<stem>\w+)_(?P<number>[2-9]|[1-9]\d+)")


def find(name: str) -> Effect:
    """Return the effect called `name`; a random process or a further wave of a known effect is made where it is not
    known yet.

    Raises
    ------
    ValueError
        If there is none; the text offers the nearest names.

    Examples
    --------
    >>> find("quadratic_gauss_markov").unit
    '(m/s²)⁻¹'
    """
    asked = KINDS.fullmatch(name)
    if name not in CATALOGUE and asked is not None and asked["stem"] in CATALOGUE:
        stem = CATALOGUE[asked["stem"]]
        if stem.port == "output" and stem.width == 1 and stem.traits.visible and stem.traits.noise is None:
            _enter(name, stem, markov=asked["kind"] == "gauss_markov")
    asked = FURTHER.fullmatch(name)
    if name not in CATALOGUE and asked is not None and asked["stem"] in CATALOGUE:
        stem = CATALOGUE[asked["stem"]]
        if any(shape.width for shape in stem.shapes.values()):
            symbol, beside = f"{stem.symbol}{asked['number']}", replace(stem.search, beside=stem.name)
            CATALOGUE[name] = replace(stem, name=name, symbol=symbol, search=beside)
    return registry.find(name)


def on_demand(effect: Effect) -> bool:
    """Whether an effect is one that `find` has made."""
    process = effect.port == "process" and effect.source == MADE.format(effect.traits.changes)
    return process or stem_of(effect) != effect.name


def stem_of(effect: Effect) -> str:
    """Name of the effect of which an effect is a further wave; its name where it is none.

    Examples
    --------
    >>> stem_of(find("tone_2")), stem_of(find("cubic"))
    ('tone', 'cubic')
    """
    asked = FURTHER.fullmatch(effect.name)
    stem = CATALOGUE.get(asked["stem"]) if asked else None
    return stem.name if stem is not None and stem.function is effect.function else effect.name


def next_name(stem: str, used: Container[str]) -> str:
    """Name under which one more wave of an effect enters beside those that are `used`.

    Examples
    --------
    >>> next_name("tone", ()), next_name("tone", ("tone", "tone_2"))
    ('tone', 'tone_3')
    """
    return next(name for n in count(1) if (name := stem if n == 1 else f"{stem}_{n}") not in used)


def _enter(name: str, stem: Effect, *, markov: bool) -> None:
    """Enter the process of the coefficient of an effect: its cosines (derivations 7.1) times what one unit adds."""
    shapes: dict[str, Shape] = {
        **stem.shapes,
        **RECORD,
        **({"tau": CATALOGUE["bias_gauss_markov"].shapes["tau"]} if markov else {}),
    }
    stem_shapes = tuple(stem.shapes)
    if len(shapes) != len(stem_shapes) + len(RECORD) + markov:
        raise AccelcalError(
            f"{name}: {stem.name} has a shape parameter of its own that a process needs: {', '.join(stem_shapes)}"
        )

    def moving(s: Signals, **shape: float) -> Array:
        column = stem.column(s, **{key: shape[key] for key in stem_shapes})
        start, length = shape["start"], shape["length"]
        if markov:
            return column[:, None] * stationary(s.t, start, length, shape["tau"])
        j = np.arange(1, len(BIAS_COSINES) + 1)
        return column[:, None] * cosines(s.t, start, length, np.sqrt(2.0 * length) / (np.pi * j))

    kind = "gauss_markov" if markov else "random_walk"
    row = {
        "function": moving,
        "card": f"""The coefficient of {stem.name} is a {"Gauss-Markov process" if markov else "random walk"}.

    Equation: as bias_{kind}, times what one unit of {stem.name} adds.
    Looks like: {stem.line("Looks like").rstrip(".")}, of a size that changes at random.
    Easily confused with: {stem.name}, bias_random_walk, scale_random_walk.
    Separate by: {stem.line("Separate by").rstrip(".")}; a longer record.
    """,
        "unit": stem.unit if markov else "1/√s" if stem.unit == "1" else f"{stem.unit}/√s",
        "port": "process",
        "owner": stem.owner,
        "symbol": f"{'sigma' if markov else 'sqrt(q)'}({stem.symbol})",
        "scale": 0.1 * stem.scale,
        "source": MADE.format(stem.name),
        "shapes": shapes,
        "needs": stem.needs,
        "parts": STATIONARY if markov else BIAS_COSINES,
        "traits": Traits(positive=True, memory=stem.traits.memory, changes=stem.name),
        "search": Search(includes=(stem.name,)),
    }
    enter({name: row})


KNOWN = ("temperature", "a_y", "a_z")
"""Channels whose named effects include the channel by itself and times the acceleration."""


def side_channel(name: str, unit: str = "") -> Effect:
    """The effect "the output follows the channel `name`", entered into the catalogue at the first call.

    It has the name of the channel; `_channel` is appended where a physical effect already has that name.

    Parameters
    ----------
    name : the recorded channel.
    unit : its SI unit, for the unit of the coefficient.

    Examples
    --------
    >>> from accelcal.effects import side_channel
    >>> side_channel("supply", "V").unit
    'm/s²/V'
    """
    effect_name = free_name(name, name)
    if effect_name not in CATALOGUE:
        enter(
            {
                effect_name: {
                    "function": lambda s: s.side[name],
                    "card": f"""The output follows the recorded channel {name!r}.

    Equation: e = c {name}.
    Looks like: a residual proportional to the channel.
    Easily confused with: any effect that changes together with the channel on this record.
    Separate by: changing the channel on purpose while everything else stays.
    """,
                    "unit": "m/s²" if unit in ("", "1") else f"m/s²/({unit})" if "/" in unit else f"m/s²/{unit}",
                    "owner": "rig",
                    "symbol": f"c({name})",
                    "scale": 1e-3,
                    "source": "0.1 mg per unit of the channel",
                    "needs": (name,),
                    "traits": Traits(follows=name),
                    "search": Search(includes=("bias",)),
                }
            }
        )
    return CATALOGUE[effect_name]


def side_channel_scale(name: str, unit: str = "") -> Effect:
    """The effect "the scale factor follows the channel `name`", as `side_channel`; `_scale` follows the name.

    Examples
    --------
    >>> from accelcal.effects.processes import side_channel_scale
    >>> side_channel_scale("supply", "V").unit
    'V⁻¹'
    """
    effect_name = free_name(f"{name}_scale", name)
    if effect_name not in CATALOGUE:
        enter(
            {
                effect_name: {
                    "function": lambda s: s.a * s.side[name],
                    "card": f"""The scale factor follows the recorded channel {name!r}.

    Equation: e = c {name} a.
    Looks like: a residual proportional to acceleration, its size following the channel.
    Easily confused with: scale_drift, temperature_scale where the channel changes with time or temperature.
    Separate by: changing the channel on purpose while the motion stays.
    """,
                    "unit": "1" if unit in ("", "1") else f"({unit})⁻¹" if "/" in unit else f"{unit}⁻¹",
                    "owner": "sensor",
                    "symbol": f"k({name})",
                    "scale": 1e-3,
                    "source": "0.1 % per unit of the channel",
                    "needs": (name,),
                    "traits": Traits(follows=name),
                    "search": Search(includes=("scale_factor",)),
                }
            }
        )
    return CATALOGUE[effect_name]


def side_channels(units: Iterable[tuple[str, str]]) -> tuple[Effect, ...]:
    """Effects of all channels (name, unit) that have no named physical effect: added, and times the acceleration."""
    free = [(name, unit) for name, unit in units if name not in KNOWN]
    return tuple(
        make(name, unit)
        for name, unit in free
        for make in (side_channel, side_channel_scale)
        if make is side_channel_scale or name != ANGULAR_ACCELERATION  # by itself it is angular_acceleration
    )


def follows_output(effect: Effect) -> bool:
    """Whether an effect of a channel is added to the output, and not times the acceleration."""
    return effect.search.includes == ("bias",)


def free_name(wanted: str, channel: str) -> str:
    """A name in the catalogue for an effect of a channel: the wanted one, unless a physical effect has it."""
    entry = CATALOGUE.get(wanted)
    return wanted if entry is None or entry.needs == (channel,) else f"{wanted}_channel"


class Names:
    """Every effect of the catalogue as an attribute, whose value is its name; those of users appear when they enter.

    Examples
    --------
    >>> Names().cubic, "odd_quadratic" in dir(Names())
    ('cubic', True)
    """

    __slots__ = ()

    def __getattr__(self, name: str) -> str:
        if name.startswith("_"):
            raise AttributeError(name)
        try:
            return find(name).name
        except ValueError as error:
            raise AttributeError(str(error)) from None

    def __dir__(self) -> list[str]:
        return sorted(CATALOGUE)

    def __repr__(self) -> str:
        return f"Names({len(CATALOGUE)} effects; effects.names.<tab> lists them)"


names = Names()
"""The catalogue's names."""


def by_name(effect: Effect) -> tuple[Callable[[str], Effect], tuple[str]]:
    """What a pickle of an effect holds: its name, under which the reader's catalogue has it.

    Raises
    ------
    PicklingError
        If the catalogue has no such effect, or another one of that name.
    """
    if CATALOGUE.get(effect.name) is not effect:
        raise PicklingError(
            f"the effect {effect.name} is not the one in the catalogue; enter it with @accelcal.effect or "
            "accelcal.load_effects, here and where it is read"
        )
    return find, (effect.name,)


copyreg.pickle(Effect, by_name)  # copies of an effect are the effect itself
