"""What may be a unit at all: names with small exponents, before any library computes with the text."""

from __future__ import annotations

import re

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
    found, at = [], 0
    text = text.rstrip()
    while at < len(text):
        part = _TOKEN.match(text, at)
        if part is None:
            return None
        if part["name"]:
            if part["name"].startswith(_DIFFERENCE):
                return None
            found.append("n")
        elif part["exponent"]:
            kind = _exponent(part["exponent"])
            if kind is None:
                return None
            found.append(kind)
        else:
            found.append(part["mark"])
        at = part.end()
    return "".join(found)


def _exponent(text: str) -> str | None:
    number = text.strip("()")
    if _ROOT.fullmatch(number):
        return "r"
    if not _INTEGER.fullmatch(number):
        return None
    size = abs(int(number))
    return None if size > MOST_EXPONENT else "s" if size <= MOST_GROUP_EXPONENT else "e"
