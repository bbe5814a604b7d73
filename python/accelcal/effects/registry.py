"""How a function becomes an effect."""

from __future__ import annotations

import difflib
import inspect
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal, get_args

import numpy as np

from accelcal.data.arrays import Array
from accelcal.signals.signals import Signals

Port = Literal["output", "position", "noise", "process"]
Owner = Literal["sensor", "mounting", "rig", "encoder", "timing"]


@dataclass(frozen=True, slots=True)
class Shape:
    """A parameter that enters an effect nonlinearly: a time constant, an instant, a period, a clip level."""

    unit: str
    bounds: tuple[float, float] | Callable[[Signals], tuple[float, float]]
    """Where it may lie, in `unit`; a function where that depends on the motion."""
    trials: int = 8
    """Values at which it is tried before it is refined; 1 = set by the record of the fit, kept by the model."""
    spacing: Literal["linear", "log"] = "linear"
    picked: Literal["", "jumps", "waves", "ripples"] = ""
    """What is sought in a record where no grid of trials would meet the right value: instants of jumps, periods in
    position, periods in acceleration."""

    @property
    def refined(self) -> bool:
        """Whether its value is sought by likelihood."""
        return self.trials > 1

    def grid(self, s: Signals) -> Array:
        """Values to try first, (trials,)."""
        low, high = self.span(s)
        if self.spacing == "log":
            return np.geomspace(low, high, self.trials)
        edges = np.linspace(low, high, self.trials + 1)
        return np.asarray((edges[1:] + edges[:-1]) / 2.0)

    def span(self, s: Signals) -> tuple[float, float]:
        """Least and largest value on this motion."""
        return self.bounds(s) if callable(self.bounds) else self.bounds


@dataclass(frozen=True, slots=True)
class Effect:
    """One physical effect: its contribution per unit of its coefficient, and what is said about it."""

    name: str
    unit: str
    """Unit of the coefficient."""
    port: Port
    """`output` adds to what the accelerometer says (m/s²), `position` to what the encoder says (m).

    `noise` returns variance per unit: of the output, (m/s²)², or of the reading, m², where the owner is the encoder.
    `process` returns the columns of a slowly wandering contribution to the output: their coefficients are independent
    with mean zero, and the effect's coefficient is the standard deviation that all of them share."""
    owner: Owner
    symbol: str
    scale: float
    """A typical size of the coefficient, in its unit."""
    source: str
    """Where that size comes from."""
    function: Callable[..., Array]
    shapes: Mapping[str, Shape]
    """Parameters that enter nonlinearly, by keyword."""
    needs: tuple[str, ...] = ()
    """Side channels without which it cannot be evaluated."""
    parts: tuple[str, ...] = ("",)
    """Names of its columns where it has several (sine and cosine, splines)."""
    family: bool = False
    """A shape without a name, not a physical cause."""
    coarse: int = 0
    """Leading columns that are a coarser shape by themselves, and are tried so too; 0: none are."""
    covers: tuple[str, ...] = ()
    """Named effects that a family generalises: functions of its variable alone."""
    bends: tuple[tuple[str, ...], ...] = ()
    """Those of them that describe one bend in several ways: two of a group together are another bend."""
    visible: bool = True
    """False for what no motion of a level, untouched rig can show."""
    experiment: str = ""
    """What separates it from what it is confused with."""
    includes: tuple[str, ...] = ()
    """Simpler effects that it contains: what it is a change of (a drift of X includes X), and what it turns into when
    the origin of time, position, temperature or a channel moves. They belong in the model beside it, and it is judged
    by what it explains beyond them."""
    positive: bool = False
    """Whether physics allows a positive coefficient only."""
    belief: tuple[float, float] | None = None
    """Mean and standard deviation of what physics says of the coefficient, in its unit, where a record says little."""
    memory: bool = False
    """Whether its value at one time depends on the signals at other times."""
    beside: str = ""
    """An effect without which this one is not looked for."""
    basis: str = ""
    """Name of the functions that its columns are, each times a positive size: shape parameters that are not refined set
    the functions, those that are refined set the sizes alone."""
    text: str = ""
    """The user's file that it comes from, whole; empty in the house catalogue."""
    digest: str = ""
    """SHA-256 of that file, hex."""

    def line(self, label: str) -> str:
        """What the card says behind `label` ("Equation", "Looks like", ...); empty where it does not."""
        return card_line(self.function, label)

    @property
    def card(self) -> str:
        """What it is, what it looks like, what it is confused with."""
        return inspect.getdoc(self.function) or ""

    @property
    def summary(self) -> str:
        """The first line of its card, to stand within a sentence."""
        first = self.card.partition("\n")[0].rstrip(".")
        return first[:1].lower() + first[1:]

    @property
    def confused(self) -> tuple[str, ...]:
        """Effects of the house that its card says it is easily confused with."""
        words = re.findall(r"\w+", self.line("Easily confused with"))
        return tuple(name for name in dict.fromkeys(words) if name in CATALOGUE and not CATALOGUE[name].text)

    @property
    def width(self) -> int:
        """Number of columns."""
        return len(self.parts)

    def column(self, s: Signals, **shape: float) -> Array:
        """Contribution per unit coefficient at the times of `s`: (n,), or (n, width) where it has several columns."""
        y = np.asarray(self.function(s, **shape), dtype=np.float64)
        return np.broadcast_to(y, s.t.shape) if self.width == 1 else y


CARD = ("Equation", "Looks like", "Easily confused with", "Separate by")
"""What every card says behind its first sentences."""

CATALOGUE: dict[str, Effect] = {}
"""Every known effect by name, in the order of entry."""


def effect(
    name: str,
    *,
    unit: str,
    port: Port = "output",
    owner: Owner = "sensor",
    symbol: str,
    scale: float,
    source: str = "",
    shapes: Mapping[str, Shape] | None = None,
    needs: tuple[str, ...] = (),
    parts: tuple[str, ...] = ("",),
    family: bool = False,
    coarse: int = 0,
    covers: tuple[str, ...] = (),
    bends: tuple[tuple[str, ...], ...] = (),
    visible: bool = True,
    experiment: str = "",
    includes: tuple[str, ...] = (),
    positive: bool = False,
    belief: tuple[float, float] | None = None,
    memory: bool = False,
    beside: str = "",
    basis: str = "",
) -> Callable[[Callable[..., Array]], Callable[..., Array]]:
    """Enter a function of :class:`Signals` (and its shape parameters, by keyword) into the catalogue.

    Parameters
    ----------
    name : the effect's identifier, as on the command line.
    unit : unit of the coefficient.
    port : where the contribution adds: "output" (m/s²) or "position" (m), or how it acts on noise.
    owner : who carries it when the sensor moves to another rig.
    symbol : letter in formulas and tables.
    scale : typical size of the coefficient, in `unit`.
    source : where that size comes from.
    shapes : nonlinear parameters by keyword of the function.
    needs : side channels it uses.
    parts : names of its columns when the function returns (n, m).
    family : a shape without a name.
    coarse : leading columns that are a coarser shape by themselves.
    covers : named effects that a family generalises.
    bends : groups of them that describe one bend in several ways.
    visible : False for what a level, untouched rig can never show.
    experiment : what separates it from its rivals; the card's line "Separate by:" unless given.
    includes : simpler effects that it contains, such as what a shifted origin turns it into.
    positive : whether only a positive coefficient is physical.
    belief : mean and standard deviation that the coefficient has before any record.
    memory : whether its value at one time depends on the signals at other times. Effects of a user's own are taken
        to have one whatever they say; a house effect without is evaluated on stretches of a long record.
    beside : an effect without which this one is not looked for.
    basis : functions that its columns are, each times a size that refined shape parameters alone set.

    Raises
    ------
    ValueError
        If the name is taken, or port, owner or a shape's keyword does not exist; if `coarse` is not fewer columns than
        there are, or `belief` is not a mean and a spread of one constant coefficient.
    """
    if port not in get_args(Port):
        raise ValueError(f"effect {name!r}: port {port!r} is none of {', '.join(get_args(Port))}")
    if owner not in get_args(Owner):
        raise ValueError(f"effect {name!r}: owner {owner!r} is none of {', '.join(get_args(Owner))}")
    if not 0 <= coarse < max(len(parts), 1):
        raise ValueError(f"effect {name!r}: {coarse} of its {len(parts)} columns cannot be a coarser shape")
    if belief is not None and (len(parts) > 1 or port not in ("output", "position")):
        raise ValueError(f"effect {name!r}: only one constant coefficient can be believed to have a value")
    if belief is not None and not (len(belief) == 2 and math.isfinite(sum(belief)) and belief[1] > 0.0):
        raise ValueError(f"effect {name!r}: belief {belief} needs a mean and a positive standard deviation")
    keywords: dict[str, Any] = {
        "shapes": MappingProxyType(dict(shapes or {})),
        "needs": needs,
        "parts": parts,
        "family": family,
        "coarse": coarse,
        "covers": covers,
        "bends": bends,
        "visible": visible,
        "includes": includes,
        "positive": positive,
        "belief": belief,
        "memory": memory,
        "beside": beside,
        "basis": basis,
    }

    def enter(function: Callable[..., Array]) -> Callable[..., Array]:
        if name in CATALOGUE:
            raise ValueError(f"effect {name!r} is already in the catalogue; choose another name")
        for keyword in keywords["shapes"]:
            if keyword not in inspect.signature(function).parameters:
                raise ValueError(f"effect {name!r} declares the shape {keyword!r} but its function does not take it")
        keywords["experiment"] = experiment or card_line(function, "Separate by")
        CATALOGUE[name] = Effect(name, unit, port, owner, symbol, scale, source, function, **keywords)
        return function

    return enter


def card_line(function: Callable[..., Array], label: str) -> str:
    """What stands behind `label:` in a function's docstring, up to the next label."""
    found: list[str] = []
    for line in (inspect.getdoc(function) or "").splitlines():
        head, colon, rest = line.partition(":")
        if colon and head in CARD:
            if found:
                break
            found = [rest.strip()] if head == label else []
        elif found:
            found.append(line.strip())
    return " ".join(found).strip()


def find(name: str) -> Effect:
    """Return the effect called `name`.

    Raises
    ------
    ValueError
        If there is none; the text offers the nearest names.
    """
    try:
        return CATALOGUE[name]
    except KeyError:
        near = difflib.get_close_matches(name, CATALOGUE, n=3)
        hint = f"; did you mean {' or '.join(near)}?" if near else f"; known are {', '.join(CATALOGUE)}"
        raise ValueError(f"there is no effect called {name!r}{hint}") from None
