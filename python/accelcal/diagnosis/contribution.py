"""How large each effect is over the used range, and whether it matters to the user."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from accelcal.diagnosis.noise_tests.noise_test import NoiseTest
from accelcal.diagnosis.search.scan import Candidate
from accelcal.effects import find
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
    """Named effects, split by what they contribute at most over the used range."""

    tolerance: float
    """Declared, m/s²."""
    matters: tuple[str, ...]
    below: tuple[str, ...]
    not_comparable: tuple[str, ...]
    """Effects on the encoder's reading: metres have no tolerance in m/s²."""


def split(names: Iterable[str], sizes: Mapping[str, Size], tolerance: float | None) -> Importance | None:
    """Which of some effects matter under a declared tolerance; None where none is declared."""
    if tolerance is None:
        return None
    kinds: dict[str, list[str]] = {"matters": [], "below": [], "not_comparable": []}
    for name in names:
        size = sizes.get(name)
        if size is None or size.at_encoder:
            kinds["not_comparable"].append(name)
        else:
            kinds["matters" if size.value >= tolerance else "below"].append(name)
    return Importance(tolerance, *(tuple(kind) for kind in kinds.values()))


def sizes_of(
    fit: Fit, passes: Sequence[RunState], candidates: Sequence[Candidate], tests: Sequence[NoiseTest]
) -> dict[str, Size]:
    """Largest contribution over all runs of every effect of the model, of candidates, and of what tests found.

    An effect of several columns is taken as their sum.
    """
    found = {c.effect: Size(c.largest, find(c.effect).port == "position") for c in reversed(candidates)}
    for test in tests:
        size = of_test(test, passes)
        if size is not None:
            found[test.effect] = max(size, found.get(test.effect, size), key=lambda one: one.value)
    inside: dict[str, Size] = {}
    for number, one in enumerate(passes):
        values = fit.values(number)
        total: dict[str, np.ndarray] = {}
        for term, column in zip(values.terms, evaluate(values.terms, one.signals), strict=True):
            part = values.by_name[term.name] * column
            total[term.effect.name] = total.get(term.effect.name, 0.0) + part
        for name, y in total.items():
            largest = max(float(np.max(np.abs(y))), inside[name].value if name in inside else 0.0)
            inside[name] = Size(largest, find(name).port == "position")
    return {**found, **inside}


def of_test(test: NoiseTest, passes: Sequence[RunState]) -> Size | None:
    """Largest contribution of an effect that the mean cannot see; None where it has no size."""
    if test.effect in ("vibration", "tone"):
        return Size(test.estimate)
    if test.effect == "accelerometer_outliers":
        return Size(test.parts["largest"])
    if test.effect == "encoder_outliers":
        return Size(test.parts["largest"], at_encoder=True)
    if test.effect == "encoder_cyclic":
        return Size(test.estimate, at_encoder=True)
    if test.effect == "quantisation" and test.estimate > 0.0:
        return Size(0.5 * test.estimate)  # rounding errs by half a step
    if test.effect == "timing_jitter":
        jerk = max(one.values.scale * float(np.max(np.abs(one.signals.jerk))) for one in passes if one.signals)
        return Size(test.estimate * jerk)
    return None
