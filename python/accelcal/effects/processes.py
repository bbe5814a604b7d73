"""Effects made of another one when they are asked for: a random process of its coefficient, and one more wave of it.

`quadratic_gauss_markov` is a process of any coefficient; `tone_2` is a second line, `encoder_cyclic_2` a second wave.
"""

from __future__ import annotations

import re
from collections.abc import Container
from dataclasses import replace
from itertools import count

import numpy as np

from accelcal._support.errors import AccelcalError
from accelcal.data.arrays import Array
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
    tau = CATALOGUE["bias_gauss_markov"].shapes["tau"]
    shapes: dict[str, Shape] = {**stem.shapes, **RECORD, **({"tau": tau} if markov else {})}
    own = tuple(stem.shapes)
    if len(shapes) != len(own) + len(RECORD) + markov:
        raise AccelcalError(
            f"{name}: {stem.name} has a shape parameter of its own that a process needs: {', '.join(own)}"
        )

    def moving(s: Signals, **shape: float) -> Array:
        column = stem.column(s, **{key: shape[key] for key in own})
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
