"""Array types, arrays of other packages, answers that stay, and the stretch about a place at which flags hold."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Annotated, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from accelcal._support.values import face

VANISHING = 1e-9
"""Share of the largest below which rounding alone leaves something: of an eigenvalue, a power, a gain."""


@dataclass(frozen=True)
class Stored:
    """Kind of the numbers of an array, by which JSON restores it."""

    kind: type[np.generic]

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        return face("results.json").array_schema(self.kind)


Array = Annotated[NDArray[np.float64], Stored(np.float64)]
Flags = Annotated[NDArray[np.bool_], Stored(np.bool_)]
Counts = Annotated[NDArray[np.int64], Stored(np.int64)]
Places = NDArray[np.intp]


Answer = TypeVar("Answer")


class Unchanged:
    """Answers that stay as long as the arrays and numbers that they were found for.

    Examples
    --------
    >>> unchanged = Unchanged()
    >>> [unchanged("sum", (np.ones(n),), lambda: n) for n in (3, 3, 4)]
    [3, 3, 4]
    """

    def __init__(self) -> None:
        self.last: dict[Hashable, tuple[tuple[Any, ...], Any]] = {}

    def __call__(self, question: Hashable, given: tuple[Any, ...], find: Callable[[], Answer]) -> Answer:
        """The answer to a question for given arrays and numbers, found again where one differs from the last."""
        before, last = self.last.get(question, ((), None))
        same = len(before) == len(given) and all(map(np.array_equal, before, given))
        answer: Answer = last if same else find()
        self.last[question] = given, answer
        return answer


def copied(values: Any) -> NDArray[Any]:
    """Values of an array of any package, which later changes of that array do not reach.

    NaN stands for what the mask of NumPy or the NA of pandas says was not sampled.

    Examples
    --------
    >>> copied(np.ma.masked_array([1, 2, 3], [False, True, False]))
    array([ 1., nan,  3.])
    """
    kind = getattr(getattr(values, "dtype", None), "kind", "")
    if kind in tuple("fiu") and hasattr(values, "isna"):
        return np.array(values.to_numpy(dtype=np.float64, na_value=np.nan))
    if kind in tuple("fiu") and np.ma.isMaskedArray(values):
        return np.array(np.ma.filled(values.astype(np.float64), np.nan))
    return np.array(values)


def stretch_about(flags: Flags, at: int) -> tuple[int, int]:
    """First and last index of the unbroken stretch of flags (n,) that hold about `at`, where one holds.

    Examples
    --------
    >>> stretch_about(np.array([True, False, True, True, False]), 3)
    (2, 3)
    """
    outside = np.flatnonzero(~flags)
    place = int(np.searchsorted(outside, at))
    first = int(outside[place - 1]) + 1 if place > 0 else 0
    last = int(outside[place]) - 1 if place < len(outside) else len(flags) - 1
    return first, last
