"""What a model of a sensor with three outputs lacks, one axis after the other."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import ClassVar

from accelcal._support.errors import AccelcalError
from accelcal._support.process import within
from accelcal._support.result import Result
from accelcal._support.values import immutable
from accelcal.data import Recording
from accelcal.diagnosis.verdict import Diagnosis
from accelcal.effects import find
from accelcal.effects.registry import on_axis
from accelcal.estimation.estimate import Fit


@immutable
@dataclass(frozen=True, slots=True)
class AxesDiagnosis(Result):
    """What a model lacks on each output of a sensor with three, examined together at one false-alarm rate."""

    derived: ClassVar[tuple[str, ...]] = ("verdict", "sentence", "effects")

    axes: tuple[str, ...]
    by_axis: tuple[Diagnosis, ...]
    """One for each axis, in the same order."""

    def __getitem__(self, axis: str) -> Diagnosis:
        """Return the diagnosis of one axis."""
        return self.by_axis[self.axes.index(axis)]

    def __repr__(self) -> str:
        return f"AxesDiagnosis({self.verdict}: {self.sentence})"

    @property
    def verdict(self) -> str:
        """That of the axis that lacks most; "adequate" where none lacks anything."""
        lacking = [judged for judged in self.by_axis if judged.verdict != "adequate"]
        return max(lacking, key=strength).verdict if lacking else "adequate"

    @property
    def sentence(self) -> str:
        """What was examined, and what each axis lacks."""
        examined = " and ".join((", ".join(self.axes[:-1]), self.axes[-1]))
        sentences = [f"{a}: {judged.sentence}" for a, judged in zip(self.axes, self.by_axis, strict=True)]
        return f"Axes {examined} examined together. " + " ".join(sentences)

    @property
    def effects(self) -> tuple[str, ...]:
        """Effects that would enter, those of the sensor with their axis (cubic_on_y), what lacks most first; one that
        all axes lack stands without."""
        pairs = sorted(zip(self.axes, self.by_axis, strict=True), key=lambda pair: -strength(pair[1]))
        missing = {axis: judged.effects for axis, judged in pairs}
        common = set.intersection(*map(set, missing.values()))
        names = (
            name if name in common or find(name).owner not in ("sensor", "mounting") else on_axis(find(name), axis).name
            for axis, several in missing.items()
            for name in several
        )
        return tuple(dict.fromkeys(names))


def strength(judged: Diagnosis) -> float:
    """Equivalent standard deviations of the first candidate of a diagnosis that lacks something; 0 of any other."""
    candidates = judged.scan.candidates
    return candidates[0].snr if judged.verdict != "adequate" and candidates else 0.0


def diagnose_axes(
    fit: Fit,
    recordings: Sequence[Recording],
    diagnose: Callable[..., Diagnosis],
    progress: Callable[[float], None],
    *,
    alpha: float,
    **settings: object,
) -> AxesDiagnosis:
    """Say what a model lacks on each output of a sensor, at one false-alarm rate over all of them.

    Parameters
    ----------
    fit : of all outputs together; what they share is held by it, as far as it is known.
    recordings : of each axis one or several.
    diagnose : examines one axis.
    progress : called with the share of the work that is done, 0 to 1.
    alpha : of all axes together; each has its share.
    settings : of `diagnose`.

    Raises
    ------
    AccelcalError
        If some of the recordings are of a sensor with one output.
    """
    axes = tuple(dict.fromkeys(recording.axis for recording in recordings))
    if "" in axes:
        raise AccelcalError(
            "recordings of one output and of an axis of three in one diagnosis; give the axes of load_axes, or "
            "recordings of one output alone"
        )
    judged = []
    for number, axis in enumerate(axes):
        share = within(progress, number / len(axes), (number + 1) / len(axes))
        runs = [recording for recording in recordings if recording.axis == axis]
        judged.append(diagnose(fit.of_axis(axis), runs, alpha=alpha / len(axes), progress=share, **settings))
    return AxesDiagnosis(axes, tuple(judged))
