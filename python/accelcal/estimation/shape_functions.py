"""Fitted families as functions of their variable, with pointwise standard uncertainty."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from accelcal._support.values import listing
from accelcal.data.arrays import Array
from accelcal.effects import Variable, find
from accelcal.effects.building_blocks import since_reversal
from accelcal.effects.curves import AGES
from accelcal.estimation.estimate import Fit
from accelcal.signals.signals import Signals

POINTS = 201
STROKE = 0.1
"""Stroke of the motion on which a response to reversals is evaluated, m; the response does not depend on it."""


@dataclass(frozen=True, slots=True)
class Shape:
    """One function with its pointwise standard uncertainty."""

    effect: str
    label: str
    """Branch of the function; empty where there is one."""
    variable: str
    variable_unit: str
    unit: str
    x: Array
    """(n,) in `variable_unit`, on the clock and scale of the recording."""
    value: Array
    """(n,) in `unit`"""
    std: Array
    """(n,) in `unit`"""


def shapes(fit: Fit) -> tuple[Shape, ...]:
    """Every family in a model, as the function that was fitted."""
    found: list[Shape] = []
    for name in fit.model.added:
        family = find(name).family
        if family is None:
            continue
        if family.variable.letter == "reversal":
            found += [_since_reversal(fit, name, direction) for direction in (1.0, -1.0)]
        elif {"low", "start"} & set(fit.model.shapes.get(name, {})):
            found.append(_over_variable(fit, name, family.variable))
    return tuple(found)


def _over_variable(fit: Fit, name: str, variable: Variable) -> Shape:
    """The function over the range of its variable; a response to velocity or acceleration per unit of it."""
    given = fit.model.shapes[name]
    low, high = (given["low"], given["high"]) if "low" in given else (given["start"], given["start"] + given["length"])
    x = np.linspace(low, high, POINTS)
    motion = {"v": np.ones(POINTS), "a": np.ones(POINTS)} | {variable.letter: x}
    t, p, v, a, jerk = (motion.get(key, np.zeros(POINTS)) for key in ("t", "p", "v", "a", "jerk"))
    side = {"temperature": x, "a_y": x}
    s = Signals(t=t, p=p, v=v, a=a, jerk=jerk, scale=fit.values().scale, rig=fit.rig, side=side)
    origins = fit.origins
    origin = {"t": origins.t, "p": origins.p}.get(variable.letter, origins.of(variable.letter))
    return _shape(fit, name, "", variable.name, variable.unit, s, x + origin, np.ones(POINTS, dtype=bool))


def _since_reversal(fit: Fit, name: str, direction: float) -> Shape:
    """Response to one reversal: the stage moves at a steady speed, turns, and moves back."""
    t = np.linspace(-AGES[-1], AGES[-1], 8 * POINTS)
    p = direction * STROKE * np.abs(t) / AGES[-1]
    zero = np.zeros(len(t))
    s = Signals(t=t, p=p, v=np.gradient(p, t), a=zero, jerk=zero, scale=fit.values().scale, rig=fit.rig)
    age = since_reversal(s)
    after = t > t[np.flatnonzero(age == 0.0)[-1]]
    label = "after turning to forwards" if direction > 0.0 else "after turning to backwards"
    return _shape(fit, name, label, "time since reversal", "s", s, age, after)


def _shape(
    fit: Fit, name: str, label: str, variable: str, variable_unit: str, s: Signals, x: Array, rows: Array
) -> Shape:
    effect = find(name)
    columns = effect.column(s, **fit.model.shapes.get(name, {}))
    terms = [term.name for term in fit.model.terms if term.effect.name == name]
    value = columns @ np.array([fit[term].value for term in terms])
    free = [e.name for e in fit.free]
    kept = [i for i, term in enumerate(terms) if term in free]
    at = [free.index(terms[i]) for i in kept]
    covariance = fit.covariance[np.ix_(at, at)]
    variance = np.einsum("ni,ij,nj->n", columns[:, kept], covariance, columns[:, kept])
    std = np.sqrt(np.maximum(variance, 0.0))
    return Shape(name, label, variable, variable_unit, effect.unit, x[rows], value[rows], std[rows])


__dir__ = listing(globals())
