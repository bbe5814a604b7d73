"""The one place where units convert: text as people write it in, SI numbers out.

The vocabulary is our own and closed, because two conventions of our field contradict the general one: ``g`` is standard
gravity (elsewhere it is the gram, and "5 g" a mass), and counts and angles are dimensions (elsewhere they are pure
numbers, so that "10 rad/s" passes for "10 Hz"). pint does the algebra over this vocabulary; it is imported only for a
unit that is neither SI nor usual.
"""

from __future__ import annotations

import difflib
import functools
import math
import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from accelcal._support.errors import AccelcalError
from accelcal._support.values import listing

LONGEST = 60
"""Characters; no unit of this field is longer, and a wrong column of prose fails fast."""
MOST_EXPONENT = 12
"""Largest exponent of a name, of either sign."""
MOST_NAMES = 12
"""Names in one unit."""
MOST_GROUP_EXPONENT = 2
"""Largest exponent of a bracket, of either sign."""

_TOKEN = re.compile(
    r"\s*(?:(?P<name>[A-Za-z][A-Za-z_]*0?)|\^\s*(?P<exponent>[+-]?[0-9.]+|\([+-]?[0-9./]+\))|(?P<mark>[*/()1]))"
)
_INTEGER = re.compile(r"[+-]?[0-9]{1,2}")
_ROOT = re.compile(r"[+-]?(?:0?\.5|1/2)")
_DIFFERENCE = "delta_"


def is_legal(text: str) -> bool:
    """Whether a normalised text is a product of names in the sense of this grammar.

    ::

        unit     = product, or 1 alone, or 1 / factor
        product  = factor, then factors with * or / or a space before each
        factor   = name, or ( product ), each with at most one exponent
        exponent = ^ and an integer of at most `MOST_EXPONENT`, or 0.5; of a bracket at most `MOST_GROUP_EXPONENT`

    Brackets do not lie in brackets. Numbers other than exponents, and a leading 1, are no part of a unit, so nothing
    that is long to compute can be written.

    Examples
    --------
    >>> [is_legal(text) for text in ("V/(m/s^2)", "ug/(Hz)^0.5", "m s^-2", "1/s")]
    [True, True, True, True]
    >>> [is_legal(text) for text in ("m^9^9", "m^99", "2*m", "m*10^10", "((m))", "delta_degC", "m//s", "")]
    [False, False, False, False, False, False, False, False]
    """
    if len(text) > LONGEST:
        return False
    tokens = _tokens(text)
    return tokens is not None and _FORM.fullmatch(tokens) is not None and 0 < tokens.count("n") <= MOST_NAMES


_NAME = "n[ers]?"
_BRACKET = rf"\((?:1/)?{_NAME}(?:[*/]?{_NAME})*\)[rs]?"
_FACTOR = f"(?:{_NAME}|{_BRACKET})"
_FORM = re.compile(f"(?:1/)?{_FACTOR}(?:[*/]?{_FACTOR})*")


def _tokens(text: str) -> str | None:
    """The text as one letter for each part; None where a part is none.

    n is a name, e an exponent, s one that a bracket may carry, r a root; marks stand for themselves.
    """
    tokens, at = [], 0
    text = text.rstrip()
    while at < len(text):
        part = _TOKEN.match(text, at)
        if part is None:
            return None
        if part["name"]:
            if part["name"].startswith(_DIFFERENCE):
                return None
            tokens.append("n")
        elif part["exponent"]:
            kind = _exponent(part["exponent"])
            if kind is None:
                return None
            tokens.append(kind)
        else:
            tokens.append(part["mark"])
        at = part.end()
    return "".join(tokens)


def _exponent(text: str) -> str | None:
    number = text.strip("()")
    if _ROOT.fullmatch(number):
        return "r"
    if not _INTEGER.fullmatch(number):
        return None
    size = abs(int(number))
    return None if size > MOST_EXPONENT else "s" if size <= MOST_GROUP_EXPONENT else "e"


_DEFINITIONS = """
n- = 1e-9
u- = 1e-6 = µ- = μ-
m- = 1e-3
c- = 1e-2
h- = 1e2
k- = 1e3
M- = 1e6
s = [time] = _ = sec = second = seconds
m = [length] = _ = metre = meter
kg = [mass]
K = [temperature]; offset: 0 = _ = kelvin
V = [voltage] = _ = volt
A = [current]
count = [count] = _ = counts = LSB = lsb = digit
rad = [angle]
degC = K; offset: 273.15 = _ = celsius
degF = K; offset: 0
min = 60 * s
h = 3600 * s
inch = 0.0254 * m = _ = in
ft = 0.3048 * m
g = 9.80665 * m / s ** 2 = _ = g0 = gn
Gal = 0.01 * m / s ** 2
Hz = 1 / s
deg = 0.017453292519943295 * rad
arcmin = 0.0002908882086657216 * rad
arcsec = 4.84813681109536e-06 * rad
rev = 6.283185307179586 * rad = _ = turn
dps = deg / s
rpm = rev / min
N = kg * m / s ** 2
Pa = N / m ** 2
bar = 100000 * Pa
psi = 6894.757293168361 * Pa
J = N * m
W = J / s
T = kg / A / s ** 2
percent = 0.01
ppm = 1e-6
"""
# h is the hour and the prefix of hPa; the exact name wins. degF is here for its dimension alone (see _TEMPERATURES).


class UnitError(AccelcalError):
    """A unit or a quantity that cannot be understood, or of the wrong dimension. The text states what was expected."""


@dataclass(frozen=True, slots=True)
class Kind:
    """Kind of a quantity, and with it the units that it may carry."""

    name: str
    """With its article, for messages: "an acceleration"."""
    si: str
    """Unit that the program counts it in."""
    example: str
    """A quantity as a data sheet prints it."""


KINDS = {
    "time": Kind("a time", "s", "20 us"),
    "length": Kind("a length", "m", "1 um"),
    "speed": Kind("a speed", "m/s", "5 mm/s"),
    "acceleration": Kind("an acceleration", "m/s^2", "5 g"),
    "noise density": Kind("an acceleration noise density", "m/s^2/Hz^0.5", "225 ug/sqrt(Hz)"),
    "random walk": Kind("a random walk of acceleration", "m/s^2/s^0.5", "10 ug/sqrt(h)"),
    "voltage": Kind("a voltage", "V", "2.5 V"),
    "count": Kind("a number of counts", "count", "2048 count"),
    "temperature": Kind("a temperature", "degC", "23 degC"),
    "angle": Kind("an angle", "rad", "0.05 deg"),
    "angular rate": Kind("an angular rate", "rad/s", "10 deg/s"),
    "frequency": Kind("a frequency", "Hz", "159 Hz"),
    "pressure": Kind("a pressure", "Pa", "101.3 kPa"),
    "current": Kind("a current", "A", "20 mA"),
    "ratio": Kind("a pure number", "1", "1e-5"),
}
"""Every kind of quantity that a sidecar or a known channel may hold."""

USUAL = {
    "time": {"ns": 1e-9, "us": 1e-6, "ms": 1e-3, "min": 60.0, "h": 3600.0},
    "length": {"nm": 1e-9, "um": 1e-6, "mm": 1e-3, "cm": 1e-2, "km": 1e3, "in": 0.0254, "inch": 0.0254, "ft": 0.3048},
    "speed": {"mm/s": 1e-3, "cm/s": 1e-2},
    "acceleration": {
        **{"g": 9.80665, "mg": 0.00980665, "ug": 9.806649999999999e-06},
        **{"mm/s^2": 1e-3, "cm/s^2": 1e-2, "Gal": 1e-2},
    },
    "noise density": {
        **{"g/(Hz)^0.5": 9.80665, "mg/(Hz)^0.5": 0.00980665, "ug/(Hz)^0.5": 9.806649999999999e-06},
        **{"mg/Hz^0.5": 0.00980665, "ug/Hz^0.5": 9.806649999999999e-06},
        **{"m/s^2/(Hz)^0.5": 1.0, "mm/s^2/(Hz)^0.5": 1e-3, "mm/s^2/Hz^0.5": 1e-3},
    },
    "random walk": {
        **{"m/s^2/(s)^0.5": 1.0, "ug/(h)^0.5": 1.6344416666666664e-07, "ug/h^0.5": 1.6344416666666664e-07},
    },
    "voltage": {"uV": 1e-6, "mV": 1e-3},
    "count": {"counts": 1.0, "LSB": 1.0, "lsb": 1.0},
    "angle": {
        **{"deg": 0.017453292519943295, "arcmin": 0.0002908882086657216, "arcsec": 4.84813681109536e-06, "mrad": 1e-3},
        **dict.fromkeys(("rev", "turn"), 6.283185307179586),
    },
    "angular rate": {"deg/s": 0.017453292519943295, "dps": 0.017453292519943295},
    "frequency": {"kHz": 1e3},
    "pressure": {"hPa": 1e2, "kPa": 1e3, "bar": 1e5},
    "current": {"mA": 1e-3},
    "ratio": {"percent": 0.01, "ppm": 1e-6},
}
"""Factors to SI of usual units, by kind and in the spelling of `normalise`, to the bit as pint computes them: to import
pint takes as long as to fit a minute."""
_REMEMBERED = 4096
"""Units that are not parsed anew; a file may bring any number of them."""
_KIND_OF_SI = {kind.si: name for name, kind in KINDS.items()}
_FACTORS = {unit: (kind, factor) for kind, factors in USUAL.items() for unit, factor in factors.items()}


@dataclass(frozen=True, slots=True)
class Conversion:
    """From one unit to SI: ``si_value = factor * value + offset``."""

    factor: float
    offset: float
    si: str
    """The unit after conversion."""

    @np.errstate(over="ignore")  # what leaves the range of a double is found as not finite
    def apply(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return `values`, shape (n,), in the unit `si`; `values` itself when nothing changes."""
        if self.factor == 1.0 and self.offset == 0.0:
            return values
        return values * self.factor + self.offset


def quantity(text: object, kind: str) -> float:
    """Read a number with its unit, as a data sheet prints it.

    Parameters
    ----------
    text : str such as ``"250 ug/sqrt(Hz)"``; a ratio may also be a bare number.
    kind : a key of `KINDS`.

    Returns
    -------
    The value in the SI unit of its kind (temperature: degC).

    Raises
    ------
    UnitError
        If the number or the unit is missing or unknown, or the unit is of another dimension.

    Examples
    --------
    >>> round(quantity("225 ug/sqrt(Hz)", "noise density"), 9)
    0.002206496
    """
    expected = KINDS[kind]
    if isinstance(text, int | float) and not isinstance(text, bool):
        if kind != "ratio":
            raise UnitError(f'{shown(text)} has no unit; expected {expected.name} such as "{expected.example}"')
        number, unit = _float(text), ""
    else:
        match = _parted(text) if isinstance(text, str) else None
        if match is None:
            raise UnitError(f'{shown(text)} is not a quantity; expected {expected.name} such as "{expected.example}"')
        number, unit = float(match["number"]), match["unit"]
        if not unit and kind != "ratio":
            raise UnitError(f'"{text}" has no unit; expected {expected.name} such as "{expected.example}"')
    rule = conversion(unit or "1", kind)
    value = number * rule.factor + rule.offset
    if not math.isfinite(value):
        raise UnitError(f"{shown(text)} is not finite; expected {expected.name} such as {expected.example!r}")
    if not is_measurable(value):
        raise UnitError(
            f"{shown(text)} is beyond all that is measured; expected {expected.name} such as {expected.example!r}"
        )
    return value


def _parted(text: str) -> re.Match[str] | None:
    """Number and unit of a quantity; None where it is none."""
    return _QUANTITY.fullmatch(text) if len(text) <= _LONGEST_QUANTITY else None


def coefficient(text: object, unit: str | None = None) -> float:
    """Read a positive size of a coefficient of any unit, in SI.

    Parameters
    ----------
    text : number and unit such as ``"100 ug/g^3"``; a pure number may be a bare one. In a product degC is a difference.
    unit : that it is to be converted to; None accepts every unit.

    Raises
    ------
    UnitError
        If it is no positive number with a known unit, or the unit is of another dimension.

    Examples
    --------
    >>> round(coefficient("100 ug/g^3", "(m/s²)⁻²") * 9.80665**2, 9)
    0.0001
    """
    written = str(text) if isinstance(text, str | int | float) and not isinstance(text, bool) else ""
    match = _parted(written)
    number = float(match["number"]) if match else math.nan
    rule = conversion(normalise(match["unit"] if match else "").replace("degC", "K") or "1")
    if not SMALLEST < number * rule.factor < LARGEST:
        raise UnitError(f"found {shown(text)}, expected a positive number with its unit")
    if unit is not None and not is_unit(unit):
        raise UnitError(f"its coefficients are in {unit}, for which there is no one size; leave the key out")
    if unit is not None and conversion(unit).si != rule.si:
        wanted = "a pure number" if unit == "1" else f"a size in {usual_unit(unit)[0]} or a unit that converts to it"
        raise UnitError(f"found {shown(text)}, expected {wanted}")
    return number * rule.factor


Sensitivity = tuple[float, str, str]
"""V, or counts, per SI unit of what is measured; "V" or "count"; and that SI unit."""


def sensitivity(text: object, kind: str | None = None) -> Sensitivity:
    """Read an electrical scale factor as a data sheet prints it, either way up: "0.25 V/g" or "4 um/count".

    Parameters
    ----------
    text : number and unit.
    kind : of what is measured, a key of `KINDS`; None accepts any.

    Raises
    ------
    UnitError
        If it is no such scale factor.

    Examples
    --------
    >>> sensitivity("0.25 V/g", "acceleration")[0] * 9.80665, sensitivity("4 um/count")
    (0.25, (250000.0, 'count', 'm'))
    """
    match = _parted(text) if isinstance(text, str) else None
    unit, number = (normalise(match["unit"]), float(match["number"])) if match else ("", 0.0)
    for signal, measured in (unit.partition("/")[::2], unit.rpartition("/")[::-2]):
        if number and measured and is_unit(signal) and conversion(signal).si in ELECTRICAL:
            inner = measured.strip()
            volts, rule = conversion(signal), conversion(inner[1:-1] if inner[:1] == "(" else inner, kind)
            upright = unit.startswith(signal)
            value = number * (volts.factor / rule.factor) if upright else volts.factor / (number * rule.factor)
            if SMALLEST < abs(value) < LARGEST:
                return value, volts.si, rule.si
    examples = SCALE_EXAMPLES.get(kind or "", SCALE_EXAMPLES["temperature"]).values()
    such = " or ".join(f'"{example}"' for example in examples)
    raise UnitError(f"{shown(text)} is no electrical scale factor; expected one that is not zero such as {such}")


ELECTRICAL = ("V", "count")
"""Units of the electrical signal of a sensor."""
SCALE_EXAMPLES = {
    "acceleration": {"V": "0.25 V/g", "count": "1024 count/g"},
    "length": {"V": "20 V/m", "count": "200 count/mm"},
    "speed": {"V": "20 V/(m/s)", "count": "1000 count/(m/s)"},
    "angle": {"V": "2 V/rev", "count": "4096 count/rev"},
    "temperature": {"V": "10 mV/degC", "count": "10 count/degC"},
}
"""Scale factors as a data sheet prints them, by kind of what is measured."""
ZERO_EXAMPLE = {"V": "2.5 V", "count": "2048 count"}


def is_measurable(value: float) -> bool:
    """Whether a number in SI is 0 or of a size whose squares and ratios a double holds."""
    return value == 0.0 or SMALLEST < abs(value) < LARGEST


SMALLEST, LARGEST = 1e-100, 1e100
"""In SI, of any unit."""


def _float(number: float) -> float:
    """A number of a file; infinite where an integer has too many digits for a float."""
    try:
        return float(number)
    except OverflowError:
        return math.inf


def shown(value: object) -> str:
    """A value of a file as messages show it: cut where it is long; Python writes no integer of thousands of digits."""
    try:
        text = repr(value)
    except ValueError:
        return "a number of thousands of digits"
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."


_SHOWN = 80
"""Characters of a value in a message."""
_LONGEST_QUANTITY = 1000
"""Characters of a number with its unit."""


@functools.lru_cache(_REMEMBERED)
def conversion(unit: str, kind: str | None = None) -> Conversion:
    """Find how `unit` converts to SI.

    Parameters
    ----------
    unit : as people write it: ``m/s^2``, ``m/s²``, ``mm/s**2``, ``m_per_s2``, ``ug/sqrt(Hz)``, ``µm`` (either µ); see
        `accelcal.data.units` for what a unit may be.
    kind : a key of `KINDS`; None accepts every dimension and converts to its SI base units.

    Raises
    ------
    UnitError
        If the unit is unknown or of another dimension than `kind`.
    """
    text = normalise(unit)
    conversion_known = _KIND_OF_SI.get(text)
    if conversion_known is not None and kind in (None, conversion_known):
        return Conversion(1.0, 0.0, text)
    conversion_known, factor = _FACTORS.get(text, ("", 0.0))
    if conversion_known and kind in (None, conversion_known):
        return Conversion(factor, 0.0, KINDS[conversion_known].si)
    if text in _TEMPERATURES and kind in (None, "temperature"):
        return _TEMPERATURES[text]

    parsed = _parsed(text)
    if parsed is None:
        close = difflib.get_close_matches(text[:LONGEST], _known_names(), n=1, cutoff=0.5)
        hint = f' (nearest known: "{close[0]}")' if close else "; expected one such as m/s^2, g, mm, V or degC"
        raise UnitError(f'unknown unit "{unit[:LONGEST]}"{hint}')
    if kind is None:
        kind = _kind_of(parsed)
    si = _si_text(parsed) if kind is None else KINDS[kind].si
    target = _parsed(si)
    if target is None or parsed.dimensionality != target.dimensionality:
        expected = KINDS[kind or "ratio"]
        raise UnitError(f'"{unit}" does not measure {expected.name}; expected a unit as in "{expected.example}"')
    return Conversion(_factor(unit, parsed, target), 0.0, si)


def _factor(unit: str, parsed: Any, target: Any) -> float:
    """How much of one pint unit the other is."""
    try:
        factor = float(_registry().Quantity(1.0, parsed).to(target).magnitude)
    except Exception:  # pint's own, where a temperature with a zero of its own is part of a product
        factor = 0.0
    if not math.isfinite(factor) or factor == 0.0:
        raise UnitError(f'"{unit}" converts by no finite factor; expected a unit such as "m/s^2"')
    return factor


def same_unit(a: str, b: str) -> bool:
    """Whether two texts name one unit ("m/s²" and "m_per_s2" do, "g" and "m/s^2" do not)."""
    try:
        return normalise(a) == normalise(b) or conversion(a) == conversion(b)
    except UnitError:
        return False


def is_unit(text: str) -> bool:
    """Whether `text` names a known unit."""
    name = normalise(text)
    if not (name in _KIND_OF_SI or name in _FACTORS or name in _TEMPERATURES) and _parsed(name) is None:
        return False  # without the search for a similar name, which a wide header of prose would pay for
    try:
        conversion(text)
    except UnitError:
        return False
    return True


def base_dimension(name: str) -> dict[str, float]:
    """Exponents of base units of the name of a unit, without angles; empty for a pure number.

    Raises
    ------
    UnitError
        If there is no such unit.

    Examples
    --------
    >>> base_dimension("m"), base_dimension("g"), base_dimension("deg")
    ({'m': 1.0}, {'m': 1.0, 's': -2.0}, {})
    """
    if name in _BASES.values():
        return {name: 1.0}
    parsed = _parsed(name)
    if parsed is None:
        raise UnitError(f"unknown unit {name!r}")
    return {
        _BASES.get(base, base): float(exponent) for base, exponent in parsed.dimensionality.items() if base != "[angle]"
    }


_BASES = {"[length]": "m", "[time]": "s", "[temperature]": "K"}
"""Base units by their dimension."""


def normalise(unit: str) -> str:
    """Write a unit in one spelling: ASCII ``^`` powers, ``u`` for micro, ``/`` for per, no spaces at the ends."""
    if len(unit) > LONGEST:
        return unit  # which is no unit
    text = _SUPERSCRIPT.sub(lambda run: "^" + run[0].translate(_DIGITS), unit.strip().translate(_SYMBOLS))
    text = text.replace("_per_", "/").replace("**", "^")
    text = _PER_SECOND_SQUARED.sub(lambda run: "m/s^2" if run[0] == text or "(" in text else "(m/s^2)", text)
    text = _IN_WORDS.get(text.lower().rstrip("."), text)
    text = re.sub(r"√\(?([A-Za-z]+)\)?|sqrt\(([^()]*)\)|\brt([A-Z][a-z]*)", _root, text)
    return re.sub(r"(?<=[A-Za-z])([23]|-[123])(?![\d.])", r"^\1", text)


_QUANTITY = re.compile(r"\s*(?P<number>[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(?P<unit>.*?)\s*", re.DOTALL)
_SYMBOLS = str.maketrans({"µ": "u", "μ": "u", "·": "*", "×": "*", "−": "-", "°": "deg", "%": "percent"})
_IN_WORDS = {
    f"{prefix}{word}{plural}": f"{letter}{unit}"
    for word, unit in (("second", "s"), ("meter", "m"), ("metre", "m"), ("volt", "V"))
    for prefix, letter in (("", ""), ("milli", "m"), ("micro", "u"), ("nano", "n"), ("centi", "c"))
    for plural in ("", "s")
} | {
    **{"sec": "s", "msec": "ms", "usec": "us", "minutes": "min", "hours": "h", "inches": "inch"},
    **{
        "degree": "deg",
        "degrees": "deg",
        "micron": "um",
        "microns": "um",
        "arcseconds": "arcsec",
        "arcminutes": "arcmin",
    },
    **dict.fromkeys(("cts", "digits", "ticks", "pulses", "increments", "steps"), "count"),
    **dict.fromkeys(("ink", "inkr", "inkremente", "imp", "impulse", "schritte", "striche"), "count"),
}
"""Units that exporters spell out or shorten, in lower case without a full stop; counts as loggers in English and in
German call them."""
_PER_SECOND_SQUARED = re.compile(r"(?<![A-Za-z])ms\^?-2(?!\d)")
"""Acceleration as charts of vibration sensors print it, in mV/ms⁻²; nobody means milliseconds by it."""
_SUPERSCRIPT = re.compile("[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+")
_DIGITS = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
_TEMPERATURES = {
    "degC": Conversion(1.0, 0.0, "degC"),
    "celsius": Conversion(1.0, 0.0, "degC"),
    "K": Conversion(1.0, -273.15, "degC"),
    "kelvin": Conversion(1.0, -273.15, "degC"),
    "degF": Conversion(5.0 / 9.0, -160.0 / 9.0, "degC"),
}


def _root(match: re.Match[str]) -> str:
    return f"({match[1] or match[2] or match[3]})^0.5"


@functools.lru_cache(_REMEMBERED)
def _parsed(text: str) -> Any:
    """Return pint's unit for a normalised text; None where it is no unit."""
    if text == "1":
        return _registry().parse_units("")
    if not is_legal(text):
        return None
    try:
        return _registry().parse_units(text.replace("^", "**"))
    except Exception:  # pint raises its own, tokenize's, and ArithmeticError, depending on the text
        return None


def _kind_of(parsed: Any) -> str | None:
    for name, kind in KINDS.items():
        if _parsed(kind.si).dimensionality == parsed.dimensionality:
            return name
    return None


def _si_text(parsed: Any) -> str:
    base = _registry().get_base_units(parsed)[1]
    return f"{base:~C}".replace("**", "^")


@functools.cache
def _known_names() -> list[str]:
    return sorted(
        {"m/s^2", "mm/s^2", "um", "mm", "mg", "ug", "mV", "ms", "us", "kPa", "hPa", "rad/s", "deg/s"} | set(_registry())
    )


@functools.cache
def _registry() -> Any:
    import pint

    registry: Any = pint.UnitRegistry(None, autoconvert_offset_to_baseunit=False)
    registry.load_definitions(_DEFINITIONS.strip().splitlines())
    return registry


def instant(t: float) -> str:
    """An instant or a span in s, to a millisecond (below 1 s to a microsecond), without powers of ten.

    Examples
    --------
    >>> instant(1234.5), instant(1.7e9 + 0.25), instant(0.0005)
    ('1234.5', '1700000000.25', '0.0005')
    """
    places = 3 if abs(t) >= 1.0 else 6
    return f"{round(float(t), places) + 0.0:.{places}f}".rstrip("0").rstrip(".")


MICRO_G = 1e-6 * 9.80665
"""1 ug in m/s²."""
NORMAL_95 = 1.96
"""Half of a 95 % interval in standard deviations."""

_USUAL = {
    "m/s²": ("mg", 1e3 * MICRO_G),
    "(m/s²)⁻¹": ("µg/g²", 1.0 / (1e6 * 9.80665)),
    "(m/s²)⁻²": ("µg/g³", 1.0 / (1e6 * 9.80665**2)),
    "rad": ("deg", math.pi / 180.0),
}
"""Unit of a coefficient -> the unit that test engineers use for it, and how much SI one of it is."""


def usual_unit(unit: str, *values: float) -> tuple[str, float]:
    """Name of the unit that test engineers use for values in an SI unit, and its size in SI.

    Lengths, speeds and times take the prefix in which the largest of the values is at least 1.

    Examples
    --------
    >>> usual_unit("m/s²", 0.05)[0], usual_unit("m", 2.7e-9, 1.7e-9)[0], usual_unit("s", 29.9)[0]
    ('mg', 'nm', 's')
    """
    if unit not in ("m", "m/s", "s"):
        return _USUAL.get(unit, (unit, 1.0))
    largest = max(map(abs, values), default=0.0)
    sizes = ((unit, 1.0), (f"m{unit}", 1e-3), (f"µ{unit}", 1e-6), (f"n{unit}", 1e-9))
    return next((size for size in sizes if largest >= size[1]), sizes[0] if largest == 0.0 else sizes[-1])


def in_usual_unit(value: float, unit: str, digits: int = 3, sign: str = "") -> str:
    """A time, a length or an angle for a sentence, with a prefix; everything else in its own unit.

    Examples
    --------
    >>> in_usual_unit(0.0051, "s"), in_usual_unit(2e-6, "m", sign="+"), in_usual_unit(0.02, "1")
    ('5.1 ms', '+2 µm', '0.02')
    >>> in_usual_unit(3.02e-7, "m", 2)
    '300 nm'
    """
    name, size = usual_unit(unit, value) if unit in ("s", "m", "rad") else (unit, 1.0)
    text = f"{value / size:{sign}.{digits}g}"
    if "e+" in text and abs(value / size) < 1e5:
        text = f"{float(text):{sign}.0f}"
    return f"{text} {name}".removesuffix(" 1").rstrip()


MOST_PLACES = 12
"""Decimals of a plain number."""


def decimal(value: float, std: float) -> str:
    """A value with its uncertainty to two digits of that, without powers of ten as far as twelve decimals go.

    Examples
    --------
    >>> decimal(9.99e-4, 2.0e-5), decimal(95640.0, 280.0), decimal(0.05, 0.0)
    ('0.000999 ± 0.000020', '95640 ± 280', '0.05')
    """
    if not (math.isfinite(std) and std > 0.0):
        return np.format_float_positional(float(f"{value:.4g}"), trim="-").replace("-", "−")
    last = 1 - math.floor(math.log10(std))
    places = min(MOST_PLACES, max(0, last))
    return f"{round(value, last) + 0.0:.{places}f} ± {round(std, last):.{places}f}".replace("-", "−")


def in_usual_size(value: float, uncertainty: float, unit: str) -> str:
    """A time or a length with its uncertainty and a prefix; everything else in its own unit.

    Examples
    --------
    >>> in_usual_size(1.48167e-5, 8.1e-7, "s"), in_usual_size(24.8609, 19.0, "1"), in_usual_size(5995.95, 11.0, "Hz")
    ('14.82 ± 0.81 µs', '25 ± 19', '5996 ± 11 Hz')
    """
    name, size = usual_unit(unit, value, uncertainty) if unit in ("s", "m") else (unit, 1.0)
    return f"{decimal(value / size, uncertainty / size)} {name}".removesuffix(" 1")


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


__dir__ = listing(globals())
