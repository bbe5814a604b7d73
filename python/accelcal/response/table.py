"""The response as a table: JSON, CSV, and lines for a terminal."""

from __future__ import annotations

import csv
import io
import math
from typing import Any

from accelcal.response.cross_check import CrossCheck
from accelcal.response.measure import FrequencyResponse
from accelcal.response.parametric import Fitted
from accelcal.response.points import Point

COLUMNS = (
    "frequency_hz",
    "magnitude",
    "magnitude_expanded",
    "phase_deg",
    "phase_expanded_deg",
    "degrees_of_freedom",
    "acceleration_m_per_s2",
    "method",
    "start_s",
    "end_s",
)
"""Of a row. Expanded uncertainties have k = 2; the acceleration of a broadband row is per square root of Hz."""


def row(point: Point) -> dict[str, Any]:
    """One point, by column."""
    values = (
        point.frequency,
        point.magnitude,
        point.expanded,
        math.degrees(point.phase),
        math.degrees(point.expanded_phase),
        point.degrees,
        abs(point.acceleration),
        point.method,
        point.start,
        point.end,
    )
    return dict(zip(COLUMNS, values, strict=True))


def to_dict(found: FrequencyResponse) -> dict[str, Any]:
    """The response as JSON of the schema accelcal/response/1."""
    model = found.model
    return {
        "schema": "accelcal/response/1",
        "recording": found.recording,
        "points": [row(p) for p in found.points],
        "model": None if model is None else _fitted(model.best),
        "not_separated": [] if model is None else [_fitted(f) for f in model.rivals],
        "fails_at_hz": [] if model is None else list(model.failing),
        "deviations": [] if model is None else model.best.deviations.tolist(),
        "sentences": [] if model is None else list(model.sentences),
        "linearity": [
            {
                "name": t.name,
                "source": t.source,
                "unit": t.unit,
                "value": t.value,
                "std": t.std,
                "expanded": t.expanded,
                "steps": t.count,
            }
            for t in found.terms
        ],
        "time_domain": _check(found.check),
    }


def _fitted(fitted: Fitted) -> dict[str, Any]:
    return {
        "structure": fitted.structure.name,
        "parameters": [
            {"name": p.name, "unit": p.unit, "value": p.value, "std": p.std, "expanded": p.expanded}
            for p in fitted.parameters
        ],
        "chi_square": fitted.chi_square,
        "degrees_of_freedom": fitted.degrees,
        "p": fitted.p_value,
    }


def _check(check: CrossCheck | str | None) -> dict[str, Any] | None:
    if check is None:
        return None
    if isinstance(check, str):
        return {"sentence": check, "gain": None, "gain_std": None, "delay_s": None, "delay_std_s": None}
    return {
        "sentence": check.sentence,
        "gain": check.gain,
        "gain_std": check.gain_std,
        "delay_s": check.delay,
        "delay_std_s": check.delay_std,
    }


def to_csv(found: FrequencyResponse) -> str:
    """The points as CSV, one a line."""
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(row(p) for p in found.points)
    return text.getvalue()


def lines(found: FrequencyResponse) -> list[str]:
    """The table, then what was concluded from it, for a terminal."""
    out = [f"{'f, Hz':>10} {'|H|':>10} {'U (k=2)':>9} {'phase, deg':>11} {'U (k=2)':>9}  {'a, m/s²':>9}"]
    for p in found.points:
        size = f"{abs(p.acceleration):9.4g}" if p.method == "sine" else " " * 9
        out.append(
            f"{p.frequency:10.5g} {p.magnitude:10.6f} {p.expanded:9.2g} {math.degrees(p.phase):11.4f} "
            f"{math.degrees(p.expanded_phase):9.2g}  {size}".rstrip()
        )
    if found.model is not None:
        out += ["", *found.model.sentences]
    out += [
        f"{t.name} from {t.source}: {t.value:.4g} +- {t.expanded:.2g} {t.unit} ({t.count} steps)" for t in found.terms
    ]
    if found.check is not None:
        out.append(found.check if isinstance(found.check, str) else found.check.sentence)
    return out
