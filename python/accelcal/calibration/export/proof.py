"""A proven bound on the error of an exported inverse: exact arithmetic for polynomials, a running bound for rounding.

Approximation. With the model's output G strictly rising in acceleration, slope at least m on the range widened by a
margin d, the residual R = G(P) - y of a polynomial P bounds its error: `|P - a| <= max|R|/m`, provided that
`max|R| < m d` and that P lies in the widened range at one point; for P cannot leave it without R reaching m d first. R
is a polynomial with rational coefficients, so its Chebyshev coefficients are found without any rounding, and the sum of
their absolute values is at least the largest R (a Chebyshev polynomial never exceeds 1).

Rounding. The steps of `inverse.evaluate` are run once more on bounds: every operation carries the largest value that it
can have and the largest error that it can have gathered (Higham 2002, section 3.3). A fused multiplication and addition
rounds once where this counts two.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from accelcal.calibration.export.inverse import Inverse, Segment, polynomial
from accelcal.calibration.export.numbers import Format

Poly = list[list[Fraction]]
"""Row i, column j multiply x^i tau^j."""


@dataclass(frozen=True, slots=True)
class Branch:
    """y = constant + (c1 + warm t) a + c2 a² + c3 a³ on [low, high], t from the centre of the temperature range."""

    low: Fraction
    high: Fraction
    constant: Fraction
    linear: Fraction
    warm: Fraction
    """Per K."""
    quadratic: Fraction
    cubic: Fraction

    def y(self, a: Fraction, t: Fraction = Fraction(0)) -> Fraction:
        """Compensated reading at acceleration `a`."""
        return self.constant + (self.linear + self.warm * t + (self.quadratic + self.cubic * a) * a) * a

    def slope(self, a: Fraction, t: Fraction = Fraction(0)) -> Fraction:
        """dy/da."""
        return self.linear + self.warm * t + (2 * self.quadratic + 3 * self.cubic * a) * a

    def least_slope(self, low: Fraction, high: Fraction, half: Fraction) -> Fraction:
        """Smallest size of the slope on [low, high] with t up to half either way, negative where its sign changes."""
        at = [low, high]
        if self.cubic:
            turn = -self.quadratic / (3 * self.cubic)
            at += [turn] if low < turn < high else []
        slopes = [self.slope(a, t) for a in at for t in (-half, half)]
        sign = 1 if self.slope((low + high) / 2) > 0 else -1
        return min(sign * s for s in slopes)


def approximation(segment: Segment, branch: Branch, margin: Fraction, half: Fraction, per_half: Fraction) -> Fraction:
    """Bound on the error of P over a segment, m/s²; raises ArithmeticError where none can be proven.

    Parameters
    ----------
    segment : polynomial and its range of y, on which `branch` holds.
    branch : the model there.
    margin : by which the branch is monotone beyond its ends, m/s².
    half, per_half : range of t, K, and tau per t, 1/K; both 0 without temperature.
    """
    least = branch.least_slope(branch.low - margin, branch.high + margin, half)
    P: Poly = [[Fraction(c) for c in row] for row in segment.coefficients]
    # Powers of P in integers: their common denominator is a power of two.
    share = Fraction(1, math.lcm(*(c.denominator for row in P for c in row)))
    whole = [[int(c / share) for c in row] for row in P]
    squared = times(whole, whole) if branch.quadratic or branch.cubic else [[0]]
    cubed = times(squared, whole) if branch.cubic else [[0]]
    R = plus(scaled(P, branch.linear), [[branch.constant]])
    R = plus(R, scaled(squared, branch.quadratic * share**2))
    R = plus(R, scaled(cubed, branch.cubic * share**3))
    if branch.warm:
        R = plus(R, [[Fraction(0), *(c * branch.warm / per_half for c in row)] for row in P])
    R = plus(R, [[-Fraction(segment.centre)], [-1 / Fraction(segment.per_half)]])
    residual = sum((abs(c) for row in chebyshev(R) for c in row), Fraction(0))
    # The first point of the segment: x there, tau = 0.
    x = (Fraction(segment.low) - Fraction(segment.centre)) * Fraction(segment.per_half)
    start = polynomial(P, x, Fraction(0))
    if not (least > 0 and residual < least * margin and branch.low - margin < start < branch.high + margin):
        raise ArithmeticError("no bound on the error of the inverse can be proven")
    return residual / least


def times(p: list[list[int]], q: list[list[int]]) -> list[list[int]]:
    """Product of two polynomials in x and tau."""
    rows, columns = len(p) + len(q) - 1, len(p[0]) + len(q[0]) - 1
    product = [[0] * columns for _ in range(rows)]
    for i, p_row in enumerate(p):
        for j, c in enumerate(p_row):
            for k, q_row in enumerate(q):
                for m, d in enumerate(q_row):
                    product[i + k][j + m] += c * d
    return product


def plus(p: Poly, q: Poly) -> Poly:
    """Sum of two polynomials in x and tau."""
    rows, columns = max(len(p), len(q)), max(len(p[0]), len(q[0]))

    def at(of: Poly, i: int, j: int) -> Fraction:
        return of[i][j] if i < len(of) and j < len(of[0]) else Fraction(0)

    return [[at(p, i, j) + at(q, i, j) for j in range(columns)] for i in range(rows)]


def scaled(p: Poly | list[list[int]], factor: Fraction) -> Poly:
    """A polynomial times a number."""
    return [[factor * c for c in row] for row in p]


def chebyshev(p: Poly) -> Poly:
    """The polynomial in products of Chebyshev polynomials T_i(x) T_j(tau)."""
    rows = [to_chebyshev(row) for row in p]
    columns = [to_chebyshev(column) for column in zip(*rows, strict=True)]
    return [list(row) for row in zip(*columns, strict=True)]


def to_chebyshev(powers: Sequence[Fraction]) -> list[Fraction]:
    """Coefficients of T_0, T_1, ... from those of 1, x, ...: x^n = 2^(1-n) sum of binomial(n, k) T_(n-2k)."""
    found = [Fraction(0)] * len(powers)
    for n, c in enumerate(powers):
        for k in range(n // 2 + 1):
            share = Fraction(math.comb(n, k), 2**n)
            found[n - 2 * k] += c * (share if n == 2 * k else 2 * share)
    return found


@dataclass(frozen=True, slots=True)
class Bounded:
    """A computed number of which only bounds are known."""

    size: Fraction
    """Largest absolute value."""
    error: Fraction
    """Largest distance from what exact arithmetic would have given."""
    format: Format

    def __add__(self, other: Bounded) -> Bounded:
        size, u = self.size + other.size, self.format.roundoff
        return Bounded(size * (1 + u), self.error + other.error + u * size, self.format)

    def __mul__(self, other: Bounded) -> Bounded:
        size, u, least = self.size * other.size, self.format.roundoff, self.format.least
        spread = self.size * other.error + (other.size + other.error) * self.error
        return Bounded(size * (1 + u) + least, spread + u * size + least, self.format)


def rounding(inverse: Inverse, true_shift: Fraction, least: Fraction) -> Fraction:
    """Bound on what rounding adds to the error of an inverse inside its range, m/s².

    Parameters
    ----------
    inverse : as exported.
    true_shift : the model's own change of the reading with temperature, of which the exported one is a neighbour.
    least : smallest size of the slope dy/da on the widened range; carries an error of y to acceleration.
    """
    fmt, u = inverse.format, inverse.format.roundoff

    def number(x: float) -> Bounded:
        return Bounded(abs(Fraction(x)), Fraction(0), fmt)

    tau, shifted = number(0.0), Fraction(0)
    if inverse.warmth is not None:
        w = inverse.warmth
        half = Fraction(w.half)
        t = Bounded(half, u * half, fmt)
        tau = t * number(w.per_half)
        largest = max(abs(Fraction(inverse.low)), abs(Fraction(inverse.high)))
        step = number(w.shift) * t
        shifted = step.error + abs(Fraction(w.shift) - true_shift) * half + u * largest * (1 + 2 * u)
    worst = Fraction(0)
    for segment in inverse.segments:
        reach = max(Fraction(segment.high) - Fraction(segment.centre), Fraction(segment.centre) - Fraction(segment.low))
        x = Bounded(reach * (1 + u), u * reach, fmt) * number(segment.per_half)
        worst = max(worst, polynomial([[number(c) for c in row] for row in segment.coefficients], x, tau).error)
    return worst + shifted / least
