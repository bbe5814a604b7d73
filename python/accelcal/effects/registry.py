"""How a function becomes an effect, and the catalogue that it enters."""

from __future__ import annotations

import difflib
import inspect
import math
import re
from collections import UserDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, Literal, TypeVar, get_args

import numpy as np

from accelcal._support.errors import AccelcalError
from accelcal._support.result import Result
from accelcal._support.values import face, immutable
from accelcal.data import Array
from accelcal.effects import guard
from accelcal.signals.signals import Signals

Entry = TypeVar("Entry")


class Catalogue(UserDict[str, Entry]):
    """Entries by name, in the order of entry.

    There is one for the process. Inside :meth:`apart` the same object is another one, for whoever runs in that context
    alone: a thread or a task begun there sees it if the context is copied to it.
    """

    def __init__(self) -> None:
        self._common: dict[str, Entry] = {}
        self._apart: ContextVar[dict[str, Entry] | None] = ContextVar("catalogue", default=None)

    @contextmanager
    def apart(self) -> Iterator[None]:
        """A catalogue that begins as that of the process; what is entered into it or removed is so inside alone."""
        token = self._apart.set(dict(self._common))
        try:
            yield
        finally:
            self._apart.reset(token)

    @property
    def data(self) -> dict[str, Entry]:  # type: ignore[override]
        """What the mapping holds in this context."""
        entries = self._apart.get()
        return self._common if entries is None else entries

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(self)})"


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
    picked: Literal["", "jumps", "waves", "ripples", "bumps"] = ""
    """What is read off the record where no grid of trials would meet the right value: instants of jumps, periods in
    position, periods in acceleration, the place and width of something local."""

    added: bool = False
    """Whether models that were stored before it existed lack it."""
    width: Callable[[Signals, float], float] | None = None
    """Of a wave: how far its value may move until the wave has one turn more or less over the record, in `unit`.

    Such a value is found by a noise test, not by trials, and refined within this width; None for all others."""
    beyond_size: bool = False
    """Whether no effect has it below the size of its coefficient, about which no iteration settles: a gap that is
    taken up within less than it moves the reading."""
    at_rest: float | None = None
    """Of a state that is carried over from before the record: its value where the sensor had long been at rest. Such a
    state belongs to its record; None for all other parameters."""

    def multiple(self, value: float, n: int) -> float:
        """Value of the n-th harmonic of a wave, a frequency or a period."""
        return value * n if self.unit == "Hz" else value / n

    @property
    def refined(self) -> bool:
        """Whether its value is found by likelihood."""
        return self.trials > 1

    @property
    def usual(self) -> float | None:
        """Value where none is given, of a form that only a record proposes or of an addition; None where one is
        needed."""
        if self.added:
            return 0.0
        return self.bounds[0] if not callable(self.bounds) and self.bounds[0] == self.bounds[1] else None

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
class Static:
    """A term of the sensor's static characteristic: |a|^power, even or odd in a, times the temperature if thermal."""

    power: int
    text: str
    """As it is written in the forward model, in ASCII."""
    odd: bool = False
    thermal: bool = False

    @property
    def mirrored(self) -> bool:
        """Whether it is a^power with the sign changed at negative a: |a|, a|a|."""
        return self.odd != bool(self.power % 2)

    def per_unit(self, a: float, warmth: float) -> float:
        """Output per unit coefficient at `a`, m/s², `warmth` K above the reference temperature."""
        value = a ** (self.power - 1) * abs(a) if self.mirrored else a**self.power
        return warmth * value if self.thermal else value


@dataclass(frozen=True, slots=True)
class Lumped:
    """Effects whose sum is all that a level rig with one mount and one encoder shows of a base parameter."""

    members: tuple[str, ...]
    experiment: str = ""
    """What separates them."""


@dataclass(frozen=True, slots=True)
class Mechanism:
    """What an effect is that makes a coefficient follow a driver, or a memory of one."""

    carrier: str
    """Effect whose coefficient follows."""
    driver: str
    """Name of the driver in `mechanisms.DRIVERS`, or of a recorded channel; empty where no memory of it is asked."""
    text: str
    """As the driver is written in an equation; a recorded channel by its name."""


SizeOf = Callable[[float, Mapping[str, float], Sequence[Signals]], float | None]
"""Largest contribution (m/s², m at the encoder) from a noise test's estimate, its particulars and the signals of all
runs; None where the test gives no size."""
NoiseTestKind = Literal[
    "line",
    "noise over speed",
    "noise over jerk",
    "output outliers",
    "reading outliers",
    "output steps",
    "stamps on a grid",
    "held output",
    "wave over position",
    "position jumps",
]
"""What a noise test looks for."""


@dataclass(frozen=True, slots=True)
class NoiseSource:
    """What a noise test knows of the effect that it finds."""

    found_by: NoiseTestKind
    size_of: SizeOf
    rejects: Literal["", "accel", "position"] = ""
    """Channel whose samples the test rejects as outliers; empty where it rejects none."""
    raises: tuple[str, ...] = ()
    """Noise tests that the effect makes significant besides its own."""


@dataclass(frozen=True, slots=True)
class Variable:
    """The variable of a nonparametric family."""

    name: str
    letter: str
    """Its name in `Signals`."""
    unit: str
    per: str = ""
    """Letter of a second variable that the family multiplies (a drag that changes along the rail: "v")."""


@dataclass(frozen=True, slots=True)
class Family:
    """A nonparametric function of one variable: what an effect is that names no physical cause."""

    variable: Variable
    covers: tuple[str, ...] = ()
    """Named effects that it generalises: functions of its variable alone."""
    groups: tuple[tuple[str, ...], ...] = ()
    """Those of them that describe the same curvature: two of one group in a model are evidence for the family."""
    coarse: int = 0
    """Leading columns that are a coarser function by themselves, and are tried so too; 0: none are."""
    basis: str = ""
    """As in `Traits`."""


@dataclass(frozen=True, slots=True)
class Search:
    """Hints for the search of what a model lacks."""

    includes: tuple[str, ...] = ()
    """Simpler effects that it contains: what it is a change of (a drift of X includes X), and what it turns into when
    the origin of time, position, temperature or a channel moves. They belong in the model with it, and it is judged
    by what it explains beyond them."""
    beside: str = ""
    """An effect without which this one is not searched for."""


DEGENERATE = 1e-12
"""Share of the largest variance of an estimate below which a direction of it is not determined by a record."""


@dataclass(frozen=True, slots=True)
class SizePrior:
    """Distribution of an effect's size over sensors, before any record: a mixture of normal ones about `mean`, whose
    standard deviations are the multiples `tails` of `scale`, equally likely."""

    scale: float
    """Standard deviation over sensors that keep their data sheets, in the effect's unit."""
    source: str = ""
    """Where that size comes from."""
    tails: tuple[float, ...] = (1.0, 10.0, 100.0)
    """Multiples of it: sensors are worse than their data sheets."""
    mean: float = 0.0
    """Size that the effect has by its definition, where it has one."""

    @property
    def typical(self) -> float:
        """A typical size, in the effect's unit."""
        return abs(self.mean) or self.scale

    def log_evidence(self, estimate: Array, covariance: Array, gain: float | None = None) -> float:
        """Log of the probability of an estimate with this prior over that with size 0.

        Parameters
        ----------
        estimate : (m,) sizes of the columns, all of the same prior; of a random process its intensity.
        covariance : (m, m) of the estimate.
        gain : twice the log-likelihood that the estimate gains over 0, where it is not that of its covariance.

        Notes
        -----
        log N(b; mean, s² I + C) - log N(b; 0, C), averaged over s = tails scale.
        """
        b, C = np.atleast_1d(estimate), np.atleast_2d(covariance)
        values, vectors = np.linalg.eigh(C)
        good = values > DEGENERATE * np.max(values)
        values, vectors = values[good], vectors[:, good]
        z = vectors.T @ (b - self.mean)
        gained = float(np.sum((vectors.T @ b) ** 2 / values)) if gain is None else gain
        s2 = (self.scale * np.array(self.tails)[:, None]) ** 2
        terms = 0.5 * (gained - np.sum(z**2 / (s2 + values) + np.log1p(s2 / values), axis=1))
        return float(np.logaddexp.reduce(terms) - math.log(len(self.tails)))


@dataclass(frozen=True, slots=True)
class Traits:
    """Physical properties of an effect that later stages use: fit, verdict, outlier rejection, calibration."""

    positive: bool = False
    """Whether physics allows a positive coefficient only."""
    memory: bool = False
    """Whether its value at one time depends on the signals at other times. Users' own effects are always taken to; a
    built-in effect that does not is evaluated on parts of a long record."""
    visible: bool = True
    """False for what a diagnosis does not search for in one run: no motion of an untouched rig shows it, or a fit
    has it wherever the recordings call for it."""
    basis: str = ""
    """Name of the functions that its columns are, each times a positive size: shape parameters that are not refined set
    the functions, those that are refined set the sizes alone."""
    common: bool = False
    """Whether its detection limit is listed first."""
    changes: str = ""
    """Effect whose coefficient changes in time by it: a drift, a step, a random process."""
    static: Static | None = None
    """Its term in the sensor's static characteristic."""
    clips_at: str = ""
    """Shape parameter that is the level, m/s², at which the output clips."""
    no_inverse: str = ""
    """Why one reading cannot be corrected for it; half a sentence with the effect as its subject."""
    lumped: Lumped | None = None
    """What a base parameter is the sum with on a level rig."""
    summand: str = ""
    """How it is written in such a sum."""
    separated_by: Literal["", "turning", "rolling"] = ""
    """Second mount with which a joint fit separates it from the base parameter."""
    uncertainty: Literal["", "level", "misalignment", "encoder_scale"] = ""
    """Key of the uncertainty that a rig declares where no joint fit separates it."""
    of_any_reference: bool = False
    """Whether it changes a velocity or an acceleration of the stage as it does a position; other effects at the
    encoder are errors of a position that is read."""
    delay_class: bool = False
    """Whether it delays the output, so that only fast motion separates it from the other effects of its class."""
    noise: NoiseSource | None = None
    """The noise test that finds it."""


@immutable
@dataclass(frozen=True, slots=True)
class Effect(Result):
    """One physical effect: its contribution per unit of its coefficient, and its card."""

    name: str
    unit: str
    """Unit of the coefficient."""
    port: Port
    """`output` adds to the accelerometer's output (m/s²), `position` to the encoder's reading (m).

    `noise` returns variance per unit: of the output, (m/s²)², or of the reading, m², where the owner is the encoder.
    `process` returns the columns of a random process that adds to the output: their coefficients are independent
    with mean zero, and the effect's coefficient is the standard deviation that all of them share. It is that of a
    Gauss-Markov process, whose correlation time is its shape parameter tau, or the intensity of a random walk."""
    owner: Owner
    symbol: str
    prior: SizePrior
    """Distribution of its size over sensors."""
    function: Callable[..., Array]
    shapes: Mapping[str, Shape]
    """Parameters that enter nonlinearly, by keyword."""
    needs: tuple[str, ...] = ()
    """Side channels without which it cannot be evaluated."""
    parts: tuple[str, ...] = ("",)
    """Names of its columns where it has several (sine and cosine, splines)."""
    traits: Traits = Traits()
    search: Search = Search()
    family: Family | None = None
    """Set for a nonparametric function; None for a physical cause."""
    mechanism: Mechanism | None = None
    """Set where a coefficient follows a memory of a driver."""
    product: Mechanism | None = None
    """Set where it follows the driver itself, without memory."""
    axis: str = ""
    """Axis of a sensor with several outputs on whose output alone it acts; empty where it acts on all."""
    text: str = ""
    """The user's file that it comes from, whole; empty in the built-in catalogue."""
    digest: str = ""
    """SHA-256 of that file, hex."""

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Any) -> Any:
        return face("results.json").named(face("effects").find)

    def __repr__(self) -> str:
        return f"Effect({self.name}: {self.summary}; {self.unit}, {self.owner})"

    def __post_init__(self) -> None:
        """Put what is not of accelcal under guard, however the effect was made.

        Raises
        ------
        EffectsFileError
            If an effect of the user is declared in a way that no model file can hold, or has no bounds.
        """
        if guard.is_trusted(self.function):
            return
        sentence, failure = guard.words_for(self.function, self.name)
        texts = {"unit": self.unit, "symbol": self.symbol, "source": self.prior.source}
        guard.require_declared(self.name, texts, self.prior.scale, sentence)
        shapes = {
            key: replace(shape, bounds=guard.guarded_bounds(shape.bounds, shape.spacing, key, sentence))
            for key, shape in self.shapes.items()
        }
        object.__setattr__(self, "function", guard.Guarded(self.function, self.width, sentence, failure))
        object.__setattr__(self, "shapes", MappingProxyType(shapes))

    @property
    def seen_by_sets(self) -> bool:
        """Whether no single run shows it, but runs of other mounts and directions of the axis do, or dwells."""
        return not self.traits.visible and bool(self.traits.separated_by or self.traits.uncertainty)

    @property
    def experiment(self) -> str:
        """What separates it from what it is confused with."""
        return self.line("Separate by")

    @property
    def covers(self) -> tuple[str, ...]:
        """Named effects that it generalises, where it is a family."""
        return self.family.covers if self.family else ()

    @property
    def groups(self) -> tuple[tuple[str, ...], ...]:
        """Those of them that describe the same curvature."""
        return self.family.groups if self.family else ()

    @property
    def coarse(self) -> int:
        """Leading columns that are a coarser function by themselves; 0: none are."""
        return self.family.coarse if self.family else 0

    @property
    def basis(self) -> str:
        """Name of the functions that its columns are multiples of; empty where they are its own."""
        return self.family.basis if self.family else self.traits.basis

    @property
    def function_of(self) -> str:
        """Letter of the one variable that it is a nonparametric function of; empty where it is none."""
        return self.family.variable.letter if self.family and not self.family.variable.per else ""

    def line(self, label: str) -> str:
        """Text of the card's line `label` ("Equation", "Looks like", ...); empty where the card has none."""
        return card_line(self.function, label)

    @property
    def card(self) -> str:
        """Its docstring: what it is, what it looks like, what it is confused with."""
        return inspect.getdoc(self.function) or ""

    @property
    def summary(self) -> str:
        """The first line of its card, for use within a sentence."""
        first = self.card.partition("\n")[0].rstrip(".")
        return first[:1].lower() + first[1:]

    @property
    def confused(self) -> tuple[str, ...]:
        """House effects that its card names as easily confused with it."""
        words = re.findall(r"\w+", self.line("Easily confused with"))
        return tuple(name for name in dict.fromkeys(words) if name in CATALOGUE and not CATALOGUE[name].text)

    @property
    def width(self) -> int:
        """Number of columns."""
        return len(self.parts)

    def parts_at(self, shape: Mapping[str, float]) -> tuple[str, ...]:
        """Names of its columns at shape parameters: of a wave with harmonics sin, cos, sin2, cos2 and so on."""
        multiples = range(2, int(shape.get(HARMONICS, 1.0)) + 1)
        return (*self.parts, *(f"{part}{n}" for n in multiples for part in self.parts))

    def rested(self, shape: Mapping[str, float]) -> dict[str, float]:
        """Shape parameters with the states of its element as after a long rest."""
        states = {name: declared.at_rest for name, declared in self.shapes.items() if declared.at_rest is not None}
        return {**shape, **states}

    def column(self, s: Signals, **shape: float) -> Array:
        """Contribution per unit coefficient at the times of `s`: (n,), or (n, m), its `parts_at`, where it has
        several columns."""
        if self.axis and self.axis != s.axis:
            return np.zeros_like(s.t) if self.width == 1 else np.zeros((len(s.t), len(self.parts_at(shape))))
        y = np.asanyarray(self.function(s, **shape))
        y = y if y.dtype == object else np.asarray(y, dtype=np.float64)  # objects are symbols of an export
        return np.broadcast_to(y, s.t.shape, subok=True) if self.width == 1 else y


HARMONICS = "harmonics"
"""Shape parameter of a wave: the highest multiple of its frequency that it has, set by the test that finds it."""

CARD = ("Equation", "Looks like", "Easily confused with", "Separate by")
"""Labels of the lines that every card has behind its first sentences."""

CATALOGUE: Catalogue[Effect] = Catalogue()
"""Every known effect by name, in the order of entry; a session of the workbench has one of its own."""


PLAIN = Traits()
NO_HINTS = Search()


def effect(
    name: str,
    *,
    unit: str,
    port: Port = "output",
    owner: Owner = "sensor",
    symbol: str,
    scale: float | SizePrior,
    source: str = "",
    shapes: Mapping[str, Shape] | None = None,
    needs: tuple[str, ...] = (),
    parts: tuple[str, ...] = ("",),
    traits: Traits = PLAIN,
    search: Search = NO_HINTS,
) -> Callable[[Callable[..., Array]], Callable[..., Array]]:
    """Enter a function of :class:`Signals` (and its shape parameters, by keyword) into the catalogue.

    Parameters
    ----------
    name : the effect's identifier, as on the command line.
    unit : unit of the coefficient.
    port : where the contribution adds: "output" (m/s²) or "position" (m), or how it acts on noise.
    owner : the part of the set-up that carries it: what moves with the sensor to another rig, and what stays.
    symbol : letter in formulas and tables.
    scale : typical size of the coefficient, in `unit`, or the whole prior of it.
    source : where that size comes from.
    shapes : nonlinear parameters by keyword of the function.
    needs : side channels it uses.
    parts : names of its columns when the function returns (n, m).
    traits : physical properties that later stages use.
    search : hints for the search of what a model lacks.

    Raises
    ------
    ValueError
        If another function has taken the name, or port, owner or a shape's keyword does not exist; if a mean is
        declared of what is not one constant coefficient, or a standard deviation that is not positive.

    Notes
    -----
    A function that is defined anew, as by a cell of a notebook that runs again, takes the place of its older self.

    Examples
    --------
    >>> @effect("my_fifth", unit="(m/s^2)^-4", symbol="K5", scale=1e-7)
    ... def my_fifth(s):
    ...     return s.a**5
    >>> find("my_fifth").unit
    '(m/s^2)^-4'
    """
    if port not in get_args(Port):
        raise AccelcalError(f"effect {name!r}: port {port!r} is none of {', '.join(get_args(Port))}")
    if owner not in get_args(Owner):
        raise AccelcalError(f"effect {name!r}: owner {owner!r} is none of {', '.join(get_args(Owner))}")
    prior = scale if isinstance(scale, SizePrior) else SizePrior(scale, source)
    if not prior.tails or not all(0.0 < multiple < math.inf for multiple in prior.tails):
        raise AccelcalError(f"effect {name!r}: tails = {prior.tails} of its size; expected positive multiples")
    if prior.mean and (len(parts) > 1 or port not in ("output", "position")):
        raise AccelcalError(f"effect {name!r}: only one constant coefficient can have a mean")
    if prior.mean and not (math.isfinite(prior.mean) and prior.scale > 0.0):
        raise AccelcalError(f"effect {name!r}: {prior} needs a finite mean and a positive standard deviation")
    declared = MappingProxyType(dict(shapes or {}))

    def enter(function: Callable[..., Array]) -> Callable[..., Array]:
        if name in CATALOGUE and not is_redefined(CATALOGUE[name], function):
            raise AccelcalError(f"effect {name!r} is already in the catalogue; choose another name")
        taken = inspect.signature(function).parameters
        for keyword in declared:
            if keyword not in taken and not any(
                parameter.kind is parameter.VAR_KEYWORD for parameter in taken.values()
            ):
                raise AccelcalError(f"effect {name!r} declares the shape {keyword!r} but its function does not take it")
        CATALOGUE[name] = Effect(
            name, unit, port, owner, symbol, prior, function, declared, needs, parts, traits, search
        )
        return function

    return enter


def is_redefined(entered: Effect, function: Callable[..., Array]) -> bool:
    """Whether a function is that of an effect, defined anew in its module; files of effects are loaded again whole."""
    before = inspect.unwrap(entered.function)
    return not entered.text and (before.__module__, before.__qualname__) == (function.__module__, function.__qualname__)


def family(
    variable: Variable,
    *,
    covers: tuple[str, ...] = (),
    groups: tuple[tuple[str, ...], ...] = (),
    coarse: int = 0,
    basis: str = "",
) -> Callable[[Callable[..., Array]], Callable[..., Array]]:
    """Make an effect, entered by the decorator :func:`effect` below this one, a nonparametric family.

    Parameters
    ----------
    variable : what its columns are functions of.
    covers : named effects that it generalises.
    groups : those of them that describe the same curvature.
    coarse : leading columns that are a coarser function by themselves.
    basis : functions that its columns are, each times a size that refined shape parameters alone set.

    Raises
    ------
    ValueError
        If the function is no effect yet, or `coarse` is not fewer columns than there are.
    """

    def enter(function: Callable[..., Array]) -> Callable[..., Array]:
        effect = next((e for e in CATALOGUE.values() if function in (e.function, inspect.unwrap(e.function))), None)
        if effect is None:
            raise AccelcalError(f"{function.__name__} is no effect yet; write @effect(...) below @family(...)")
        if not 0 <= coarse < effect.width:
            raise AccelcalError(
                f"effect {effect.name!r}: {coarse} of its {effect.width} columns cannot be a coarser function"
            )
        CATALOGUE[effect.name] = replace(effect, family=Family(variable, covers, groups, coarse, basis))
        return function

    return enter


def enter(table: Mapping[str, Mapping[str, Any]]) -> None:
    """Enter the effects of a table into the catalogue.

    Parameters
    ----------
    table : by name what :func:`effect` takes, the function, its card where it has none, and for a nonparametric family
        what :func:`family` takes, or what follows which driver.
    """
    for name, row in table.items():
        function = row["function"]
        function.__doc__ = row.get("card", function.__doc__)
        following = {key: row[key] for key in ("mechanism", "product") if key in row}
        apart = ("function", "card", "family", *following)
        effect(name, **{key: value for key, value in row.items() if key not in apart})(function)
        if "family" in row:
            family(**row["family"])(function)
        CATALOGUE[name] = replace(CATALOGUE[name], **following)


def card_line(function: Callable[..., Array], label: str) -> str:
    """Text behind `label:` in a function's docstring, up to the next label."""
    lines: list[str] = []
    for line in (inspect.getdoc(function) or "").splitlines():
        head, colon, rest = line.partition(":")
        if colon and head in CARD:
            if lines:
                break
            lines = [rest.strip()] if head == label else []
        elif lines:
            lines.append(line.strip())
    return " ".join(lines).strip()


ON_AXIS = re.compile(r"(?P<effect>[a-z]\w*?)_on_(?P<axis>[xyz])")
"""Name of an effect on one output of a sensor with several."""


def on_axis(effect: Effect, axis: str) -> Effect:
    """An effect of the sensor or its mounting on one output of three alone, entered into the catalogue at first call.

    Examples
    --------
    >>> on_axis(find("cubic"), "y").name
    'cubic_on_y'
    """
    name = f"{effect.name}_on_{axis}"
    if name not in CATALOGUE:
        CATALOGUE[name] = replace(effect, name=name, symbol=f"{effect.symbol}_{axis}", axis=axis, family=None)
    return CATALOGUE[name]


def find(name: str) -> Effect:
    """Return the effect called `name`.

    Raises
    ------
    ValueError
        If there is none; the text offers the nearest names.

    Examples
    --------
    >>> find("cubic")
    Effect(cubic: third-order nonlinearity (IEEE 1293 K3); (m/s²)⁻², sensor)
    """
    try:
        return CATALOGUE[name]
    except KeyError:
        near = difflib.get_close_matches(name, CATALOGUE, n=3)
        hint = f"; did you mean {' or '.join(near)}?" if near else "; accelcal effects lists them all"
        raise AccelcalError(f"there is no effect called {name!r}{hint}") from None
