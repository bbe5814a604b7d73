"""A triad of accelerometers from positions of unknown attitude, in which the norm of gravity alone is known.

a = T K (y - b), T upper triangular with unit diagonal, K diagonal: nine parameters, by least squares of |a| - g over
the positions, each with the same weight (Tedaldi, Pretto, Menegatti, ICRA 2014). Terms of second and third order are
tested one by one; those that the norm cannot tell apart form one class. Six to nine positions, each axis up and down
among them, give scale and zero of each axis, T = 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import ClassVar

import numpy as np
import scipy

from accelcal._support.result import Storable
from accelcal.data import Array, Positions, RecordingError, root_mean_square
from accelcal.estimation.gauss_newton import NotIdentifiable
from accelcal.estimation.noise import REMARKED_BEYOND
from accelcal.estimation.plausible import plausible
from accelcal.estimation.run_to_run import REMARK_ALPHA, over_all

AXES = "xyz"
SPHERE = np.array([1.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0])
"""Parameters of equal, perpendicular axes."""
PARAMETERS = 9
UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
"""Free elements of T K."""
SIX = np.array([0, 3, 5, 6, 7, 8])
"""Places of scale and zero of each axis among the nine."""
ON_FACE = 0.7
"""Share of the largest output from which an axis points up or down."""
LEFT = 1e-6
"""Share of a column's power beyond the model, and the angle zeros of dwells, below which a record at rest does not show
it."""
LEAST_KNOWN = 0.1
"""Relative standard deviation of a scale beyond which it is not determined."""
WORST_CONDITION = 1e8
"""Condition number of the scaled problem beyond which the positions do not determine it."""
WORST_OF_FACES = 20.0
"""The same of six parameters: tilts and angles between the axes, which they lack, are enlarged as much."""


@dataclass(frozen=True, slots=True)
class NormTerm:
    """One product of accelerations, tested beside the nine parameters."""

    members: tuple[str, ...]
    """Terms of single axes that are this product in the norm."""
    t: float
    """Estimate over its standard deviation; 0 where the norm does not show it."""
    p_value: float
    """Of all that were tested together."""


@dataclass(frozen=True, slots=True, eq=False)
class TriadFit(Storable):
    """Nine parameters of a triad, or six."""

    derived: ClassVar[tuple[str, ...]] = ("values", "rms", "verdict", "sentence", "remarks")

    T: Array
    """Upper triangular, unit diagonal: angles between the axes, rad."""
    K: Array
    """Scale of each axis, m/s² per unit of the output, (3,)."""
    b: Array
    """Output of each axis without acceleration, (3,)."""
    std: tuple[tuple[str, float], ...]
    """Standard deviation of each parameter, from the scatter of the positions."""
    residual: Array
    """|a| - g, (n,) m/s²."""
    ratio: float
    """Scatter between positions over what noise within them explains."""
    terms: tuple[NormTerm, ...]
    name: str
    unit: str
    gravity: float

    @property
    def rms(self) -> float:
        """Root mean square of the residual, m/s²."""
        return root_mean_square(self.residual)

    @property
    def values(self) -> dict[str, float]:
        """Parameters by name, those that were estimated."""
        angles = {f"T_{AXES[i]}{AXES[j]}": float(self.T[i, j]) for i, j in UPPER if i != j}
        scales = {f"K_{axis}": float(k) for axis, k in zip(AXES, self.K, strict=True)}
        zeros = {f"b_{axis}": float(y) for axis, y in zip(AXES, self.b, strict=True)}
        return {name: y for name, y in {**scales, **angles, **zeros}.items() if name in dict(self.std)}

    @property
    def missing(self) -> NormTerm | None:
        """The most significant term beyond the nine parameters; None where none is."""
        largest = min(self.terms, key=lambda term: term.p_value, default=None)
        return largest if largest is not None and largest.p_value < REMARK_ALPHA else None

    @property
    def verdict(self) -> str:
        """Verdict on what the parameters lack; "untested" of six."""
        if not self.terms:
            return "untested"
        return "adequate" if self.missing is None else "tied"

    @property
    def sentence(self) -> str:
        """For people."""
        if not self.terms:
            return (
                f"Scale and zero of each axis, six parameters; {len(self.residual)} positions test nothing beyond. Ten "
                "or more, some of them in between, give the angles between the axes as well."
            )
        shown = [term for term in self.terms if term.t != 0.0]
        largest = max((abs(term.t) for term in shown), default=0.0)
        if self.missing is None:
            return (
                f"Nothing is missing ({len(shown)} products of second and third order examined, the largest at "
                f"{largest:.1f} sigma)."
            )
        return (
            f"{' or '.join(self.missing.members)} is missing ({abs(self.missing.t):.1f} sigma, p = "
            f"{self.missing.p_value:.2g}, {len(shown)} products examined); the norm of gravity does not tell them "
            "apart: use known attitudes."
        )

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences to be read with the numbers."""
        sentences = [
            f"K_{axis} = {k:.4g} is implausible for a working sensor, whose output over acceleration is 0.7 to 1.4: "
            f"check the unit of accel_{axis}, gravity in [dwell], and that it was at rest on every face"
            for axis, k in zip(AXES, self.K, strict=True)
            if self.unit == "m/s^2" and not plausible(1.0 / float(k))
        ]
        if self.ratio > REMARKED_BEYOND:
            sentences.append(
                f"the positions scatter by {self.rms:.2g} m/s², {float(f'{self.ratio:.2g}'):g} times what noise within "
                "them explains (instability of the bias, temperature, a hand that shakes); the uncertainties are those "
                "of this scatter"
            )
        if not self.terms:
            leaves = "" if len(self.residual) > len(SIX) else "six positions leave no scatter to judge by: "
            return (
                *sentences,
                f"{leaves}the uncertainties are those of noise within the positions. A tilt of the faces alone shifts "
                "nothing; axes that are perpendicular to 1 degree shift scale and zero by up to 0.03 % of g beside "
                "them, 0.08 % with faces that tilt by 1 degree, 0.17 % by 3 degrees",
            )
        classes = [" = ".join(term.members) for term in self.terms if len(term.members) > 1 and term.t != 0.0]
        sentences.append(
            f"the norm of gravity does not tell apart: {'; '.join(classes[:4])}, and {len(classes) - 4} more"
        )
        return tuple(sentences)

    def apply(self, y: Array) -> Array:
        """Accelerations of outputs (n, 3), m/s²."""
        return np.asarray((y - self.b) @ (self.T * self.K).T)


def fit_triad(positions: Positions) -> TriadFit:
    """Nine parameters by least squares; of six to nine positions six, scale and zero of each axis.

    Raises
    ------
    RecordingError
        If there are fewer than six positions.
    NotIdentifiable
        If the positions do not point into enough directions; it names the faces that are missing.
    """
    y, n = positions.mean, len(positions.mean)
    absent = absent_faces(y)
    further = f"no position has {', '.join(absent)}; add {'it' if len(absent) == 1 else 'them'}, level to some degrees"
    if n < len(SIX):
        raise RecordingError(
            f"{positions.name}: {n} positions; scale and zero of three axes need at least 6, each axis up and down, "
            f"the angles between them at least 10, better 30: {further}"
        )
    require_within_range(positions)
    free, count = (np.arange(PARAMETERS), "nine") if n > PARAMETERS else (SIX, "six")
    more = further if absent else "add positions in which each axis points up and down, and some in between"
    undetermined = f"{positions.name}: {n} positions do not determine {count} parameters; {more}"
    middle, half = 0.5 * (np.max(y, axis=0) + np.min(y, axis=0)), 0.5 * np.ptp(y, axis=0)
    if np.any(half <= 0.0):
        raise NotIdentifiable(
            f"{positions.name}: axis {AXES[int(np.argmin(half))]} is the same in all positions; check its column"
        )
    u = (y - middle) / half  # of order 1
    x = ellipsoid(u) if n > PARAMETERS else SPHERE.copy()

    def full(part: Array) -> Array:
        whole = x.copy()
        whole[free] = part
        return whole

    x = full(
        scipy.optimize.least_squares(
            lambda part: norm_error(full(part), u),
            x[free],
            jac=lambda part: slopes(full(part), u)[:, free],
            method="lm",
            xtol=1e-15,
            ftol=1e-15,
            gtol=1e-15,
        ).x
    )
    for _ in range(3):  # to the last digit
        x[free] -= np.linalg.lstsq(slopes(x, u)[:, free], norm_error(x, u), rcond=None)[0]
    J = slopes(x, u)[:, free]
    worst = WORST_CONDITION if n > PARAMETERS else WORST_OF_FACES
    if not np.all(np.isfinite(x)) or np.linalg.cond(J / np.linalg.norm(J, axis=0)) > worst:
        raise NotIdentifiable(undetermined)
    g = positions.gravity
    residual = g * norm_error(x, u)
    M, offset = matrix(x), x[6:]
    K, b = g * np.diag(M) / half, middle + half * offset
    T = M / np.diag(M)
    a = g * (u - offset) @ M.T
    white = white_noise(M * g / half, a, positions)
    variance = float(residual @ residual) / (n - len(free)) if n > len(free) else white
    variance = variance if n > PARAMETERS else max(variance, white)
    covariance = np.zeros((PARAMETERS, PARAMETERS))
    covariance[np.ix_(free, free)] = variance / g**2 * np.linalg.inv(J.T @ J)
    std = tuple(pair for pair in deviations(x, covariance, g, half) if pair[1] > 0.0)
    if any(dict(std)[f"K_{axis}"] > LEAST_KNOWN * k for axis, k in zip(AXES, K, strict=True)):
        raise NotIdentifiable(undetermined)
    return TriadFit(
        T=T,
        K=K,
        b=b,
        std=std,
        residual=residual,
        ratio=math.sqrt(variance / white) if white > 0.0 else math.inf,
        terms=tested(a / g, J, residual / g) if n > PARAMETERS else (),
        name=positions.name,
        unit=positions.unit,
        gravity=g,
    )


def require_within_range(positions: Positions) -> None:
    """Refuse positions in most of which the largest output alone does not scatter, as at the end of a range.

    Raises
    ------
    RecordingError
        With their number.
    """
    y, n, exact = positions.mean, len(positions.mean), positions.std == 0.0
    largest = np.argmax(np.abs(y - np.median(y, axis=0)), axis=1)
    clipped = int(np.count_nonzero(exact[np.arange(n), largest] & (np.sum(exact, axis=1) == 1)))
    if 2 * clipped > n:
        raise RecordingError(
            f"{positions.name}: in {clipped} of {n} positions the axis that points up or down reads one value while "
            "the others scatter, as at the end of its range; record with a larger range"
        )


def absent_faces(y: Array, centre: Array | None = None) -> list[str]:
    """Axes that point up or down in none of the outputs (n, 3), as in "z down"; the zeros (3,) are about the medians
    where they are not given."""
    away = y - (np.median(y, axis=0) if centre is None else centre)
    shown = away / max(float(np.max(np.abs(away), initial=0.0)), np.finfo(float).tiny)
    up, down = np.any(shown > ON_FACE, axis=0), np.any(shown < -ON_FACE, axis=0)
    return [f"{AXES[k]} {word}" for word, has in (("up", up), ("down", down)) for k in np.flatnonzero(~has)]


def matrix(x: Array) -> Array:
    """T K of scaled outputs."""
    M = np.zeros((3, 3))
    for value, (i, j) in zip(x, UPPER, strict=False):
        M[i, j] = value
    return M


def norm_error(x: Array, u: Array) -> Array:
    """|M (u - b)| - 1, (n,)."""
    return np.asarray(np.linalg.norm((u - x[6:]) @ matrix(x).T, axis=1) - 1.0)


def slopes(x: Array, u: Array) -> Array:
    """Its derivatives, (n, 9)."""
    M, away = matrix(x), u - x[6:]
    a = away @ M.T
    unit = a / np.linalg.norm(a, axis=1)[:, None]
    return np.column_stack([*(unit[:, i] * away[:, j] for i, j in UPPER), -(unit @ M)])


def ellipsoid(u: Array) -> Array:
    """Start: the ellipsoid through the positions in algebraic least squares; a sphere where it is none."""
    pairs = list(combinations_with_replacement(range(3), 2))
    columns = np.column_stack([*(u[:, i] * u[:, j] for i, j in pairs), u])
    coefficients = np.linalg.lstsq(columns, np.ones(len(u)), rcond=None)[0]
    A = np.zeros((3, 3))
    for value, (i, j) in zip(coefficients, pairs, strict=False):
        A[i, j] += 0.5 * value
        A[j, i] += 0.5 * value
    try:
        centre = -0.5 * np.linalg.solve(A, coefficients[6:])
        scaled = A / (1.0 + centre @ A @ centre)
        M = np.linalg.cholesky(scaled).T  # M'M = A with M upper triangular
    except np.linalg.LinAlgError:
        return SPHERE
    return np.array([*(M[i, j] for i, j in UPPER), *centre])


def white_noise(M: Array, a: Array, positions: Positions) -> float:
    """Mean variance of |a| from noise within the positions, (m/s²)²."""
    unit = a / np.linalg.norm(a, axis=1)[:, None]
    return float(np.mean(np.sum((unit @ M) ** 2 * positions.std**2 / positions.samples[:, None], axis=1)))


def deviations(x: Array, covariance: Array, g: float, half: Array) -> tuple[tuple[str, float], ...]:
    """Standard deviations of K, T and b from the covariance of the elements of the scaled matrix."""
    place = {pair: k for k, pair in enumerate(UPPER)}
    pairs: list[tuple[str, float]] = []
    for j, axis in enumerate(AXES):
        pairs.append((f"K_{axis}", g / float(half[j]) * math.sqrt(covariance[place[j, j], place[j, j]])))
    for i, j in UPPER:
        if i != j:
            slope = np.zeros(PARAMETERS)
            slope[place[i, j]], slope[place[j, j]] = 1.0 / x[place[j, j]], -x[place[i, j]] / x[place[j, j]] ** 2
            pairs.append((f"T_{AXES[i]}{AXES[j]}", math.sqrt(float(slope @ covariance @ slope))))
    for j, axis in enumerate(AXES):
        pairs.append((f"b_{axis}", float(half[j]) * math.sqrt(covariance[6 + j, 6 + j])))
    return tuple(pairs)


def tested(a: Array, J: Array, residual: Array) -> tuple[NormTerm, ...]:
    """Every product of two and of three accelerations on every axis, as the norm shows it: one class a monomial."""
    basis = scipy.linalg.orth(J)
    classes: dict[tuple[int, ...], list[str]] = {}
    for order in (2, 3):
        for axis in range(3):
            for product in combinations_with_replacement(range(3), order):
                name = f"{'K' if order == 2 else 'L'}_{AXES[axis]},{''.join(AXES[k] for k in product)}"
                classes.setdefault(tuple(sorted((axis, *product))), []).append(name)
    terms_tested = []
    for monomial, members in classes.items():
        column = np.prod(a[:, monomial], axis=1)
        beyond = column - basis @ (basis.T @ column)
        terms_tested.append((tuple(members), t_of(beyond, column, residual)))
    freedom, count = len(residual) - PARAMETERS - 1, sum(1 for _, t in terms_tested if t != 0.0)
    return tuple(NormTerm(members, t, corrected(t, freedom, count)) for members, t in terms_tested)


def t_of(beyond: Array, column: Array, residual: Array) -> float:
    """Student's t of a column beside the nine parameters; 0 where the norm does not show it."""
    power = float(beyond @ beyond)
    if power < LEFT * float(column @ column):
        return 0.0
    estimate = float(beyond @ residual) / power
    left = residual - estimate * beyond
    variance = float(left @ left) / max(len(residual) - PARAMETERS - 1, 1)
    return estimate * math.sqrt(power / variance) if variance > 0.0 else 0.0


def corrected(t: float, freedom: int, count: int) -> float:
    """Probability of a t as large under none, over all that are tested (Sidak)."""
    if t == 0.0 or freedom < 1:
        return 1.0
    alone = 2.0 * float(scipy.special.stdtr(freedom, -abs(t)))
    return over_all(alone, count)
