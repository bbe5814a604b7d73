"""Example recordings with a hidden effect: what they show, how they are made, and the answer."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from accelcal.data.recording import Recording
from accelcal.demo import TRUTH, with_effect
from accelcal.effects import find, spelled
from accelcal.estimation.run import prepare
from accelcal.results.words import with_unit
from accelcal.simulation.sensor import CXL02_RIG, simulate


@dataclass(frozen=True, slots=True)
class Example:
    """A recording that is simulated when it is asked for; the same one every time."""

    title: str
    about: str
    """What was recorded, without the answer."""
    motion: str
    """Profile of `accelcal.simulation.motion`."""
    effect: str
    """What is hidden: a name of the catalogue."""
    size: float
    """Its coefficient, SI."""
    seed: int
    seconds: float = 40.0

    @property
    def answer(self) -> str:
        """The hidden effect with its true coefficient, a sentence."""
        size = with_unit(f"{self.size:g}", find(self.effect).unit)
        return f"Hidden: {spelled(self.effect)}, with the coefficient {size}."

    def record(self) -> Recording:
        """Simulate the recording."""
        rng = np.random.default_rng(self.seed)
        made = simulate(self.motion, seconds=self.seconds, rig=CXL02_RIG, parameters=TRUTH, rng=rng)
        return with_effect(made, find(self.effect), self.size, {}, prepare(made.recording).origins)


EXAMPLES: Mapping[str, Example] = MappingProxyType(
    {
        "stage": Example(
            "A positioning stage",
            "It moves, stops and moves back. Without position the model drifts by centimetres within seconds.",
            "moves",
            "coulomb",
            2e-2,
            1,
        ),
        "shaker": Example(
            "A shaker",
            "Bursts of vibration with rests between them. What the sensor says depends on how hard it is shaken.",
            "bursts",
            "quadratic",
            2e-3,
            2,
        ),
        "mixed": Example(
            "Moves and bursts",
            "Slow moves and fast bursts in turn. Two effects look alike here; the product says which, and how to "
            "separate them.",
            "interleaved",
            "cubic",
            1e-3,
            1,
        ),
    }
)
"""By the name of the file that each becomes: example_NAME.csv."""
PREFIX = "example_"


def example_of(path: Path | None) -> Example | None:
    """The example that a recording of this name is; None where it is none."""
    if path is None or not path.stem.startswith(PREFIX):
        return None
    return EXAMPLES.get(path.stem.removeprefix(PREFIX))
