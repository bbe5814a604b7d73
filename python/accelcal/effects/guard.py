"""What a user's effect may do when it is evaluated: its inputs stay, its values are finite, its time is bound."""

from __future__ import annotations

import functools
import inspect
import math
import os
import re
import time
import traceback
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from accelcal._support.errors import OBEYED_IN_NAMES, AccelcalError
from accelcal.data import Array, instant
from accelcal.signals.signals import Signals

LEAST_SECONDS = 0.2
"""Processor time that any evaluation may take, s."""
SECONDS_A_SAMPLE = 50e-6
"""Processor time that one sample may take, s: some 100 times what the dearest effect of the catalogue needs, and ten
times what a loop in Python over the samples does."""


class EffectsFileError(AccelcalError):
    """An effect of the user's own cannot be used. The text names file and effect and states what to change."""


Sentence = Callable[[str], str]
"""From what is wrong, with the effect as its subject, to a whole sentence with file and line."""
Failure = Callable[[Exception], str]
"""The same from an exception that the effect raised."""
Function = Callable[..., Array]
Bounds = tuple[float, float] | Callable[[Signals], tuple[float, float]]
PACKAGE = str(Path(__file__).parents[1]) + os.sep
LONGEST = 200
"""Characters of a name, a unit, a symbol or a source."""
_NAME = re.compile(r"[A-Za-z_]\w{0,63}", re.ASCII)


class Guarded:
    """A function of an effect, every evaluation of which is looked at.

    Parameters
    ----------
    function : of the user's own.
    width : number of columns that it returns.
    sentence, failure : how to name it in an :class:`EffectsFileError`.

    Notes
    -----
    Arrays are handed out read-only. Values at samples where a signal is itself not finite are let pass.
    """

    def __init__(self, function: Function, width: int, sentence: Sentence, failure: Failure) -> None:
        functools.update_wrapper(self, function)
        self._function, self._width = function, width
        self._sentence, self._failure = sentence, failure

    def __call__(self, s: Signals, **shape: float) -> Array:
        if s.a.dtype == object:  # symbols of an export
            return self._function(s, **shape)
        given = read_only(s)
        try:
            values, seconds = timed(self._function, given, shape)
            budget = LEAST_SECONDS + SECONDS_A_SAMPLE * len(s.t)
            if seconds > budget:  # once more: the first call may compile or import
                values, seconds = timed(self._function, given, shape)
        except EffectsFileError:
            raise
        except Exception as error:
            raise EffectsFileError(self._failure(error)) from None
        if seconds > budget:
            raise EffectsFileError(
                self._sentence(
                    f"takes {seconds:.2g} s of processor time at {len(s.t)} times; {budget:.2g} s are allowed. Replace "
                    "loops by operations on whole arrays"
                )
            )
        return values_of(values, s, self._width, self._sentence)


def is_trusted(function: Function) -> bool:
    """Whether a function is one of accelcal, or guarded already; all others are code of the user."""
    code = getattr(function, "__code__", None)
    return isinstance(function, Guarded) or (code is not None and code.co_filename.startswith(PACKAGE))


def words_for(function: Function, name: str) -> tuple[Sentence, Failure]:
    """How to name an effect of the user: by the file and the line of its function, where it has any."""
    path, first = place_of(function)
    subject = f"effect {name!r}"
    if not path:
        return lambda wrong: f"{subject} {wrong}", lambda error: f"{subject} does not evaluate: {text_of(error)}"
    return (
        lambda wrong: f"{path}, line {first}: {subject} {wrong}",
        lambda error: f"{path}, line {line_of(path, error, first)}: {subject} does not evaluate: {text_of(error)}",
    )


def require_declared(name: Any, texts: Mapping[str, Any], scale: Any, sentence: Sentence) -> None:
    """Refuse an effect of the user whose declaration no model file can hold.

    Raises
    ------
    EffectsFileError
        If its name is none, a text is long or not plain, or its typical size is not positive.
    """
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise EffectsFileError(sentence("needs a name of letters, digits and underscores, such as cable_pull"))
    for words, text in texts.items():
        if not isinstance(text, str) or len(text) > LONGEST or OBEYED_IN_NAMES.search(text):
            raise EffectsFileError(sentence(f"needs a {words} of at most {LONGEST} plain characters"))
    if not isinstance(scale, float | int) or not (math.isfinite(scale) and scale > 0.0):
        raise EffectsFileError(sentence(f"has the typical size {scale!r:.40}; expected a positive number"))


def place_of(function: Function) -> tuple[str, int]:
    """The file that a function was compiled from, and its first line; an empty name where it is no function."""
    inner = inspect.unwrap(function)
    return (inner.__code__.co_filename, inner.__code__.co_firstlineno) if inspect.isfunction(inner) else ("", 1)


def text_of(error: BaseException) -> str:
    """Text of an exception, on one line."""
    if isinstance(error, KeyError):
        return f"there is no {error.args[0]!r} here; a side channel must be named in needs=(...)"
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__


def line_of(path: str, error: BaseException, otherwise: int = 1) -> int:
    """The last line of a file that was being run."""
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == path]
    return lines[-1] or otherwise if lines else otherwise


def timed(function: Callable[..., Any], s: Signals, shape: Mapping[str, float]) -> tuple[Any, float]:
    """What a function returns, and the processor time of this thread that it took, s."""
    began = time.thread_time()
    with np.errstate(all="ignore"):  # what is not finite is refused afterwards
        values = function(s, **shape)
    return values, time.thread_time() - began


def values_of(answer: Any, s: Signals, width: int, sentence: Sentence) -> Array:
    """What an effect returned as real numbers, (n,) or (n, width).

    Raises
    ------
    EffectsFileError
        If it is something else, or not finite where the signals are.
    """
    wanted = (len(s.t),) if width == 1 else (len(s.t), width)
    expected = f"return real numbers of shape {wanted}"
    if answer is None:
        raise EffectsFileError(sentence(f"returns None; {expected}"))
    try:
        array = np.asarray(answer)
    except ValueError:
        raise EffectsFileError(sentence(f"returns rows of different lengths; {expected}")) from None
    if array.dtype.kind not in "biuf":
        kind = {"c": "complex numbers", "O": "objects"}.get(array.dtype.kind, f"values of type {array.dtype}")
        raise EffectsFileError(sentence(f"returns {kind}; {expected}"))
    if array.shape != wanted:
        raise EffectsFileError(sentence(f"returns shape {array.shape} at {len(s.t)} times; return {wanted}"))
    values = array.astype(np.float64)
    if not np.all(np.isfinite(values)):
        finite = np.all([np.isfinite(y) for y in (s.t, s.p, s.v, s.a, s.jerk, *s.side.values())], axis=0)
        wrong = finite & ~np.all(np.isfinite(values.reshape(len(s.t), -1)), axis=1)
        if np.any(wrong):
            first = float(s.t[int(np.argmax(wrong))])
            raise EffectsFileError(
                sentence(
                    f"returns values that are not finite at {int(np.sum(wrong))} of {len(s.t)} times, first at "
                    f"t = {instant(first)} s; guard divisions and roots"
                )
            )
    return values


def read_only(s: Signals) -> Signals:
    """The same signals, side channels as they were recorded but for temperature; their arrays cannot be written."""
    return replace(
        s,
        t=_locked(s.t),
        p=_locked(s.p),
        v=_locked(s.v),
        a=_locked(s.a),
        jerk=_locked(s.jerk),
        side=MappingProxyType({name: _locked(y + s.side_origins.get(name, 0.0)) for name, y in s.side.items()}),
        side_origins={},
        whole=None if s.whole is None else read_only(s.whole),
    )


def _locked(y: Array) -> Array:
    view = np.asarray(y).view()
    view.flags.writeable = False
    return view


def guarded_bounds(declared: Bounds, spacing: str, name: str, sentence: Sentence) -> Bounds:
    """Bounds of a shape parameter; those that depend on the motion are looked at when they are asked for."""

    def checked(interval: Any) -> tuple[float, float]:
        try:
            low, high = (float(end) for end in interval)
        except (TypeError, ValueError):
            low, high = math.nan, math.nan
        if not (math.isfinite(low) and math.isfinite(high) and low <= high):
            raise EffectsFileError(sentence(f"has no bounds of {name}: found {interval!r:.60}, expected two numbers"))
        if spacing == "log" and not low > 0.0:
            raise EffectsFileError(sentence(f"tries {name} on a logarithmic grid from {low:g}; begin above 0"))
        return low, high

    if not callable(declared):
        return checked(declared)

    def bounds(s: Signals) -> tuple[float, float]:
        try:
            interval = declared(read_only(s))
        except Exception as error:
            raise EffectsFileError(sentence(f"has no bounds of {name}: {type(error).__name__}: {error}")) from None
        return checked(interval)

    return bounds
