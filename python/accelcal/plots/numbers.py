"""What figures show: numbers and labels that static figures, interactive figures and the report share."""

from __future__ import annotations

from accelcal.diagnosis.search.scan import Candidate
from accelcal.diagnosis.verdict import Diagnosis
from accelcal.results import words as formatting
from accelcal.results.comparisons import density
from accelcal.selection.nested_models import NestedModels
from accelcal.validation.comparison import Comparison
from accelcal.validation.sensor_noise import SOURCES, Source
from accelcal.validation.stretches import headline_horizon, quoted_error

TWO_SIDED_95 = 1.96
CANDIDATES = 12
"""Candidates that are drawn."""


def drift_headline(comparison: Comparison) -> str:
    """The drift that is quoted first, with its noise floor."""
    horizon = headline_horizon(comparison)
    if horizon is None:
        return "Unaided drift: the record is too short"
    floor = comparison.drift_floors.get(horizon)
    beside = "" if floor is None else f", noise floor {formatting.length(floor)}"
    return f"Unaided drift after {horizon:g} s: {formatting.length(quoted_error(comparison, horizon))} rms{beside}"


def imposed_band_note(comparison: Comparison) -> str:
    """A remark where predicted deviations are not valid."""
    return (
        ""
        if comparison.nis is not None
        else "; the fit used a prescribed band, so its predicted deviations are not valid"
    )


def model_names(nested: NestedModels) -> list[str]:
    """Name of each model: the base, then the effect that is new, or the finer form of a curve that it holds already."""
    found: list[str] = []
    for member in nested.models:
        name = f"+ {member.effect.replace('_', ' ')}" if member.effect else "base"
        found.append(f"{name}, finer" if name in found else name)
    return found


def nested_comparisons(nested: NestedModels) -> list[tuple[str, Comparison]]:
    """Comparisons of all models with the names that figures give them."""
    return list(zip(model_names(nested), (member.heldout for member in nested.models), strict=True))


def error_reduction_sentence(nested: NestedModels) -> str:
    """The error of the first and of the last model in one sentence."""
    errors = nested.errors
    text = f"{formatting.length(errors[0])}"
    if len(errors) > 1:
        text += f" → {formatting.length(errors[-1])}"
    measure = nested.measure[:1].upper() + nested.measure[1:]
    return f"{measure}, on held-out data: {text}; {floor_sentence(nested)}"


def floor_sentence(nested: NestedModels) -> str:
    """The noise floor with its interval and its source."""
    floor, sensor = nested.floor, nested.noise_floor.sensor
    ends = f"{formatting.length(floor.low)} to {formatting.length(floor.high)}"
    return f"noise alone {ends} ({source_of_noise(sensor.source, sensor.density, sensor.declared)})"


def source_of_noise(source: Source, value: float, declared: float | None) -> str:
    """Where a noise density comes from, and the declared one where it differs, both in (m/s²)/sqrt(Hz)."""
    beside = "" if declared is None else f"; declared {density(declared)}"
    return f"{SOURCES[source]} {density(value)}{beside}"


def share_text(nested: NestedModels, number: int) -> str:
    """What a step did to the error: the part of the excess over noise that it removes, and whether that is all."""
    share = nested.shares[number]
    if number and nested.at_floor[number] and nested.at_floor[number - 1]:
        return "within the noise"
    if share is None:
        return "within the noise" if nested.at_floor[number] else ""
    if share < 0.0:
        return "error rises"
    if nested.at_floor[number]:
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
