"""Polynomials of the inverse characteristic, in the number formats of an export with directed rounding."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.polynomial import chebyshev

from accelcal._support.errors import AccelcalError
from accelcal._support.values import face
from accelcal.calibration.characteristic import Characteristic
from accelcal.data import Array, Sensor


@dataclass(frozen=True, slots=True)
class Format:
    """A binary floating-point format; its numbers are held as Python floats, which contain both."""

    name: str
    """As C calls it."""
    kind: type[np.float64] | type[np.float32]
    digits: int
    """Bits of the significand."""
    least: Fraction
    """Smallest normal number; covers what underflow costs, with flushing to zero too."""

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Any) -> Any:
        return face("results.json").named(format_of)

    @property
    def roundoff(self) -> Fraction:
        """Largest relative error of one operation."""
        return Fraction(1, 2**self.digits)

    def nearest(self, x: Fraction | float) -> float:
        """A neighbour of `x`, the nearest up to double rounding."""
        return float(self.kind(float(x)))

    def below(self, x: Fraction) -> float:
        """Largest number that is not above `x`."""
        y = self.nearest(x)
        while Fraction(y) > x:
            y = self.next(y, -1.0)
        return y

    def above(self, x: Fraction) -> float:
        """Smallest number that is not below `x`."""
        return -self.below(-x)

    def next(self, x: float, direction: float) -> float:
        """Neighbour of a number, upwards where `direction` is positive."""
        return float(np.nextafter(self.kind(x), self.kind(np.copysign(np.inf, direction))))

    def array(self, values: Any) -> Any:
        """Values as an array of this format."""
        return np.asarray(values, dtype=self.kind)


DOUBLE = Format("double", np.float64, 53, Fraction(1, 2**1022))
SINGLE = Format("float", np.float32, 24, Fraction(1, 2**126))


def format_of(name: str) -> Format:
    """Return the format that C calls `name`.

    Raises
    ------
    ValueError
        If there is none.
    """
    formats = {number_format.name: number_format for number_format in (DOUBLE, SINGLE)}
    if name not in formats:
        raise AccelcalError(" or ".join(formats))
    return formats[name]


READING_OUTSIDE = 1
"""Flag: the reading lies beyond the range in which the bound holds; continued in a straight line."""
TEMPERATURE_OUTSIDE = 2
"""Flag: the temperature does; the bias is extrapolated in a straight line, the scale factor is held."""


@dataclass(frozen=True, slots=True)
class Segment:
    """One polynomial in x = (y - centre) per_half and tau, both within -1 and 1."""

    low: float
    """First y that belongs to it."""
    high: float
    """Last one."""
    centre: float
    per_half: float
    coefficients: tuple[tuple[float, ...], ...]
    """Row i, column j multiply x^i tau^j."""


@dataclass(frozen=True, slots=True)
class Warmth:
    """How temperature enters: y = reading - shift (T - centre), tau = (T - centre) per_half."""

    centre: float
    """degC"""
    half: float
    """K"""
    per_half: float
    """1/K"""
    shift: float
    """Unit of the reading per K."""


@dataclass(frozen=True, slots=True)
class Inverse:
    """Reading to acceleration in one number format; every number in it is one of that format."""

    format: Format
    segments: tuple[Segment, ...]
    """By rising y."""
    slopes: tuple[float, float]
    """d acceleration / d y with which it goes on below the first and above the last segment."""
    warmth: Warmth | None
    """None where temperature does not matter."""

    @property
    def low(self) -> float:
        """Least y of the validity range."""
        return self.segments[0].low

    @property
    def high(self) -> float:
        """Largest y of the validity range."""
        return self.segments[-1].high


def horner(values: Sequence[Any], x: Any) -> Any:
    """Sum of values[i] x^i."""
    total = values[-1]
    for value in values[-2::-1]:
        total = total * x + value
    return total


def polynomial(coefficients: Sequence[Sequence[Any]], x: Any, tau: Any) -> Any:
    """Sum of coefficients[i][j] x^i tau^j: rows in tau, then their values in x."""
    return horner([row[0] if len(row) == 1 else horner(row, tau) for row in coefficients], x)


def evaluate(inverse: Inverse, reading: Any, temperature: Any = 0.0) -> tuple[Any, Any]:
    """Acceleration and flags, bit by bit as the exported code computes them.

    Parameters
    ----------
    inverse : in either format.
    reading : (n,) V, counts or m/s²; taken in the format of the inverse.
    temperature : (n,) degC; not looked at where it does not matter.

    Returns
    -------
    Acceleration (n,), m/s², in the format of the inverse, and the sum of the flags (n,).
    """
    number = inverse.format.kind
    y = inverse.format.array(reading)
    outside = np.zeros(y.shape, dtype=np.uint8)
    tau: Any = number(0.0)
    if inverse.warmth is not None:
        w = inverse.warmth
        t = inverse.format.array(temperature) - number(w.centre)
        y = y - number(w.shift) * t
        held = np.where(t >= number(-w.half), np.where(t <= number(w.half), t, number(w.half)), number(-w.half))
        outside |= np.where((t >= number(-w.half)) & (t <= number(w.half)), 0, TEMPERATURE_OUTSIDE).astype(np.uint8)
        tau = held * number(w.per_half)
    low, high = number(inverse.low), number(inverse.high)
    beyond = ~((y >= low) & (y <= high))
    outside |= np.where(beyond, READING_OUTSIDE, 0).astype(np.uint8)
    inside = np.where(y >= low, np.where(y <= high, y, high), low)
    starts = inverse.format.array([segment.low for segment in inverse.segments[1:]])
    chosen = np.searchsorted(starts, inside, side="right")
    a = np.zeros_like(inside)
    for index, segment in enumerate(inverse.segments):
        x = (inside - number(segment.centre)) * number(segment.per_half)
        rows = [[number(c) for c in row] for row in segment.coefficients]
        a = np.where(chosen == index, polynomial(rows, x, tau), a)
    slope = np.where(y >= low, number(inverse.slopes[1]), number(inverse.slopes[0]))
    return np.where(beyond, a + slope * (y - inside), a), outside


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
    residual = sum((abs(c) for row in chebyshev_rows(R) for c in row), Fraction(0))
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


def chebyshev_rows(p: Poly) -> Poly:
    """The polynomial in products of Chebyshev polynomials T_i(x) T_j(tau)."""
    rows = [to_chebyshev(row) for row in p]
    columns = [to_chebyshev(column) for column in zip(*rows, strict=True)]
    return [list(row) for row in zip(*columns, strict=True)]


def to_chebyshev(powers: Sequence[Fraction]) -> list[Fraction]:
    """Coefficients of T_0, T_1, ... from those of 1, x, ...: x^n = 2^(1-n) sum of binomial(n, k) T_(n-2k)."""
    coefficients = [Fraction(0)] * len(powers)
    for n, c in enumerate(powers):
        for k in range(n // 2 + 1):
            share = Fraction(math.comb(n, k), 2**n)
            coefficients[n - 2 * k] += c * (share if n == 2 * k else 2 * share)
    return coefficients


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


NODES = (33, 17)
"""Chebyshev points in x and tau from which a polynomial is made."""
MOST_DEGREE = 15
"""A segment that needs a higher degree is halved."""
MOST_HALVINGS = 5
SMALL = 0.25
"""Size up to which a coefficient is dropped, in roundoffs of the largest acceleration."""
MARGIN = Fraction(1, 1000)
"""Share of the range by which the model must be monotone beyond it."""
WORST = Fraction(1, 10**5)
"""Largest share of the largest acceleration that the inverse may be off by."""


class NotInvertible(AccelcalError):
    """An output of the model does not belong to one acceleration. The text states where."""


@dataclass(frozen=True, slots=True)
class Domain:
    """Accelerations and temperatures for which an inverse is made."""

    acceleration: tuple[float, float]
    """m/s²"""
    temperature: tuple[float, float] | None
    """degC; None where the model does not depend on it."""


@dataclass(frozen=True, slots=True)
class Proven:
    """An inverse with its bound."""

    inverse: Inverse
    approximation: float
    """Bound on the error of the polynomials in exact arithmetic, m/s²."""
    rounding: float
    """Bound on what rounding adds, m/s²."""

    @property
    def bound(self) -> float:
        """Bound on the distance from the model's exact inverse inside the range, m/s², a number of the format."""
        return self.inverse.format.above(Fraction(self.approximation) + Fraction(self.rounding))


def invert(curve: Characteristic, sensor: Sensor, domain: Domain, fmt: Format) -> Proven:
    """Make the inverse in one number format and prove its bound.

    Parameters
    ----------
    curve : the sensor's characteristic.
    sensor : with its electrical scale and zero, if any.
    domain : where the inverse must hold.
    fmt : number format of all constants and operations.

    Raises
    ------
    NotInvertible
        If the model is not strictly monotone there, with a margin of a thousandth, or so nearly not that no polynomial
        follows it.
    """
    warmth = _warmth(curve, sensor, domain, fmt)
    half = Fraction(warmth.half) if warmth else Fraction(0)
    branches = _branches(curve, sensor, domain, warmth)
    low, high = (Fraction(a) for a in domain.acceleration)
    margin = MARGIN * (high - low)
    least = min(b.least_slope(b.low - margin, b.high + margin, half) for b in branches)
    if not least > 0 or len({b.slope((b.low + b.high) / 2) > 0 for b in branches}) > 1:
        raise NotInvertible(_turning(curve, domain))
    segments: list[tuple[Segment, Branch]] = []
    for branch, (first, last) in zip(branches, _ranges(branches, half, fmt), strict=True):
        if not first < last:
            raise NotInvertible(
                f"within {_span(domain.temperature or (0.0, 0.0), 'degC')} temperature changes the output by more than "
                f"the accelerations {_span(domain.acceleration, 'm/s²')} do; fit a record with more motion"
            )
        segments += [(s, branch) for s in _segments(branch, first, last, warmth, fmt, MOST_HALVINGS)]
    segments.sort(key=lambda pair: pair[0].low)
    padded = _padded([s for s, _ in segments])
    ends = (segments[0][1], padded[0].low), (segments[-1][1], padded[-1].high)
    slopes = (_slope_at(*ends[0], fmt), _slope_at(*ends[1], fmt))
    inverse = Inverse(fmt, padded, slopes, warmth)
    per_half = Fraction(warmth.per_half) if warmth else Fraction(0)
    try:
        off = max(approximation(s, b, margin, half, per_half) for s, (_, b) in zip(padded, segments, strict=True))
    except ArithmeticError:
        raise NotInvertible(_turning(curve, domain)) from None
    shift = Fraction(sensor.scale or 1.0) * Fraction(curve.thermal[0])
    proven = Proven(inverse, fmt.above(off), fmt.above(rounding(inverse, shift, least)))
    if proven.approximation > WORST * max(abs(low), abs(high)):
        raise NotInvertible(_turning(curve, domain))
    if proven.rounding > margin:
        raise NotInvertible(
            f"in {fmt.name} rounding alone would cost {proven.rounding:.2g} m/s², too much for accelerations "
            f"{_span(domain.acceleration, 'm/s²')}: the declared zero is too large against the scale"
        )
    return proven


def _span(ends: tuple[float, float], unit: str) -> str:
    return f"{ends[0]:.4g} to {ends[1]:.4g} {unit}"


def _turning(curve: Characteristic, domain: Domain) -> str:
    """Text that states where the slope is least."""
    a = np.linspace(*domain.acceleration, 1001)
    warmths = [0.0] if domain.temperature is None else [T - curve.reference for T in domain.temperature]
    sign = -1.0 if curve.scale < 0.0 else 1.0
    slope, where = min((sign * curve.slope(float(at), w), float(at)) for at in a for w in warmths)
    return (
        "the model is not safely monotone on the accelerations that the fit has seen "
        f"({_span(domain.acceleration, 'm/s²')}): at {where:.4g} m/s² its slope is {sign * slope:.2g} where 1 + k is "
        f"{curve.scale:.4g}, so that an output does not belong to one acceleration. Drop the nonlinear effect that is "
        "least certain, or fit a record with more of the range"
    )


def _warmth(curve: Characteristic, sensor: Sensor, domain: Domain, fmt: Format) -> Warmth | None:
    if domain.temperature is None:
        return None
    low, high = (Fraction(T) for T in domain.temperature)
    centre = fmt.nearest((low + high) / 2)
    half = fmt.above(max(high - Fraction(centre), Fraction(centre) - low))
    per_half = fmt.below(1 / Fraction(half)) if half > 0.0 else 0.0
    shift = fmt.nearest(Fraction(sensor.scale or 1.0) * Fraction(curve.thermal[0]))
    return Warmth(centre, half, per_half, shift)


def _branches(curve: Characteristic, sensor: Sensor, domain: Domain, warmth: Warmth | None) -> tuple[Branch, ...]:
    """The compensated reading y over acceleration, exactly, on each side of a corner at zero."""
    scale, zero = Fraction(sensor.scale or 1.0), Fraction(sensor.zero or 0.0)
    c1, kT = (Fraction(c) for c in curve.thermal)
    centre = Fraction(warmth.centre) - Fraction(curve.reference) if warmth else Fraction(0)
    low, high = (Fraction(a) for a in domain.acceleration)
    corner = curve.has_corner and low < 0 < high
    ends = ((low, Fraction(0)), (Fraction(0), high)) if corner else ((low, high),)
    branches = []
    for first, last in ends:
        b0, b1, b2, b3 = (Fraction(b) for b in curve.side(1.0 if first + last > 0 else -1.0))
        branches.append(
            Branch(
                low=first,
                high=last,
                constant=zero + scale * (b0 + c1 * centre),
                linear=scale * (b1 + kT * centre),
                warm=scale * kT if warmth and warmth.half else Fraction(0),
                quadratic=scale * b2,
                cubic=scale * b3,
            )
        )
    return tuple(branches)


def _ranges(branches: tuple[Branch, ...], half: Fraction, fmt: Format) -> list[tuple[float, float]]:
    """Numbers y that belong to each branch at every temperature of the range."""
    ranges = []
    for branch in branches:
        ends = [[branch.y(a, t) for t in (-half, half)] for a in (branch.low, branch.high)]
        if ends[0][0] > ends[1][0]:
            ends.reverse()
        ranges.append((fmt.above(max(ends[0])), fmt.below(min(ends[1]))))
    if len(ranges) == 2:
        # The corner itself belongs to the upper range.
        lower, upper = (0, 1) if ranges[0][0] < ranges[1][0] else (1, 0)
        first = ranges[upper][0]
        ranges[lower] = (ranges[lower][0], fmt.next(first, -1.0))
    return ranges


def _segments(
    branch: Branch, first: float, last: float, warmth: Warmth | None, fmt: Format, halvings: int
) -> list[Segment]:
    """Polynomials for y from `first` to `last`, halved until the degree suffices."""
    centre = fmt.nearest((Fraction(first) + Fraction(last)) / 2)
    reach = max(Fraction(last) - Fraction(centre), Fraction(centre) - Fraction(first))
    per_half = fmt.below(1 / reach)
    series = _series(branch, centre, per_half, warmth)
    small = SMALL * float(fmt.roundoff) * float(max(abs(branch.low), abs(branch.high)))
    n, m = _degree(series, small, axis=1), _degree(series, small, axis=0)
    if n > MOST_DEGREE and halvings > 0:
        lower = _segments(branch, first, fmt.next(centre, -1.0), warmth, fmt, halvings - 1)
        return lower + _segments(branch, centre, last, warmth, fmt, halvings - 1)
    powers = np.apply_along_axis(_to_powers, 0, series[: n + 1, : m + 1])
    powers = np.apply_along_axis(_to_powers, 1, powers)
    rows = tuple(tuple(fmt.nearest(float(c)) for c in row) for row in powers)
    return [Segment(first, last, centre, per_half, rows)]


def _series(branch: Branch, centre: float, per_half: float, warmth: Warmth | None) -> Array:
    """Chebyshev coefficients of the inverse in x and tau by interpolation, (NODES[0], NODES[1] or 1).

    A straight line in x is taken off exactly before and put back after, so that the small coefficients are not lost in
    the rounding of the large ones.
    """
    x = chebyshev.chebpts1(NODES[0])
    tau = chebyshev.chebpts1(NODES[1] if branch.warm else 1)
    t = tau * (warmth.half if warmth else 0.0)
    y = [Fraction(centre) + Fraction(float(at)) / Fraction(per_half) for at in x]
    above = np.array([float(value - branch.constant) for value in y])
    a = _solve(branch, above[:, None], t[None, :])
    middle, rise = float(a.mean()), float((a[-1] - a[0]).mean() / (x[-1] - x[0]))
    curved = np.empty_like(a)
    for i, j in np.ndindex(*a.shape):
        at, warm = Fraction(float(a[i, j])), Fraction(float(t[j]))
        newton = (y[i] - branch.y(at, warm)) / Fraction(float(branch.slope(at, warm)))
        curved[i, j] = float(at + newton - Fraction(middle) - Fraction(rise) * Fraction(float(x[i])))
    series = _transform(x) @ curved @ _transform(tau).T
    series[:2, 0] += middle, rise
    return series


def _transform(points: Array) -> Array:
    """Matrix that takes values at Chebyshev points of the first kind to coefficients."""
    n = len(points)
    weights = np.full(n, 2.0 / n)
    weights[0] = 1.0 / n
    return np.asarray(weights[:, None] * chebyshev.chebvander(points, n - 1).T)


def _solve(branch: Branch, y: Array, t: Array) -> Array:
    """Acceleration at which the branch is `y` above its constant: bisection, then Newton's steps to rest."""
    linear, warm = float(branch.linear), float(branch.warm)
    quadratic, cubic = float(branch.quadratic), float(branch.cubic)
    slope = linear + warm * t
    shape = np.broadcast_shapes(y.shape, t.shape)
    low, high = np.full(shape, float(branch.low)), np.full(shape, float(branch.high))
    rising = branch.slope((branch.low + branch.high) / 2) > 0
    for _ in range(40):
        a = 0.5 * (low + high)
        above = ((slope + (quadratic + cubic * a) * a) * a > y) == rising
        low, high = np.where(above, low, a), np.where(above, a, high)
    a = 0.5 * (low + high)
    for _ in range(3):
        a = a - ((slope + (quadratic + cubic * a) * a) * a - y) / (slope + (2.0 * quadratic + 3.0 * cubic * a) * a)
    return np.asarray(a)


def _degree(series: Array, small: float, axis: int) -> int:
    """Degree of the last coefficient that is not small."""
    return int(np.flatnonzero(np.max(np.abs(series), axis=axis) > small)[-1])


def _to_powers(series: Array) -> Array:
    """Coefficients of powers from those of Chebyshev polynomials, of equal length."""
    powers = chebyshev.cheb2poly(series)
    return np.pad(powers, (0, len(series) - len(powers)))


def _padded(segments: list[Segment]) -> tuple[Segment, ...]:
    """Segments with coefficients of one shape; zeros change no bit of what Horner's rule gives."""
    rows = max(len(s.coefficients) for s in segments)
    columns = max(len(s.coefficients[0]) for s in segments)

    def widened(s: Segment) -> Segment:
        table = [[*row, *[0.0] * (columns - len(row))] for row in s.coefficients]
        table += [[0.0] * columns for _ in range(rows - len(table))]
        return Segment(s.low, s.high, s.centre, s.per_half, tuple(tuple(row) for row in table))

    return tuple(widened(s) for s in segments)


def _slope_at(branch: Branch, y: float, fmt: Format) -> float:
    """da/dy of the exact inverse at the end of its range, in the middle of the temperatures."""
    offset = np.array([[float(Fraction(y) - branch.constant)]])
    a = float(_solve(branch, offset, np.zeros((1, 1)))[0, 0])
    return fmt.nearest(1 / branch.slope(Fraction(a)))
