"""Parameters of a sensor from its frequency response: gain, delay, a pole, a resonance or second-order low-pass.

Every structure is fitted by complex weighted least squares. The one with the smallest information criterion is chosen;
all whose criterion is as good within `SAME` are one class that the data do not separate.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import chain, product
from typing import ClassVar

import numpy as np
import scipy

from accelcal._support.result import Storable
from accelcal.data import Array, ChannelFilter, units
from accelcal.response.sine import COVERAGE, Point
from accelcal.signals.processing import Spectrum, response as gain_of

SAME = 6.0
"""Difference of the information criterion below which two structures are not separated: odds of 20 to 1."""
AT_BOUND = 1e-3
"""Distance of the logarithm of a corner or of Q from its bound below which it is at it."""
FAILS = 0.01
"""Probability, adjusted for the number of frequencies, below which a frequency deviates."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """One fitted number."""

    name: str
    unit: str
    value: float
    std: float
    """Standard uncertainty; widened where the structure does not fit."""
    expanded: float
    """k = 2"""


@dataclass(frozen=True, slots=True)
class Factor:
    """A factor of the response beside the gain."""

    parameters: tuple[tuple[str, str, bool], ...]
    """Name and unit of each parameter, and whether its logarithm is estimated."""
    response: Callable[[Spectrum, Array], Spectrum]
    """Factor (n,) at s = j w (n,), from the estimated parameters."""
    starts: Callable[[Array, float], list[tuple[float, ...]]]
    """First values to try, from corners in Hz and a delay in s."""
    bounds: Callable[[float, float], list[tuple[float, float]]]
    """Lowest and highest value of each, from those of the logarithm of a corner."""


def _second_order(s: Spectrum, theta: Array) -> Spectrum:
    w0, q = 2.0 * math.pi * math.exp(theta[0]), math.exp(theta[1])
    return np.asarray(w0**2 / (s * s + s * w0 / q + w0**2))


def _pole(s: Spectrum, theta: Array) -> Spectrum:
    w0 = 2.0 * math.pi * math.exp(theta[0])
    return np.asarray(w0 / (s + w0))


FACTORS = {
    "second_order": Factor(
        (("f0", "Hz", True), ("Q", "1", True)),
        _second_order,
        lambda corners, lag: [(math.log(c), math.log(q)) for c in corners for q in (0.5, 1.0, 5.0, 30.0)],
        lambda low, high: [(low, high), (math.log(0.05), math.log(1e4))],
    ),
    "pole": Factor(
        (("f_pole", "Hz", True),),
        _pole,
        lambda corners, lag: [(math.log(c),) for c in corners],
        lambda low, high: [(low, high)],
    ),
    "delay": Factor(
        (("delay", "s", False),),
        lambda s, theta: np.exp(-s * theta[0]),
        lambda corners, lag: [(lag,), (0.5 * lag,), (0.0,)],
        lambda low, high: [(-math.inf, math.inf)],
    ),
}
"""By name. Corners lie between the bounds that are given, Q between 0.05 and 1e4."""


@dataclass(frozen=True, slots=True)
class Structure:
    """A form of the response: gain times a pole or a second-order low-pass, times a delay."""

    name: str
    terms: tuple[str, ...]
    """Of `FACTORS`."""

    @property
    def factors(self) -> list[Factor]:
        """Factors beside the gain."""
        return [FACTORS[term] for term in self.terms]

    @property
    def size(self) -> int:
        """Number of parameters."""
        return 1 + sum(len(factor.parameters) for factor in self.factors)

    def contains(self, other: Structure) -> bool:
        """Whether another structure is a special case of this one; a pole is the limit of a second order of low Q."""
        terms = {*self.terms, *(("pole",) if "second_order" in self.terms else ())}
        return set(other.terms) <= terms

    def response(self, theta: Array, frequency: Array) -> Spectrum:
        """Gain (n,) at frequencies (n,) Hz. theta: gain, then log f0 and log Q, log f_pole, delay in s."""
        s = np.asarray(2j * math.pi * np.asarray(frequency, dtype=np.float64), dtype=np.complex128)
        total, rest = np.full(s.shape, theta[0], dtype=np.complex128), theta[1:]
        for factor in self.factors:
            total *= factor.response(s, rest)
            rest = rest[len(factor.parameters) :]
        return total

    def starts(self, f: Array, value: Spectrum) -> list[Array]:
        """First values to try for a sensitivity (n,) at frequencies (n,) Hz: corners over the range and beyond it, with
        several sharpnesses."""
        low = float(np.real(value[np.argmin(f)]) or 1.0)
        gain = math.copysign(abs(value[np.argmin(f)]), low)
        lag = _delay(f, value * math.copysign(1.0, gain))
        corners = np.geomspace(0.5 * np.max(f) / 2.0, 30.0 * np.max(f), 7)
        several = product(*(factor.starts(corners, lag) for factor in self.factors))
        return [np.array([gain, *chain.from_iterable(values)]) for values in several]

    def parameters(self, theta: Array, covariance: Array, factors: Array) -> tuple[Parameter, ...]:
        """Names, units and uncertainties, expanded by factors (m,); logarithms are undone."""
        std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        parameters = [Parameter("k", "1", float(theta[0]), float(std[0]), float(factors[0] * std[0]))]
        kinds = (kind for factor in self.factors for kind in factor.parameters)
        for i, (name, unit, logarithm) in enumerate(kinds, start=1):
            value = math.exp(min(theta[i], 300.0)) if logarithm else float(theta[i])
            spread = float(std[i]) * (value if logarithm else 1.0)
            parameters.append(Parameter(name, unit, value, spread, float(factors[i]) * spread))
        return tuple(parameters)


STRUCTURES = (
    Structure("gain", ()),
    Structure("gain and delay", ("delay",)),
    Structure("one pole", ("pole",)),
    Structure("one pole and delay", ("pole", "delay")),
    Structure("second order", ("second_order",)),
    Structure("second order and delay", ("second_order", "delay")),
    Structure("second order and pole", ("second_order", "pole")),
)
"""All that are tried."""


@dataclass(frozen=True, slots=True)
class Fitted:
    """One structure at its best parameters."""

    structure: Structure
    parameters: tuple[Parameter, ...]
    theta: Array
    criterion: float
    """Bayesian information criterion; smaller is better."""
    chi_square: float
    degrees: int
    p_value: float
    """Probability of so large a chi-square if the structure is right."""
    deviations: Array
    """(n,) |measured - fitted| in standard uncertainties of its two parts, sqrt(chi-square of two degrees)."""

    behind: tuple[ChannelFilter, ...] = ()
    """Declared filters that are in the sensitivity and in no structure: factors that are known."""
    rate: float = 1.0
    """Hz, at which such that are digital run."""

    def response(self, frequency: Array) -> Spectrum:
        """Fitted sensitivity (n,) at frequencies (n,) Hz."""
        return self.structure.response(self.theta, frequency) * gain_of(self.behind, self.rate)(frequency)

    @property
    def filters(self) -> tuple[ChannelFilter, ...]:
        """Low-passes of the structure as they are declared, to four digits, and those that were declared before."""
        values = {p.name: float(f"{p.value:.4g}") for p in self.parameters}
        low: tuple[ChannelFilter, ...] = ()
        if "f0" in values:
            low = (ChannelFilter("resonance", cutoff=values["f0"], quality=values["Q"]),)
        if "f_pole" in values:
            low += (ChannelFilter("RC", cutoff=values["f_pole"]),)
        return (*low, *self.behind)

    def __getitem__(self, name: str) -> Parameter:
        return next(p for p in self.parameters if p.name == name)


@dataclass(frozen=True, slots=True)
class ResponseModel(Storable):
    """The chosen structure, those that the data do not separate from it, and where it fails."""

    derived: ClassVar[tuple[str, ...]] = ("sentences",)

    best: Fitted
    rivals: tuple[Fitted, ...]
    """As good within `SAME`."""
    failing: tuple[float, ...]
    """Frequencies at which the structure deviates, Hz."""

    @property
    def sentences(self) -> tuple[str, ...]:
        """For people."""
        best = self.best
        behind = f" behind the declared {', '.join(item.name for item in best.behind)}" if best.behind else ""
        sentences = [
            f"{best.structure.name}{behind}: {_values(best)} (± U, k = 2); chi-square {best.chi_square:.4g} on "
            f"{best.degrees} degrees of freedom (p = {best.p_value:.2g})"
        ]
        if self.rivals:
            others = "; ".join(f"{r.structure.name} ({_values(r)})" for r in self.rivals)
            sentences.append(f"not separated at these frequencies from: {others}. {self.further}")
        return (*sentences, *([self.failure] if self.failure else []))

    @property
    def failure(self) -> str:
        """Where the structure fails, for people; empty where it does not."""
        if self.failing:
            places = ", ".join(f"{f:.4g} Hz" for f in self.failing[:6])
            more = f" and {len(self.failing) - 6} more" if len(self.failing) > 6 else ""
            return f"it fails at {places}{more}: the response there is not of this form"
        return "it fails over all frequencies together, at none of them alone" if self.fails_together else ""

    @property
    def fails_together(self) -> bool:
        """Whether the structure deviates over all frequencies together, at none of them alone."""
        return not self.failing and self.best.p_value < FAILS

    @property
    def further(self) -> str:
        """How structures that are not separated differ, for people; empty where there is one alone."""
        if not self.rivals:
            return ""
        terms = {t for f in (self.best, *self.rivals) for t in f.structure.terms}
        what = "a delay and a low-pass are one class here; " if "delay" in terms and len(terms) > 1 else ""
        return f"{what}they differ in magnitude at higher frequencies".capitalize()


def _values(fitted: Fitted) -> str:
    """Parameters with their expanded uncertainties."""
    return ", ".join(
        f"{'1 + ' * (p.name == 'k')}{p.name} = {units.in_usual_size(p.value, p.expanded, p.unit)}"
        for p in fitted.parameters
    )


def fit_response(
    points: Sequence[Point], behind: Sequence[ChannelFilter] = (), rate: float = 1.0
) -> ResponseModel | None:
    """Fit every structure that has fewer parameters than the points have numbers; None with fewer than two points.

    Parameters
    ----------
    points : the sensitivity by frequency.
    behind, rate : declared filters of the output that no structure has, and the rate of the output, Hz.
    """
    if len(points) < 2:
        return None
    able = [structure for structure in STRUCTURES if structure.size < 2 * len(points) - 1]
    candidates = [_fit(structure, points, tuple(behind), rate) for structure in able]
    fitted = [candidate for candidate in candidates if candidate is not None]
    if not fitted:
        return None
    best = min(fitted, key=lambda rival: rival.criterion)
    rivals = [f for f in fitted if f is not best and f.criterion < best.criterion + SAME and _own(f, best, fitted)]
    limit = math.sqrt(float(scipy.special.chdtri(2, FAILS / len(points))))
    failing = tuple(p.frequency for p, d in zip(points, best.deviations, strict=True) if d > limit)
    return ResponseModel(best, tuple(sorted(rivals, key=lambda rival: rival.criterion)), failing)


def _own(rival: Fitted, best: Fitted, fitted: Sequence[Fitted]) -> bool:
    """Whether a rival explains in another way: not a structure as good with a term, or an order, more."""
    as_good = [f.structure for f in fitted if f is not rival and f.criterion <= best.criterion + SAME]
    return not any(rival.structure.contains(s) for s in as_good)


def _fit(
    structure: Structure, points: Sequence[Point], behind: tuple[ChannelFilter, ...], rate: float
) -> Fitted | None:
    f = np.array([p.frequency for p in points])
    through = gain_of(behind, rate)(f)
    value = np.array([p.value for p in points]) / through
    # the expectation of chi-square is that of known variances
    std = np.array([p.std * math.sqrt(p.degrees / max(p.degrees - 2.0, 1.0)) for p in points])
    std = np.maximum(std / np.abs(through), 1e-12 * np.abs(value))

    def residual(theta: Array) -> Array:
        with np.errstate(all="ignore"):
            apart = (structure.response(theta, f) - value) / std
        both = np.concatenate([apart.real, apart.imag])
        return np.asarray(np.nan_to_num(both, nan=1e12, posinf=1e12, neginf=-1e12))

    starts = sorted(structure.starts(f, value), key=lambda theta: float(np.sum(residual(theta) ** 2)))
    low, high = _bounds(structure, f)
    trials = [
        scipy.optimize.least_squares(
            residual, np.clip(start, low, high), x_scale="jac", bounds=(low, high), max_nfev=200
        )
        for start in starts[:4]
    ]
    best = min(trials, key=lambda trial: float(trial.cost))
    chi_square, degrees = 2.0 * float(best.cost), 2 * len(points) - structure.size
    if np.min([best.x - low, high - best.x]) < AT_BOUND:  # it is another structure
        return None
    if np.linalg.matrix_rank(best.jac / (np.linalg.norm(best.jac, axis=0) + 1e-300)) < structure.size:
        return None
    widened = max(1.0, chi_square / degrees)
    covariance = np.linalg.inv(best.jac.T @ best.jac) * widened
    of_noise = np.diag(covariance).copy()
    covariance[0, 0] += (max(p.reference_std for p in points) * best.x[0]) ** 2  # an error that all points share
    share = of_noise / np.maximum(np.diag(covariance), 1e-300)
    free = degrees if widened > 2.0 else sum(p.degrees for p in points)  # of the fit where that widened it
    effective = free / np.maximum(share, 1e-12) ** 2  # Welch and Satterthwaite
    factors = scipy.special.stdtrit(effective, 0.5 + 0.5 * COVERAGE)
    half = len(points)
    return Fitted(
        structure,
        structure.parameters(best.x, covariance, factors),
        best.x,
        chi_square + structure.size * math.log(2 * len(points)),
        chi_square,
        degrees,
        float(scipy.special.chdtrc(degrees, chi_square)),
        np.hypot(best.fun[:half], best.fun[half:]),
        behind,
        rate,
    )


def _bounds(structure: Structure, f: Array) -> tuple[Array, Array]:
    """Corners lie within a factor of 1000 of the frequencies, the gain anywhere."""
    corner = math.log(1e-3 * float(np.min(f))), math.log(1e3 * float(np.max(f)))
    pairs = [(-math.inf, math.inf), *chain.from_iterable(factor.bounds(*corner) for factor in structure.factors)]
    return np.array([low for low, _ in pairs]), np.array([high for _, high in pairs])


def _delay(f: Array, value: Spectrum) -> float:
    """Delay from the slope of the unwrapped phase, s."""
    order = np.argsort(f)
    phase = np.unwrap(np.angle(value[order]))
    w = 2.0 * math.pi * f[order]
    return float(-(w @ phase) / (w @ w))
