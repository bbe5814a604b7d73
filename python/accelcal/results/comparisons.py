"""Tables of comparisons: drift by horizon, where a model fails, and the errors of several models."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

from accelcal._support.values import listing
from accelcal.data import MICRO_G, POSITION_ORDER, instant
from accelcal.diagnosis.select.improvement import Improvement
from accelcal.results.diagnoses import VERDICTS
from accelcal.results.table import Column, Row, Table, as_sentence, require, table
from accelcal.results.words import (
    error_size,
    grouped,
    in_g,
    largest_residual,
    length,
    number,
    percent,
    plain,
    prefixed,
    probability,
    typeset,
    with_unit,
)
from accelcal.validation.comparison import ONLY_WHITE, SOURCES, Evaluation, NoiseFloor, Region, SensorNoise
from accelcal.validation.differences import Comparison, HeldOutChange, Measure, verdict_of
from accelcal.validation.noise_floor import Ruler


@table.register
def _(evaluation: Evaluation, which: str = "") -> Table:
    require(which, "regions")
    if which == "regions":
        return regions(("", evaluation.recording, evaluation))
    return Table(
        title=f"Model against {evaluation.recording or 'recording'}",
        sentence=fall([evaluation]),
        columns=(
            Column("horizon", "unaided drift after", lambda r: f"{r['horizon']:g} s", "s"),
            length_column("drift", "bias re-estimated"),
            length_column("drift_frozen", "all from the fit"),
            length_column("noise_floor", "noise alone"),
            Column("start_points", "start points"),
        ),
        rows=tuple(
            {
                "horizon": h,
                "drift": evaluation.coast_rms[h],
                "drift_frozen": evaluation.coast_frozen_rms[h],
                "noise_floor": evaluation.drift_floors[h],
                **span_of(evaluation.noise_floor, h, "noise_floor"),
                "start_points": evaluation.coast_starts[h],
            }
            for h in evaluation.coast_rms
        ),
        alarms=tuple(f"Suspect data: {text}" for text in suspect(evaluation)),
        notes=(
            *reference_note(evaluation),
            *unresolved_note(evaluation),
            *floor_note(evaluation.noise_floor),
            *comparison_notes(evaluation),
        ),
        detail=(*DEFINITIONS, *comparison_details(evaluation)),
        about={"name": evaluation.recording},
    )


DEFINITIONS = (
    "Systematic error: functions of time and motion, errors of the fitted parameters among them; slow noise as "
    "far as this record does not tell it from white noise.",
    as_sentence(ONLY_WHITE),
)
"""Explanations of the words of a comparison."""


def comparison_notes(evaluation: Evaluation) -> list[str]:
    """Errors beside the drift, and what must be read with them."""
    nis = "" if evaluation.nis is None else f" (normalised innovation squared {evaluation.nis:.3f})"
    fit = "" if evaluation.fit_percent is None else f", fit {percent(evaluation.fit_percent)}"
    return [
        f"One-step error {length(evaluation.one_step_rms)} rms{nis}; accelerometer residual up to "
        f"{number(evaluation.band)} Hz {error_size(evaluation.accel_rms, 'm/s²')} rms{fit}.",
        *([] if not own_constant(evaluation) else [setup_note(evaluation)]),
        largest_residual(evaluation.worst),
        *(as_sentence(score.sentence) for score in evaluation.noise_scores),
        *map(as_sentence, evaluation.not_carried),
        *outside_note(evaluation),
    ]


def comparison_details(evaluation: Evaluation) -> list[str]:
    """Further errors of one model on one recording."""
    steps = [f"{k}: {length(y)}" for k, y in evaluation.k_step_rms.items() if y is not None]
    setup = [setup_note(evaluation)] if math.isfinite(evaluation.setup_bias[1]) and not own_constant(evaluation) else []
    return [*setup, *([f"Errors of k steps, in readings: {', '.join(steps)}."] if steps else [])]


def own_constant(evaluation: Evaluation) -> bool:
    """Whether the constant of this recording differs from that of the fit."""
    setup, std = evaluation.setup_bias
    return math.isfinite(std) and abs(setup) > OWN_CONSTANT * std


OWN_CONSTANT = 3.0
"""Standard deviations from which the constant of a recording is its own."""


def setup_note(evaluation: Evaluation) -> str:
    """How much the constant of this recording differs from that of the fit."""
    return f"Change of set-up or turn-on bias: {plain('m/s²', *evaluation.setup_bias)}."


def regions(*several: tuple[str, str, Evaluation]) -> Table:
    """Where models fail: the worst region of every variable, worst first, of each model on each recording."""
    (_, recording, first), *others = several
    return Table(
        title="Where it fails",
        sentence=as_sentence(first.worst),
        columns=(
            Column("variable", "variable"),
            *((Column("model", "model"), Column("recording", "recording")) if others else ()),
            Column("", "range", range_text),
            Column("excess", "excess", excess_text),
            Column("sigma", "sigma", lambda r: f"{abs(r['sigma']):.1f}"),
            Column("share", "share of residual", share_text),
            Column("p", "p", lambda r: probability(r["p"])),
            *(Column(key) for key in ("unit", "low", "high", "excess_unit", "start", "end")),
        ),
        rows=tuple(
            {"model": name, "recording": place, **region_row(region)}
            for name, place, evaluation in several
            for region in evaluation.worst_regions
        ),
        notes=(
            "The worst region of each variable, set-up aside: mean residual, its share of the mean square residual, "
            "and p adjusted for the number of all regions.",
        ),
        about={"name": recording, "worst": first.worst},
    )


def region_row(region: Region) -> Row:
    """Values of one region."""
    start, end = region.stretch or (None, None)
    keys = ("variable", "unit", "low", "high", "excess", "excess_unit", "sigma", "share", "p")
    return {**{key: getattr(region, key) for key in keys}, "start": start, "end": end}


def range_text(row: Row) -> str:
    """Range of a region in its unit."""
    plain_unit = row["unit"] in ("s", "Hz")
    factor, unit = (1.0, row["unit"]) if plain_unit else prefixed(row["unit"], row["low"], row["high"])
    low, high = (instant(x) if row["variable"] == "time" else number(x * factor) for x in (row["low"], row["high"]))
    return with_unit(f"{low} to {high}", unit)


def excess_text(row: Row) -> str:
    """Mean residual of a region beyond noise."""
    if row["excess_unit"] == "1":
        return f"{number(row['excess'], 3)} × noise"
    factor, unit = prefixed(row["excess_unit"], row["excess"])
    return with_unit(typeset(f"{row['excess'] * factor:+.3g}"), unit)


def share_text(row: Row) -> str:
    """Share of the mean square residual in per cent."""
    return "–" if row["share"] is None else f"{number(100.0 * max(row['share'], 0.0), 2)} %"


def length_column(key: str, head: str, *, detail: bool = False) -> Column:
    """Column of lengths, each with the prefix that fits it; an interval where the row has its ends."""
    return Column(key, head, lambda r: length_text(r, key), "m", detail=detail)


def length_text(row: Row, key: str) -> str:
    """A length, or the interval that holds it in 95 of 100 such records."""
    if row.get(f"{key}_low") is not None:
        return f"{length(row[f'{key}_low'])} to {length(row[f'{key}_high'])}"
    return "–" if row.get(key) is None else length(row[key])


def span_of(floor: NoiseFloor | None, horizon: float | None, key: str) -> Row:
    """Ends of the interval of the noise floor at a horizon, or of the simulation."""
    spread = None if floor is None else floor.at(horizon)
    return {} if spread is None else {f"{key}_low": spread.low, f"{key}_high": spread.high}


def quoted(measure: Measure, evaluation: Evaluation, full_scale: float | None = None) -> str:
    """The error of a model, rms; below the limit of detection its bound."""
    size = error_size(measure.error(evaluation), measure.unit, full_scale)
    interval = measure.interval(evaluation)
    return f"≤ {size}" if measure.band is not None and interval is not None and interval.low == 0.0 else size


def floor_of(measure: Measure, evaluation: Evaluation) -> str:
    """End of a sentence on what noise of the sensor alone would give."""
    spread = measure.floor(evaluation)
    if spread is None:
        return ""
    if measure.band is not None:
        return f"; limit of detection {error_size(spread.high, measure.unit)}"
    return f"; noise alone {length(spread.low)} to {length(spread.high)}"


def floor_note(floor: NoiseFloor | None) -> list[str]:
    """Source of the noise floor."""
    return [] if floor is None else [f"Noise alone: {source_of_noise(floor.sensor)}; 95 % prediction intervals."]


def source_of_noise(sensor: SensorNoise) -> str:
    """Source and size of the noise density of a sensor, and the declared one where it differs."""
    beside = "" if sensor.declared is None else f"; declared {density(sensor.declared)}"
    return f"{SOURCES[sensor.source]} {density(sensor.density)}{beside}"


def density(value: float) -> str:
    """A noise density in the unit of data sheets."""
    return f"{number(value / MICRO_G, 3)} µg/√Hz"


CLEARLY_BEYOND = 1.05
"""Times the trained range from which a motion is said to leave it; the motion of two filters differs by less."""


def outside_note(evaluation: Evaluation) -> list[str]:
    """One sentence on how far the motion of a recording leaves the trained range, and the errors inside and outside."""
    *parts, anywhere = evaluation.outside or (None,)
    if anywhere is None or not anywhere.count:
        return []
    clear = [part for part in parts if part is not None and part.count and part.beyond >= CLEARLY_BEYOND]
    if not clear:
        return []
    beyond = ", ".join(f"{part.variable} {part.beyond:.2g}×" for part in clear)
    inside, outside = ("–" if y is None else length(y) for y in anywhere.one_step)
    return [
        f"{evaluation.recording or 'The recording'} goes beyond the trained range: {beyond} "
        f"({grouped(anywhere.count)} of {grouped(anywhere.of)} readings; one-step error {inside} inside, {outside} "
        "outside)."
    ]


Part = tuple[str, Sequence[Evaluation], Sequence[HeldOutChange | None]]
"""Name of a recording, empty for all together; evaluation of each model on it, and the change of its error."""


@table.register
def _(result: Comparison, which: str = "") -> Table:
    require(which, "changes", "regions", "budget")
    if which in ("changes", "budget"):
        return changes(result) if which == "changes" else budgets(result)
    every = [
        (name, recording, evaluation)
        for recording, evaluations in zip(result.recordings, result.evaluations, strict=True)
        for name, evaluation in zip(result.names, evaluations, strict=True)
    ]
    if len(every) == 1:
        return table(every[0][2], which)
    if which == "regions":
        return regions(*every)
    differences = result.differences
    parts: list[Part] = [("", list(result), [None, *(difference.pooled for difference in differences)])]
    if len(result.recordings) > 1:
        parts += [
            (recording, evaluations, [None, *(difference.recordings[number] for difference in differences)])
            for number, (recording, evaluations) in enumerate(zip(result.recordings, result.evaluations, strict=True))
        ]
    return error_reduction(
        f"{', '.join(result.names)} on {', '.join(name or 'recording' for name in result.recordings)}",
        result.names,
        parts,
        result.ruler,
        sentence=" ".join(
            [
                fall(parts[0][1], full_scale=result.fits[0].rig.sensor.range),
                *(as_sentence(typeset(d.sentence)) for d in differences),
            ]
        ),
        alarms=[f"Suspect data: {text}" for text in suspect(*(evaluations[-1] for evaluations in result.evaluations))],
    )


@table.register
def _(result: Improvement, which: str = "") -> Table:
    require(which)
    last, steps = result.diagnosis, [step.heldout for step in result.steps]
    same = "the end of the same run, which does not reveal set-up and slow-drift errors"
    lacking = {*last.effects} - {*result.best.model.effects}  # an effect on noise is found by the last diagnosis
    verdict = "adequate" if last.verdict == "named" and not lacking else last.verdict
    return error_reduction(
        f"Improvement: {VERDICTS[verdict]}; held out: {same if result.same_run else 'another recording'}",
        [" + ".join(("base", *step.effects)) for step in result.steps],
        [("", steps, [None, *result.changes])],
        Ruler.of([step.fit for step in result.steps]),
        sentence=typeset(result.sentence),
        notes=[fall(steps, " on held-out data", result.best.rig.sensor.range), *map(as_sentence, last.notes)],
        alarms=[f"Suspect data: {text}" for text in last.suspect]
        + [f"Held out: {text}" for text in suspect(steps[-1])],
    )


def fall(steps: Sequence[Evaluation], where: str = "", full_scale: float | None = None) -> str:
    """The quoted error of the first and of the last model, and what noise alone gives."""
    measure = Measure.of(steps)
    errors = " → ".join(quoted(measure, evaluation, full_scale) for evaluation in (steps[0], steps[-1])[: len(steps)])
    return f"{measure.name[:1].upper()}{measure.name[1:]}{where}: {errors} rms{floor_of(measure, steps[0])}."


def reference_note(evaluation: Evaluation) -> list[str]:
    """Error of the readings without and with what a model corrects of them."""
    sizes = [length(end.value) if end.low else f"≤ {length(end.high)}" for end in evaluation.reference or ()]
    return [f"Error of the reference: {' → '.join(sizes)} rms."] if sizes else []


def unresolved_note(evaluation: Evaluation) -> list[str]:
    """What the systematic error may leave out."""
    if (systematic := evaluation.systematic) is None:
        return []
    bound = f"What is no function of time or motion, as a narrow bump, may reach {in_g(systematic.unresolved)} rms."
    if evaluation.largest is None:
        return [bound]
    variable, span = evaluation.largest
    value, low, high = (in_g(y) for y in (span.value, span.low, span.high))
    if span.low == 0.0:
        return [f"{bound} Mean error of no region above {high} (all at once)."]
    return [f"{bound} Largest mean error of a region: {value}, over {variable} (all at once: {low} to {high})."]


def suspect(*several: Evaluation) -> list[str]:
    """Readings that are left out, and breaks, of each recording."""
    return [text for evaluation in several for text in evaluation.left_out]


def error_reduction(
    title: str,
    names: Sequence[str],
    parts: Sequence[Part],
    ruler: Ruler,
    *,
    sentence: str,
    notes: Sequence[str] = (),
    alarms: Sequence[str] = (),
) -> Table:
    """Errors of several models, one row each, and a row for noise alone: over all recordings, then on each of them."""
    steps = parts[0][1]
    measure, horizons = Measure.of([e for _, every, _ in parts for e in every]), list(steps[0].coast_rms)
    rows: list[Row] = []
    errors: list[float] = []
    ranked = measure.band is not None  # models are ranked by the systematic error; other errors stand beside it
    changed = next((change.measure for _, _, changes in parts for change in changes if change is not None), "")
    for recording, every, changes in parts:
        rows += [
            {
                "model": name,
                "recording": recording,
                "systematic": None if evaluation.systematic is None else evaluation.systematic.rms,
                "systematic_low": None if evaluation.systematic is None else evaluation.systematic.low,
                "systematic_high": None if evaluation.systematic is None else evaluation.systematic.high,
                **{f"drift_{k:g}s": evaluation.coast_rms[k] for k in horizons},
                "simulation": evaluation.simulated_rms,
                "one_step": evaluation.one_step_rms,
                "change": None if change is None else change.percent,
                "change_std": None if change is None else change.percent_std,
            }
            for name, evaluation, change in zip(names, every, changes, strict=True)
        ]
        errors += [measure.error(evaluation) for evaluation in every]
        if (floor := every[-1].noise_floor) is not None:
            alone: dict[str, Any] = {"model": "noise alone", "recording": recording}
            for k in horizons:
                alone |= {f"drift_{k:g}s": every[-1].drift_floors[k], **span_of(floor, k, f"drift_{k:g}s")}
            rows.append(alone | {"simulation": floor.simulated.value, **span_of(floor, None, "simulation")})
            errors.append(0.0)
    longest = max((error for error in errors if math.isfinite(error)), default=0.0) or 1.0
    return Table(
        title=title,
        sentence=sentence,
        columns=(
            Column("model", "model"),
            *([Column("recording", "recording", lambda r: r["recording"] or "all")] if len(parts) > 1 else []),
            *([Column("systematic", "systematic error", systematic_text, "m/s²")] if ranked else []),
            *([Column(f"systematic_{end}", unit="m/s²") for end in ("low", "high")] if ranked else []),
            *(length_column(f"drift_{k:g}s", f"drift, {k:g} s", detail=ranked and k > horizons[0]) for k in horizons),
            length_column("simulation", "simulation", detail=ranked),
            Column("one_step", "one step", lambda r: length_text(r, "one_step") if "one_step" in r else "", "m"),
            Column("change", "change, %" if ranked else f"change of {changed}, %", step_text),
            Column("change_std"),
        ),
        rows=tuple(rows),
        alarms=tuple(alarms),
        notes=(
            *notes,
            *reference_note(steps[-1]),
            *unresolved_note(steps[-1]),
            *floor_note(steps[0].noise_floor),
            *(as_sentence(score.sentence) for score in steps[-1].noise_scores),
            *dict.fromkeys(as_sentence(text) for evaluation in steps for text in evaluation.not_carried),
            *(note for _, every, _ in (parts if len(parts) == 1 else parts[1:]) for note in outside_note(every[-1])),
        ),
        detail=(*DEFINITIONS, *ruler_note(ruler, steps[0])),
        bars=tuple(error / longest for error in errors),
        about={"name": steps[0].recording},
    )


def systematic_text(row: Row) -> str:
    """Systematic error in mg with its 95 % interval, or the bound below the limit of detection."""
    if row.get("systematic") is None:
        return ""
    value, low, high = (in_g(row[f"systematic{end}"]) for end in ("", "_low", "_high"))
    return f"{value} ({low} to {high})" if row["systematic_low"] > 0.0 else f"≤ {high}"


def step_text(row: Row) -> str:
    """Change of the error in per cent with its paired standard error."""
    return "" if row.get("change") is None else typeset(f"{row['change']:+.3g} ± {row['change_std']:.2g}")


def ruler_note(ruler: Ruler, first: Evaluation) -> list[str]:
    """The filter and the band that all models of a table share."""
    usual, reference = ruler.noise.usual, first.reference_noise
    at_encoder = reference is None or reference.order == POSITION_ORDER
    reading = f", encoder {length(math.sqrt(usual.r))}" if at_encoder else ""
    return [
        f"All models share one filter, for noise of {density(math.sqrt(2.0 * usual.q))}{reading}; residuals up to "
        f"{number(first.band)} Hz; changes are paired, with their standard error."
    ]


def changes(result: Comparison) -> Table:
    """Changes of the error from the first model to each other one: over all recordings, on each, at every horizon."""
    several = len(result.recordings) > 1
    every: list[tuple[str, str, HeldOutChange | None]] = []
    for difference in result.differences:
        together = "" if several else result.recordings[0]
        if several:
            every += [(difference.name, *part) for part in zip(result.recordings, difference.recordings, strict=True)]
        every.append((difference.name, together, difference.pooled))
        shown = None if difference.pooled is None else difference.pooled.measure
        every += [(difference.name, together, change) for change in difference.horizons if change.measure != shown]
    return Table(
        title="Changes",
        sentence=" ".join(as_sentence(typeset(difference.sentence)) for difference in result.differences),
        columns=(
            Column("model", "model"),
            Column("recording", "recording", lambda r: r["recording"] or "all"),
            Column("verdict", "verdict", lambda r: r["verdict"].replace("_", " ")),
            Column("measure", "rms of"),
            Column("before", result.names[0], lambda r: error_text(r, "before")),
            Column("after", "this model", lambda r: error_text(r, "after")),
            Column("percent", "change, % (95 % interval)", change_text),
            Column("low"),
            Column("high"),
            Column("stretches", "stretches", lambda r: str(r.get("stretches") or "")),
        ),
        rows=tuple(
            {"model": model, "recording": name, "verdict": verdict_of(change), **change_values(change)}
            for model, name, change in every
        ),
        notes=(f"Changes are paired, against {result.names[0]}; the interval is that of these recordings.",),
        about={"reference": result.names[0]},
    )


def budgets(result: Comparison) -> Table:
    """Parts of the drift of each model on each recording, whose squares add up."""
    every = [
        (name, recording, evaluation.budget)
        for recording, evaluations in zip(result.recordings, result.evaluations, strict=True)
        for name, evaluation in zip(result.names, evaluations, strict=True)
        if evaluation.budget is not None
    ]
    horizon = next((f"{budget.horizon:g} s" for *_, budget in every if budget is not None), "")
    heads = {
        "total": "drift",
        "noise": "noise",
        "setup": "start and bias",
        "parameters": "parameters",
        "missing": f"effects of {result.names[-1]}",
        "unexplained": "unexplained",
    }
    rows: list[Row] = []
    for name, recording, budget in every:
        row: dict[str, Any] = {"model": name, "recording": recording, "horizon": budget.horizon}
        for key in heads:
            part = getattr(budget, key)
            row |= (
                {key: part} if key == "missing" else {key: part.value, f"{key}_low": part.low, f"{key}_high": part.high}
            )
        rows.append(row | {"predicted": budget.predicted})
    return Table(
        title=f"Budget of the drift after {horizon}" if rows else "Budget of the drift",
        sentence=" ".join(map(budget_sentence, rows)),
        columns=(
            Column("model", "model"),
            Column("recording", "recording", lambda r: r["recording"] or "recording"),
            *(Column(key, head, partial(budget_text, key=key), "m") for key, head in heads.items()),
        ),
        rows=tuple(rows),
        notes=(
            "The squares of the parts add up to that of the drift, but for the scatter of its few stretches; 95 % "
            "intervals in brackets. Start and bias: state at the start, constant re-zeroed.",
        ),
        about={"name": result.recordings[0]},
    )


def budget_text(row: Row, key: str) -> str:
    """A part with its interval, where it has one."""
    if not math.isfinite(row.get(f"{key}_high", math.inf)):
        return length(row[key])
    low, high = (length(row[f"{key}_{end}"]) for end in ("low", "high"))
    return (
        f"≤ {high}"
        if key == "unexplained" and row["unexplained_low"] == 0.0
        else f"{length(row[key])} ({low} to {high})"
    )


def budget_sentence(row: Row) -> str:
    """Whether somebody with this motion notices what a model lacks."""
    where = f"{row['model']} on {row['recording'] or 'the recording'}"
    alone = math.hypot(row["noise"], row["setup"], row["parameters"])
    if row["unexplained_low"] > 0.0:
        return f"{where}: {budget_text(row, 'unexplained')} of {length(row['total'])} is explained by no part."
    if row["missing"] == 0.0:
        return f"{where}: nothing is left that its parts, {length(alone)}, do not explain."
    beside = "more than all else" if row["missing"] > alone else "which nobody would notice beside the rest"
    return f"{where}: what it lacks makes {length(row['missing'])}, {beside}, {length(alone)}."


def change_values(change: HeldOutChange | None) -> dict[str, Any]:
    """Errors of two models, and the change in per cent with its 95 % interval."""
    if change is None:
        return {}
    low, high = change.percent_interval
    keys = ("measure", "unit", "before", "after", "percent", "stretches")
    return {**{key: getattr(change, key) for key in keys}, "low": low, "high": high}


def error_text(row: Row, key: str) -> str:
    """An error in its unit."""
    if row.get(key) is None:
        return "–"
    if row["unit"] == "1":
        return number(row[key])
    if key == "after" and row["unit"] == "m/s²" and row["low"] <= -100.0:
        return f"≤ {error_size(row['before'] * (1.0 + row['high'] / 100.0), 'm/s²')}"
    return error_size(row[key], row["unit"])


def change_text(row: Row) -> str:
    """A change in per cent with its interval."""
    if row.get("percent") is None:
        return "too short"
    return typeset(f"{row['percent']:+.3g} ({row['low']:+.3g} to {row['high']:+.3g})")


__dir__ = listing(globals())
