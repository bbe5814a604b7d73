"""What could be missing: every effect of the catalogue at each of its trial shapes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from accelcal.diagnose.picks import jumps, waves
from accelcal.effects import HOUSE, Effect, find, side_channels
from accelcal.model import Model, Term, terms_of
from accelcal.passes import Pass
from accelcal.recording import Array
from accelcal.shaping import linearised, signals_of


@dataclass(frozen=True, slots=True)
class Item:
    """An effect at given shape parameters: what can enter a set."""

    effect: Effect
    shape: Mapping[str, float]
    looks: int = 1
    """Alternatives that this one was picked from before it was tried."""
    near: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Where the shape parameters that were picked may be refined."""

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
        if effect.port == "position" and "instant" in effect.shapes:
            looks = max(1, int(s.length * 2.0 * np.pi * one.run.crossover(one.noise)))
            items += [Item(effect, {"instant": t}, looks, {"instant": (t, t)}) for t in jumps(one)]
        elif effect.name == "rail_wave":
            items += [Item(effect, {"period": w.period}, w.looks, {"period": w.near}) for w in waves(one)]
        else:
            grids = {name: shape.grid(s) for name, shape in effect.shapes.items()}
            items += [Item(effect, values) for values in _product(grids)]
    return items


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
    known = [(Term(find("lowpass_error")), tolerance)] if tolerance > 0.0 else []
    bends = linearised(model, one.values, signals_of(one), one.information)
    return known + [(bend.term, bend.belief) for bend in bends]
