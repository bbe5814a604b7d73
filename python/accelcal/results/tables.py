"""Tables by kind of result: importing this module makes all of them known to `table`."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from accelcal._support.values import listing
from accelcal.data import Dwells, Recording, describe, instant
from accelcal.effects import Effect, spelled
from accelcal.effects.registry import CARD
from accelcal.estimation.tracks import Track
from accelcal.filters.choice import STATE_UNITS
from accelcal.filters.record import FilterRun
from accelcal.model import Model
from accelcal.results import (
    comparisons,  # noqa: F401  they register their tables
    diagnoses,  # noqa: F401  they register their tables
    parameters,  # noqa: F401  they register their tables
)
from accelcal.results.comparisons import length_column
from accelcal.results.table import Column, Table, as_sentence, require, table
from accelcal.results.words import amount, grouped, label, number, plain, with_unit
from accelcal.simulation.sensor import Simulated
from accelcal.validation.comparison import Coast

TERMS = 12
"""Coefficients of a model that are shown."""
COASTED = 6
"""Instants of an unaided drift that are shown."""


@table.register
def _(recording: Recording, which: str = "") -> Table:
    require(which)
    description = describe(recording)
    warnings = [f.text for f in recording.findings if f.severity == "warning"]
    used = (
        ""
        if description["range_used"] is None
        else f"; {100.0 * description['range_used']:.0f} % of the sensor's range used"
    )
    counted = f"{len(warnings)} warning{'s' if len(warnings) != 1 else ''}" if warnings else "no warnings"
    rest = sum(end - start for start, end in description["rest_s"])
    clocks = [channel.t for channel in (recording.accel, recording.position) if len(channel)]
    duration = float(max(t[-1] for t in clocks) - min(t[0] for t in clocks))
    return Table(
        title=f"Recording {recording.name}".strip(),
        sentence=f"{instant(duration)} s, at rest for {instant(rest)} s{used}; {counted}.",
        columns=(
            Column("channel", "channel"),
            Column("samples", "samples", lambda r: grouped(r["samples"])),
            Column("rate_hz", "rate", lambda r: f"{r['rate_hz']:.6g} Hz" if r["rate_hz"] else "", "Hz"),
            Column("start_s", "from", lambda r: f"{instant(r['start_s'])} s", "s"),
            Column("end_s", "to", lambda r: f"{instant(r['end_s'])} s", "s"),
            Column("min", "least", lambda r: reading(r["min"], r["unit"])),
            Column("max", "largest", lambda r: reading(r["max"], r["unit"])),
            Column("unit"),
        ),
        rows=tuple({"channel": name, **channel} for name, channel in description["channels"].items()),
        alarms=tuple(f"warning: {text}" for text in warnings),
        notes=(
            *(f.text for f in recording.findings if f.severity != "warning"),
            *(f"assumed: {text}" for text in description["assumptions"]),
        ),
    )


@table.register
def _(dwells: Dwells, which: str = "") -> Table:
    require(which)
    groups = len(set(dwells.group))
    quantities = {
        "attitude": (np.degrees(dwells.angle), "deg", 5),
        "mean": (dwells.mean, "m/s²", 4),
        "duration": (dwells.duration, "s", 4),
        "standard deviation of a mean": (np.sqrt(dwells.variance), "m/s²", 4),
    }
    return Table(
        title=f"{dwells.name or 'Dwells'}",
        sentence=f"{len(dwells)} dwells in {groups} group{'s' if groups > 1 else ''} that share an angle zero.",
        columns=(
            Column("quantity", "quantity"),
            Column("least", "least", lambda r: f"{number(r['least'], r['digits'])} {r['unit']}"),
            Column("greatest", "greatest", lambda r: f"{number(r['greatest'], r['digits'])} {r['unit']}"),
            Column("unit"),
        ),
        rows=tuple(
            {"quantity": name, "least": float(y.min()), "greatest": float(y.max()), "unit": unit, "digits": digits}
            for name, (y, unit, digits) in quantities.items()
        ),
        notes=tuple(f"assumed: {text}" for text in dwells.assumptions),
    )


def reading(y: float, unit: str) -> str:
    """A sample in its unit."""
    return with_unit(number(y), label("", unit).strip(" ()"))


@table.register
def _(model: Model, which: str = "") -> Table:
    require(which)
    rest = len(model.terms) - TERMS
    return Table(
        title="Model",
        sentence=f"{len(model.terms)} coefficients, {len(model.free)} of them free.",
        columns=tuple(Column(key, key) for key in ("coefficient", "symbol", "unit", "owner", "state")),
        rows=tuple(
            {
                "coefficient": spelled(term.name),
                "symbol": term.symbol,
                "unit": term.unit,
                "owner": term.owner,
                "state": state_of(model, term.name),
            }
            for term in model.terms[:TERMS]
        ),
        notes=(
            *(f"{spelled(e.name)} acts on the noise." for e in model.noise_effects),
            *((f"{rest} more coefficients.",) if rest > 0 else ()),
        ),
    )


def state_of(model: Model, name: str) -> str:
    """Whether a coefficient is free, held, has a prior, or differs from run to run."""
    if name in model.fixed:
        return f"held at {number(model.fixed[name])}"
    prior = model.priors.get(name)
    text = "free" if prior is None else f"free, prior {number(prior.mean)} ± {number(prior.std)}"
    return f"{text}, one for each run" if name in model.per_run else text


@table.register
def _(effect: Effect, which: str = "") -> Table:
    require(which)
    lines = {label_: text for label_ in CARD if (text := effect.line(label_))}
    lines["Unit"] = f"{effect.unit}; owner: {effect.owner}"
    return Table(
        title=f"Effect {effect.name}",
        sentence=" ".join(effect.card.split("\nEquation:")[0].split()),
        columns=(Column("property", " "), Column("text", "  ")),
        rows=tuple({"property": name, "text": text} for name, text in lines.items()),
    )


@table.register
def _(run: FilterRun, which: str = "") -> Table:
    require(which)
    last = zip(run.names, run.states[-1].tolist(), run.variances[-1].tolist(), strict=True)
    rows = ((name, x, math.sqrt(max(v, 0.0)), STATE_UNITS[name]) for name, x, v in last)
    return last_values(
        "state",
        f"Filter {run.choice.system}, {run.choice.model} model",
        f"{grouped(len(run.times))} events, {instant(run.times[0])} s to {instant(run.times[-1])} s; "
        f"{len(run.rejections)} readings rejected.",
        rows,
    )


@table.register
def _(track: Track, which: str = "") -> Table:
    require(which)
    return last_values(
        "parameter",
        "Estimates over time",
        f"{grouped(len(track.t))} instants, {instant(track.t[0])} s to {instant(track.t[-1])} s.",
        zip(track.names, track.values[-1].tolist(), track.std[-1].tolist(), track.units, strict=True),
    )


def last_values(kind: str, title: str, sentence: str, rows: Iterable[tuple[str, float, float, str]]) -> Table:
    """Table of name, value, standard deviation and unit at the end of a time series."""
    return Table(
        title=title,
        sentence=sentence,
        columns=(
            Column(kind, kind),
            Column("", "last value", lambda r: plain(r["unit"], r["value"], r["std"])),
            Column("", "SI value (u)", lambda r: amount(r["value"], r["std"], r["unit"])),
            *(Column(key) for key in ("value", "std", "unit")),
        ),
        rows=tuple({kind: name, "value": x, "std": std, "unit": unit} for name, x, std, unit in rows),
    )


@table.register
def _(coast: Coast, which: str = "") -> Table:
    require(which)
    instants = np.unique(np.linspace(0, len(coast.t) - 1, COASTED).round().astype(int)) if len(coast.t) else ()
    return Table(
        title="Unaided drift",
        sentence=f"{grouped(len(coast.t))} positions are predicted from {instant(coast.start)} s.",
        columns=(
            Column("t", "time", lambda r: f"{instant(r['t'])} s", "s"),
            length_column("frozen", "position, all parameters held"),
            length_column("rezeroed", "position, constant of this run"),
            length_column("floor", "std from noise alone"),
        ),
        rows=tuple(
            {key: float(getattr(coast, key)[i]) for key in ("t", "frozen", "rezeroed", "floor")} for i in instants
        ),
    )


@table.register
def _(simulated: Simulated, which: str = "") -> Table:
    require(which)
    return Table(
        title=simulated.recording.name,
        sentence=as_sentence(f"{simulated.truth!r}"),
        columns=(Column("parameter", "parameter"), Column("value", "true value", lambda r: number(r["value"]))),
        rows=tuple({"parameter": name, "value": value} for name, value in simulated.truth.parameters.items()),
    )


__all__ = ["table"]


__dir__ = listing(globals())
