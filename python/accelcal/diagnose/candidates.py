"""What could be missing: every effect of the catalogue at each of its trial shapes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from accelcal.effects import HOUSE, Effect, find, side_channels
from accelcal.model import Model, Term, terms_of
from accelcal.passes import Pass
from accelcal.recording import Array
from accelcal.shaping import linearised

JUMPS = 8
"""Instants at which a jump of the encoder is tried."""


@dataclass(frozen=True, slots=True)
class Item:
    """An effect at given shape parameters: what can enter a set."""

    effect: Effect
    shape: Mapping[str, float]
    looks: int = 1
    """Alternatives that this one was picked from before it was tried."""

    @property
    def terms(self) -> tuple[Term, ...]:
        """Its coefficients."""
        return terms_of(self.effect, self.shape)


def candidates_for(one: Pass, model: Model, extra: Sequence[Effect] = ()) -> list[Item]:
    """Every effect that could be missing from a model on this record, at each of its trial shapes."""
    s = one.signals
    assert s is not None
    recorded = [(name, channel.unit) for name, channel in one.run.recording.side.items()]
    offered = (*HOUSE, *side_channels(recorded), *extra)
    items = []
    for effect in offered:
        taken = effect.name in model.effects or not effect.visible or effect.port == "noise"
        if taken or any(name not in s.side for name in effect.needs):
            continue
        grids = {name: shape.grid(s) for name, shape in effect.shapes.items()}
        looks = 1
        if effect.port == "position" and "instant" in grids:
            grids["instant"] = jumps(one)
            looks = max(1, int(s.length * 2.0 * np.pi * one.run.crossover(one.noise)))
        for values in _product(grids):
            items.append(Item(effect, values, looks))
    return items


def jumps(one: Pass) -> Array:
    """Instants at which readings may have jumped, on the clock of the effects, s, (at most 8,).

    The filter forgets a jump within its own time constant, so no coarse grid of instants would meet it: those where
    innovations add up most over one time constant are tried.
    """
    span = max(1, int(1.0 / (2.0 * np.pi * one.run.crossover(one.noise) * one.run.reading_step)))
    y = np.where(one.counts, one.whitened, 0.0)
    loud = np.abs(np.convolve(y, np.ones(span), mode="full")[span - 1 :])
    found: list[float] = []
    for _ in range(JUMPS):
        k = int(np.argmax(loud))
        found.append(float(one.run.t[k] - 0.5 * one.run.reading_step - one.run.origins.t))
        loud[max(0, k - 4 * span) : k + 4 * span] = 0.0
    return np.array(sorted(found))


def _product(grids: Mapping[str, Array]) -> list[dict[str, float]]:
    combined: list[dict[str, float]] = [{}]
    for name, values in grids.items():
        combined = [{**old, name: float(value)} for old in combined for value in values]
    return combined


def nuisances(one: Pass, model: Model) -> list[tuple[Term, float]]:
    """What is known not to be known, with its standard deviation.

    The shape parameters of the effects that are in the model: an effect that mends the shape of one that is there
    must not be paid for it.

    The time constant of the low-pass is carried in every judgement, with the five percent of the delay rule where no
    tolerance is declared: five percent of a millisecond is more than a delay when the motion is fast.
    """
    tolerance = one.run.rig.lowpass_tolerance
    assert one.signals is not None
    known = [(Term(find("lowpass_error")), tolerance)] if tolerance > 0.0 else []
    bends = linearised(model, one.values, one.signals, one.information)
    return known + [(bend.term, bend.belief) for bend in bends]
