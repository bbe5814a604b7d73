"""No number that is not finite leaves in an export: one guard over everything that is written."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass

import numpy as np

from accelcal._support.errors import AccelcalError

NEGATIVE = 1e-9
"""Share of the largest variance by which rounding may make an eigenvalue of a covariance negative."""


class NotExportable(AccelcalError):
    """A model that cannot become a function of one reading. The text names the effects and the next step."""


def require_finite(parts: Mapping[str, object]) -> None:
    """Refuse NaN and infinity anywhere in what is exported.

    Parameters
    ----------
    parts : by the words that name each in a sentence: numbers, arrays, or objects that hold some.

    Raises
    ------
    NotExportable
        Naming the first part with a number that is not finite.
    """
    for words, part in parts.items():
        for value in numbers(part):
            if not math.isfinite(value):
                raise NotExportable(
                    f"{words} {'is not a number' if math.isnan(value) else 'is infinite'}, so nothing is exported; fit "
                    "the model again: accelcal fit RUN.csv -o MODEL.json"
                )


def require_covariance(P: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> None:
    """Refuse a covariance that gives some combination of parameters a negative variance.

    Raises
    ------
    NotExportable
        If it has a negative eigenvalue beyond rounding.
    """
    if not len(P):
        return
    size = np.sqrt(np.maximum(np.diag(P), 0.0))
    C = P / np.outer(size, size).clip(min=1e-300)
    if np.any(np.diag(P) < 0.0) or float(np.linalg.eigvalsh(0.5 * (C + C.T))[0]) < -NEGATIVE * len(P):
        raise NotExportable(
            "the covariance of the parameters is not positive semi-definite, so no uncertainty follows from it and "
            "nothing is exported; fit the model again: accelcal fit RUN.csv -o MODEL.json"
        )


def numbers(part: object) -> Iterator[float]:
    """Every number in a part, however deep."""
    if isinstance(part, float | np.floating):
        yield float(part)
    elif isinstance(part, np.ndarray):
        yield from part.astype(np.float64).ravel().tolist()
    elif isinstance(part, Mapping):
        for value in part.values():
            yield from numbers(value)
    elif is_dataclass(part) and not isinstance(part, type):
        for each in fields(part):
            yield from numbers(getattr(part, each.name))
    elif isinstance(part, Sequence) and not isinstance(part, str):
        for value in part:
            yield from numbers(value)
