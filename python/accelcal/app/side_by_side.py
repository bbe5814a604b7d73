"""Two models side by side: parameters with their differences in joint sigma, and the errors of both."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from accelcal.app.state import State
from accelcal.data.recording import RecordingError, require_same_sensor
from accelcal.estimation.estimate import Fit
from accelcal.estimation.noise_effects import NoiseEffect
from accelcal.model import Estimate


@dataclass(frozen=True, slots=True)
class Difference:
    """One parameter of two models."""

    name: str
    unit: str
    first: Estimate | NoiseEffect | None
    """None where the model does not have it."""
    second: Estimate | NoiseEffect | None

    @property
    def value(self) -> float | None:
        """Second less first, SI; None where one of them does not have it."""
        return None if self.first is None or self.second is None else self.second.value - self.first.value

    @property
    def std(self) -> float:
        """Joint standard uncertainty of two independent fits, SI."""
        return math.hypot(*(e.std for e in (self.first, self.second) if e is not None))

    @property
    def sigma(self) -> float | None:
        """The difference in joint standard uncertainties; None where there is none."""
        return None if self.value is None or not self.std > 0.0 else self.value / self.std


def differences(first: Fit, second: Fit) -> list[Difference]:
    """Parameters of two models, in the order of the first; those of timing are of the first recording."""
    one, two = by_name(first), by_name(second)
    names = [*one, *(name for name in two if name not in one)]
    return [Difference(name, (one.get(name) or two[name]).unit, one.get(name), two.get(name)) for name in names]


def by_name(fit: Fit) -> dict[str, Estimate | NoiseEffect]:
    """Parameters by name, effects on noise among them."""
    return {e.name: fit[e.name] for e in (*fit.estimates, *fit.shapes)} | {e.name: e for e in fit.noise_effects}


def same_sensor(fits: Sequence[Fit], state: State) -> bool:
    """Whether models can be compared with the held-out data of a session: no other sensor is declared."""
    try:
        for fit in fits:
            for recording in state.unseen:
                require_same_sensor(recording, fit.rig, "the model")
    except RecordingError:
        return False
    return True
