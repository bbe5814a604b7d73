"""A frequency response for people: curves of both kinds of figures, and the tables of report and workbench."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from accelcal.data.arrays import Array, Flags
from accelcal.response import FrequencyResponse, Point
from accelcal.response.parametric import Fitted
from accelcal.results.words import number, probability, typeset, with_unit

RESPONSE_HEAD = ("f, Hz", "|H|", "U (k = 2)", "phase, °", "U (k = 2), °", "a, m/s²", "lack of fit, σ")
RESPONSE_NOTE = (
    "H is output over acceleration of the reference, a lag is negative, a the amplitude of a steady sine. U is of "
    "type A: the calibration of the reference is not in it. Lack of fit: distance of H from the parametric fit in "
    "standard uncertainties, sqrt(chi-square of two degrees of freedom)."
)
FIT_HEAD = ("structure", "parameters ± U (k = 2)", "chi-square", "degrees of freedom", "p", "class")
LINEARITY_HEAD = ("term", "from", "value ± U (k = 2)", "steps")


def response_rows(found: FrequencyResponse) -> list[tuple[str, ...]]:
    """A row of cells for each point, under `RESPONSE_HEAD`."""
    model = found.model
    deviations = [math.nan] * len(found.points) if model is None else list(model.best.deviations)
    failing = () if model is None else model.failing
    rows = []
    for point, deviation in zip(found.points, deviations, strict=True):
        fails = ", fails" if point.frequency in failing else ""
        rows.append((*_cells(point), "" if math.isnan(deviation) else f"{deviation:.1f}{fails}"))
    return rows


def _cells(p: Point) -> tuple[str, ...]:
    phase, spread = math.degrees(p.phase), math.degrees(p.expanded_phase)
    size = number(abs(p.acceleration), 4) if p.method == "sine" else ""
    return (
        number(p.frequency, 5),
        rounded(p.magnitude, p.expanded),
        rounded(p.expanded, p.expanded),
        rounded(phase, spread),
        rounded(spread, spread),
        size,
    )


def rounded(value: float, uncertainty: float) -> str:
    """A value to the second digit of its uncertainty.

    Examples
    --------
    >>> rounded(1.0204712, 0.00031), rounded(-68.1234, 0.0041), rounded(0.0002, 0.0002)
    ('1.02047', '−68.1234', '0.00020')
    """
    places = 1 - math.floor(math.log10(uncertainty)) if uncertainty > 0.0 else 6
    return typeset(f"{value:.{min(max(places, 0), 12)}f}")


def with_expanded(value: float, expanded: float, unit: str) -> str:
    """A value and its expanded uncertainty, both to the second digit of that; times below a millisecond in us.

    Examples
    --------
    >>> with_expanded(400.0012, 0.028, "Hz"), with_expanded(5e-5, 1e-7, "s"), with_expanded(-9.8e-7, 9.2e-6, "1")
    ('400.001 ± 0.028 Hz', '50.00 ± 0.10 µs', '(−1.0 ± 9.2)e−6')
    """
    if unit == "s" and abs(value) < 1e-3:
        value, expanded, unit = 1e6 * value, 1e6 * expanded, "µs"
    largest = max(abs(value), expanded)
    power = math.floor(math.log10(largest)) if largest > 0.0 else 0
    if -4 < power < 6:
        return with_unit(f"{rounded(value, expanded)} ± {rounded(expanded, expanded)}", unit)
    value, expanded = value / 10.0**power, expanded / 10.0**power
    return with_unit(f"({rounded(value, expanded)} ± {rounded(expanded, expanded)}){typeset(f'e{power}')}", unit)


def fit_rows(found: FrequencyResponse) -> list[tuple[str, ...]]:
    """The chosen structure, then those that the frequencies do not separate from it, under `FIT_HEAD`."""
    model = found.model
    if model is None:
        return []
    rivals = [(fitted, "not separated") for fitted in model.rivals]
    return [_fit_cells(fitted, role) for fitted, role in ((model.best, "chosen"), *rivals)]


def _fit_cells(fitted: Fitted, role: str) -> tuple[str, ...]:
    numbers = ", ".join(f"{p.name} = {with_expanded(p.value, p.expanded, p.unit)}" for p in fitted.parameters)
    return (
        fitted.structure.name,
        numbers,
        number(fitted.chi_square, 4),
        str(fitted.degrees),
        probability(fitted.p_value),
        role,
    )


def linearity_rows(found: FrequencyResponse) -> list[tuple[str, ...]]:
    """Quadratic and cubic term by each way of measuring them, under `LINEARITY_HEAD`."""
    return [(t.name, t.source, with_expanded(t.value, t.expanded, t.unit), str(t.count)) for t in found.terms]


def response_sentences(found: FrequencyResponse) -> list[str]:
    """What was concluded beyond the tables: where the fit fails, what is confounded, the fit in the time domain."""
    model, check = found.model, found.check
    texts = ["too few points for a parametric fit"] if model is None else [model.failure, model.further]
    if model is not None and not model.failure:
        texts[0] = f"{model.best.structure.name} fails at none of the {len(found.points)} points"
    texts.append("" if check is None else check if isinstance(check, str) else check.sentence)
    return [f"{text[:1].upper()}{text[1:]}.".replace("+-", "±").replace(" us", " µs") for text in texts if text]


@dataclass(frozen=True, slots=True)
class ResponsePanel:
    """One quantity of a frequency response against frequency."""

    quantity: str
    unit: str
    measured: Array
    """(n,)"""
    expanded: Array
    """(n,) k = 2"""
    fitted: Array | None
    """(m,) the parametric fit at `ResponseCurves.grid`; None where there is none."""
    is_deviation: bool = False
    """Whether it is measured minus fitted."""

    def reach(self) -> tuple[float, float]:
        """Least and largest value that is drawn, with a margin."""
        drawn = [self.measured - self.expanded, self.measured + self.expanded]
        drawn += [] if self.fitted is None else [self.fitted]
        low, high = float(min(map(np.min, drawn))), float(max(map(np.max, drawn)))
        return low - 0.06 * (high - low), high + 0.06 * (high - low)


@dataclass(frozen=True, slots=True)
class ResponseCurves:
    """What a figure of a frequency response shows."""

    frequency: Array
    """(n,) Hz, rising."""
    failing: Flags
    """(n,) where the structure deviates."""
    grid: Array
    """(m,) Hz, at which the fit is drawn."""
    structure: str
    """Name of the fitted structure; empty where there is none."""
    panels: tuple[ResponsePanel, ...]
    """Magnitude and phase, each followed by its deviation from the fit."""
    sentence: str
    """Whether the structure describes the response, and where not."""

    def ends(self) -> tuple[float, float]:
        """First and last frequency of the axis, Hz."""
        return float(0.92 * self.frequency[0]), float(1.08 * self.frequency[-1])


def response_curves(found: FrequencyResponse) -> ResponseCurves:
    """Magnitude (1), phase (°, unwrapped) and their deviations (% and °) with expanded uncertainties."""
    f = np.array([p.frequency for p in found.points])
    value = np.array([p.value for p in found.points])
    magnitude, wide = np.abs(value), np.array([p.expanded for p in found.points])
    phase, wide_phase = np.unwrap(np.angle(value)), np.degrees([p.expanded_phase for p in found.points])
    grid = np.geomspace(f[0], f[-1], 400)
    span = f"Sensitivity from {f[0]:.4g} to {f[-1]:.4g} Hz"
    if found.model is None:
        bare = (
            ResponsePanel("magnitude", "1", magnitude, wide, None),
            ResponsePanel("phase", "°", np.degrees(phase), wide_phase, None),
        )
        return ResponseCurves(f, np.zeros(len(f), dtype=np.bool_), grid, "", bare, span)
    best = found.model.best
    there, along = best.response(f), best.response(grid)
    turns = np.unwrap(np.angle(along))
    turns += 2.0 * np.pi * round((phase[0] - turns[0]) / (2.0 * np.pi))
    relative = value / there
    panels = (
        ResponsePanel("magnitude", "1", magnitude, wide, np.abs(along)),
        ResponsePanel(
            "deviation", "%", 100.0 * (np.abs(relative) - 1.0), 100.0 * wide / np.abs(there), np.zeros(len(grid)), True
        ),
        ResponsePanel("phase", "°", np.degrees(phase), wide_phase, np.degrees(turns)),
        ResponsePanel("deviation", "°", np.degrees(np.angle(relative)), wide_phase, np.zeros(len(grid)), True),
    )
    failing = np.isin(f, found.model.failing)
    verdict = found.model.failure.partition(":")[0].removeprefix("it ") or f"fails at none of {len(f)} points"
    sentence = f"{span}: {best.structure.name} {verdict}"
    return ResponseCurves(f, failing, grid, best.structure.name, panels, sentence)
