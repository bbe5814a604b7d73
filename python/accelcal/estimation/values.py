"""Noise intensities and coefficients at which a run is filtered."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from accelcal.data import Array
from accelcal.effects import HARMONICS, Effect
from accelcal.model import NOMINAL, Term, evaluate
from accelcal.signals.signals import Signals


@dataclass(frozen=True, slots=True)
class NoiseGrowth:
    """What an effect that acts on noise adds to both noises, per unit of its variance function."""

    effect: Effect
    q: float = 0.0
    """Two-sided density of the noise on acceleration, (m/s²)²/Hz per unit."""
    r: float = 0.0
    """Variance of one encoder reading, m² per unit."""
    mean: float = 0.0
    """Mean of the variance function over the record, in its unit."""


@dataclass(frozen=True, slots=True)
class Noise:
    """Intensity of the two noises, and what effects of the model add to them along the record."""

    q: float
    """Two-sided density of the noise on acceleration, (m/s²)²/Hz."""
    r: float
    """Variance of one encoder reading, m²."""
    growth: tuple[NoiseGrowth, ...] = ()
    """Of each effect of the model that acts on noise; none where the noise is the same all along."""

    @property
    def usual(self) -> Noise:
        """Mean noise of the record: what spectra and bandwidths that know no time are taken from."""
        if not self.growth:
            return self
        grown = [(part.q * part.mean, part.r * part.mean) for part in self.growth]
        return Noise(self.q + sum(q for q, _ in grown), self.r + sum(r for _, r in grown))

    def scaled(self, q: float, r: float = 1.0) -> Noise:
        """The same with the process noise and the reading noise multiplied by factors, their growth too."""
        growth = tuple(replace(part, q=q * part.q, r=r * part.r) for part in self.growth)
        return Noise(q * self.q, r * self.r, growth)


@dataclass(frozen=True, slots=True)
class Values:
    """Coefficients of a model in forward sense, SI, by name."""

    by_name: Mapping[str, float]
    terms: tuple[Term, ...] = ()
    nuisances: tuple[tuple[Term, float], ...] = ()
    """Terms of one run beyond the model, and their coefficients, which no fit reports."""

    @property
    def scale(self) -> float:
        """1 + k."""
        return 1.0 + self.by_name.get("scale_factor", 0.0)

    @property
    def time_offset(self) -> float:
        """s"""
        return self.by_name.get("time_offset", 0.0)

    @property
    def clock_skew(self) -> float:
        """What the delay of the output grows by per second."""
        return self.by_name.get("clock_skew", 0.0)

    def stamps(self, t: Array, origin: float) -> Array:
        """Stamps of the output that belong to instants `t`, s: late by the time offset, which grows from `origin` on.

        An offset that has grown to a radian of the motion is no column of its jerk any more, so that clocks are read
        exactly and the columns carry corrections alone (derivations 7.1).
        """
        late = t + self.time_offset
        return late + self.clock_skew * (t - origin) if self.clock_skew else late

    def instants(self, stamps: Array, origin: float) -> Array:
        """Instants that belong to stamps of the output, s; the inverse of `stamps`."""
        t = stamps - self.time_offset
        return t - self.clock_skew / (1.0 + self.clock_skew) * (t - origin) if self.clock_skew else t

    @property
    def bias(self) -> float:
        """m/s²"""
        return self.by_name.get("bias", 0.0)

    @property
    def lowpass_error(self) -> float:
        """Excess of the time constant of the low-pass over the declared one, s."""
        return self.by_name.get("lowpass_error", 0.0)

    def additive(self, port: str) -> Iterator[tuple[Term, float]]:
        """Terms beyond the nominal that add to the output, or to the reading, with coefficients other than zero."""
        for term, coefficient in (*((term, self.by_name[term.name]) for term in self.terms), *self.nuisances):
            if term.name not in NOMINAL and term.port == port and coefficient != 0.0:
                yield term, coefficient

    def total(self, port: str, s: Signals) -> Array | None:
        """Sum of the additive contributions at the times of `s`, (n,); None when there is none."""
        pairs = list(self.additive(port))
        if not pairs:
            return None
        total = np.zeros(len(s.t))
        for (_, c), column in zip(pairs, evaluate([term for term, _ in pairs], s), strict=True):
            total += c * column
        return total

    def fastest(self, speed: float = 0.0) -> float:
        """Highest frequency of a line among the terms, and of a wave over position at a speed (m/s), Hz; 0 without
        any."""
        waves = (
            (shape.unit, shape.multiple(term.shape[name], int(term.shape.get(HARMONICS, 1.0))))
            for term in self.terms
            for name, shape in term.effect.shapes.items()
            if shape.width and name in term.shape
        )
        return max((value if unit == "Hz" else speed / value for unit, value in waves), default=0.0)

    @property
    def constant(self) -> bool:
        """Whether the base alone acts on the output."""
        return next(self.additive("output"), None) is None and next(self.additive("position"), None) is None
