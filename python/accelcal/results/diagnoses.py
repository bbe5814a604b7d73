"""Tables of diagnoses: candidates, detection limits, and what is confounded."""

from __future__ import annotations

import math
from collections.abc import Collection

from accelcal._support.values import listing
from accelcal.diagnosis.dwells import DwellDiagnosis
from accelcal.diagnosis.findings import Confounded, Size
from accelcal.diagnosis.search.scan import Candidate
from accelcal.diagnosis.verdict import AxesDiagnosis, Diagnosis
from accelcal.effects import CATALOGUE, find, spelled
from accelcal.results.table import Column, Row, Table, as_sentence, require, table
from accelcal.results.words import about, amount, error_size, in_g, largest_residual, plain, probability, typeset

VERDICTS = {
    "adequate": "no effect is missing",
    "named": "an effect is missing",
    "tied": "confounded effects",
    "shape": "nonparametric curve",
    "unexplained": "unexplained residual",
    "too_short": "too short for a verdict",
}
CANDIDATES = 8
"""Candidates, and detection limits, that a table shows; data frames and JSON have all."""


@table.register
def _(result: Diagnosis, which: str = "") -> Table:
    require(which, "candidates", "limits", "coefficients")
    missing = result.verdict != "adequate"  # a ranking of insignificant candidates would mislead
    most = None if which else CANDIDATES
    which = which or ("candidates" if missing else "limits")
    columns, rows = {
        "limits": (LIMIT_COLUMNS, limit_rows),
        "candidates": (CANDIDATE_COLUMNS, candidate_rows),
        "coefficients": (COEFFICIENT_COLUMNS, coefficient_rows),
    }[which]
    ties = [tie for tie in result.classes if len(tie.members) > 1]
    shown = rows(result)[:most]
    inseparable = "; ".join(f"{t.members[0]} with {' and '.join(t.members[1:])}" for t in result.inseparable)
    return Table(
        title=f"Diagnosis: {VERDICTS[result.verdict]}",
        sentence=typeset(result.sentence),
        columns=columns,
        rows=tuple(shown),
        alarms=tuple(f"Suspect data: {text}" for text in result.suspect),
        notes=(
            *map(as_sentence, result.notes),
            *contribution_notes(result, {row["effect"] for row in shown} if which == "candidates" else set()),
            largest_residual(result.where.worst),
            *(as_sentence(rejected.sentence) for rejected in result.dropped),
            *(as_sentence(test.sentence) for test in result.channels),
            *(f"{confounded_on('record', t)}." for t in ties if t.experiment not in result.sentence),
            *([f"Inseparable on this rig: {inseparable}."] if inseparable else []),
        ),
        detail=tuple(f"{confounded_on('rig', t)}." for t in result.inseparable),
        about={"verdict": result.verdict, "sentence": result.sentence},
    )


def confounded_on(where: str, tie: Confounded) -> str:
    """Members of a confounding class, and the experiment that separates them."""
    return f"Confounded on this {where}: {', '.join(tie.members)}. To separate them: {tie.experiment}"


def candidate_groups(result: Diagnosis, most: int | None = None) -> list[list[Candidate]]:
    """The best candidates, each class of confounded ones together, best first."""
    left, groups = list(result.scan.candidates[:most]), list[list[Candidate]]()
    while left:
        first = left[0]
        sure = first.p_value < result.alpha
        group = [c for c in left if c is first or (sure and c.effect in first.members and c.p_value < result.alpha)]
        groups.append(group)
        left = [c for c in left if c not in group]
    return groups


def candidate_rows(result: Diagnosis) -> list[Row]:
    """Candidates, best first, confounded ones together."""
    return [candidate_row(result, c) for group in candidate_groups(result) for c in group]


CANDIDATE_COLUMNS = (
    Column("effect", "candidate", lambda r: spelled(r["effect"])),
    Column("", "estimate", lambda r: r["size"]),
    Column("", "SI value (u)", lambda r: r["si"], detail=True),
    Column("", "largest contribution", lambda r: r["contribution"]),
    Column("", "significance", lambda r: typeset(f"{r['sigma']:.1f} σ, p {probability(r['p_value'])}")),
    *(Column(key) for key in ("estimate", "std", "unit", "sigma", "p_value", "largest", "largest_unit")),
    *(Column(key) for key in ("confounded_with", "named")),
)


def candidate_row(result: Diagnosis, c: Candidate) -> Row:
    """Row of one candidate; an effect of several coefficients has no single estimate."""
    single, at_encoder = len(c.estimate) == 1, find(c.effect).port == "position"
    return {
        "effect": c.effect,
        "estimate": c.estimate[0] if single else None,
        "std": c.std[0] if single else None,
        "unit": c.unit,
        "sigma": c.snr,
        "p_value": c.p_value,
        "largest": c.largest,
        "largest_unit": "m" if at_encoder else "m/s²",
        "confounded_with": ", ".join(name for name in c.members if name != c.effect),
        "named": c.effect in result.effects,
        "size": plain(c.unit, c.estimate[0], c.std[0]) if single else f"{len(c.estimate)} coefficients",
        "si": amount(c.estimate[0], c.std[0], c.unit) if single else "",
        "contribution": contribution(Size(c.largest, at_encoder), result.fit.rig.sensor.range),
    }


def contribution(size: Size, full_scale: float | None) -> str:
    """Largest contribution over the used range: in mg, m/s² and per cent of full scale, or a length at the encoder."""
    return error_size(size.value, "m" if size.at_encoder else "m/s²", full_scale)


def contribution_notes(result: Diagnosis, listed: Collection[str]) -> list[str]:
    """One sentence for each named effect, its largest contribution over the used range and whether that matters; none
    for those that a table has `listed` with it where no tolerance is declared."""
    judged, notes = result.importance, []
    for name in result.effects:
        if judged is None and name in listed:
            continue
        size = result.sizes.get(name)
        if size is None:
            notes.append(f"{name} adds nothing to the output that could be compared.")
            continue
        matters = ""
        if judged is not None:
            limit = in_g(judged.tolerance)
            matters = "; not comparable with the tolerance, which applies to the output"
            if name in (*judged.matters, *judged.below):
                matters = f"; {'matters' if name in judged.matters else 'below tolerance'} (tolerance {limit})"
        notes.append(f"{name} contributes at most {contribution(size, result.fit.rig.sensor.range)}{matters}.")
    return notes


COEFFICIENT_COLUMNS = tuple(
    Column(key, key.replace("_", " "))
    for key in (
        *("effect", "part", "estimate", "std", "unit", "sigma", "p_value", "largest", "largest_unit"),
        *("confounded_with", "named"),
    )
)


def coefficient_rows(result: Diagnosis) -> list[Row]:
    """One row for each coefficient of each candidate, the most significant candidate first."""
    return [
        {**candidate_row(result, c), "part": part, "estimate": estimate, "std": std}
        for c in result.scan.candidates
        for part, (estimate, std) in enumerate(zip(c.estimate, c.std, strict=True))
    ]


LIMIT_COLUMNS: tuple[Column, ...] = (
    Column("effect", "effect", lambda r: spelled(r["effect"])),
    Column("limit", "detection limit (95 % probability)", lambda r: about(r["unit"], r["limit"])),
    Column("unit"),
)


def limit_rows(result: Diagnosis) -> list[Row]:
    """Detection limits of effects of the sensor: common effects first, of these the static ones before drift."""
    order = sorted(CATALOGUE.values(), key=lambda e: (not e.traits.common, e.traits.common and not e.traits.static))
    limits = result.scan.detection_limits
    return [
        {"effect": effect.name, "limit": limits[effect.name], "unit": effect.unit}
        for effect in order
        if (effect.owner, effect.port, effect.width) == ("sensor", "output", 1)
        and math.isfinite(limits.get(effect.name, math.inf))
    ]


@table.register
def _(result: DwellDiagnosis, which: str = "") -> Table:
    require(which)
    return Table(
        title=f"Diagnosis of dwells: {result.verdict}",
        sentence=as_sentence(typeset(result.sentence)),
        columns=(
            Column("effect", "candidate", lambda r: spelled(r["effect"])),
            Column("", "value", lambda r: plain(r["unit"], r["estimate"], r["std"])),
            Column("", "SI value (u)", lambda r: amount(r["estimate"], r["std"], r["unit"])),
            Column("", "significance", lambda r: f"{r['sigma']:.1f} σ, p {probability(r['p_value'])}"),
            *(Column(key) for key in ("estimate", "std", "unit", "sigma", "p_value")),
        ),
        rows=tuple(
            {key: getattr(c, key) for key in ("effect", "estimate", "std", "unit", "sigma", "p_value")}
            for c in result.candidates[:CANDIDATES]
        ),
        notes=tuple(as_sentence(note.sentence) for note in result.remarks),
        about={"verdict": result.verdict, "sentence": result.sentence},
    )


@table.register
def _(result: AxesDiagnosis, which: str = "") -> Table:
    require(which)
    rows = [axis_row(axis, judged) for axis, judged in zip(result.axes, result.by_axis, strict=True)]
    return Table(
        title=f"Diagnosis of {len(result.axes)} outputs: {VERDICTS[result.verdict]}",
        sentence=typeset(result.sentence),
        columns=(
            Column("axis", "axis"),
            Column("verdict", "verdict", lambda r: VERDICTS[r["verdict"]]),
            Column("effect", "effect", lambda r: spelled(r["effect"]) if r["effect"] else ""),
            Column("", "significance", lambda r: f"{r['sigma']:.1f} σ, p {probability(r['p_value'])}"),
            Column("", "examined", lambda r: str(r["examined"])),
            *(Column(key) for key in ("sigma", "p_value", "examined")),
        ),
        rows=tuple(rows),
        alarms=tuple(f"Suspect data, {axis}: {text}" for axis in result.axes for text in result[axis].suspect),
        notes=tuple(f"{axis}: {as_sentence(note)}" for axis in result.axes for note in result[axis].notes),
        about={"verdict": result.verdict, "sentence": result.sentence},
    )


def axis_row(axis: str, judged: Diagnosis) -> Row:
    """Row of one output: its first candidate, and what it is worth."""
    first = next(iter(judged.scan.candidates), None)
    return {
        "axis": axis,
        "verdict": judged.verdict,
        "effect": first.effect if first is not None and judged.verdict != "adequate" else "",
        "sigma": first.snr if first is not None else 0.0,
        "p_value": first.p_value if first is not None else 1.0,
        "examined": judged.scan.examined,
    }


__dir__ = listing(globals())
