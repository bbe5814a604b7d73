"""Words: numbers with their uncertainty, units and names, in one notation for every face."""

from __future__ import annotations

import math
import re

import numpy as np

from accelcal._support.values import listing
from accelcal.data import MICRO_G, NORMAL_95, Array, concise as concise, usual_unit
from accelcal.data.units import decimal as decimal
from accelcal.effects import CATALOGUE, spelled, static_terms
from accelcal.effects.mechanisms import PATTERN


def interval(value: float, std: float, factor: float = NORMAL_95) -> str:
    """The interval that contains the true value with 95 % probability, to two digits of the standard deviation.

    `factor` is half the interval over the standard deviation, more where that is known from few runs.

    Examples
    --------
    >>> interval(0.04984, 2.1e-4), interval(9e-7, 3.2e-6), interval(0.050017, 4.25e-5)
    ('0.04943 .. 0.05025', '(−5.4 .. 7.2)e−6', '0.049934 .. 0.050100')
    """
    last = 1 - math.floor(math.log10(std))
    ends = [round(value + side * factor * std, last) + 0.0 for side in (-1.0, 1.0)]
    largest = max(map(abs, ends))
    if 0.0 < largest < 1e-4:
        power = math.floor(math.log10(largest))
        low, high = (f"{end / 10.0**power:.{max(0, last + power)}f}" for end in ends)
        return typeset(f"({low} .. {high})e{power}")
    return " .. ".join(f"{end:.{max(0, last)}f}" for end in ends).replace("-", "−")


def number(value: float, digits: int = 4) -> str:
    """A number for reading, with a true minus sign; powers of ten below 1e-4 and from a million on.

    Examples
    --------
    >>> number(-0.000123456), number(1.8e-5, 2), number(17660.0, 3), number(1.8e7)
    ('−0.0001235', '1.8e−5', '17700', '1.8e7')
    """
    rounded = float(f"{value:.{digits}g}")
    whole = 10.0**digits <= abs(rounded) < 1e6
    return typeset(f"{rounded:.0f}" if whole else f"{value:.{digits}g}")


def typeset(text: str) -> str:
    """Numbers in a text with true minus signs and short exponents; a hyphen between words stays."""
    short = re.sub(r"e([+-])0*(?=\d)", r"e\1", text).replace("e+", "e")
    return re.sub(r"(?:(?<=\de)|(?<=\be)|(?<!\w))-(?=[\d.]|inf)", "−", short)


def with_unit(text: str, unit: str) -> str:
    """A number with its unit; a pure number has none."""
    return text if unit in ("", "1") else f"{text} {unit}"


def amount(value: float, std: float, unit: str) -> str:
    """A value with the standard uncertainty of its last digits and its unit."""
    shown = concise(value, std) if std > 0.0 else f"{number(value)} (held)"
    return with_unit(shown, unit)


def probability(p: float) -> str:
    """A probability, also where it is too small for a number."""
    return number(p, 2) if p > 0.0 else "<1e−300"


def plain(unit: str, value: float, std: float) -> str:
    """A value as people say it: in the customary unit, else in SI, with ± and without powers of ten; never empty.

    Examples
    --------
    >>> plain("(m/s²)⁻²", 9.99e-4, 2.0e-5), plain("1", 0.01929, 2.2e-4), plain("K⁻¹", 1.25e-5, 3.1e-6)
    ('96100 ± 1900 µg/g³', '1.929 ± 0.022 %', '0.0000125 ± 0.0000031 K⁻¹')
    >>> plain("m", 2.7e-9, 1.7e-9), plain("s", 29.867305, 3.9e-5), plain("1", 0.01929, math.inf)
    ('2.7 ± 1.7 nm', '29.867305 ± 0.000039 s', '1.929 % ± not known')
    """
    if not math.isfinite(std):
        return f"{plain(unit, value, 0.0)} ± not known"
    name, size = ("%", 0.01) if unit == "1" else usual_unit(unit, value, std)
    return with_unit(decimal(value / size, std / size), typeset(name) if size != 1.0 else name)


def about(unit: str, value: float) -> str:
    """A size to two digits as people say it: in the customary unit, else in SI, without powers of ten.

    Examples
    --------
    >>> about("m/s²", 3.76e-4), about("1", 4.73e-4), about("(m/s²)⁻²", 1.0e-4), about("s²/m³", 18.7)
    ('0.038 mg', '0.047 %', '9600 µg/g³', '19 s²/m³')
    """
    size, _, name = plain(unit, value, 0.0).replace("−", "-").partition(" ")
    return with_unit(decimal(float(f"{float(size):.2g}"), 0.0), name)


def with_plain(value: float, std: float, unit: str) -> str:
    """A value as people say it, then with the standard uncertainty of its last digits in SI; a pure number once.

    Examples
    --------
    >>> with_plain(9.99e-4, 2.0e-5, "(m/s²)⁻²")
    '96100 ± 1900 µg/g³ = 9.99(20)e−4 (m/s²)⁻²'
    """
    first, exact = plain(unit, value, std), amount(value, std, unit)
    if std <= 0.0:
        return exact
    return first if unit == "1" else f"{first} = {exact}"


def at_full_scale(
    name: str, unit: str, value: float, std: float, full_scale: float | None, used: float = math.inf
) -> str:
    """Contribution of a coefficient to the output at full scale, in per cent of that; empty where it is not known, or
    is the coefficient itself.

    Parameters
    ----------
    name : the coefficient. Terms of the static characteristic count with their power; of others those in m/s².
    unit, value, std : of the coefficient.
    full_scale : declared range of the sensor, m/s².
    used : largest acceleration of the record, m/s². Where it is less than half of the full scale, what grows with a
        power of the acceleration is extrapolated.

    Examples
    --------
    >>> at_full_scale("bias", "m/s²", 0.05, 0.001, 20.0), at_full_scale("quadratic", "(m/s²)⁻¹", 1e-4, 1e-5, 20.0)
    ('0.2500 ± 0.0050 % FS', '0.200 ± 0.020 % FS')
    >>> at_full_scale("quadratic", "(m/s²)⁻¹", 1e-4, 1e-5, 20.0, used=4.0)
    '0.2 % FS, from 20 %'
    """
    static = static_terms().get(name)
    if not full_scale or (static is None and unit != "m/s²") or (static is not None and static.thermal) or unit == "1":
        return ""
    per_unit = 100.0 / full_scale * (1.0 if static is None else abs(static.per_unit(full_scale, 0.0)))
    if unit != "m/s²" and used < EXTRAPOLATED * full_scale:
        return f"{number(per_unit * value, 2)} % FS, from {100.0 * used / full_scale:.0f} %"
    return f"{decimal(per_unit * value, per_unit * std)} % FS"


EXTRAPOLATED = 0.5
"""Share of the full scale below which a nonlinearity at full scale is extrapolated."""


def readable(text: str) -> str:
    """A sentence of the library with effect names written as words."""

    def worded(name: re.Match[str]) -> str:
        return spelled(name[0]) if name[0] in CATALOGUE or PATTERN.fullmatch(name[0]) else name[0]

    return re.sub(r"\w+_\w+", worded, text).replace(" sigma", " σ")


def prefixed(unit: str, *values: Array | float) -> tuple[float, str]:
    """Factor and unit in which the largest of some values is at least 1; only metres and units that begin with them.

    Examples
    --------
    >>> prefixed("m", 2e-6)
    (1000000.0, 'µm')
    >>> prefixed("K", 2e-6)
    (1.0, 'K')
    """
    sizes = [np.abs(v[np.isfinite(v)]).max(initial=0.0) for v in map(np.atleast_1d, values)]
    largest = float(max(sizes, default=0.0))
    if not (unit == "m" or unit.startswith("m/")) or not 0.0 < largest < 1.0:
        return 1.0, unit
    for factor, prefix in ((1e3, "m"), (1e6, "µ")):
        if largest * factor >= 1.0:
            return factor, prefix + unit
    return 1e9, "n" + unit


def length(metres: float) -> str:
    """A length in words, three digits.

    Examples
    --------
    >>> length(1.2345e-6)
    '1.23 µm'
    """
    factor, unit = prefixed("m", metres)
    return typeset(f"{metres * factor:.3g} {unit}")


def error_size(value: float, unit: str, full_scale: float | None = None) -> str:
    """A size of an error: a length; of an acceleration in mg, in SI and in per cent of the full scale, m/s².

    Examples
    --------
    >>> error_size(0.0313, "m/s²", 19.6133), error_size(7.2e-4, "m/s²"), error_size(2e-6, "m")
    ('3.19 mg (31.3 mm/s², 0.16 % FS)', '73.4 µg (720 µm/s²)', '2 µm')
    """
    if unit == "m":
        return length(value)
    factor, prefixed_unit = prefixed(unit, value)
    share = "" if full_scale is None else f", {number(100.0 * value / full_scale, 2)} % FS"
    return f"{in_g(value)} ({number(value * factor, 3)} {prefixed_unit}{share})"


def in_g(value: float) -> str:
    """An acceleration in mg, in µg where it is smaller than a tenth of one, in g from 1 g on.

    Examples
    --------
    >>> in_g(0.0313), in_g(7.2e-4), in_g(98.0665)
    ('3.19 mg', '73.4 µg', '10 g')
    """
    of_g = abs(value) / (1e6 * MICRO_G)
    size, unit = (1.0, "g") if of_g >= 1.0 else (1e-3, "mg") if of_g >= 1e-4 else (1e-6, "µg")
    size *= 1e6 * MICRO_G
    return f"{number(value / size, 3)} {unit}"


def largest_residual(worst: str) -> str:
    """Where a model fails most, in a sentence.

    Examples
    --------
    >>> largest_residual("velocity between -0.3 and -0.2 m/s: mean residual -0.002 m/s² (5.2 sigma)")
    'Largest residual: velocity between −0.3 and −0.2 m/s: mean residual −0.002 m/s² (5.2 sigma).'
    """
    beginning = "Largest residual: " if " between " in worst else ""
    return f"{beginning or worst[:1].upper()}{typeset(worst) if beginning else worst[1:]}."


def percent(value: float) -> str:
    """A fit in percent, with two digits of what it lacks to 100."""
    lacks = abs(100.0 - value)
    digits = min(4, max(0, 1 - math.floor(math.log10(lacks)))) if lacks > 0.0 else 0
    return f"{value:.{digits}f} %".replace("-", "−")


def grouped(number: int) -> str:
    """A count with its thousands separated: 400 000."""
    return f"{number:,}".replace(",", " ")


def label(quantity: str, unit: str) -> str:
    """Title of an axis: the quantity with its unit in parentheses, "1" for a pure number.

    Examples
    --------
    >>> label("temperature", "degC")
    'temperature (°C)'
    """
    shown = unit.replace("degC", "°C").replace("^2", "²").replace("^3", "³")
    return f"{quantity} ({shown or 'no unit given'})"


__dir__ = listing(globals())
