"""Columns that are the same, or multiples of one another: carried once, whatever their sizes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from accelcal.data.arrays import Array
from accelcal.effects import Effect
from accelcal.model import Term
from accelcal.signals.signals import Signals

TIMES = 256
"""Times at which two columns are compared."""


def multiples(terms: Sequence[Term], s: Signals) -> dict[int, tuple[int, float]]:
    """Of each term whose column is a multiple of an earlier one's, or the same: index of the first, and the factor."""
    first: dict[tuple[object, ...], int] = {}
    known: dict[tuple[object, ...], Array] = {}

    def size(k: int) -> float:
        effect, shape = terms[k].effect, terms[k].shape
        key = (effect.name, *sorted(shape.items()))
        if key not in known:
            known[key] = sizes(effect, shape, s)
        return float(known[key][terms[k].part])

    found = {}
    for k, term in enumerate(terms):
        effect = term.effect
        held = {n: value for n, value in term.shape.items() if not (effect.basis and effect.shapes[n].refined)}
        key = (effect.basis or effect.name, term.port, term.part, *sorted(held.items()))
        source = first.setdefault(key, k)
        if source != k:
            found[k] = source, size(k) / size(source) if effect.basis else 1.0
    return found


def sizes(effect: Effect, shape: Mapping[str, float], s: Signals) -> Array:
    """Size of each column of an effect with a basis, in a unit that is the same for all shapes, (width,)."""
    few = s.at(slice(None, None, max(1, len(s.t) // TIMES)))
    return np.asarray(np.linalg.norm(effect.column(few, **shape).reshape(len(few.t), -1), axis=0))
