"""What was found of an immutable object, kept for as long as the object lives: a recording is judged once, not again
by each fit and each comparison."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Hashable
from typing import Any, TypeVar

Found = TypeVar("Found")

_kept: dict[int, dict[str, tuple[Hashable, Any]]] = {}
"""By identity of the object: under each name the last question and its answer."""


def found_before(of: object, name: str, question: Hashable, find: Callable[[], Found]) -> Found:
    """The answer to a question about an object, which is found once while the last question of this name is the same.

    Parameters
    ----------
    of : immutable, and weak references to it can be made.
    name : of what is asked; one answer is kept for each.
    question : what the answer depends on beside the object.
    find : finds the answer, which must not refer to the object: it would live for ever.

    Examples
    --------
    >>> class Record:
    ...     pass
    >>> record = Record()
    >>> [found_before(record, "length", "m", lambda: print("measured") or 3) for _ in range(2)]
    measured
    [3, 3]
    """
    answers = _kept.get(id(of))
    if answers is None:
        answers = _kept[id(of)] = {}
        weakref.finalize(of, _kept.pop, id(of), None).atexit = False
    known = answers.get(name)
    if known is not None and known[0] == question:
        answer: Found = known[1]
        return answer
    answer = find()
    answers[name] = question, answer
    return answer
