"""Numbers, units and names for people: shared by command line, figures, report, notebook and workbench."""

from __future__ import annotations

import math
import re

import numpy as np

from accelcal.data.arrays import Array
from accelcal.data.units import display
from accelcal.effects import CATALOGUE, spelled


def concise(value: float, std: float) -> str:
    """A value with the standard uncertainty of its last two digits in parentheses.

    Examples
    --------
    >>> concise(0.0123456, 0.000021)
    '0.012346(21)'
    >>> concise(1.2345e-5, 2.1e-7)
    '1.234(21)e−5'
    """
    if not (math.isfinite(std) and std > 0.0):
        return f"{value:.4g}"
    largest = max(abs(value), std)
    exponent = math.floor(math.log10(largest))
    exponent = 0 if -3 <= exponent <= 4 else exponent
    value, std = value / 10.0**exponent, float(f"{std / 10.0**exponent:.1e}")
    digits = 1 - math.floor(math.log10(std))
    places = max(0, digits)
    shown = f"{round(value, digits):.{places}f}({round(std * 10.0**places)})"
    tail = f"e{exponent}" if exponent else ""
    return (shown + tail).replace("-", "−")


def plus_minus(value: float, std: float) -> str:
    """A value with two digits of its standard deviation, where that is known.

    Examples
    --------
    >>> plus_minus(229.04, 3.52), plus_minus(-1.598e-4, 2.1e-4), plus_minus(1.04321, math.nan)
    ('229.0 ± 3.5', '-0.00016 ± 0.00021', '1.043')
    """
    from uncertainties import ufloat

    if not math.isfinite(std) or std <= 0.0:
        return f"{value:.4g}"
    return f"{ufloat(value, std):.2u}".replace("+/-", " ± ")


def short(value: float, std: float) -> str:
    """A value with the last two digits of its standard deviation in parentheses.

    Examples
    --------
    >>> short(0.0009945, 2.8e-6), short(-4.5e-7, 4.4e-7)
    ('0.0009945(28)', '-4.5(4.4)e-07')
    """
    from uncertainties import ufloat

    return f"{ufloat(value, std):.2uS}"


def interval(value: float, std: float, factor: float = 1.96) -> str:
    """The interval that contains the true value with 95 % probability, to two digits of the standard deviation.

    `factor` is half the interval over the standard deviation, more where that is known from few runs.

    Examples
    --------
    >>> interval(0.04984, 2.1e-4), interval(9e-7, 3.2e-6)
    ('0.04943 .. 0.05025', '-5.4e-06 .. 7.2e-06')
    """
    last = 1 - math.floor(math.log10(std))
    low, high = (round(value + side * factor * std, last) for side in (-1.0, 1.0))
    digits = max(1, 1 + last + math.floor(math.log10(max(abs(low), abs(high)))))
    return f"{low:.{digits}g} .. {high:.{digits}g}"


def millionths(value: float | None) -> str:
    """A length in um, "-" where there is none."""
    return "-" if value is None else f"{1e6 * value:.4g} um"


def number(value: float, digits: int = 4) -> str:
    """A number for reading, with a true minus sign.

    Examples
    --------
    >>> number(-0.000123456), number(1.8e-5, 2)
    ('−0.0001235', '1.8e−5')
    """
    return typeset(f"{value:.{digits}g}")


def typeset(text: str) -> str:
    """Numbers in a text with true minus signs and short exponents."""
    return re.sub(r"e([+-])0*(?=\d)", r"e\1", text).replace("e+", "e").replace("-", "−")


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


def usual(unit: str, value: float, std: float) -> str:
    """A value in the customary unit, such as mg; empty where that is SI."""
    return typeset(display(unit, value, std) or "").replace(" u", " µ")


def readable(text: str) -> str:
    """A sentence of the library with effect names written as words."""
    for name in sorted((n for n in CATALOGUE if "_" in n), key=len, reverse=True):
        text = text.replace(name, spelled(name))
    return text.replace(" sigma", " σ")


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
    return f"{metres * factor:.3g} {unit}"


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
