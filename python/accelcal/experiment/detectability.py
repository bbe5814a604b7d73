"""Detection limits of every effect on a record or a plan, and the effects that it confounds: the results."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Annotated

import numpy as np

from accelcal._support.errors import AccelcalError
from accelcal._support.result import NotStored, Result
from accelcal._support.values import immutable
from accelcal.experiment.detection_probability import DetectionModel
from accelcal.experiment.drift_bandwidth import DriftBandwidth


@dataclass(frozen=True, slots=True)
class Detectability:
    """Detection limit of one effect, at the trial shape at which it is most visible."""

    effect: str
    unit: str
    shape: Mapping[str, float]
    parts: tuple[str, ...]
    """Names of its columns; one empty name where it has one column, or where its one coefficient is an intensity."""
    d: tuple[float, ...]
    """Standard deviations per unit coefficient, by part, the base projected out."""
    smallest: tuple[float, ...]
    """Size that is detected with 95 % probability, by part, in `unit`; infinite where the effect is not visible."""
    largest: float
    """Largest contribution at that size, of the most visible part."""
    largest_unit: str
    """m/s², or m for what acts on the encoder."""
    members: tuple[str, ...]
    """Effects whose signature is confounded with its own, itself first."""
    experiment: str
    """Experiment that separates them."""

    @property
    def seen(self) -> bool:
        """Whether it is visible before it is as large as the motion itself."""
        return math.isfinite(min(self.smallest))


@dataclass(frozen=True, slots=True)
class Group:
    """Effects whose signatures are nearly equal, and the experiment that separates them."""

    members: tuple[str, ...]
    correlation: float
    """Least |rho| between the first and the others."""
    experiment: str


@immutable
@dataclass(frozen=True, slots=True)
class Power(Result):
    """What a record, or a planned motion, can detect."""

    detectabilities: tuple[Detectability, ...]
    """In the order of the catalogue."""
    ties: tuple[Group, ...]
    examined: int
    """Alternatives that `diagnose` would examine."""
    blocks: int
    """Effective blocks."""
    alpha: float
    detection_model: Annotated[
        DetectionModel | None, NotStored("accelcal.power(recording) makes it from the recording")
    ] = field(repr=False, compare=False)
    """Model from which probabilities of detection are simulated; None in one that was pickled."""
    name: str = ""
    drift: DriftBandwidth | None = None
    """Detectable drift bandwidth; None where a plan of several is only compared."""

    def __repr__(self) -> str:
        seen = sum(each.seen for each in self.detectabilities)
        return f"Power({self.name!r}: {seen} of {len(self.detectabilities)} effects are detectable)"

    @property
    def of_run(self) -> DetectionModel:
        """The model of the run.

        Raises
        ------
        ValueError
            If it was left behind when this was pickled.
        """
        if self.detection_model is None:
            raise AccelcalError("this was pickled, without the run; accelcal.power(model, recording) makes it anew")
        return self.detection_model

    def __getstate__(self) -> list[object]:
        """What a pickle holds: all but the model of the run, which is as large as the recording."""
        return [None if f.name == "detection_model" else getattr(self, f.name) for f in fields(self)]

    def __copy__(self) -> Power:
        return self

    def __deepcopy__(self, memo: object) -> Power:
        return self

    def _ipython_key_completions_(self) -> list[str]:
        """Names that a notebook offers behind power[."""
        return [each.effect for each in self.detectabilities]

    def __getitem__(self, effect: str) -> Detectability:
        """Return the detection limit of `effect`."""
        for detectability in self.detectabilities:
            if detectability.effect == effect:
                return detectability
        known = ", ".join(s.effect for s in self.detectabilities)
        raise KeyError(f"{effect!r} is in the model or cannot be tested on this record; it has {known}")

    def detection(self, effect: str, size: float | Sequence[float], shape: Mapping[str, float] | None = None) -> float:
        """Probability that any effect enters when `effect` is present at a given size.

        Rivals share its signature in part and have their own share of the noise, so one of them may enter where the
        effect just fails; the search refines shapes and divides significance by the scatter of blocks. All of that is
        simulated (:mod:`accelcal.experiment.detection_probability`); `predicted_detection` is the probability that an
        effect enters on its own.

        Parameters
        ----------
        effect : name.
        size : coefficient in its unit, the intensity of a random process; of several parts one value for each, or
            a single one for the most visible part.
        shape : its shape parameters; by default the most visible one.
        """
        detectability = self[effect]
        truth = self.of_run.item(effect, detectability.shape if shape is None else shape)
        sizes = np.atleast_1d(np.asarray(size, dtype=np.float64))
        if len(sizes) == 1 and len(detectability.parts) > 1:
            sizes = sizes * (np.arange(len(detectability.parts)) == int(np.argmax(detectability.d)))
        if len(sizes) != len(detectability.parts):
            raise AccelcalError(
                f"{effect!r} has {len(detectability.parts)} parts ({', '.join(detectability.parts)}), not {len(sizes)}"
            )
        return self.of_run.detection(truth, sizes)
