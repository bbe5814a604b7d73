"""A model: which effects the output is made of, and which of their coefficients are free."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, Literal

import numpy as np

from accelcal._support.arguments import check_fields, checked
from accelcal._support.errors import AccelcalError
from accelcal._support.result import Result
from accelcal._support.values import immutable, listing, short_repr
from accelcal.data import Array
from accelcal.effects import CATALOGUE, Effect, find, polynomial
from accelcal.effects.mechanisms import channel_of
from accelcal.effects.registry import Owner, Port
from accelcal.signals.signals import Signals

BASE = ("bias", "scale_factor", "time_offset")
"""The three parameters of every model."""

NOMINAL = (*BASE, "lowpass_error", "clock_skew")
"""Coefficients at which the output itself is taken; all others add to it."""


@immutable
@dataclass(frozen=True, slots=True)
class Prior:
    """Normal distribution of a coefficient before the fit.

    Examples
    --------
    >>> Model.linear().add("cubic", priors={"cubic": Prior(0.0, 1e-3)}).priors["cubic"]
    Prior(mean=0.0, std=0.001)
    """

    mean: float
    std: float

    def __post_init__(self) -> None:
        check_fields(self, signed=("mean",))


@dataclass(frozen=True, slots=True)
class OwnEffect:
    """An effect of the user, with the file that it comes from."""

    name: str
    digest: str
    """SHA-256 of that file, hex."""
    source: str


@dataclass(frozen=True, slots=True)
class SideChannel:
    """An effect that is a recorded channel."""

    channel: str
    unit: str
    """Of the coefficient."""
    of: Literal["output", "scale_factor"]


@dataclass(frozen=True, slots=True)
class Term:
    """One coefficient of a model: an effect, or one of its columns, at given shape parameters."""

    effect: Effect
    part: int = 0
    shape: Mapping[str, float] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The effect's name, with the column's where it has several: rail_wave.sin."""
        return (
            self.effect.name
            if self.effect.width == 1
            else f"{self.effect.name}.{self.effect.parts_at(self.shape)[self.part]}"
        )

    @property
    def symbol(self) -> str:
        """Letter in tables."""
        return (
            self.effect.symbol
            if self.effect.width == 1
            else f"{self.effect.symbol}_{self.effect.parts_at(self.shape)[self.part]}"
        )

    @property
    def unit(self) -> str:
        """Unit of the coefficient."""
        return self.effect.unit

    @property
    def owner(self) -> Owner:
        """Part of the set-up that carries it."""
        return self.effect.owner

    @property
    def port(self) -> Port:
        """Where it adds; a random process adds to the output."""
        return "output" if self.effect.port == "process" else self.effect.port

    def column(self, s: Signals) -> Array:
        """Contribution per unit coefficient, (n,)."""
        y = self.effect.column(s, **self.shape)
        return y if self.effect.width == 1 else np.ascontiguousarray(y[:, self.part])


def terms_of(effect: Effect, shape: Mapping[str, float] | None = None) -> tuple[Term, ...]:
    """Every coefficient of an effect at given shape parameters."""
    shape = shape or {}
    return tuple(Term(effect, part, shape) for part in range(len(effect.parts_at(shape))))


def evaluate(terms: Sequence[Term], s: Signals) -> Iterator[Array]:
    """Columns of several terms in turn, (n,) each; an effect with several columns is evaluated once."""
    last: tuple[Effect, Mapping[str, float]] | None = None
    columns = np.empty(0)
    for term in terms:
        if term.effect.width == 1:
            yield term.column(s)
            continue
        if last is None or last[0] is not term.effect or last[1] is not term.shape:
            columns, last = term.effect.column(s, **term.shape), (term.effect, term.shape)
        yield columns[:, term.part]


def plain_name(name: str, plain: Mapping[str, str]) -> str:
    """Name of an effect, a coefficient or a shape parameter, the effect called as `plain` says."""
    effect, dot, part = name.partition(".")
    return f"{plain.get(effect, effect)}{dot}{part}"


@immutable
@short_repr
@dataclass(frozen=True, slots=True)
class Model(Result):
    """Base and effects in forward sense: output(t + t0) = (1 + k) a + K0 + sum c_j e_j.

    Every coefficient is free unless `fixed` gives its value; `priors` holds priors of free ones. Both go by the name of
    the coefficient, which is the effect's where it has one column. Shape parameters are estimated from the values in
    `shapes`, unless `fixed` holds them under the name of effect and parameter (creep.tau).

    Examples
    --------
    >>> Model.linear().add("cubic").freeze(bias=0.05)
    Model(effects=('bias', 'scale_factor', 'time_offset', 'cubic'), fixed={'bias': 0.05})
    """

    derived: ClassVar[tuple[str, ...]] = ("own", "side_channels")

    effects: tuple[str, ...] = BASE
    """Names in the order in which they were added; the base comes first."""
    fixed: Mapping[str, float] = field(default_factory=dict)
    priors: Mapping[str, Prior] = field(default_factory=dict)
    shapes: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Shape parameters by effect."""
    per_run: tuple[str, ...] = ()
    """Coefficients that differ from run to run: one value for each run of a joint fit, drawn about a common mean."""

    def __post_init__(self) -> None:
        check_fields(self)
        if self.effects[: len(BASE)] != BASE:
            raise AccelcalError(f"a model begins with {', '.join(BASE)}; found {', '.join(self.effects)}")
        if len(set(self.effects)) != len(self.effects):
            raise AccelcalError(f"an effect can enter a model once; found {', '.join(self.effects)}")
        for name in self.effects:
            usual = {shape: declared.usual for shape, declared in find(name).shapes.items()}
            given = {shape: value for shape, value in usual.items() if value is not None} | dict(
                self.shapes.get(name, {})
            )
            if given != self.shapes.get(name, {}):
                object.__setattr__(self, "shapes", {**self.shapes, name: given})
            missing = set(usual) - set(given)
            if missing:
                raise AccelcalError(f"{name} needs a value of {', '.join(sorted(missing))}")
        names = {term.name for term in self.terms}
        curved = {f"{name}.{shape}" for name in self.effects for shape in find(name).shapes}
        for name in (*self.fixed, *self.priors):
            if name in self.effects and find(name).port == "noise":
                raise AccelcalError(f"{name!r} acts on noise: it has no value to hold and no prior")
            if name not in names and not (name in curved and name in self.fixed):
                near = difflib.get_close_matches(name, names, n=1)
                hint = f"did you mean {near[0]!r}?" if near else "add the effect first"
                raise AccelcalError(f"{name!r} is fixed or has a prior but is not in the model; {hint}")
        for name in self.per_run:
            if name not in names:
                raise AccelcalError(f"{name!r} cannot differ from run to run: it is no coefficient of the model")
            if name in self.priors:
                raise AccelcalError(
                    f"{name!r} has a prior, which is on one value for all runs: it cannot differ between them"
                )

    @classmethod
    def linear(cls) -> Model:
        """Bias, scale factor and time offset (paper, eq. 3)."""
        return cls()

    @classmethod
    def cubic(cls) -> Model:
        """The linear model with K2 and K3 (paper, eq. 4)."""
        return cls((*BASE, *polynomial(3)))

    @checked
    def add(
        self,
        *names: str,
        shapes: Mapping[str, Mapping[str, float]] | None = None,
        priors: Mapping[str, Prior] | None = None,
    ) -> Model:
        """Return the model with further effects, all free, with the priors that physics gives their coefficients.

        Parameters
        ----------
        names : effects to add.
        shapes : shape parameters of those that have some, by effect.
        priors : other priors of coefficients, by name.
        """
        effects = [find(name) for name in names]  # a pattern may have a name of its own
        physics = {e.name: Prior(e.prior.mean, e.prior.scale) for e in effects if e.prior.mean}
        return replace(
            self,
            effects=(*self.effects, *(effect.name for effect in effects)),
            shapes={**self.shapes, **{find(name).name: shape for name, shape in (shapes or {}).items()}},
            priors={**self.priors, **physics, **(priors or {})},
        )

    @checked
    def drop(self, *names: str) -> Model:
        """Return the model without some of its effects.

        Raises
        ------
        ValueError
            If one of them is not in the model or belongs to the base.
        """
        for name in names:
            if name not in self.effects or name in BASE:
                raise AccelcalError(
                    f"{name!r} is not an added effect of this model; it has {', '.join(self.added) or 'none'}"
                )
        dropped = {term.name for term in self.terms if term.effect.name in names}
        dropped |= {f"{name}.{shape}" for name in names for shape in find(name).shapes}
        return replace(
            self,
            effects=tuple(n for n in self.effects if n not in names),
            fixed={n: c for n, c in self.fixed.items() if n not in dropped},
            priors={n: b for n, b in self.priors.items() if n not in dropped},
            shapes={n: s for n, s in self.shapes.items() if n not in names},
            per_run=tuple(n for n in self.per_run if n not in dropped),
        )

    @checked
    def vary(self, *names: str) -> Model:
        """Return the model with some coefficients that differ from run to run."""
        return replace(self, per_run=(*self.per_run, *(n for n in names if n not in self.per_run)))

    @checked
    def alike(self, *names: str) -> Model:
        """Return the model with one value for all runs of some coefficients."""
        return replace(self, per_run=tuple(n for n in self.per_run if n not in names))

    @checked
    def with_priors(self, priors: Mapping[str, Prior]) -> Model:
        """Return the model with normal priors of those of its free coefficients that are among `priors`.

        Examples
        --------
        >>> Model.linear().with_priors({"bias": Prior(0.05, 1e-3), "cubic": Prior(0.0, 1e-3)}).priors
        {'bias': Prior(mean=0.05, std=0.001)}
        """
        free = {term.name for term in self.free}
        return replace(self, priors={**self.priors, **{n: prior for n, prior in priors.items() if n in free}})

    @checked
    def freeze(self, **values: float) -> Model:
        """Return the model with some coefficients or shape parameters (creep.tau) held at given values (SI)."""
        shapes = {name: dict(shape) for name, shape in self.shapes.items()}
        for name, value in values.items():
            effect, _, shape = name.partition(".")
            if shape in shapes.get(effect, {}):
                shapes[effect][shape] = value
        return replace(self, fixed={**self.fixed, **values}, shapes=shapes)

    @checked
    def reshaped(self, **values: float) -> Model:
        """Return the model with other values of some shape parameters, by names such as creep.tau."""
        return replace(self.freeze(**values), fixed=self.fixed)

    @checked
    def release(self, *names: str) -> Model:
        """Return the model with some held coefficients free again.

        Raises
        ------
        ValueError
            If one of them is not held.
        """
        for name in names:
            if name not in self.fixed:
                raise AccelcalError(f"{name!r} is not held; held are {', '.join(self.fixed) or 'none'}")
        return replace(self, fixed={n: c for n, c in self.fixed.items() if n not in names})

    def of_axis(self, axis: str) -> Model:
        """Return the model of one output of a sensor with several: effects on that axis alone have plain names."""
        elsewhere = [name for name in self.effects if find(name).axis not in ("", axis)]
        model, plain = self.drop(*elsewhere) if elsewhere else self, self.plain_names(axis)

        def renamed(name: str) -> str:
            return plain_name(name, plain)

        return Model(
            effects=tuple(map(renamed, model.effects)),
            fixed={renamed(name): value for name, value in model.fixed.items()},
            priors={renamed(name): prior for name, prior in model.priors.items()},
            shapes={renamed(name): shape for name, shape in model.shapes.items()},
            per_run=tuple(map(renamed, model.per_run)),
        )

    def plain_names(self, axis: str) -> Mapping[str, str]:
        """Names, on that axis, of effects on it alone, by what they are called here; not of those it has twice."""
        stems = {name: name.removesuffix(f"_on_{axis}") for name in self.effects if axis and find(name).axis == axis}
        return {name: stem for name, stem in stems.items() if stem not in self.effects}

    @property
    def own(self) -> tuple[OwnEffect, ...]:
        """Effects of the user."""
        several = self._with_carriers
        return tuple(OwnEffect(effect.name, effect.digest, effect.text) for effect in several if effect.text)

    @property
    def _with_carriers(self) -> tuple[Effect, ...]:
        """Its effects, and those whose coefficients its mechanisms change, each once."""
        effects = tuple(map(find, self.effects))
        carriers = (find(effect.mechanism.carrier) for effect in effects if effect.mechanism)
        return tuple({effect.name: effect for effect in (*effects, *carriers)}.values())

    @property
    def side_channels(self) -> Mapping[str, SideChannel]:
        """Effects that are recorded channels, by name; those of a channel that a mechanism follows are among them."""
        effects = self._with_carriers
        remembered = {channel_of(effect) for effect in effects if effect.mechanism} - {""}
        several = (*effects, *(effect for effect in CATALOGUE.values() if channel_of(effect) in remembered))
        of: dict[str, Literal["output", "scale_factor"]] = {"bias": "output", "scale_factor": "scale_factor"}
        return {
            e.name: SideChannel(channel_of(e), e.unit, of[e.product.carrier])
            for e in several
            if e.product is not None and channel_of(e)
        }

    @property
    def added(self) -> tuple[str, ...]:
        """Effects beyond the base."""
        return self.effects[len(BASE) :]

    @property
    def terms(self) -> tuple[Term, ...]:
        """Every coefficient of the mean, free or fixed."""
        added = ((find(name), self.shapes.get(name, {})) for name in self.effects)
        return tuple(term for effect, shape in added if effect.port != "noise" for term in terms_of(effect, shape))

    @property
    def noise_effects(self) -> tuple[Effect, ...]:
        """Effects that act on the noise alone; they have no coefficient in the mean."""
        return tuple(effect for effect in map(find, self.effects) if effect.port == "noise")

    @property
    def free(self) -> tuple[Term, ...]:
        """The coefficients that a fit estimates."""
        return tuple(term for term in self.terms if term.name not in self.fixed)


@immutable
@dataclass(frozen=True, slots=True)
class Estimate(Result):
    """One parameter with its standard uncertainty.

    Examples
    --------
    >>> Estimate("bias", "K0", "m/s²", 0.05, 1e-4, "sensor")
    Estimate(bias 0.05 ± 0.0001 m/s²)
    """

    counterparts: ClassVar[Mapping[str, str]] = {
        **dict.fromkeys(("stderr", "bse", "error", "std_dev", "uncertainty"), "estimate.std"),
        **dict.fromkeys(("nominal_value", "estimate", "mean"), "estimate.value"),
        **dict.fromkeys(("low", "high", "min", "max"), 'fit.to_dataframe()[["low", "high"]]'),
    }

    name: str
    symbol: str
    unit: str
    value: float
    std: float
    """0 when the parameter was held fixed."""
    owner: Owner
    run: int | None = None
    """Number of the run that it belongs to in a joint fit; None when all runs share it."""
    axis: str = ""
    """Axis of the sensor that it belongs to; empty when all of its outputs share it."""

    def __repr__(self) -> str:
        spread = f" ± {self.std:.2g}" if self.std > 0.0 else " (held)"
        run = (f", {self.axis} axis" if self.axis else "") + ("" if self.run is None else f", run {self.run}")
        return f"Estimate({self.name} {self.value:.5g}{spread} {self.unit}".removesuffix(" 1") + f"{run})"


__dir__ = listing(globals())
