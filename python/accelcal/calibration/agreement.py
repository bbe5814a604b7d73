"""Whether two calibrations of one sensor agree: differences with their joint uncertainty, and what changed between."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from accelcal._support.values import listing
from accelcal.calibration.characteristic import (
    COVERAGE_FACTOR,
    STATIC,
    Budget,
    budget,
    characteristic,
    expanded_uncertainty,
    standard_uncertainty,
)
from accelcal.data import MICRO_G, Array, RunLabels
from accelcal.effects import spelled
from accelcal.estimation.estimate import Fit
from accelcal.estimation.noise import REMARKED_BEYOND
from accelcal.estimation.tracks import POINTS
from accelcal.model import Estimate

LIMIT = 1.0
"""Of |En|: within it two results agree (ISO 13528, ISO/IEC 17043)."""
BEYOND_BY_CHANCE = math.erfc(COVERAGE_FACTOR / math.sqrt(2.0))
"""Probability that |En| of two results that agree exceeds 1, for coverage factor 2 and normal distributions."""

DIFFERENT_RANGE = 0.1
"""Share of its length by which a range is another one."""

Span = tuple[float, float]
Verdict = Literal["agree", "differ", "not comparable"]


@dataclass(frozen=True, slots=True)
class ComparedParameter:
    """One coefficient in two calibrations; None where a model does not have it."""

    name: str
    symbol: str
    unit: str
    owner: str
    first: Estimate | None
    second: Estimate | None
    expanded: tuple[float, float]
    """Expanded uncertainties of both, coverage factor 2; NaN where there is no value."""

    @property
    def difference(self) -> float | None:
        """Second less first."""
        return None if self.first is None or self.second is None else self.second.value - self.first.value

    @property
    def joint(self) -> float | None:
        """Expanded uncertainty of the difference of independent results."""
        return None if self.difference is None else math.hypot(*self.expanded)

    @property
    def en(self) -> float | None:
        """The difference over its expanded uncertainty; None where there is none, as of a coefficient that is held."""
        return self.difference / self.joint if self.difference is not None and self.joint else None


@dataclass(frozen=True, slots=True)
class ComparedCharacteristic:
    """The difference of two static outputs over the accelerations that both fits have used."""

    a: Array
    """(n,) m/s²"""
    difference: Array
    """Second less first, (n,) m/s²."""
    expanded: Array
    """Expanded uncertainty of the difference, (n,) m/s²."""

    @property
    def en(self) -> Array:
        """The difference over its expanded uncertainty, (n,)."""
        return np.asarray(self.difference / self.expanded)

    @property
    def worst(self) -> int:
        """Point with the largest |En|."""
        return int(np.argmax(np.abs(self.en)))


@dataclass(frozen=True, slots=True)
class Agreement:
    """Two calibrations side by side."""

    names: tuple[str, str]
    fits: tuple[Fit, Fit]
    parameters: tuple[ComparedParameter, ...]
    characteristic: ComparedCharacteristic | None
    """None where the ranges of acceleration do not overlap, or a model has no static characteristic."""
    changes: tuple[tuple[str, str, str], ...]
    """What differs between the two: quantity, first, second."""
    shared: tuple[str, ...]
    """Recordings that both fits have used: their results are not independent."""

    @property
    def compared(self) -> tuple[ComparedParameter, ...]:
        """Coefficients of the sensor that both have: the verdict is on them and on the characteristic."""
        return tuple(p for p in self.parameters if p.owner == "sensor" and p.en is not None)

    @property
    def differing(self) -> tuple[ComparedParameter, ...]:
        """Those of them with |En| > 1."""
        return tuple(p for p in self.compared if abs(p.en or 0.0) > LIMIT)

    @property
    def only_in_one(self) -> tuple[ComparedParameter, ...]:
        """Coefficients of the sensor that one model has."""
        return tuple(p for p in self.parameters if p.owner == "sensor" and p.difference is None)

    @property
    def verdict(self) -> Verdict:
        """Whether they agree; a characteristic that differs is a difference, whatever the coefficients do."""
        shared = self.characteristic
        if not self.compared and shared is None:
            return "not comparable"
        apart = shared is not None and abs(float(shared.en[shared.worst])) > LIMIT
        return "differ" if self.differing or apart else "agree"


def agreement(first: Fit, second: Fit, *, names: tuple[str, str] = ("A", "B")) -> Agreement:
    """Compare two calibrations of one sensor.

    Parameters
    ----------
    first, second : from `accelcal.fit` or `accelcal.load_model`.
    names : of the two, as tables show them.

    Notes
    -----
    En = (x2 − x1) / sqrt(U1² + U2²) with expanded uncertainties of coverage factor 2; results agree where |En| ≤ 1 (ISO
    13528, ISO/IEC 17043). Uncertainties contain the declared contributions where there is a budget, taken as
    independent.

    Examples
    --------
    >>> import numpy as np
    >>> import accelcal as ac
    >>> rng = np.random.default_rng(1)
    >>> simulated = ac.simulate("tones", seconds=10.0, rig=ac.simulation.CXL02_RIG, parameters={}, rng=rng)
    >>> fit = ac.fit(simulated.recording)
    >>> agreement(fit, fit).verdict
    'agree'
    """
    budgets = (budget(first), budget(second))
    return Agreement(
        names=names,
        fits=(first, second),
        parameters=tuple(_parameters((first, second), budgets)),
        characteristic=_characteristic((first, second), budgets),
        changes=tuple(_changes(first, second)),
        shared=_shared(first, second),
    )


def _parameters(fits: tuple[Fit, Fit], budgets: tuple[Budget, Budget]) -> Iterator[ComparedParameter]:
    """Coefficients of either model that apply to all its runs, those of the sensor first."""
    by_name = [{e.name: e for e in fit.estimates if e.run is None or len(fit.runs) == 1} for fit in fits]
    names = list(dict.fromkeys([*by_name[0], *by_name[1]]))
    names.sort(key=lambda name: (by_name[0].get(name) or by_name[1][name]).owner != "sensor")
    for name in names:
        pair = by_name[0].get(name), by_name[1].get(name)
        estimate = pair[0] or by_name[1][name]
        expanded = [
            math.nan if e is None else expanded_uncertainty(fit, uncertainty, e)
            for fit, uncertainty, e in zip(fits, budgets, pair, strict=True)
        ]
        yield ComparedParameter(name, estimate.symbol, estimate.unit, estimate.owner, *pair, (expanded[0], expanded[1]))


def _characteristic(fits: tuple[Fit, Fit], budgets: tuple[Budget, Budget]) -> ComparedCharacteristic | None:
    """Both static outputs at the reference temperature of the first, over the common range of acceleration."""
    spans = [fit.validity.get("a") for fit in fits]
    if spans[0] is None or spans[1] is None:
        return None
    low, high = max(spans[0][0], spans[1][0]), min(spans[0][1], spans[1][1])
    if not low < high:
        return None
    a = np.linspace(low, high, POINTS)
    output, variance = [], np.zeros(POINTS)
    for fit, uncertainty in zip(fits, budgets, strict=True):
        static = characteristic(fit)
        warmth = fits[0].origins.temperature - fit.origins.temperature if static.needs_temperature else 0.0
        output.append(np.array([static.forward(float(x), warmth) for x in a]))
        columns = [
            [STATIC[e.name].per_unit(float(x), warmth) if e.name in STATIC else 0.0 for e in fit.free] for x in a
        ]
        J = np.array(columns).reshape(POINTS, len(fit.free))
        declared = np.array([max(0.0, standard_uncertainty(uncertainty, e) ** 2 - e.std**2) for e in fit.free])
        variance += np.einsum("ni,ij,nj->n", J, fit.covariance, J) + J**2 @ declared
    return ComparedCharacteristic(a, output[1] - output[0], COVERAGE_FACTOR * np.sqrt(np.maximum(variance, 1e-30)))


def _changes(first: Fit, second: Fit) -> Iterator[tuple[str, str, str]]:
    """Conditions that are not the same in both."""
    mine, other = _conditions(first), _conditions(second)
    yield from ((what, text, other[what]) for what, text in mine.items() if text != other[what])
    for key, called, unit in RANGES:
        spans = first.validity.get(key), second.validity.get(key)
        if _unlike(*spans):
            yield f"range of {called}", _shown(spans[0], unit), _shown(spans[1], unit)
    densities = [[run.noise.all.density / MICRO_G for run in fit.runs] for fit in (first, second)]
    if all(densities):
        means = [float(np.mean(density)) for density in densities]
        if max(means) > REMARKED_BEYOND * min(means):
            yield "noise density", f"{means[0]:.3g} µg/√Hz", f"{means[1]:.3g} µg/√Hz"


def _conditions(fit: Fit) -> dict[str, str]:
    """Everything declared or recorded that may set two calibrations apart, as text."""
    rig, sensor = fit.rig, fit.rig.sensor
    scale = f"{sensor.scale:g}, {sensor.zero or 0.0:g} {sensor.scale_unit}" if sensor.scale else NOT_DECLARED
    return {
        "date": _labels(fit, "day"),
        "operator": _labels(fit, "operator"),
        "mounting": _labels(fit, "mounting"),
        "sensor": " ".join(filter(None, (sensor.model, sensor.serial))) or NOT_DECLARED,
        "orientation": f"axis {rig.axis}, mount {rig.mount}",
        "effects of the model": ", ".join(map(spelled, fit.model.added)) or "base only",
        "method": fit.method,
        "declared scale and zero": scale,
        "declared low-pass": f"{rig.lowpass.cutoff:g} Hz" if rig.lowpass else "none",
        "further filters": ", ".join(channel_filter.kind for channel_filter in rig.filters) or "none",
        "encoder resolution": f"{rig.resolution:g} m" if rig.resolution else NOT_DECLARED,
    }


NOT_DECLARED = "not declared"
RANGES = (
    ("a", "acceleration", "m/s²"),
    ("v", "velocity", "m/s"),
    ("p", "position", "m"),
    ("temperature", "temperature", "°C"),
    ("frequency", "frequency", "Hz"),
)
"""Range of validity, what it is called, unit."""


def _labels(fit: Fit, what: str) -> str:
    labels: list[RunLabels] = [run.labels for run in fit.runs]
    return ", ".join(dict.fromkeys(filter(None, (getattr(label, what) for label in labels)))) or NOT_DECLARED


def _unlike(first: Span | None, second: Span | None) -> bool:
    """Whether two ranges differ by more than a tenth of the longer one."""
    if first is None or second is None:
        return first is not second
    longer = max(first[1] - first[0], second[1] - second[0])
    return max(abs(first[0] - second[0]), abs(first[1] - second[1])) > DIFFERENT_RANGE * longer


def _shown(span: Span | None, unit: str) -> str:
    return "not recorded" if span is None else f"{span[0]:.3g} to {span[1]:.3g} {unit}".replace("-", "−")


def _shared(first: Fit, second: Fit) -> tuple[str, ...]:
    """Names of recordings, or of recordings of which parts, are in both fits."""
    keys = {key for run in first.runs for key in (run.digest, run.session) if key}
    return tuple(run.name for run in second.runs if keys & {run.digest, run.session})


__dir__ = listing(globals())
