"""Largest contribution of each effect over the used range, and whether it exceeds the declared tolerance."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from accelcal.diagnosis.noise_tests.noise_test import NoiseTest
from accelcal.diagnosis.search.scan import Candidate
from accelcal.effects import CATALOGUE, find
from accelcal.estimation.estimate import Fit
from accelcal.estimation.run_state import RunState
from accelcal.model import evaluate


@dataclass(frozen=True, slots=True)
class Size:
    """Largest contribution of one effect over the used range."""

    value: float
    at_encoder: bool = False
    """In m, added to the reading; otherwise in m/s², added to the output."""


@dataclass(frozen=True, slots=True)
class Importance:
    """Named effects, divided by their largest contribution over the used range."""

    tolerance: float
    """Declared, m/s²."""
    matters: tuple[str, ...]
    below: tuple[str, ...]
    not_comparable: tuple[str, ...]
    """Effects on the encoder's reading: metres have no tolerance in m/s²."""


def split(names: Iterable[str], sizes: Mapping[str, Size], tolerance: float | None) -> Importance | None:
    """Which of some effects exceed a declared tolerance; None where none is declared."""
    if tolerance is None:
        return None
    groups: dict[str, list[str]] = {"matters": [], "below": [], "not_comparable": []}
    for name in names:
        size = sizes.get(name)
        if size is None or size.at_encoder:
            groups["not_comparable"].append(name)
        else:
            groups["matters" if size.value >= tolerance else "below"].append(name)
    return Importance(tolerance, *(tuple(group) for group in groups.values()))


def sizes_of(
    fit: Fit, states: Sequence[RunState], candidates: Sequence[Candidate], tests: Sequence[NoiseTest]
) -> dict[str, Size]:
    """Largest contribution over all runs of every effect of the model, of candidates, and of what noise tests found.

    The contribution of an effect of several columns is their sum.
    """
    found = {c.effect: Size(c.largest, find(c.effect).port == "position") for c in reversed(candidates)}
    for test in tests:
        size = contribution_of_test(test, states)
        if size is not None:
            found[test.effect] = max(size, found.get(test.effect, size), key=lambda state: state.value)
    in_model: dict[str, Size] = {}
    for number, state in enumerate(states):
        values = fit.values(number)
        total: dict[str, np.ndarray] = {}
        for term, column in zip(values.terms, evaluate(values.terms, state.signals), strict=True):
            contribution = values.by_name[term.name] * column
            total[term.effect.name] = total.get(term.effect.name, 0.0) + contribution
        for name, y in total.items():
            largest = max(float(np.max(np.abs(y))), in_model[name].value if name in in_model else 0.0)
            in_model[name] = Size(largest, find(name).port == "position")
    return {**found, **in_model}


def contribution_of_test(test: NoiseTest, states: Sequence[RunState]) -> Size | None:
    """Largest contribution of an effect that a noise test found; None where it has no size."""
    effect = CATALOGUE.get(test.effect)
    if effect is None or effect.traits.noise is None:
        return None
    value = effect.traits.noise.size_of(test.estimate, test.parts, [state.signals for state in states])
    return None if value is None else Size(value, at_encoder=effect.owner == "encoder")
