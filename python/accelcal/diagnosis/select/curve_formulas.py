"""From a curve to formulas: short algebra for what a nonparametric function of one variable shows (derivations D9).

One pass through a record gives the Gram matrix of hat functions over the variable. A formula is a mixture of hats, so
that thousands are compared without another pass. A mechanism (derivations 7.13) is a mixture of its columns at some
time constants.
"""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, ClassVar

import numpy as np
import scipy

from accelcal._support.errors import AccelcalError
from accelcal._support.result import Storable
from accelcal._support.values import listing
from accelcal.data import Array, concise, unit_diagonal
from accelcal.diagnosis.policy import (
    FAMILYWISE_ALPHA,
    FORMULA_LACK_OF_FIT_ALPHA,
)
from accelcal.diagnosis.search.beam import SearchRules, block_length
from accelcal.diagnosis.search.confounding import CLASS_ODDS
from accelcal.diagnosis.search.hypotheses import Hypothesis, hypotheses_for, mechanisms_for
from accelcal.diagnosis.search.refine import refine
from accelcal.diagnosis.search.scores import BaseProjection, CandidateScores, log_survival, score_gain
from accelcal.effects import Effect, Own, find, from_expression, spelled
from accelcal.effects.curves import curve as smooth_curve
from accelcal.estimation.run_state import RunState
from accelcal.model import Model
from accelcal.signals.signals import Signals

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
    memory: tuple[Hypothesis, ...] = field(default=(), compare=False)
    """A mechanism at several time constants, its inner parameter, and the same for what its memory begins with; their
    columns follow the nodes."""
    alternatives: int = 0
    """Mechanisms that a record has; 0 where it is none."""

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


ALTERNATIVES = Counter(map(len, combinations()))
"""Formulas of the grammar by their number of elements."""


def lengths(elements: Sequence[Element], nodes: Array) -> Array:
    """Trial values of the inner parameter; one of no meaning where there is none."""
    span = float(nodes[-1] - nodes[0])
    if elements[0].memory:
        return np.unique([item.shape["tau"] for item in elements[0].memory])
    if any(element.wave for element in elements):
        return np.asarray(span / PERIODS)
    if any(element.inner for element in elements):
        return np.geomspace(SHORTEST * span, span, LENGTHS)
    return np.ones(1)


def columns_of(elements: Sequence[Element], nodes: Array, d: float) -> Array:
    """Values of every summand at the nodes, (nodes, p); of a mechanism weights of its columns, behind zeros."""
    return np.column_stack([f(nodes, d) for element in elements for f in element.functions])


NODES = 121
"""Hat functions over the range of the variable, or one less or more."""
CLOSE = (0.25, 0.0625, 0.015625)
"""Further nodes beside 0, in spacings of the others."""
REFINED = 24
"""Formulas whose inner parameter is refined."""
DETERMINED = 2.0
"""Standard deviations that an inner parameter is at least; one of fewer is not in the data."""
DIFFERENCE = 1e-3
"""Step of the derivative with respect to the inner parameter, over its value."""
FARTHEST = 30.0
"""Factor beyond which an interval of the inner parameter is open."""
MOST_MEMORIES, TAUS, REACH = 3, 17, 8.0
"""Mechanisms that enter the comparison, their time constants and the factor to which these reach on either side."""


@dataclass(frozen=True, slots=True)
class Formula(Storable):
    """One formula with its numbers."""

    derived: ClassVar[tuple[str, ...]] = ("text",)

    elements: tuple[str, ...]
    summands: tuple[str, ...]
    """As algebra, with {d} for the inner parameter."""
    units: tuple[str, ...]
    coefficients: tuple[float, ...]
    std: tuple[float, ...]
    inner: float | None
    """Its length or period, in the unit of the variable; None where it has none."""
    inner_interval: tuple[float, float] | None
    """Its 68 % interval by likelihood, which need not lie evenly about it; 0 or infinite where it is open."""
    inner_unit: str
    gain: float
    """Twice the log-likelihood gained."""
    log_evidence: float
    lack_of_fit: float
    """Probability of what a smooth curve still explains beside it."""
    held_out: float | None = None
    """Twice the log-likelihood gained on held-out data; None without any."""
    mechanism: str = ""
    """Name under which `add` takes it, where it is a coefficient that follows the memory of a driver."""

    @property
    def contradicted(self) -> bool:
        """Whether it makes held-out data less likely."""
        return self.held_out is not None and self.held_out < 0.0

    def texts(self, digits: int) -> list[str]:
        """Its summands, the inner parameter to some digits."""
        return [text.format(d="" if self.inner is None else f"{self.inner:.{digits}g}") for text in self.summands]

    @property
    def text(self) -> str:
        """The formula with its numbers, for reading."""
        if self.mechanism and self.inner is not None and self.inner_interval is not None:
            low, high = self.inner_interval
            memory = self.summands[0].format(d=concise(self.inner, 0.5 * (high - low)))
            return f"{memory}, {concise(self.coefficients[0], self.std[0])} {self.units[0]} ({self.mechanism})"
        pairs = zip(self.coefficients, self.texts(4), strict=True)
        return " + ".join(f"{c:.4g}*{text}" for c, text in pairs).replace("+ -", "- ").replace(f"{TURN:.15g}", "2*pi")

    def effect(self, name: str, *, owner: Any = "sensor", port: Any = "output", channels: tuple[str, ...] = ()) -> Own:
        """Enter it as an effect of one coefficient, the first; `file` of the answer is its Python source.

        A mechanism has a name of its own and no file.

        Raises
        ------
        ExpressionError
            If the name is taken.
        """
        if self.mechanism:
            return Own(find(self.mechanism), self.text)
        first, texts = self.coefficients[0], self.texts(9)
        ratios = (f"{c / first:.9g}*{text}" for c, text in zip(self.coefficients[1:], texts[1:], strict=True))
        whole = " + ".join([texts[0], *ratios])
        return from_expression(name, whole, unit=self.units[0], owner=owner, port=port, channels=channels)


@dataclass(frozen=True, slots=True)
class FormulaSet(Storable):
    """Formulas that a record does not separate."""

    derived: ClassVar[tuple[str, ...]] = ("sentence",)

    curve: str
    variable: str
    unit: str
    formulas: tuple[Formula, ...]
    """Largest log-evidence first; empty where none holds."""
    examined: int
    chance: float
    """Probability of the best gain by chance, over all that were examined."""
    origin: float = 0.0
    """Value from which the variable counts in the formulas, in its unit."""
    rejected: tuple[Formula, ...] = ()
    """Those within reach of the best that a smooth curve rejects."""
    alpha: float = FAMILYWISE_ALPHA

    @property
    def sentence(self) -> str:
        """The answer in words."""
        tried = f"{self.examined} formulas examined"
        if self.chance >= self.alpha:
            return f"the record shows no function of {self.variable} beyond the model ({tried}, p = {self.chance:.2g})"
        if not self.formulas:
            return f"no short formula describes what depends on {self.variable}: a smooth curve rejects each ({tried})"
        counted = self.origin and not self.formulas[0].mechanism
        from_zero = f"; {self.variable} counts from {self.origin:.6g} {self.unit}" if counted else ""
        tried += from_zero
        of = "" if self.formulas[0].mechanism else f"what depends on {self.variable} is "
        first, *others = (formula.text for formula in self.formulas)
        rest = f", or one of these, which the record does not separate: {'; '.join(others)}" if others else ""
        against = ". The held-out record contradicts it" if self.formulas[0].contradicted else ""
        return f"{of}{first}{rest} ({tried}){against}"


class HatGram:
    """Gram matrix and scores of hat functions over a variable, and of mechanisms, the base projected out."""

    def __init__(
        self, state: RunState, model: Model, curve: Effect, nodes: Array, memories: Sequence[Element] = ()
    ) -> None:
        def hats(s: Signals) -> Array:
            x = np.clip(value_of(s, curve), nodes[0], nodes[-1])
            cell = np.clip(np.searchsorted(nodes, x, side="right") - 1, 0, len(nodes) - 2)
            share = (x - nodes[cell]) / np.diff(nodes)[cell]
            columns, rows = np.zeros((len(nodes), len(x))), np.arange(len(x))
            columns[cell, rows] = 1.0 - share
            columns[cell + 1, rows] = share
            return columns.T

        effect = replace(
            curve,
            name=f"{curve.name}.hats",
            function=hats,
            shapes={},
            parts=tuple(f"h{k}" for k in range(len(nodes))),
            traits=replace(curve.traits, memory=True),
            family=None,
        )
        self.nodes = nodes
        items = [Hypothesis(effect, {}), *(item for element in memories for item in element.memory)]
        evidence = CandidateScores([BaseProjection(state, model)], items).against_slow_noise()
        self.G, self.power = evidence.G, evidence.power
        back = fitted_curve(state, curve, nodes)  # what the fit has subtracted comes back
        self.c = evidence.c + self.G[:, : len(nodes)] @ back
        self.blocks = max(2.0, float(state.run.t[-1] - state.run.t[0]) / block_length(state))
        """Effective number of readings in the price of a coefficient."""

    def gain(self, columns: Array) -> tuple[float, int, Array, Array]:
        """Gain, degrees of freedom, coefficients and covariance of columns given at the nodes, (nodes, p).

        Further rows are weights of the columns of mechanisms.
        """
        m = len(columns)
        before = np.diag(self.power[:m] @ columns**2)
        return score_gain(columns.T @ self.G[:m, :m] @ columns, columns.T @ self.c[:m], before)

    def of_function(self, values: Array) -> float:
        """Twice the log-likelihood that a given function gains, (nodes,)."""
        m = len(values)
        return float(2.0 * values @ self.c[:m] - values @ self.G[:m, :m] @ values)


def value_of(s: Signals, curve: Effect) -> Array:
    """The variable of a nonparametric family at the times of some signals."""
    letter = curve.family.variable.letter if curve.family else ""
    return s.side[letter] if letter in s.side else np.asarray(getattr(s, letter), dtype=np.float64)


def fitted_curve(state: RunState, curve: Effect, nodes: Array) -> Array:
    """The curve itself at the nodes as a run was fitted with it, (nodes,); 0 where it was not."""
    terms = [term for term in state.values.terms if term.effect.name == curve.name]
    letter = curve.family.variable.letter if curve.family else ""
    t, p, v, a, jerk = (nodes if name == letter else np.zeros_like(nodes) for name in ("t", "p", "v", "a", "jerk"))
    s = Signals(t, p, v, a, jerk, scale=state.values.scale, rig=state.run.rig, side={letter: nodes})
    return sum((state.values.by_name[term.name] * term.column(s) for term in terms), np.zeros_like(nodes))


def memories_of(
    base: BaseProjection, model: Model, others: Sequence[RunState], alpha: float
) -> tuple[list[Element], int]:
    """Mechanisms that explain more than all other effects of the catalogue and any random process; how many were tried.

    Parameters
    ----------
    base : a run, what the model lacks left in.
    model : its model.
    others : further runs, which must have the channels of the drivers.
    alpha : family-wise false-alarm rate.
    """
    state, s = base.state, base.state.signals
    items = [*hypotheses_for(state, model, others=others), *mechanisms_for(state, model, others)]
    rules = SearchRules(len(items), int((state.run.t[-1] - state.run.t[0]) / block_length(state)), alpha)
    best: dict[str, tuple[float, Hypothesis]] = {}
    rival = 0.0
    for item, gain, dof in zip(items, *CandidateScores([base], items).gains(), strict=True):
        if item.effect.mechanism is None:
            rival = max(rival, rules.net_gain(float(gain), int(dof), item) if dof else rival)
        elif rules.significant(float(gain), int(dof), item) and gain > best.get(item.effect.name, (0.0, item))[0]:
            best[item.effect.name] = float(gain), item
    first = sorted(best.values(), key=lambda trial: -trial[0])[:MOST_MEMORIES]
    near = [item for _, item in first]
    count = sum(item.effect.mechanism is not None for item in items)
    if not near:
        return [], count
    (refined,) = refine([base], [near])
    gains = zip(refined, *CandidateScores([base], refined).gains(), strict=True)
    least = rival + 2.0 * CLASS_ODDS
    ahead = [item for item, gain, dof in gains if rules.net_gain(float(gain), int(dof), item) > least]
    names = len({item.effect.name for item in items if item.effect.mechanism})
    return [memory_element(item, s, 2 * k * TAUS, names) for k, item in enumerate(ahead)], count


def memory_element(item: Hypothesis, s: Signals, before: int, alternatives: int) -> Element:
    """A mechanism as an element; its columns are interpolated between time constants, `before` others precede them."""
    effect, of, tau = item.effect, item.effect.mechanism, item.shape["tau"]
    assert of is not None
    low, high = effect.shapes["tau"].span(s)
    taus = np.geomspace(max(low, tau / REACH), min(high, tau * REACH), TAUS)
    weights = scipy.interpolate.CubicSpline(np.log(taus), np.eye(TAUS))

    def begins(s: Signals, start: float, **shape: float) -> Array:
        return effect.function(s, start=1.0, **shape) - effect.function(s, start=0.0, **shape)

    def column(x: Array, d: float, part: int) -> Array:
        shares = np.zeros((2, TAUS))
        shares[part] = weights(math.log(min(max(d, taus[0]), taus[-1])))
        return np.concatenate([np.zeros(len(x) + before), shares.ravel()])

    parts = effect, replace(effect, name=f"{effect.name}.start", function=begins)
    memory = tuple(
        replace(item, effect=part, shape={**item.shape, "tau": tau}) for part in parts for tau in taus.tolist()
    )
    functions = partial(column, part=0), partial(column, part=1)
    text = f"{spelled(of.carrier)} follows {of.text} with a memory of {{d}} s"
    return Element(effect.name, (text,), functions, memory=memory, alternatives=alternatives)


def nodes_over(x: Array, width: float = 0.0) -> Array:
    """Even nodes over the range of a variable; 0 is one of them, with closer ones beside it, where signs jump.

    None is closer than `width`, within which noise makes the sign.
    """
    step = float(np.ptp(x)) / (NODES - 2)
    low, high = math.floor(np.min(x) / step), math.ceil(np.max(x) / step)
    even = step * np.arange(low, high + 1)
    if not low < 0 < high:
        return np.asarray(even)
    close = [step * share for share in CLOSE if step * share > width]
    return np.unique(np.concatenate([even, np.outer([-1.0, 1.0], close).ravel()]))


def nodes_of(state: RunState, curve: Effect) -> Array:
    """Nodes over what a run covers of the variable."""
    return nodes_over(value_of(state.signals, curve), corner_width(state.signals, curve))


def corner_width(s: Signals, curve: Effect) -> float:
    """Half-width within which the sign of the variable is that of its noise, in its unit."""
    letter = curve.family.variable.letter if curve.family else ""
    return {"v": s.v_width, "a": s.a_width, "p": s.p_std}.get(letter, 0.0)


@dataclass(frozen=True, slots=True)
class Trial:
    """Some elements of the grammar at one value of their inner parameter."""

    elements: tuple[Element, ...]
    d: float
    gain: float
    dof: int
    log_evidence: float

    @classmethod
    def at(cls, elements: tuple[Element, ...], d: float, hats: HatGram) -> Trial:
        """The elements at an inner parameter, with their evidence: gain, price of parameters, size of the grammar."""
        gain, dof, _, _ = hats.gain(columns_of(elements, hats.nodes, d))
        inner = any(element.inner for element in elements)
        alternatives = elements[0].alternatives or ALTERNATIVES[len(elements)]
        price = 0.5 * (dof + inner) * math.log(hats.blocks) + math.log(alternatives)
        whole = dof >= (1 if elements[0].memory else sum(len(element.functions) for element in elements))
        return cls(elements, d, gain, dof + inner, 0.5 * gain - price if whole else -math.inf)

    @classmethod
    def of(cls, elements: tuple[Element, ...], hats: HatGram) -> Trial:
        """The elements at the best of the trial values."""
        return max(
            (cls.at(elements, float(d), hats) for d in lengths(elements, hats.nodes)), key=lambda trial: trial.gain
        )

    def refined(self, hats: HatGram) -> Trial:
        """The same at the most likely inner parameter between the neighbours of its trial value."""
        trials = np.sort(lengths(self.elements, hats.nodes))
        if len(trials) == 1:
            return self
        k = int(np.argmin(np.abs(trials - self.d)))
        bounds = np.log([trials[max(k - 1, 0)], trials[min(k + 1, len(trials) - 1)]])
        best = scipy.optimize.minimize_scalar(
            lambda log_d: -Trial.at(self.elements, math.exp(log_d), hats).gain,
            bounds=tuple(bounds),
            method="bounded",
            options={"xatol": 1e-4},
        )
        trial = Trial.at(self.elements, math.exp(float(best.x)), hats)
        return trial if trial.gain > self.gain else self

    def estimate(self, hats: HatGram) -> tuple[Array, Array]:
        """Coefficients, then the inner parameter where there is one, and their standard deviations."""
        columns = columns_of(self.elements, hats.nodes, self.d)
        _, _, c, covariance = hats.gain(columns)
        if not any(element.inner for element in self.elements):
            return c, np.sqrt(np.diag(covariance))
        step = DIFFERENCE * self.d
        above, below = (columns_of(self.elements, hats.nodes, self.d + h) for h in (step, -step))
        J = np.column_stack([columns, (above - below) @ c / (2.0 * step)])
        information, size = unit_diagonal(J.T @ hats.G[: len(J), : len(J)] @ J)
        inverse = np.linalg.pinv(information, rcond=1e-10, hermitian=True)
        return np.append(c, self.d), np.sqrt(np.diag(inverse)) / size

    def inner_interval(self, hats: HatGram) -> tuple[float, float]:
        """The inner parameters at which the gain, all coefficients most likely, is by at most 1 less: 68 %."""

        def lost(log_d: float) -> float:
            return self.gain - Trial.at(self.elements, math.exp(log_d), hats).gain - 1.0

        ends = []
        for side, end in ((-1.0, 0.0), (1.0, math.inf)):
            inner = math.log(self.d)
            for outer in inner + side * np.geomspace(0.01, math.log(FARTHEST), 40):
                if lost(float(outer)) >= 0.0:
                    end = math.exp(scipy.optimize.brentq(lost, inner, float(outer), xtol=1e-4))
                    break
                inner = float(outer)
            ends.append(end)
        return ends[0], ends[1]

    def determined(self, hats: HatGram) -> bool:
        """Whether the record determines the inner parameter, inside the range of the trials."""
        trials = lengths(self.elements, hats.nodes)
        if len(trials) == 1:
            return True
        values, std = self.estimate(hats)
        return bool(1.02 * trials.min() < values[-1] < 0.98 * trials.max() and values[-1] > DETERMINED * std[-1])

    def formula(self, hats: HatGram, curve: Effect, holdout: HatGram | None) -> Formula:
        """The elements as a formula with numbers, units, lack of fit and gain on held-out data."""
        assert curve.family is not None
        letter, unit = curve.family.variable.letter, curve.family.variable.unit
        values, std = self.estimate(hats)
        p = sum(len(element.functions) for element in self.elements)
        columns = columns_of(self.elements, hats.nodes, self.d)
        smooth = smooth_curve(hats.nodes, hats.nodes[0], hats.nodes[-1])
        smooth = np.pad(smooth, ((0, len(columns) - len(smooth)), (0, 0)))
        more, rank, _, _ = hats.gain(np.column_stack([columns, smooth]))
        added = "m" if curve.port == "position" else "m/s²"
        followed = self.elements[0].memory[0].effect if self.elements[0].memory else None
        shown = 1 if followed else p  # what a memory begins with belongs to the record
        held_out = None
        if holdout is not None:
            held_out = holdout.of_function(columns_of(self.elements, holdout.nodes, self.d)[:, :shown] @ values[:shown])
        powers = tuple(per(added, unit, element.power) for element in self.elements for _ in element.functions)
        return Formula(
            elements=tuple(element.name for element in self.elements),
            summands=tuple(text.replace("{x}", letter) for element in self.elements for text in element.texts),
            units=(followed.unit,) if followed else powers,
            coefficients=tuple(values[:shown].tolist()),
            std=tuple(std[:shown].tolist()),
            inner=float(values[p]) if len(values) > p else None,
            inner_interval=self.inner_interval(hats) if len(values) > p else None,
            inner_unit="s" if followed else unit,
            gain=self.gain,
            log_evidence=self.log_evidence,
            lack_of_fit=math.exp(log_survival(more - self.gain, max(0, rank - self.dof))),
            held_out=held_out,
            mechanism=followed.name if followed else "",
        )


def per(added: str, unit: str, power: float) -> str:
    """Unit of a coefficient that multiplies a power of a variable."""
    if power == 0.0:
        return added
    return f"{added}/({unit})" if power == 1.0 else f"{added}/({unit})^{power:g}"


def formulas_of(
    state: RunState,
    model: Model,
    curve: Effect,
    *,
    holdout: tuple[RunState, Model] | None = None,
    alpha: float = FAMILYWISE_ALPHA,
) -> FormulaSet:
    """Formulas for what depends on the variable of a nonparametric family.

    Parameters
    ----------
    state : a run, fitted best with the curve: its motion is then what it is, however strong the effect.
    model : the model without the curve.
    curve : the family.
    holdout : another run and the model, which take no part in the choice.
    alpha : probability by chance below which there is something to describe.

    Raises
    ------
    ValueError
        If the effect is no nonparametric function of one variable, or the variable does not change.
    """
    if curve.family is None or curve.family.variable.per or curve.family.variable.letter == "reversal":
        raise AccelcalError(f"{curve.name} is no curve of one variable; shape_of_velocity is one")
    variable = curve.family.variable
    others = () if holdout is None else holdout[:1]
    for checked_state in (state, *others):
        if missing := [name for name in curve.needs if name not in checked_state.signals.side]:
            name = checked_state.run.recording.title
            raise AccelcalError(f"{name} has no channel {' and '.join(missing)}, of which {curve.name} is a function")
    x = value_of(state.signals, curve)
    if not np.ptp(x) > 0.0:
        raise AccelcalError(f"{variable.name} does not change on this record, which therefore shows no function of it")
    nodes = nodes_of(state, curve)
    fitted = [term for term in state.values.terms if term.effect.name == curve.name]
    memories, tried = memories_of(BaseProjection(state, model, given_back=fitted), model, others, alpha)
    hats = HatGram(state, model, curve, nodes, memories)
    elements_tried = (*combinations(), *((memory,) for memory in memories))
    trials = sorted((Trial.of(elements, hats) for elements in elements_tried), key=lambda trial: -trial.log_evidence)
    ranked = sorted((trial.refined(hats) for trial in trials[:REFINED]), key=lambda trial: -trial.log_evidence)
    examined = tried + sum(len(lengths(elements, nodes)) for elements in combinations())
    p_value = min(1.0, math.exp(min(0.0, log_survival(ranked[0].gain, ranked[0].dof) + math.log(examined))))
    other = None if holdout is None else HatGram(*holdout, curve, nodes_of(holdout[0], curve), memories)
    near = [trial for trial in ranked if trial.log_evidence > ranked[0].log_evidence - CLASS_ODDS]
    candidates = [
        trial.formula(hats, curve, other) for trial in near if trial.determined(hats) and not contains(trial, near)
    ]
    held = tuple(formula for formula in candidates if formula.lack_of_fit > FORMULA_LACK_OF_FIT_ALPHA)
    refused = tuple(formula for formula in candidates if formula.lack_of_fit <= FORMULA_LACK_OF_FIT_ALPHA)
    formulas = held if p_value < alpha else ()
    origins = state.run.origins
    origin = {"t": origins.t, "p": origins.p}.get(variable.letter, origins.of(variable.letter))
    return FormulaSet(curve.name, variable.name, variable.unit, formulas, examined, p_value, origin, refused, alpha)


def contains(trial: Trial, others: Sequence[Trial]) -> bool:
    """Whether a shorter formula that is as good is part of one."""
    return any(
        set(other.elements) < set(trial.elements) and other.log_evidence >= trial.log_evidence for other in others
    )


__dir__ = listing(globals())
