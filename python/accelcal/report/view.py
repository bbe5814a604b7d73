"""Texts and numbers of a report as plain values, printed by both HTML page and PDF."""

from __future__ import annotations

import math
from typing import Any

from accelcal._core import __version__
from accelcal.calibration.budget import COVERAGE_FACTOR, Component
from accelcal.data.references import UNITS
from accelcal.data.rig import STANDARD_GRAVITY
from accelcal.data.units import instant
from accelcal.diagnosis.findings import Size
from accelcal.effects import find, spelled
from accelcal.estimation.noise import NoiseReport
from accelcal.model import Estimate
from accelcal.plots.numbers import (
    error_reduction_sentence,
    floor_sentence,
    share_text,
)
from accelcal.plots.response import (
    FIT_HEAD,
    LINEARITY_HEAD,
    RESPONSE_HEAD,
    RESPONSE_NOTE,
    fit_rows,
    linearity_rows,
    response_rows,
    response_sentences,
)
from accelcal.report.content import Content
from accelcal.report.first_page import detection_limits, first_page
from accelcal.results.diagnoses import VERDICTS, contribution
from accelcal.results.table import Column, Row, Table, as_view
from accelcal.results.words import (
    amount,
    grouped,
    label,
    length,
    number,
    plain,
    probability,
    readable,
    with_plain,
    with_unit,
)
from accelcal.validation.sensor_noise import ONLY_WHITE
from accelcal.validation.stretches import headline_horizon, quoted_error

METHOD = (
    "A Kalman filter for position and velocity processes the encoder readings once; its input is the exact integral of "
    "the accelerometer output through the inverse of the declared low-pass.",
    "Every parameter, and every candidate effect, is filtered as a column with the same gains, so that estimates, "
    "covariance and ranking follow from one linear problem on whitened innovations.",
    "The motion that effects depend on is smoothed from both sensors, with weights that keep its error out of the "
    "residual; both noise levels are estimated by maximum likelihood.",
    "An effect is named if it explains more than the best of all alternatives would explain by chance; effects that "
    "explain as much within a stated margin are reported as confounded.",
    "Error reduction is measured as unaided drift: position is withheld, and the position predicted from the "
    "accelerometer alone is compared with the encoder on data that the fit has not used.",
)


def view(content: Content) -> dict[str, Any]:
    """Everything that is printed, by section; every number is one of `content`."""
    d = content.diagnosis
    return {
        "title": f"Accelerometer report: {content.recording.name or 'recording'}",
        "verdict": d.verdict,
        "badge": VERDICTS[d.verdict],
        "sentence": readable(d.sentence),
        "first": not d.nameable,
        "suspect": list(d.suspect),
        "notes": [readable(text) for text in d.notes],
        "summary": [readable(text) for text in summary(content)],
        "page": first_page(content),
        "version": f"accelcal {__version__}",
        "found": found(content),
        "limits": detection_limits(content),
        "importance": importance(content),
        "apart": apart(content),
        "falling": falling(content),
        "where": [
            f"{s[:1].upper()}{s[1:]}."
            for s in (content.diagnosis.where.worst, *content.judged.not_carried, *content.judged.remarks)
        ],
        "regions": as_view(content.diagnosis.where.table("regions")),
        "response": response(content),
        "parameters": as_view(parameters(content)),
        "electrical": volts(content),
        "budget": budget(content),
        "data": data(content),
        "method": list(METHOD),
        "example": example(content),
        "provenance": provenance(content),
        "remarks": [*(one.sentence for one in content.fit.remarks), *content.remarks],
    }


def summary(content: Content) -> list[str]:
    """The key figures: unaided drift, one-step prediction error, largest residual."""
    seen = content.judged
    held_out = "a held-out part of the fitted recording" if content.is_part else "a held-out recording"
    kind = held_out if content.unseen else "the fitted recording"
    lines = []
    h = headline_horizon(seen)
    if h is not None:
        floor = f"; {floor_sentence(content.nested)}" if content.nested and content.nested.horizon == h else ""
        lines.append(f"Unaided drift after {h:g} s on {kind}: {length(quoted_error(seen, h))} rms{floor}.")
    lines += [f"{score.sentence[:1].upper()}{score.sentence[1:]}." for score in seen.noise_scores]
    lines.append(
        f"One-step prediction error: {length(seen.one_step_rms)} rms. {seen.worst[:1].upper()}{seen.worst[1:]}."
    )
    return lines


def found(content: Content) -> list[dict[str, Any]]:
    """Effects of the model beyond its base, and missing ones."""
    d, rows = content.diagnosis, list[dict[str, Any]]()
    for name in (n for n in content.fit.model.added if find(n).traits.visible):
        mine = [e for e in content.fit.estimates if e.name.split(".")[0] == name]
        seen = [e for e in content.fit.noise_effects if e.name == name and e.std > 0.0]
        of_noise = [with_plain(e.value, e.std, e.unit) for e in seen]
        size = contributed(content, name)
        rows.append(
            {
                "effect": name,
                "state": "in the model",
                "estimate": of_noise[0] if of_noise else several(mine),
                "contribution": size,
            }
        )
    for one in d.scan.found:
        c = next((c for c in d.scan.candidates if c.effect == one.effect), None)
        if c is not None:
            single = len(c.estimate) == 1
            text = with_plain(c.estimate[0], c.std[0], c.unit) if single else f"{len(c.estimate)} coefficients"
            rows.append(
                {
                    "effect": c.effect,
                    "state": "missing",
                    "estimate": text,
                    "snr": c.snr,
                    "p_value": probability(c.p_value),
                    "contribution": contributed(content, c.effect),
                }
            )
    for test in d.channels:
        rows.append(
            {
                "effect": test.effect,
                "state": "in the noise",
                "estimate": test.sentence,
                "p_value": probability(test.p_value),
                "contribution": contributed(content, test.effect),
            }
        )
    return rows


def contributed(content: Content, name: str) -> str:
    """Largest contribution of an effect over the used range; empty where it has none."""
    size = content.diagnosis.sizes.get(name)
    return "" if size is None else contribution(size, content.fit.rig.sensor.range)


def several(estimates: list[Estimate]) -> str:
    """Estimates of one effect in a cell."""
    if len(estimates) > 2:
        return f"{sum(e.std > 0.0 for e in estimates)} coefficients"
    return ", ".join(with_plain(e.value, e.std, e.unit) for e in estimates)


def importance(content: Content) -> list[str]:
    """Effects sorted by the declared tolerance; empty where none is declared."""
    found = content.diagnosis.importance
    if found is None:
        return []
    parts = (
        ("exceeded by", found.matters),
        ("not reached by", found.below),
        ("not applicable at the encoder to", found.not_comparable),
    )
    limit = f"Declared tolerance {number(found.tolerance)} m/s²"
    return [f"{limit}, {relation} {', '.join(names)}." for relation, names in parts if names]


def apart(content: Content) -> list[dict[str, str]]:
    """Confounded effects, and the experiment that separates them."""
    d = content.diagnosis
    ties = [(t, "on this record") for t in d.classes if len(t.members) > 1]
    ties += [(t, "on this rig, as mounted") for t in d.inseparable]
    return [
        {
            "members": ", ".join(map(spelled, t.members)),
            "where": where,
            "experiment": f"{t.experiment[:1].upper()}{t.experiment[1:]}.",
        }
        for t, where in ties
    ]


def falling(content: Content) -> dict[str, Any] | None:
    """Error reduction as a table."""
    nested = content.nested
    if nested is None:
        return None
    return {
        "sentence": f"{error_reduction_sentence(nested)}; {ONLY_WHITE}",
        "same_run": nested.same_run,
        "floor": nested.floor.value,
        "rows": [
            {
                "model": name,
                "error": error,
                "shown": length(error),
                "in_model": number < len(nested) - content.lacking,
                "around": "" if around is None else f"{length(around.low)} to {length(around.high)}",
                "share": share_text(nested, number),
            }
            for number, (name, error, around) in enumerate(
                zip(nested.names, nested.errors, nested.intervals, strict=True)
            )
        ],
    }


def response(content: Content) -> dict[str, Any] | None:
    """Frequency response: tables, then what was concluded; None where the motion is not one of sine steps."""
    found = content.response
    if found is None:
        return None
    return {
        "sentences": response_sentences(found),
        "head": RESPONSE_HEAD,
        "rows": response_rows(found),
        "note": RESPONSE_NOTE,
        "fits": {"head": FIT_HEAD, "rows": fit_rows(found)},
        "linearity": {"head": LINEARITY_HEAD, "rows": linearity_rows(found)},
    }


def parameters(content: Content) -> Table:
    """Table of parameters, with the largest contribution of each; uncertainties are those of the fit."""
    fit, largest = content.fit, content.diagnosis.largest
    at_encoder = {term.name for term in fit.model.terms if term.port == "position"}
    sizes = {name: Size(value, name in at_encoder) for name, value in largest.items()} | dict(content.diagnosis.sizes)

    def contributed(row: Row) -> str:
        size = sizes.get(row["name"])
        return "" if size is None else contribution(size, fit.rig.sensor.range)

    def expanded(row: Row) -> float | None:
        e = row.get("estimate")
        return None if e is None else fit.expanded(e, COVERAGE_FACTOR)

    def in_unit(value: float | None, row: Row) -> str:
        return "" if not value else with_unit(number(value, 2), row["unit"])

    shown: Table = fit.table()
    return shown.with_columns(
        Column("", "standard uncertainty", lambda r: in_unit(r.get("std"), r), exact=lambda r: r.get("std")),
        Column("", "expanded uncertainty, coverage factor 2", lambda r: in_unit(expanded(r), r), exact=expanded),
        Column("", "belongs to", lambda row: row["owner"]),
        Column("", "largest contribution", contributed),
    )


def volts(content: Content) -> list[dict[str, Any]]:
    """Sensitivity and zero-g output where a scale is declared; V/g as mV/g."""
    rows = []
    for key, quantity in content.fit.electrical.items():
        factor, unit = (1e3, f"m{quantity.unit}") if quantity.unit.startswith("V") else (1.0, quantity.unit)
        value, std = factor * quantity.value, factor * quantity.std
        rows.append(
            {
                "name": spelled(key),
                "value": value,
                "std": std,
                "unit": unit,
                "plain": plain(unit, value, std),
                "shown": amount(value, std, unit),
                "shown_expanded": f"{number(COVERAGE_FACTOR * std, 2)} {unit}",
            }
        )
    return rows


def budget(content: Content) -> dict[str, Any]:
    """The uncertainty budget, or the keys that are not declared."""
    found = content.budget

    def component(c: Component, unit: str) -> dict[str, str]:
        given = with_unit(number(c.input_std, 2), c.input_unit)
        return {
            "source": c.source,
            "kind": c.kind,
            "input": given,
            "share": with_unit(number(c.contribution, 2), unit),
        }

    return {
        "missing": list(found.missing),
        "lines": [
            {
                "name": line.estimate.name,
                "symbol": line.estimate.symbol,
                "value": line.estimate.value,
                "unit": line.estimate.unit,
                "shown": amount(line.estimate.value, line.combined, line.estimate.unit),
                "combined": line.combined,
                "expanded": line.expanded,
                "shown_combined": with_unit(number(line.combined, 2), line.estimate.unit),
                "shown_expanded": with_unit(number(line.expanded, 2), line.estimate.unit),
                "plain": plain(line.estimate.unit, line.estimate.value, line.combined),
                "components": [component(c, line.estimate.unit) for c in line.components],
            }
            for line in found.lines
        ],
    }


def data(content: Content) -> dict[str, Any]:
    """Summary of the recording."""
    seen = content.described
    rest = sum(end - start for start, end in seen["rest_s"])
    return {
        "channels": [
            {
                "name": name,
                "samples": grouped(c["samples"]),
                "rate": f"{c['rate_hz']:.6g} Hz" if c["rate_hz"] else "",
                "span": f"{instant(c['start_s'])} s to {instant(c['end_s'])} s",
                "range": f"{number(c['min'])} to {number(c['max'])} {label('', c['unit']).strip(' ()')}",
            }
            for name, c in seen["channels"].items()
        ],
        "used": [f"{instant(a)} s to {instant(b)} s" for a, b in content.diagnosis.used],
        "breaks": [f"{instant(t)} s" for t in content.diagnosis.breaks],
        "range_used": None if seen["range_used"] is None else f"{100.0 * seen['range_used']:.0f} %",
        "rest": f"{instant(rest)} s in {len(seen['rest_s'])} stretches",
        "dropped": [dropped.sentence for dropped in content.diagnosis.dropped],
        "warnings": [f["text"] for f in seen["findings"] if f["severity"] == "warning"],
        "notes": [f["text"] for f in seen["findings"] if f["severity"] != "warning"],
        "assumptions": list(seen["assumptions"]),
        "noise": [noise(content, i) for i in range(len(content.fit.runs))],
    }


def of_reference(noise: NoiseReport) -> str:
    """Noise of one reading of the reference."""
    if noise.reference == "position":
        return f"encoder {length(noise.all.reading)} rms"
    return f"{noise.reference} {number(1e6 * noise.all.reading)} µ{UNITS[noise.reference]} rms"


def noise(content: Content, index: int) -> str:
    """Noise of one fitted run in a sentence."""
    run = content.fit.runs[index]
    level, micro = run.noise.all, 1e6 / STANDARD_GRAVITY
    text = f"{run.name or 'recording'}: {number(level.density * micro)} µg/√Hz, {of_reference(run.noise)}"
    if run.noise.declared is not None:
        text += f"; declared {number(run.noise.declared * micro)} µg/√Hz"
    return text


def example(content: Content) -> dict[str, Any] | None:
    """Correction of one reading, step by step."""
    applied = content.applied
    if applied is None:
        return None
    fit, steps_ = content.fit, []
    sensor = fit.rig.sensor
    if applied.raw is not None:
        unit = applied.raw_unit
        steps_.append(f"The instrument reads {number(applied.raw, 6)} {unit}.")
        steps_.append(
            f"Declared zero and scale: ({number(applied.raw, 6)} − {number(sensor.zero or 0.0, 6)}) {unit} / "
            f"({number(sensor.scale or math.nan, 6)} {unit}/(m/s²)) = {number(applied.output, 8)} m/s²."
        )
    else:
        steps_.append(f"The output is {number(applied.output, 8)} m/s².")
    steps_.append(
        f"Without nonlinearity: (output − K0)/(1 + k) = ({number(applied.output, 8)} − {number(fit['bias'].value, 8)})/"
        f"{number(fit.values().scale, 8)} = {number(applied.rounds[0], 8)} m/s²."
    )
    iterates = list(dict.fromkeys(number(a, 8) for a in applied.rounds))
    steps_ += [f"Newton step {i} on the nonlinear terms: {a} m/s²." for i, a in enumerate(iterates[1:], 1)]
    steps_.append(
        f"Specific force along the input axis: {number(applied.acceleration, 8)} m/s² = "
        f"{number(applied.acceleration / STANDARD_GRAVITY, 7)} g, standard uncertainty from the fit "
        f"{number(applied.std, 2)} m/s², expanded uncertainty {number(COVERAGE_FACTOR * applied.std, 2)} m/s², "
        "coverage factor 2; noise of this reading not included."
    )
    left = [f"{name} ({owner})" for name, owner in applied.left_out]
    if left:
        steps_.append(f"Not applied to a single reading: {', '.join(left)}.")
    return {"steps": steps_, "output": applied.output, "acceleration": applied.acceleration, "std": applied.std}


def provenance(content: Content) -> list[tuple[str, str]]:
    """Origin of the model and the data."""
    fit = content.fit
    rows = [("program", f"accelcal {__version__}"), ("command", content.command), ("method", fit.method)]
    rows += [(f"fitted: {name}", digest) for name, digest in fit.sources]
    rows += [(f"evaluated on: {r.name}", r.session) for r in (content.recording, content.holdout) if r is not None]
    rows += [("effects", ", ".join(fit.model.effects))]
    sensor = fit.rig.sensor
    rows += [("sensor", " ".join(filter(None, (sensor.model, sensor.serial))))]
    rows += [("valid for", "; ".join(f"{k}: {number(a)} to {number(b)}" for k, (a, b) in fit.validity.items()))]
    return [(name, value) for name, value in rows if value]
