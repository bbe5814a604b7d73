"""From the model's output as a function of acceleration to the polynomials of its inverse."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.polynomial import chebyshev

from accelcal._support.errors import AccelcalError
from accelcal.calibration.characteristic import Characteristic
from accelcal.calibration.export.inverse import Inverse, Segment, Warmth
from accelcal.calibration.export.numbers import Format
from accelcal.calibration.export.proof import Branch, approximation, rounding
from accelcal.data.arrays import Array
from accelcal.data.rig import Sensor

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


def invert(own: Characteristic, sensor: Sensor, domain: Domain, fmt: Format) -> Proven:
    """Make the inverse in one number format and prove its bound.

    Parameters
    ----------
    own : the sensor's characteristic.
    sensor : with its electrical scale and zero, if any.
    domain : where the inverse must hold.
    fmt : number format of all constants and operations.

    Raises
    ------
    NotInvertible
        If the model is not strictly monotone there, with a margin of a thousandth, or so nearly not that no polynomial
        follows it.
    """
    warmth = _warmth(own, sensor, domain, fmt)
    half = Fraction(warmth.half) if warmth else Fraction(0)
    branches = _branches(own, sensor, domain, warmth)
    low, high = (Fraction(a) for a in domain.acceleration)
    margin = MARGIN * (high - low)
    least = min(b.least_slope(b.low - margin, b.high + margin, half) for b in branches)
    if not least > 0 or len({b.slope((b.low + b.high) / 2) > 0 for b in branches}) > 1:
        raise NotInvertible(_turning(own, domain))
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
        raise NotInvertible(_turning(own, domain)) from None
    shift = Fraction(sensor.scale or 1.0) * Fraction(own.thermal[0])
    proven = Proven(inverse, fmt.above(off), fmt.above(rounding(inverse, shift, least)))
    if proven.approximation > WORST * max(abs(low), abs(high)):
        raise NotInvertible(_turning(own, domain))
    if proven.rounding > margin:
        raise NotInvertible(
            f"in {fmt.name} rounding alone would cost {proven.rounding:.2g} m/s², too much for accelerations "
            f"{_span(domain.acceleration, 'm/s²')}: the declared zero is too large against the scale"
        )
    return proven


def _span(ends: tuple[float, float], unit: str) -> str:
    return f"{ends[0]:.4g} to {ends[1]:.4g} {unit}"


def _turning(own: Characteristic, domain: Domain) -> str:
    """Text that states where the slope is least."""
    a = np.linspace(*domain.acceleration, 1001)
    warmths = [0.0] if domain.temperature is None else [T - own.reference for T in domain.temperature]
    sign = -1.0 if own.scale < 0.0 else 1.0
    slope, where = min((sign * own.slope(float(at), w), float(at)) for at in a for w in warmths)
    return (
        "the model is not safely monotone on the accelerations that the fit has seen "
        f"({_span(domain.acceleration, 'm/s²')}): at {where:.4g} m/s² its slope is {sign * slope:.2g} where 1 + k is "
        f"{own.scale:.4g}, so that an output does not belong to one acceleration. Drop the nonlinear effect that is "
        "least certain, or fit a record with more of the range"
    )


def _warmth(own: Characteristic, sensor: Sensor, domain: Domain, fmt: Format) -> Warmth | None:
    if domain.temperature is None:
        return None
    low, high = (Fraction(T) for T in domain.temperature)
    centre = fmt.nearest((low + high) / 2)
    half = fmt.above(max(high - Fraction(centre), Fraction(centre) - low))
    per_half = fmt.below(1 / Fraction(half)) if half > 0.0 else 0.0
    shift = fmt.nearest(Fraction(sensor.scale or 1.0) * Fraction(own.thermal[0]))
    return Warmth(centre, half, per_half, shift)


def _branches(own: Characteristic, sensor: Sensor, domain: Domain, warmth: Warmth | None) -> tuple[Branch, ...]:
    """The compensated reading y over acceleration, exactly, on each side of a corner at zero."""
    scale, zero = Fraction(sensor.scale or 1.0), Fraction(sensor.zero or 0.0)
    c1, kT = (Fraction(c) for c in own.thermal)
    centre = Fraction(warmth.centre) - Fraction(own.reference) if warmth else Fraction(0)
    low, high = (Fraction(a) for a in domain.acceleration)
    corner = own.has_corner and low < 0 < high
    ends = ((low, Fraction(0)), (Fraction(0), high)) if corner else ((low, high),)
    found = []
    for first, last in ends:
        b0, b1, b2, b3 = (Fraction(b) for b in own.side(1.0 if first + last > 0 else -1.0))
        found.append(
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
    return tuple(found)


def _ranges(branches: tuple[Branch, ...], half: Fraction, fmt: Format) -> list[tuple[float, float]]:
    """Numbers y that belong to each branch at every temperature of the range."""
    found = []
    for branch in branches:
        ends = [[branch.y(a, t) for t in (-half, half)] for a in (branch.low, branch.high)]
        if ends[0][0] > ends[1][0]:
            ends.reverse()
        found.append((fmt.above(max(ends[0])), fmt.below(min(ends[1]))))
    if len(found) == 2:
        # The corner itself belongs to the upper range.
        lower, upper = (0, 1) if found[0][0] < found[1][0] else (1, 0)
        first = found[upper][0]
        found[lower] = (found[lower][0], fmt.next(first, -1.0))
    return found


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
