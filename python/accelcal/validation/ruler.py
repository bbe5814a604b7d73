"""One ruler for all models of a table: noise of the filter, low-pass of the motion, and start points of each.

Every fit has a noise of its own, which also holds what its model lacks. Errors that are taken with different filters
cannot be compared: start states, settling times and bands differ. So a table has one, chosen once.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass, field, replace

from accelcal._support.errors import AccelcalError
from accelcal.effects import find, is_local
from accelcal.estimation.estimate import Fit
from accelcal.estimation.values import Noise


@dataclass(frozen=True, slots=True)
class Ruler:
    """Filter under which several models are compared."""

    noise: Noise
    """Of the filter that makes start states and one-step predictions."""
    cutoff: float
    """Bandwidth of the motion that effects are evaluated on, Hz."""
    remembers: bool = False
    """Whether an effect of one of the models has a memory: all are then run over the history of what is compared."""
    remembering: tuple[Fit, ...] = field(default=(), compare=False)
    """Those models: all are followed from the fewer start points of these."""
    nodes: dict[Hashable, float] = field(default_factory=dict, compare=False, repr=False)
    """Spacing of the nodes of their motion, by recording and part of it, s."""

    @classmethod
    def of(cls, fits: Sequence[Fit]) -> Ruler:
        """The filter of that model of a table whose fitted noise of the sensor is least: a missing effect adds to it.

        Raises
        ------
        ValueError
            If there is no model.
        """
        best = min(fits, key=lambda fit: fit.noise().usual.q, default=None)
        if best is None:
            raise AccelcalError("a comparison of several models needs at least one of them")
        remembering = tuple(fit for fit in fits if not all(is_local(find(name)) for name in fit.model.added))
        return cls(best.noise(), best.validity["frequency"][1], bool(remembering), remembering)

    def held_by(self, fit: Fit) -> Fit:
        """The fit with this filter in place of its own."""
        first, *others = fit.runs
        ruled = replace(first, noise=replace(first.noise, noise=self.noise))
        validity = {**fit.validity, "frequency": (fit.validity["frequency"][0], self.cutoff)}
        return replace(fit, runs=(ruled, *others), validity=validity)
