"""What a user's effect may do when it is evaluated: its inputs stay, its values are finite, its time is bound."""

from __future__ import annotations

import functools
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np

from accelcal.data.arrays import Array
from accelcal.data.units import instant
from accelcal.effects.registry import Effect, Shape
from accelcal.signals.signals import Signals

LEAST_SECONDS = 0.2
"""Processor time that any evaluation may take, s."""
SECONDS_A_SAMPLE = 50e-6
"""Processor time that one sample may take, s: some 100 times what the dearest effect of the catalogue needs, and ten
times what a loop in Python over the samples does."""


class EffectsFileError(ValueError):
    """An effect of the user's own cannot be used. The text names file and effect and states what to change."""


Sentence = Callable[[str], str]
"""From what is wrong, with the effect as its subject, to a whole sentence with file and line."""
Failure = Callable[[Exception], str]
"""The same from an exception that the effect raised."""


def guarded(effect: Effect, sentence: Sentence, failure: Failure) -> Effect:
    """The effect, every evaluation of which is looked at.

    Parameters
    ----------
    effect : of the user's own.
    sentence, failure : how to name it in an :class:`EffectsFileError`.

    Notes
    -----
    Arrays are handed out read-only. Values at samples where a signal is itself not finite are let pass.
    """

    @functools.wraps(effect.function)
    def function(s: Signals, **shape: float) -> Array:
        given = read_only(s)
        try:
            found, seconds = timed(effect.function, given, shape)
            budget = LEAST_SECONDS + SECONDS_A_SAMPLE * len(s.t)
            if seconds > budget:  # once more: the first call may compile or import
                found, seconds = timed(effect.function, given, shape)
        except EffectsFileError:
            raise
        except Exception as error:
            raise EffectsFileError(failure(error)) from None
        if seconds > budget:
            raise EffectsFileError(
                sentence(
                    f"takes {seconds:.2g} s of processor time at {len(s.t)} times; {budget:.2g} s are allowed. Replace "
                    "loops by operations on whole arrays"
                )
            )
        return values_of(found, s, effect.width, sentence)

    shapes = {key: replace(one, bounds=_guarded_bounds(one, key, sentence)) for key, one in effect.shapes.items()}
    return replace(effect, function=function, shapes=MappingProxyType(shapes))


def timed(function: Callable[..., Any], s: Signals, shape: Mapping[str, float]) -> tuple[Any, float]:
    """What a function returns, and the processor time of this thread that it took, s."""
    began = time.thread_time()
    with np.errstate(all="ignore"):  # what is not finite is refused afterwards
        found = function(s, **shape)
    return found, time.thread_time() - began


def values_of(found: Any, s: Signals, width: int, sentence: Sentence) -> Array:
    """What an effect returned as real numbers, (n,) or (n, width).

    Raises
    ------
    EffectsFileError
        If it is something else, or not finite where the signals are.
    """
    wanted = (len(s.t),) if width == 1 else (len(s.t), width)
    expected = f"return real numbers of shape {wanted}"
    if found is None:
        raise EffectsFileError(sentence(f"returns None; {expected}"))
    try:
        array = np.asarray(found)
    except ValueError:
        raise EffectsFileError(sentence(f"returns rows of different lengths; {expected}")) from None
    if array.dtype.kind not in "biuf":
        kind = {"c": "complex numbers", "O": "objects"}.get(array.dtype.kind, f"values of type {array.dtype}")
        raise EffectsFileError(sentence(f"returns {kind}; {expected}"))
    if array.shape != wanted:
        raise EffectsFileError(sentence(f"returns shape {array.shape} at {len(s.t)} times; return {wanted}"))
    values = array.astype(np.float64)
    if not np.all(np.isfinite(values)):
        known = np.all([np.isfinite(y) for y in (s.t, s.p, s.v, s.a, s.jerk, *s.side.values())], axis=0)
        wrong = known & ~np.all(np.isfinite(values.reshape(len(s.t), -1)), axis=1)
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
    """The same signals; their arrays cannot be written."""
    return replace(
        s,
        t=_locked(s.t),
        p=_locked(s.p),
        v=_locked(s.v),
        a=_locked(s.a),
        jerk=_locked(s.jerk),
        side=MappingProxyType({name: _locked(y) for name, y in s.side.items()}),
        whole=None if s.whole is None else read_only(s.whole),
    )


def _locked(y: Array) -> Array:
    view = np.asarray(y).view()
    view.flags.writeable = False
    return view


def _guarded_bounds(
    shape: Shape, name: str, sentence: Sentence
) -> tuple[float, float] | Callable[[Signals], tuple[float, float]]:
    """Bounds of a shape parameter; those that depend on the motion are looked at when they are asked for."""
    declared = shape.bounds

    def checked(found: Any) -> tuple[float, float]:
        try:
            low, high = (float(end) for end in found)
        except (TypeError, ValueError):
            low, high = math.nan, math.nan
        if not (math.isfinite(low) and math.isfinite(high) and low <= high):
            raise EffectsFileError(sentence(f"has no bounds of {name}: found {found!r:.60}, expected two numbers"))
        if shape.spacing == "log" and not low > 0.0:
            raise EffectsFileError(sentence(f"tries {name} on a logarithmic grid from {low:g}; begin above 0"))
        return low, high

    if not callable(declared):
        return checked(declared)

    def bounds(s: Signals) -> tuple[float, float]:
        try:
            found = declared(read_only(s))
        except Exception as error:
            raise EffectsFileError(sentence(f"has no bounds of {name}: {type(error).__name__}: {error}")) from None
        return checked(found)

    return bounds
