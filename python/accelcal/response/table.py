"""The response as a table: CSV, and lines for a terminal."""

from __future__ import annotations

import csv
import io
import math
from typing import Any

from accelcal.response.measure import FrequencyResponse
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
