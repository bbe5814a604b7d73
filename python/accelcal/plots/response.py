"""A frequency response for people: its figure, and the tables of report and workbench."""

from __future__ import annotations

import math

import numpy as np

from accelcal.data import Array
from accelcal.plots.figure import Axis, Figure, Line, Panel, Points, Role
from accelcal.response import FrequencyResponse, Point
from accelcal.results.words import number, probability, typeset, with_unit

RESPONSE_HEAD = ("f, Hz", "|H|", "U (k = 2)", "phase, °", "U (k = 2), °", "a, m/s²", "lack of fit, σ")
FIT_HEAD = ("structure", "parameters ± U (k = 2)", "chi-square", "degrees of freedom", "p", "class")
MEASURED, FAILS = "measured, U (k = 2)", "measured, the fit fails"
TALL, THIN = 180.0, 100.0
"""Heights of a panel and of a deviation, px."""
LINEARITY_HEAD = ("term", "from", "value ± U (k = 2)", "steps")


def response_note(answer: FrequencyResponse) -> str:
    """What the columns under `RESPONSE_HEAD` are, and what is in U."""
    return (
        "H is output over acceleration of the reference, a lag is negative, a the amplitude of a steady sine. "
        f"{answer.basis} Lack of fit: distance of H from the parametric fit in standard uncertainties, sqrt(chi-square "
        "of two degrees of freedom)."
    )


def response_rows(answer: FrequencyResponse) -> list[tuple[str, ...]]:
    """A row of cells for each point, under `RESPONSE_HEAD`."""
    model = answer.model
    deviations = [math.nan] * len(answer.points) if model is None else list(model.best.deviations)
    failing = () if model is None else model.failing
    return [
        (*_cells(p), "" if math.isnan(d) else f"{d:.1f}{', fails' * (p.frequency in failing)}")
        for p, d in zip(answer.points, deviations, strict=True)
    ]


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


def fit_rows(answer: FrequencyResponse) -> list[tuple[str, ...]]:
    """The chosen structure, then those that the frequencies do not separate from it, under `FIT_HEAD`."""
    model = answer.model
    if model is None:
        return []
    return [
        (
            fitted.structure.name,
            ", ".join(f"{p.name} = {with_expanded(p.value, p.expanded, p.unit)}" for p in fitted.parameters),
            number(fitted.chi_square, 4),
            str(fitted.degrees),
            probability(fitted.p_value),
            "not separated" if rank else "chosen",
        )
        for rank, fitted in enumerate((model.best, *model.rivals))
    ]


def linearity_rows(answer: FrequencyResponse) -> list[tuple[str, ...]]:
    """Quadratic and cubic term by each way of measuring them, under `LINEARITY_HEAD`."""
    return [(t.name, t.source, with_expanded(t.value, t.expanded, t.unit), str(t.count)) for t in answer.terms]


def response_sentences(answer: FrequencyResponse) -> list[str]:
    """What was concluded beyond the tables: where the fit fails, what is confounded, the fit in the time domain."""
    model, check = answer.model, answer.check
    texts = ["too few points for a parametric fit"] if model is None else [model.failure, model.further]
    if model is not None and not model.failure:
        texts[0] = f"{model.best.structure.name} fails at none of the {len(answer.points)} points"
    texts.append("" if check is None else check if isinstance(check, str) else check.sentence)
    return [f"{text[:1].upper()}{text[1:]}." for text in texts if text]


def sensitivity(answer: FrequencyResponse) -> Figure:
    """Draw magnitude and phase against frequency with expanded uncertainties, each above its deviation from the fit.

    Parameters
    ----------
    answer : from `accelcal.response.frequency_response`.
    """
    f, value = np.array([p.frequency for p in answer.points]), np.array([p.value for p in answer.points])
    magnitude, wide = np.abs(value), np.array([p.expanded for p in answer.points])
    phase, wide_phase = np.unwrap(np.angle(value)), np.degrees([p.expanded_phase for p in answer.points])
    headline = f"Sensitivity from {f[0]:.4g} to {f[-1]:.4g} Hz"
    grid, failing = np.geomspace(f[0], f[-1], 400), np.zeros(len(f), dtype=np.bool_)
    axis = Axis("frequency", "Hz", "log", (0.92 * float(f[0]), 1.08 * float(f[-1])))

    def panel(quantity: str, unit: str, y: Array, expanded: Array, fitted: Array | None, height: float) -> Panel:
        marks: list[Points | Line] = []
        kinds: tuple[tuple[str, Role], ...] = ((MEASURED, "model"), (FAILS, "other"))
        for chosen, (name, role) in zip((~failing, failing), kinds, strict=True):
            if chosen.any():
                hover = [
                    f"{at:.5g} Hz: {v:.6g} ± {u:.2g}{'' if unit == '1' else f' {unit}'}"
                    for at, v, u in zip(f[chosen], y[chosen], expanded[chosen], strict=True)
                ]
                marks.append(Points(f[chosen], y[chosen], name, role, expanded[chosen], hover=hover))
        drawn = [y - expanded, y + expanded]
        if fitted is not None and answer.model is not None:
            marks.append(Line(grid, fitted, answer.model.best.structure.name, "band"))
            drawn.append(fitted)
        low, high = float(min(map(np.min, drawn))), float(max(map(np.max, drawn)))
        margin = 0.06 * (high - low)
        return Panel(tuple(marks), axis, Axis(quantity, unit, range=(low - margin, high + margin)), height=height)

    if answer.model is None:
        bare = (
            panel("magnitude", "1", magnitude, wide, None, TALL),
            panel("phase", "°", np.degrees(phase), wide_phase, None, TALL),
        )
        return Figure(bare, headline, shared_x=True)
    best = answer.model.best
    failing = np.isin(f, answer.model.failing)
    there, along = best.response(f), best.response(grid)
    turns = np.unwrap(np.angle(along))
    turns += 2.0 * np.pi * round((phase[0] - turns[0]) / (2.0 * np.pi))
    relative, zero = value / there, np.zeros(len(grid))
    deviation, expanded = 100.0 * (np.abs(relative) - 1.0), 100.0 * wide / np.abs(there)
    panels = (
        panel("magnitude", "1", magnitude, wide, np.abs(along), TALL),
        panel("deviation", "%", deviation, expanded, zero, THIN),
        panel("phase", "°", np.degrees(phase), wide_phase, np.degrees(turns), TALL),
        panel("deviation", "°", np.degrees(np.angle(relative)), wide_phase, zero, THIN),
    )
    verdict = answer.model.failure.partition(":")[0].removeprefix("it ") or f"fails at none of {len(f)} points"
    return Figure(panels, f"{headline}: {best.structure.name} {verdict}", shared_x=True)
