"""Array types, arrays of other packages, answers that stay, and the stretches in which flags hold."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable
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


def median_step(t: Array) -> float:
    """Median spacing of stamps (n,)."""
    return float(np.median(np.diff(t)))


def root_mean_square(y: Array) -> float:
    """Root mean square of samples."""
    return float(np.sqrt(np.mean(y**2)))


def running_integral(y: Array, step: Array | float) -> Array:
    """Integral of samples (n, ...) from the first to each, by trapezia; `step` from one to the next, (n - 1, ...)."""
    return np.concatenate([np.zeros((1, *y.shape[1:])), np.cumsum(0.5 * step * (y[1:] + y[:-1]), axis=0)])


def white_variance(y: Array) -> float:
    """Variance of white noise in samples (n,), robustly, from third differences: of variance R they have 20 R."""
    third = np.diff(y, 3)
    return (float(np.median(np.abs(third - np.median(third)))) / 0.6745) ** 2 / 20.0


def unit_diagonal(A: Array) -> tuple[Array, Array]:
    """Symmetric matrix (m, m) scaled to a unit diagonal, and the roots (m,) of its own; empty rows stay empty."""
    size = np.sqrt(np.maximum(np.diag(A), 1e-300))
    return A / np.outer(size, size), size


def batches(count: int, most: int) -> list[slice]:
    """So many rows in stretches of at most `most`; the last has what is left.

    Examples
    --------
    >>> batches(5, 2)
    [slice(0, 2, None), slice(2, 4, None), slice(4, 5, None)]
    """
    return [slice(begin, min(begin + most, count)) for begin in range(0, count, most)]


def runs_of(flags: Flags) -> NDArray[np.intp]:
    """First index of each run of flags (n,) that hold, and the index behind its last, (k, 2).

    Examples
    --------
    >>> runs_of(np.array([True, False, True, True])).tolist()
    [[0, 1], [2, 4]]
    """
    return np.flatnonzero(np.diff(flags, prepend=False, append=False)).reshape(-1, 2)


def within_spans(spans: NDArray[np.intp] | Iterable[tuple[int, int]], count: int) -> Flags:
    """Whether each of `count` places lies in a span: from its first index to before its second, (count,)."""
    inside = np.zeros(count, dtype=np.bool_)
    for begin, end in spans:
        inside[begin:end] = True
    return inside


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
