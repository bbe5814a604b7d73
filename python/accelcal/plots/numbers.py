"""What figures show: numbers and labels that static figures, interactive figures and the report share."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from accelcal import formatting
from accelcal.data.arrays import Array
from accelcal.data.units import MICRO_G, instant
from accelcal.diagnosis.search.scan import Candidate
from accelcal.diagnosis.verdict import Diagnosis
from accelcal.selection.nested_models import NestedModels
from accelcal.validation.comparison import Comparison, Region
from accelcal.validation.sensor_noise import SOURCES, Source
from accelcal.validation.stretches import headline_horizon, quoted_error

TWO_SIDED_95 = 1.96
LAGS = 40
"""Of the autocorrelation; fewer on short records."""
TRANSIENT = 1.5
"""Predicted deviations beyond this many medians, as before the filter has settled, do not size the axis."""
QUANTILES = 2000
"""Points of a Q-Q plot; as many again at each end are all drawn."""
CANDIDATES = 12
"""Candidates that are drawn."""


def normal_quantiles(y: Array) -> tuple[Array, Array]:
    """Normal quantiles and those of `y` (n,): all of them at the two ends, evenly chosen ones between."""
    n = len(y)
    rank = np.arange(n)
    if n > 3 * QUANTILES:
        between = np.linspace(QUANTILES, n - 1 - QUANTILES, QUANTILES).astype(np.intp)
        rank = np.unique(np.concatenate([rank[:QUANTILES], between, rank[-QUANTILES:]]))
    return np.asarray(special.ndtri((rank + 0.5) / n)), np.sort(y)[rank]


def allowed_horizons(found: Mapping[float, float | None]) -> tuple[Array, Array]:
    """Horizons that the record allows, s, with their values, (n,) each."""
    pairs = [(h, y) for h, y in sorted(found.items()) if y is not None]
    return np.array([h for h, _ in pairs]), np.array([y for _, y in pairs])


def drift_headline(comparison: Comparison) -> str:
    """The drift that is quoted first, with its noise floor."""
    horizon = headline_horizon(comparison)
    if horizon is None:
        return "Unaided drift: the record is too short"
    floor = comparison.drift_floors.get(horizon)
    beside = "" if floor is None else f", noise floor {formatting.length(floor)}"
    return f"Unaided drift after {horizon:g} s: {formatting.length(quoted_error(comparison, horizon))} rms{beside}"


@dataclass(frozen=True, slots=True)
class OneStep:
    """One-step residuals as they are drawn over time."""

    t: Array
    """(n,) s"""
    e: Array
    """(n,)"""
    reach: Array
    """Half-width of their 95 % band, (n,)."""
    edge: float
    """Half-height of an axis that holds both."""
    unit: str
    headline: str


def one_step_residuals(comparison: Comparison) -> OneStep:
    """Residuals in metres; where the reference is no position, over their standard deviations."""
    (t, e), std, unit = comparison.residual, comparison.residual_std, "m"
    what = f"One-step residuals: rms {formatting.length(comparison.one_step_rms)}"
    if comparison.innovations is not None:
        (t, e), unit = comparison.innovations, "1"
        std = np.ones_like(e)
        what = f"Innovations over their predicted deviation: rms {math.sqrt(np.mean(e**2)):.3f}"
    reach = TWO_SIDED_95 * std
    settled = std <= TRANSIENT * np.median(std)
    edge = 1.15 * float(max(np.abs(e[settled]).max(), reach[settled].max()))
    share = f"{100.0 * float(np.mean(np.abs(e) <= reach)):.1f} % of {formatting.grouped(len(e))} inside the 95 % band"
    return OneStep(t, e, reach, edge, unit, f"{what}, {share}{imposed_band_note(comparison)}")


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


def named_models(models: Comparison | Sequence[tuple[str, Comparison]]) -> list[tuple[str, Comparison]]:
    """Comparisons with their names; that of a single model has none.

    Raises
    ------
    ValueError
        If there is no model.
    """
    several = [("", models)] if isinstance(models, Comparison) else list(models)
    if not several:
        raise ValueError("an overlay needs at least one comparison")
    return several


def fit_text(seen: Comparison) -> str:
    """The fit of one model in percent."""
    if seen.fit_percent is None:
        return "too short for a fit in percent"
    return f"fit {formatting.percent(seen.fit_percent)}"


def overlay_headline(models: Sequence[tuple[str, Comparison]]) -> str:
    """How well the current model gives the output, in one sentence."""
    name, current = models[-1]
    of = f" ({name})" if name else ""
    return f"Measured and simulated output{of}: {fit_text(current)} below {current.band:.3g} Hz"


REGION_HEAD = ("variable", "range", "excess", "sigma", "share of residual", "p")
"""Columns of the table of where a model fails."""
REGION_NOTE = (
    "the worst region of each variable: mean residual, its share of the mean square residual, and p adjusted for the "
    "number of all regions"
)


def region_cells(region: Region) -> tuple[str, ...]:
    """One row of the table of where a model fails: variable, range, excess, deviation, share, adjusted p value."""
    factor, unit = (1.0, region.unit)
    if unit not in ("s", "Hz"):
        factor, unit = formatting.prefixed(unit, region.low, region.high)
    low, high = (
        instant(x) if region.variable == "time" else formatting.number(x * factor) for x in (region.low, region.high)
    )
    if region.excess_unit == "1":
        excess = f"{formatting.number(region.excess, 3)} × noise"
    else:
        by, excess_unit = formatting.prefixed(region.excess_unit, region.excess)
        excess = formatting.with_unit(formatting.typeset(f"{region.excess * by:+.3g}"), excess_unit)
    return (
        region.variable,
        formatting.with_unit(f"{low} to {high}", unit),
        excess,
        f"{abs(region.sigma):.1f}",
        "–" if region.share is None else f"{formatting.number(100.0 * max(region.share, 0.0), 2)} %",
        formatting.probability(region.p),
    )


def region_rows(comparison: Comparison) -> list[tuple[str, ...]]:
    """The table of where a model fails, worst region first."""
    return [region_cells(region) for region in comparison.worst_regions]


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


def density(value: float) -> str:
    """A noise density for people."""
    return f"{value / MICRO_G:.3g} µg/√Hz"


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
