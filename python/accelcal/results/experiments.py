"""Tables of experiments: what a recording or a planned motion can detect, and what was simulated.

A fit needs none of them: `Result.table` imports this module for the kinds of results that name it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from accelcal._support.values import listing
from accelcal.calibration.export.axes import SensorMatrix
from accelcal.data import concise
from accelcal.diagnosis.experiment.design import Plan
from accelcal.diagnosis.experiment.detectability import Detectability, Power
from accelcal.diagnosis.experiment.next_runs import NextExperiments
from accelcal.diagnosis.policy import CLASS_WEIGHT
from accelcal.results.table import Column, Row, Table, as_sentence, require, table
from accelcal.results.words import amount, number, with_unit
from accelcal.simulation.sensor import Simulated


@table.register
def _(simulated: Simulated, which: str = "") -> Table:
    require(which)
    return Table(
        title=simulated.recording.name,
        sentence=as_sentence(f"{simulated.truth!r}"),
        columns=(Column("parameter", "parameter"), Column("value", "true value", lambda r: number(r["value"]))),
        rows=tuple({"parameter": name, "value": value} for name, value in simulated.truth.parameters.items()),
    )


@table.register
def _(result: Power, which: str = "") -> Table:
    require(which, "coefficients")
    visible = [limit for limit in result.detectabilities if limit.visible]
    return Table(
        title=f"Detection limits of {result.name or 'a recording'}",
        sentence=f"{len(visible)} of {len(result.detectabilities)} effects would be detected at some size "
        f"({result.examined} candidates, false alarms {100.0 * result.alpha:.2g} % per record).",
        columns=DETECTABLE_COLUMNS,
        rows=detectable_rows(result.detectabilities, in_full=which == "coefficients"),
        notes=tuple(f"Confounded: {', '.join(tie.members)}. {tie.experiment}" for tie in result.ties),
        about={"name": result.name},
    )


@table.register
def _(result: Plan, which: str = "") -> Table:
    require(which)
    return Table(
        title="Detection limits of the planned motion",
        sentence="",
        columns=DETECTABLE_COLUMNS,
        rows=detectable_rows(result.detectabilities),
        notes=tuple(
            f"{limit.effect} is confounded with {', '.join(limit.members[1:])}."
            for limit in result.detectabilities
            if limit.members[1:]
        ),
    )


def detectable_rows(limits: Sequence[Detectability], *, in_full: bool = False) -> tuple[Row, ...]:
    """Smallest detectable sizes: of the best coefficient of each effect, or of every one."""
    return tuple(
        {
            "effect": limit.effect,
            "part": part,
            "smallest": size,
            "unit": units[part] if len(units) > 1 else units[0],
            "largest": limit.largest,
            "largest_unit": limit.largest_unit,
            "confounded_with": ", ".join(limit.members[1:]),
        }
        for limit in limits
        for units in [limit.unit.split(", ")]
        for part, size in enumerate(limit.smallest)
        if in_full or part == limit.smallest.index(min(limit.smallest))
    )


def smallest_text(row: Row) -> str:
    """Smallest detectable size with its unit."""
    if not math.isfinite(row["smallest"]):
        return "not detectable"
    return with_unit(number(row["smallest"], 3), row["unit"])


def largest_text(row: Row) -> str:
    """Largest contribution at the smallest detectable size."""
    return with_unit(number(row["largest"], 2), row["largest_unit"]) if math.isfinite(row["smallest"]) else ""


DETECTABLE_COLUMNS = (
    Column("effect", "effect"),
    Column("smallest", "smallest size (95 % probability)", smallest_text),
    Column("largest", "largest contribution at that size", largest_text),
    *(Column(key) for key in ("part", "unit", "largest_unit", "confounded_with")),
)


@table.register
def _(result: NextExperiments, which: str = "") -> Table:
    require(which, "causes")
    names = ", ".join(cause.effect for cause in result.causes if cause.weight > 0.0)
    if which == "causes":
        weight = "weight by the recordings"
        return Table(
            title="Causes",
            sentence="",
            columns=(
                Column("effect", "cause"),
                Column("before", "weight before", lambda r: "" if r["before"] is None else f"{r['before']:.2f}"),
                Column("weight", weight, lambda r: f"{r['weight']:.2f}"),
            ),
            rows=tuple({"effect": c.effect, "before": c.before, "weight": c.weight} for c in result.causes),
        )
    return Table(
        title=f"Further runs that separate {names}" if result.ranked else f"Causes after {result.recordings[-1]}",
        sentence=result.sentence,
        columns=NEXT_COLUMNS,
        rows=tuple(
            {
                "run": run.run,
                "minutes": run.minutes,
                "fall": run.fall,
                "decided": run.decided,
                "separation": run.separation,
                "pair": " and ".join(run.pair),
            }
            for run in result.ranked
        ),
        notes=(f"Not simulated: {', '.join(result.left_out)}.",) if result.left_out else (),
    )


NEXT_COLUMNS = (
    Column("run", "what to record"),
    Column("minutes", "min with set-up", lambda r: f"{r['minutes']:.3g}"),
    Column("fall", "expected fall of entropy, nat", lambda r: f"{r['fall']:.2f}"),
    Column("decided", f"probability that one has {100.0 * CLASS_WEIGHT:g} %", lambda r: f"{r['decided']:.2f}"),
    Column("separation", "closest pair, sigma", lambda r: f"{r['separation']:.1f}"),
    Column("pair", "closest pair", detail=True),
)


@table.register
def _(result: SensorMatrix, which: str = "") -> Table:
    require(which)
    axes = tuple("xyz")
    rows: list[Row] = [
        {
            "axis": axis,
            "M": result.M[i].tolist(),
            "M_std": result.M_std[i].tolist(),
            "bias": float(result.bias[i]),
            "bias_std": float(result.bias_std[i]),
            "lever": result.lever[i].tolist(),
        }
        for i, axis in enumerate(axes)
    ]
    return Table(
        title=f"Matrix of three outputs{f' of {result.source}' if result.source else ''}",
        sentence="Output = offset + M times the specific force in the axes of the attitude (ENU: +g along up).",
        columns=(
            Column("axis", "output"),
            *(
                Column("", f"M along {of}", lambda r, k=k: concise(r["M"][k], r["M_std"][k]))  # type: ignore[misc]
                for k, of in enumerate(axes)
            ),
            Column("", "offset", lambda r: amount(r["bias"], r["bias_std"], "m/s²")),
            Column("", "lever arm, mm", lambda r: ", ".join(f"{1e3 * x:.1f}" for x in r["lever"])),
            *(Column(key) for key in ("bias", "bias_std")),
        ),
        rows=tuple(rows),
        notes=(f"Delay of all outputs {1e3 * result.delay:.4g} ms.",),
    )


__dir__ = listing(globals())
