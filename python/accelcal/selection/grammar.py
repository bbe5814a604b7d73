"""A small grammar of functions of one variable: what a formula is made of."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from accelcal.data.arrays import Array

LENGTHS = 24
"""Trial lengths of a formula that has one, from a hundredth of the range to all of it."""
SHORTEST = 0.01
"""In ranges of the variable."""
PERIODS = np.arange(1.0, 30.1, 0.25)
"""Trial periods per range of a wave."""


@dataclass(frozen=True, slots=True)
class Element:
    """One summand of a formula: functions of x, and of an inner parameter d where it has one."""

    name: str
    texts: tuple[str, ...]
    """As algebra, one for each coefficient, with {x} and {d}."""
    functions: tuple[Callable[[Array, float], Array], ...]
    power: float = 0.0
    """Of the unit of x in its functions; an inner parameter has the unit of x and divides it."""
    wave: bool = False

    @property
    def inner(self) -> bool:
        """Whether it has an inner parameter."""
        return any("{d}" in text for text in self.texts)


def _plain(name: str, text: str, power: float, function: Callable[[Array], Array]) -> Element:
    return Element(name, (text,), (lambda x, d: function(x),), power)


def _scaled(name: str, text: str, function: Callable[[Array], Array]) -> Element:
    return Element(name, (text,), (lambda x, d: function(x / d),))


def _product(name: str, text: str, function: Callable[[Array], Array]) -> Element:
    """x times a function of x/d, from that function times x/d."""
    return Element(name, (text,), (lambda x, d: d * function(x / d),), 1.0)


TURN = 2.0 * math.pi
GRAMMAR: tuple[Element, ...] = (
    _plain("linear", "{x}", 1.0, lambda x: x),
    _plain("square", "{x}**2", 2.0, lambda x: x**2),
    _plain("cube", "{x}**3", 3.0, lambda x: x**3),
    _plain("fourth power", "{x}**4", 4.0, lambda x: x**4),
    _plain("fifth power", "{x}**5", 5.0, lambda x: x**5),
    _plain("size", "abs({x})", 1.0, np.abs),
    _plain("signed square", "{x}*abs({x})", 2.0, lambda x: x * np.abs(x)),
    _plain("sign", "sign({x})", 0.0, np.sign),
    _plain("root of the size", "sqrt(abs({x}))", 0.5, lambda x: np.sqrt(np.abs(x))),
    _plain("signed root", "sign({x})*sqrt(abs({x}))", 0.5, lambda x: np.sign(x) * np.sqrt(np.abs(x))),
    _scaled("change of sign within a width", "tanh({x}/{d})", np.tanh),
    _scaled("growth", "exp({x}/{d})", lambda u: np.exp(np.minimum(u, 50.0))),
    _scaled("decay", "exp(-{x}/{d})", lambda u: np.exp(np.minimum(-u, 50.0))),
    _scaled("peak", "exp(-abs({x})/{d})", lambda u: np.exp(-np.abs(u))),
    _scaled("signed peak", "sign({x})*exp(-abs({x})/{d})", lambda u: np.sign(u) * np.exp(-np.abs(u))),
    _scaled("resonance", "1/(1 + ({x}/{d})**2)", lambda u: 1.0 / (1.0 + u**2)),
    _scaled("signed resonance", "({x}/{d})/(1 + ({x}/{d})**2)", lambda u: u / (1.0 + u**2)),
    _product("linear times peak", "{x}*exp(-abs({x})/{d})", lambda u: u * np.exp(-np.abs(u))),
    _product("linear times change of sign", "{x}*tanh({x}/{d})", lambda u: u * np.tanh(u)),
    Element(
        "wave",
        (f"sin({TURN:.15g}*{{x}}/{{d}})", f"cos({TURN:.15g}*{{x}}/{{d}})"),
        (lambda x, d: np.sin(TURN * x / d), lambda x, d: np.cos(TURN * x / d)),
        wave=True,
    ),
)
"""Summands; a formula is one of them, or two of which one at most has an inner parameter."""


def combinations() -> Iterator[tuple[Element, ...]]:
    """One element, or two of which one at most has an inner parameter."""
    for element in GRAMMAR:
        yield (element,)
    for first, second in itertools.combinations(GRAMMAR, 2):
        if not (first.inner and second.inner):
            yield first, second


def lengths(elements: Sequence[Element], nodes: Array) -> Array:
    """Trial values of the inner parameter; one of no meaning where there is none."""
    span = float(nodes[-1] - nodes[0])
    if any(element.wave for element in elements):
        return np.asarray(span / PERIODS)
    if any(element.inner for element in elements):
        return np.geomspace(SHORTEST * span, span, LENGTHS)
    return np.ones(1)


def columns_of(elements: Sequence[Element], nodes: Array, d: float) -> Array:
    """Values of every summand at the nodes, (nodes, p)."""
    return np.column_stack([f(nodes, d) for element in elements for f in element.functions])
