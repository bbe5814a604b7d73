"""The two number formats of an export: neighbours, directed rounding, unit roundoff (IEEE 754)."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np

from accelcal._support.errors import AccelcalError
from accelcal._support.values import face


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
    known = {one.name: one for one in (DOUBLE, SINGLE)}
    if name not in known:
        raise AccelcalError(" or ".join(known))
    return known[name]
