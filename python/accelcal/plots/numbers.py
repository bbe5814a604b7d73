"""What figures show: numbers and labels that static figures, interactive figures and the report share."""

from __future__ import annotations

from accelcal.diagnosis.search.scan import Candidate
from accelcal.diagnosis.verdict import Diagnosis
from accelcal.results import words as formatting
from accelcal.results.comparisons import source_of_noise
from accelcal.validation.comparison import Evaluation
from accelcal.validation.differences import Comparison
from accelcal.validation.stretches import headline_horizon, quoted_error

TWO_SIDED_95 = 1.96
CANDIDATES = 12
"""Candidates that are drawn."""


def drift_headline(comparison: Evaluation) -> str:
    """The drift that is quoted first, with its noise floor."""
    horizon = headline_horizon(comparison)
    if horizon is None:
        return "Unaided drift: the record is too short"
    floor = comparison.drift_floors.get(horizon)
    beside = "" if floor is None else f", noise floor {formatting.length(floor)}"
    return f"Unaided drift after {horizon:g} s: {formatting.length(quoted_error(comparison, horizon))} rms{beside}"


def imposed_band_note(comparison: Evaluation) -> str:
    """A remark where predicted deviations are not valid."""
    return (
        ""
        if comparison.nis is not None
        else "; the fit used a prescribed band, so its predicted deviations are not valid"
    )


def error_reduction_sentence(comparison: Comparison) -> str:
    """The error of the first and of the last model in one sentence."""
    errors = comparison.errors
    text = f"{formatting.length(errors[0])}"
    if len(errors) > 1:
        text += f" → {formatting.length(errors[-1])}"
    measure = comparison.measure[:1].upper() + comparison.measure[1:]
    return f"{measure}: {text}; {floor_sentence(comparison)}"


def floor_sentence(comparison: Comparison) -> str:
    """The noise floor with its interval and its source."""
    floor = comparison.floor
    ends = f"{formatting.length(floor.low)} to {formatting.length(floor.high)}"
    return f"noise alone {ends} ({source_of_noise(comparison.noise_floor.sensor)})"


def share_text(comparison: Comparison, number: int) -> str:
    """What a step did to the error: the part of the excess over noise that it removes, and whether that is all."""
    share = comparison.shares[number]
    if number and comparison.at_floor[number] and comparison.at_floor[number - 1]:
        return "within the noise"
    if share is None:
        return "within the noise" if comparison.at_floor[number] else ""
    if share < 0.0:
        return "error rises"
    if comparison.at_floor[number]:
        return f"{round(100.0 * min(share, 1.0))} % of the excess explained, down to the noise"
    return f"{min(round(100.0 * share), 99)} % of the excess explained"


def candidate_groups(diagnosis: Diagnosis, most: int = CANDIDATES) -> list[list[Candidate]]:
    """The best candidates, each class of confounded ones together, best first."""
    left = list(diagnosis.scan.candidates[:most])
    found: list[list[Candidate]] = []
    while left:
        first = left[0]
        sure = first.p_value < diagnosis.alpha
        tied = [c for c in left[1:] if sure and c.effect in first.members and c.p_value < diagnosis.alpha]
        group = [first, *tied]
        found.append(group)
        left = [c for c in left if c not in group]
    return found
