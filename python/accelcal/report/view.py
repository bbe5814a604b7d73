"""Texts and numbers of a report as plain values, printed by both HTML page and PDF."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

from accelcal._core import __version__
from accelcal.calibration.characteristic import COVERAGE_FACTOR, expanded_uncertainty, standard_uncertainty
from accelcal.calibration.export import SensorMatrix
from accelcal.data import STANDARD_GRAVITY, Recording, Rig, instant
from accelcal.diagnosis.findings import Size
from accelcal.diagnosis.search.scan import Candidate
from accelcal.effects import BUILT_IN, find, spelled
from accelcal.estimation.estimate import tied_sum
from accelcal.estimation.noise import NoiseEffect, NoiseReport
from accelcal.estimation.run_fit import RunFit
from accelcal.model import Estimate
from accelcal.plots.figure import error_reduction_sentence, share_text
from accelcal.plots.response import (
    FIT_HEAD,
    LINEARITY_HEAD,
    RESPONSE_HEAD,
    fit_rows,
    linearity_rows,
    response_note,
    response_rows,
    response_sentences,
)
from accelcal.report.content import AxesContent, Content
from accelcal.results.comparisons import fall, outside_note, quoted, reference_note
from accelcal.results.diagnoses import VERDICTS, contribution
from accelcal.results.table import Column, Row, Table, as_sentence, as_view
from accelcal.results.tables import CHANNEL_UNITS, axes_table, parameter_rows, used_acceleration
from accelcal.results.words import (
    about,
    amount,
    at_full_scale,
    error_size,
    grouped,
    label,
    largest_residual,
    length,
    number,
    plain,
    prefixed,
    probability,
    readable,
    with_plain,
    with_unit,
)
from accelcal.validation.comparison import ONLY_WHITE

MOST_PARAMETERS, MOST_LIMITS, MOST_FILES = 12, 8, 4
"""Rows of the first page; the details show all."""
NOT_DECLARED = "not declared"
QUANTITIES = {
    "a_y": "transverse acceleration",
    "a_z": "transverse acceleration",
    "rate_i": "angular rate",
    "rate_p": "angular rate",
    "alpha_o": "angular acceleration",
}
"""What a side channel is called where its own name is a symbol."""
AXES = {"level": "axis level", "up": "axis vertical, upwards", "down": "axis vertical, downwards"}
RANGES = (
    ("a", "acceleration", "m/s²"),
    ("v", "velocity", "m/s"),
    ("p", "position", "m"),
    ("frequency", "frequency", "Hz"),
)
"""Range of validity, what it is called, unit."""


def first_page(content: Content) -> dict[str, Any]:
    """Everything that the first page shows beside the verdict and the figure.

    Returns
    -------
    ``parameters``: rows with ``name``, ``symbol``, ``shown`` (value and expanded uncertainty), ``at_full_scale``,
    ``si`` (value and standard uncertainty); ``further``: parameters that only the details show; ``coverage``,
    ``conditions``, ``files``, ``unknown``.
    """
    rig = of_rig(content.fit.rig, called(content.recording))
    ordered = sorted(parameter_rows(content.fit), key=lambda row: row["owner"] != "sensor")
    return {
        "parameters": [with_budget(content, row) for row in ordered[:MOST_PARAMETERS]],
        "further": max(0, len(ordered) - MOST_PARAMETERS),
        "coverage": coverage(content),
        "conditions": [*of_runs(content), *rig, *sampling(content), *of_ranges(content)],
        "files": files(content),
        "unknown": list(unknown(content)),
    }


def with_budget(content: Content, row: Row) -> dict[str, Any]:
    """One parameter with its expanded uncertainty, that of the budget where there is one."""
    e = row.get("estimate")
    beside = f"{row['parameter'].removeprefix(row['name'])}{row.get('where', '')}"
    named = {"name": f"{spelled(row['name'])}{beside}", "symbol": row["symbol"]}
    if e is None:
        return named | {"shown": row["worded"], "at_full_scale": "", "si": row["si"]}
    std = standard_uncertainty(content.budget, e)
    expanded = expanded_uncertainty(content.fit, content.budget, e)
    full_scale = content.fit.rig.sensor.range
    return named | {
        "value": e.value,
        "expanded": expanded,
        "shown": f"{plain(e.unit, e.value, 0.0)} (held)" if row["held"] else plain(e.unit, e.value, expanded),
        "at_full_scale": at_full_scale(e.name, e.unit, e.value, expanded, full_scale, used_acceleration(content.fit)),
        "si": amount(e.value, std, e.unit),
    }


def coverage(content: Content) -> str:
    """What the expanded uncertainties are, in a sentence."""
    text = f"Value ± expanded uncertainty, coverage factor {COVERAGE_FACTOR:g} (about 95 %)"
    if content.budget.missing:
        left = ", ".join(spelled(key.removeprefix("uncertainty.")) for key in content.budget.missing)
        return f"{text}, from the scatter of the data alone. Not declared and not included: {left}."
    return f"{text}; sensor parameters include the declared contributions of the uncertainty budget."


def of_runs(content: Content) -> list[tuple[str, str]]:
    """Date, operator and mounting of the recordings, as declared."""
    runs = [run for run in (content.recording, content.holdout) if run is not None]
    return [
        ("date", labelled(runs, [run.labels.day for run in runs])),
        ("operator", labelled(runs, [run.labels.operator for run in runs])),
        ("mounting", labelled(runs, [run.labels.mounting for run in runs])),
    ]


def sampling(content: Content) -> list[tuple[str, str]]:
    """Rates of the two channels."""
    channels = content.described["channels"]
    recording = content.recording
    both = (("output", recording.accel.name), (called(recording), recording.position.name))
    rates = []
    for channel, name in both:
        if name in channels:
            rate, samples = channels[name]["rate_hz"], channels[name]["samples"]
            rates.append(f"{channel} {f'{rate:.6g} Hz' if rate else 'without a rate'} ({grouped(samples)} samples)")
    return [("sampling", ", ".join(rates))]


def labelled(runs: Sequence[Recording], texts: Sequence[str]) -> str:
    """One label of several recordings: once where they agree."""
    if len(set(texts)) == 1:
        return texts[0] or NOT_DECLARED
    return "; ".join(f"{text or NOT_DECLARED} ({run.name})" for run, text in zip(runs, texts, strict=True))


def called(recording: Recording) -> str:
    """What its reference is: a position, a velocity, or the acceleration of a reference."""
    return "position" if recording.reference is None else recording.reference.name.replace("_", " ")


def of_rig(rig: Rig, reference: str) -> list[tuple[str, str]]:
    """Sensor, reference, orientation and declared filters."""
    sensor = rig.sensor
    name = " ".join(filter(None, (sensor.model, sensor.serial and f"no. {sensor.serial}"))) or NOT_DECLARED
    full_scale = f", full scale ±{number(sensor.range)} m/s²" if sensor.range else ""
    factor, unit = prefixed("m", rig.resolution or 0.0)
    step = f"resolution {number(rig.resolution * factor)} {unit}" if rig.resolution else "resolution not declared"
    filters = [f"RC low-pass {number(rig.lowpass.cutoff)} Hz"] if rig.lowpass else []
    filters += [channel_filter.kind for channel_filter in rig.filters]
    return [
        ("sensor", f"{name}{full_scale}"),
        ("position reference", step) if reference == "position" else ("reference", reference),
        ("orientation", f"{AXES[rig.axis]}, mount {rig.mount}"),
        ("declared filters", ", ".join(filters) or "none"),
    ]


def of_ranges(content: Content) -> list[tuple[str, str]]:
    """Ranges of motion and temperature that the fit has used: the calibration is valid in them."""
    valid = content.fit.validity
    parts = [f"{called} {span(unit, *valid[key])}" for key, called, unit in RANGES if key in valid]
    recorded = content.described["channels"].get("temperature")
    limits = valid.get("temperature") or (None if recorded is None else (recorded["min"], recorded["max"]))
    warmth = f"{number(limits[0])} °C to {number(limits[1])} °C" if limits else "not recorded"
    share = content.described["range_used"]
    used = "" if share is None else f" ({100.0 * share:.0f} % of full scale)"
    return [("range of motion", f"{', '.join(parts)}{used}"), ("temperature", warmth)]


def span(unit: str, low: float, high: float) -> str:
    """A range in a unit with a fitting prefix."""
    factor, shown = prefixed(unit, low, high) if unit.startswith("m") else (1.0, unit)
    return f"{number(low * factor, 3)} to {with_unit(number(high * factor, 3), shown)}"


def files(content: Content) -> list[dict[str, str]]:
    """Recordings with the SHA-256 of their files, by what they were used for."""
    fit = content.fit
    entries = [of_file("fit", run) for run in fit.runs]
    entries += [
        {"use": "fit", "name": dwells.name or "dwells", "digest": dwells.digest} for dwells in (fit.dwells,) if dwells
    ]
    digests = {run.digest for run in fit.runs}
    for use, run in (("evaluation", content.recording), ("held out", content.holdout)):
        if run is not None and run.digest not in digests:
            entries.append(of_file(use, run))
    shown = entries[:MOST_FILES]
    if len(entries) > MOST_FILES:
        shown.append({"use": "", "name": f"and {len(entries) - MOST_FILES} more, see Provenance", "digest": ""})
    return shown


def of_file(use: str, run: RunFit | Recording) -> dict[str, str]:
    """One row of `files`: the digest is that of the whole file, so that it can be checked, where a part was used."""
    whole = run.session or run.digest
    part = "" if run.digest == whole else " (part)"
    return {"use": use, "name": f"{run.name or 'recording'}{part}", "digest": whole}


def unknown(content: Content) -> Iterator[str]:
    """What this calibration does not know: confounded, below the detection limits, or not tested."""
    d = content.diagnosis
    for group in d.classes:
        if len(group.members) > 1:
            yield f"Confounded on this record: {', '.join(map(spelled, group.members))}."
    sums = dict.fromkeys(tied_sum(content.fit, e) for e in content.fit.estimates)
    inseparable = [text for text in sums if " + " in text]
    if inseparable:
        yield f"Inseparable in this set-up, determined as a sum: {'; '.join(inseparable)}."
    limits = detection_limits(content)
    if limits:
        yield f"Detection limits (95 % probability of detection): {', '.join(limits)}. Smaller effects may be present."
    elif d.verdict != "adequate":
        yield "The error of an incomplete model is not in the uncertainties; detection limits need a complete one."
    yield from not_tested(content)


def detection_limits(content: Content) -> list[str]:
    """Smallest sizes of further effects of the sensor that would have been found; only where nothing is missing."""
    if content.diagnosis.verdict != "adequate" or content.power is None:
        return []
    mine = {effect.name: effect.traits for effect in BUILT_IN if (effect.owner, effect.port) == ("sensor", "output")}
    shown = [
        limit
        for limit in content.power.detectabilities
        if limit.effect in mine and limit.visible and len(limit.smallest) == 1
    ]
    shown.sort(key=lambda limit: (not mine[limit.effect].common, not mine[limit.effect].static))
    return [f"{spelled(limit.effect)} {about(limit.unit, limit.smallest[0])}" for limit in shown[:MOST_LIMITS]]


def not_tested(content: Content) -> Iterator[str]:
    """What the data cannot show: missing channels, other mountings and days, data that the fit has used."""
    missing = [
        QUANTITIES.get(channel, spelled(channel))
        for effect in BUILT_IN
        for channel in effect.needs
        if effect.owner == "sensor" and channel not in content.recording.side
    ]
    lacking = (
        (missing, f"Not tested, because not recorded: effects of {', '.join(dict.fromkeys(missing))}."),
        (not content.unseen, "Not tested on data that the fit has not used."),
        (not content.fit.spreads, "The uncertainties do not include differences between mountings and between days."),
    )
    yield from (sentence for holds, sentence in lacking if holds)


METHOD = (
    "A Kalman filter for position and velocity processes the encoder readings once; its input is the exact integral of "
    "the accelerometer output through the inverse of the declared low-pass.",
    "Every parameter, and every candidate effect, is filtered as a column with the same gains, so that estimates, "
    "covariance and ranking follow from one linear problem on whitened innovations.",
    "The motion that effects depend on is smoothed from both sensors, with weights that keep its error out of the "
    "residual; both noise levels are estimated by maximum likelihood.",
    "An effect is named if it explains more than the best of all alternatives would explain by chance; effects that "
    "explain as much within a stated margin are reported as confounded.",
    "Error reduction is measured by the systematic error of the corrected output on data that the fit has not used: "
    "its rms where the reference is better than the sensor, less the power of noise; unaided drift stands beside it.",
)


OF_INTEGRALS = (
    "Output and reference are integrated against smooth functions of short duration, on which all derivatives fall, so "
    "that no measured signal is differentiated; the declared low-pass is undone.",
    "Every parameter, and every candidate effect, is a column of such integrals, so that estimates, covariance and "
    "ranking follow from one linear problem, weighted by the noise of both channels.",
)
"""What a fit by the weak form has in place of the first two sentences of `METHOD`."""


def view(content: Content | AxesContent) -> dict[str, Any]:
    """Everything that is printed, by section; every number is one of `content`."""
    if isinstance(content, AxesContent):
        return view_of_axes(content)
    d, shown = content.diagnosis, parameters(content)
    fitted = [as_sentence(note.sentence) for note in content.fit.remarks]
    return {
        "title": f"Accelerometer report: {content.recording.title}",
        "verdict": d.verdict,
        "badge": VERDICTS[d.verdict],
        "sentence": readable(d.sentence),
        "first": not d.nameable,
        "suspect": list(d.suspect),
        "notes": [readable(text) for text in d.notes],
        "summary": [readable(text) for text in summary(content)],
        "page": first_page(content),
        "version": f"accelcal {__version__}",
        "found": findings(content),
        "limits": detection_limits(content),
        "importance": importance(content),
        "apart": apart(content),
        "falling": falling(content),
        "where": [
            largest_residual(content.diagnosis.where.worst),
            *map(as_sentence, content.judged.not_carried),
            *outside_note(content.judged),
        ],
        "regions": as_view(content.diagnosis.where.table("regions")),
        "response": response(content),
        "parameters": as_view(shown),
        "electrical": volts(content),
        "budget": budget(content),
        "data": data(content),
        "method": [*(OF_INTEGRALS if content.fit.method == "weak" else METHOD[:2]), *METHOD[2:]],
        "example": example(content),
        "provenance": provenance(content),
        "remarks": [*(note for note in fitted if note not in shown.notes), *content.remarks],
    }


def view_of_axes(content: AxesContent) -> dict[str, Any]:
    """Everything that is printed of several outputs: parameters and matrix side by side, then each by itself."""
    first, *_ = content.by_axis.values()
    return {
        "title": f"Accelerometer report: {', '.join(c.recording.name for c in content.by_axis.values())}",
        "axes": {axis: view(c) for axis, c in content.by_axis.items()},
        "parameters": as_view(
            axes_table(
                content.fit, lambda r: str(with_budget(content.by_axis.get(r.get("axis", ""), first), r)["shown"])
            )
        ),
        "coverage": coverage(first),
        "matrix": as_view(SensorMatrix.of(content.fit).table()) if content.fit.axes else None,
        "version": f"accelcal {__version__}",
    }


def summary(content: Content) -> list[str]:
    """The key figures: unaided drift, one-step prediction error, largest residual."""
    evaluation = content.judged
    held_out = "a held-out part of the fitted recording" if content.is_part else "a held-out recording"
    kind = held_out if content.unseen else "the fitted recording"
    nested = content.nested
    steps = [evaluation] if nested is None else list(nested)[: len(nested) - content.lacking]
    lines = [
        fall(steps, f" on {kind}", content.fit.rig.sensor.range),
        *reference_note(steps[-1]),
        *(as_sentence(score.sentence) for score in evaluation.noise_scores),
        f"One-step prediction error: {length(evaluation.one_step_rms)} rms.",
    ]
    if content.diagnosis.verdict != "adequate":  # the region of the largest residual says what a model lacks
        lines.append(largest_residual(evaluation.worst))
    return lines


def findings(content: Content) -> list[dict[str, Any]]:
    """Effects of the model beyond its base, and missing ones."""
    d, rows = content.diagnosis, list[dict[str, Any]]()
    for name in (n for n in content.fit.model.added if find(n).traits.visible):
        noise = [e for e in content.fit.noise_effects if e.name == name and e.std > 0.0]
        mine = [e for e in content.fit.estimates if e.name.split(".")[0] == name]
        rows.append(
            {
                "effect": name,
                "state": "in the model",
                "estimate": several(noise[:1] or mine),
                "contribution": contributed(content, name),
                **({"snr": abs(mine[0].value) / mine[0].std} if len(mine) == 1 and mine[0].std > 0.0 else {}),
            }
        )
    scanned = {c.effect: c for c in reversed(d.scan.candidates)}
    rows += [
        {
            "effect": c.effect,
            "state": "missing",
            "estimate": size_text(c),
            "snr": c.snr,
            "p_value": probability(c.p_value),
            "contribution": contributed(content, c.effect),
        }
        for effect_found in d.scan.detected
        if (c := scanned.get(effect_found.effect)) is not None
    ]
    rows += [
        {
            "effect": test.effect,
            "state": "in the noise",
            "estimate": test.sentence,
            "p_value": probability(test.p_value),
            "contribution": contributed(content, test.effect),
        }
        for test in d.channels
    ]
    return rows


def size_text(c: Candidate) -> str:
    """Estimate of a candidate, or how many coefficients it has."""
    return with_plain(c.estimate[0], c.std[0], c.unit) if len(c.estimate) == 1 else f"{len(c.estimate)} coefficients"


def contributed(content: Content, name: str) -> str:
    """Largest contribution of an effect over the used range; empty where it has none."""
    size = content.diagnosis.sizes.get(name)
    return "" if size is None else contribution(size, content.fit.rig.sensor.range)


def several(estimates: Sequence[Estimate | NoiseEffect]) -> str:
    """Estimates of one effect in a cell."""
    if len(estimates) > 2:
        return f"{sum(e.std > 0.0 for e in estimates)} coefficients"
    return ", ".join(with_plain(e.value, e.std, e.unit) for e in estimates)


def importance(content: Content) -> list[str]:
    """Effects sorted by the declared tolerance; empty where none is declared."""
    rows = content.diagnosis.importance
    if rows is None:
        return []
    parts = (
        ("exceeded by", rows.matters),
        ("not reached by", rows.below),
        ("not applicable at the encoder to", rows.not_comparable),
    )
    limit = f"Declared tolerance {number(rows.tolerance)} m/s²"
    return [f"{limit}, {relation} {', '.join(names)}." for relation, names in parts if names]


def apart(content: Content) -> list[dict[str, str]]:
    """Confounded effects, and the experiment that separates them."""
    d = content.diagnosis
    ties = [
        *((t, "on this record") for t in d.classes if len(t.members) > 1),
        *((t, "on this rig, as mounted") for t in d.inseparable),
    ]
    return [
        {
            "members": ", ".join(map(spelled, t.members)),
            "where": where,
            "experiment": as_sentence(t.experiment),
        }
        for t, where in ties
    ]


def falling(content: Content) -> dict[str, Any] | None:
    """Error reduction as a table."""
    nested = content.nested
    if nested is None:
        return None
    unit = nested.headline.unit
    return {
        "sentence": error_reduction_sentence(nested) + (f"; {ONLY_WHITE}" if unit == "m" else ""),
        "same_run": nested.same_run,
        "floor": nested.floor.value,
        "rows": [
            {
                "model": name,
                "error": error,
                "shown": quoted(nested.headline, evaluation),
                "in_model": number < len(nested) - content.lacking,
                "around": "" if around is None else " to ".join(error_size(e, unit) for e in (around.low, around.high)),
                "share": share_text(nested, number),
            }
            for number, (name, error, around, evaluation) in enumerate(
                zip(nested.names, nested.errors, nested.intervals, nested, strict=True)
            )
        ],
    }


def response(content: Content) -> dict[str, Any] | None:
    """Frequency response: tables, then what was concluded; None where the motion is not one of sine steps."""
    answer = content.response
    if answer is None:
        return None
    return {
        "sentences": response_sentences(answer),
        "head": RESPONSE_HEAD,
        "rows": response_rows(answer),
        "note": response_note(answer),
        "fits": {"head": FIT_HEAD, "rows": fit_rows(answer)},
        "linearity": {"head": LINEARITY_HEAD, "rows": linearity_rows(answer)},
    }


def parameters(content: Content) -> Table:
    """Table of parameters, with the largest contribution of each; uncertainties are those of the fit."""
    fit, largest = content.fit, content.diagnosis.largest
    at_encoder = {term.name for term in fit.model.terms if term.port == "position"}
    sizes = {name: Size(value, name in at_encoder) for name, value in largest.items()} | dict(content.diagnosis.sizes)

    def contributed(row: Row) -> str:
        size = None if row["kind"] == "mean" else sizes.get(row["name"])
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
    """Sensitivity and zero-g output where a scale is declared; V/g as mV/g; with their budget where it is complete."""
    rows, fit = [], content.fit
    for (key, quantity), name in zip(fit.electrical.items(), ("scale_factor", "bias"), strict=False):
        factor, unit = (1e3, f"m{quantity.unit}") if quantity.unit.startswith("V") else (1.0, quantity.unit)
        of_fit, combined = fit[name].std, standard_uncertainty(content.budget, fit[name])
        value, std = factor * quantity.value, factor * quantity.std * (combined / of_fit if of_fit else 1.0)
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
    components = content.budget

    return {
        "missing": list(components.missing),
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
                "components": [
                    {
                        "source": c.source,
                        "kind": c.kind,
                        "input": with_unit(number(c.input_std, 2), c.input_unit),
                        "share": with_unit(number(c.contribution, 2), line.estimate.unit),
                    }
                    for c in line.components
                ],
            }
            for line in components.lines
        ],
    }


def data(content: Content) -> dict[str, Any]:
    """Summary of the recording."""
    described = content.described
    rest = sum(end - start for start, end in described["rest_s"])
    return {
        "channels": [
            {
                "name": name,
                "samples": grouped(c["samples"]),
                "rate": f"{c['rate_hz']:.6g} Hz" if c["rate_hz"] else "",
                "span": f"{instant(c['start_s'])} s to {instant(c['end_s'])} s",
                "range": f"{number(c['min'])} to {number(c['max'])} {label('', c['unit']).strip(' ()')}",
            }
            for name, c in described["channels"].items()
        ],
        "used": [f"{instant(a)} s to {instant(b)} s" for a, b in content.diagnosis.used],
        "breaks": [f"{instant(t)} s" for t in content.diagnosis.breaks],
        "range_used": None if described["range_used"] is None else f"{100.0 * described['range_used']:.0f} %",
        "rest": f"{instant(rest)} s in {len(described['rest_s'])} stretches",
        "dropped": [dropped.sentence for dropped in content.diagnosis.dropped],
        "warnings": [f["text"] for f in described["findings"] if f["severity"] == "warning"],
        "notes": [f["text"] for f in described["findings"] if f["severity"] != "warning"],
        "assumptions": list(described["assumptions"]),
        "noise": [noise(content, i) for i in range(len(content.fit.runs))],
    }


def of_reference(noise: NoiseReport) -> str:
    """Noise of one reading of the reference."""
    if noise.reference == "position":
        return f"encoder {length(noise.all.reading)} rms"
    return f"{noise.reference.replace('_', ' ')} {plain(CHANNEL_UNITS[noise.reference], noise.all.reading, 0.0)} rms"


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
        steps_ += [
            f"The instrument reads {number(applied.raw, 6)} {unit}.",
            f"Declared zero and scale: ({number(applied.raw, 6)} − {number(sensor.zero or 0.0, 6)}) {unit} / "
            f"({number(sensor.scale or math.nan, 6)} {unit}/(m/s²)) = {number(applied.output, 8)} m/s².",
        ]
    else:
        steps_.append(f"The output is {number(applied.output, 8)} m/s².")
    steps_.append(
        f"Without nonlinearity: (output − K0)/(1 + k) = ({number(applied.output, 8)} − {number(fit['bias'].value, 8)})/"
        f"{number(fit.values().scale, 8)} = {number(applied.rounds[0], 8)} m/s²."
    )
    iterates = list(dict.fromkeys(number(a, 8) for a in applied.rounds))
    steps_ += [f"Newton step {i} on the nonlinear terms: {a} m/s²." for i, a in enumerate(iterates[1:], 1)]
    u = applied.combined
    basis = "with the declared contributions of the budget" if applied.declared else "from the fit alone"
    steps_.append(
        f"Specific force along the input axis: {number(applied.acceleration, 8)} m/s² = "
        f"{number(applied.acceleration / STANDARD_GRAVITY, 7)} g, standard uncertainty {basis} "
        f"{number(u, 2)} m/s², expanded uncertainty {number(COVERAGE_FACTOR * u, 2)} m/s², "
        "coverage factor 2; noise of this reading not included."
    )
    left = [f"{name} ({owner})" for name, owner in applied.left_out]
    if left:
        steps_.append(f"Not applied to a single reading: {', '.join(left)}.")
    return {"steps": steps_, "output": applied.output, "acceleration": applied.acceleration, "std": applied.combined}


def provenance(content: Content) -> list[tuple[str, str]]:
    """Origin of the model and the data."""
    fit = content.fit
    rows = [
        *(("program", f"accelcal {__version__}"), ("command", content.command), ("method", fit.method)),
        *((f"fitted: {name}", digest) for name, digest in fit.sources),
        *((f"evaluated on: {r.name}", r.session) for r in (content.recording, content.holdout) if r is not None),
        ("effects", ", ".join(fit.model.effects)),
        ("sensor", " ".join(filter(None, (fit.rig.sensor.model, fit.rig.sensor.serial)))),
        ("valid for", "; ".join(f"{k}: {number(a)} to {number(b)}" for k, (a, b) in fit.validity.items())),
    ]
    return [(name, value) for name, value in rows if value]
