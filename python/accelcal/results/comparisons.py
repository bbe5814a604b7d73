"""Tables of comparisons: drift by horizon, where a model fails, and the errors of several models."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

from accelcal._support.values import listing
from accelcal.data import MICRO_G, instant
from accelcal.diagnosis.select.improvement import Improvement
from accelcal.results.diagnoses import VERDICTS
from accelcal.results.table import Column, Row, Table, as_sentence, require, table
from accelcal.results.words import (
    decimal,
    error_size,
    in_g,
    length,
    number,
    percent,
    prefixed,
    probability,
    typeset,
    with_unit,
)
from accelcal.validation.comparison import ONLY_WHITE, SOURCES, Evaluation, NoiseFloor, Outside, Region, SensorNoise
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
        notes=(*unresolved_note(evaluation), *floor_notes(evaluation.noise_floor), *comparison_notes(evaluation)),
        about={"name": evaluation.recording},
    )


def comparison_notes(evaluation: Evaluation) -> list[str]:
    """Errors beside the drift, and what must be read with them."""
    (setup, std), k_steps = evaluation.setup_bias, evaluation.k_step_rms.items()
    nis = "" if evaluation.nis is None else f", normalised innovation squared {evaluation.nis:.4f} (1 when consistent)"
    return [
        *([f"Change of set-up or turn-on bias: {decimal(setup, std)} m/s²."] if math.isfinite(std) else []),
        f"One-step prediction error: {length(evaluation.one_step_rms)} rms{nis}.",
        f"Errors of k steps, in readings: {', '.join(f'{k}: {length(y)}' for k, y in k_steps if y is not None)}.",
        f"Accelerometer residual up to {number(evaluation.band)} Hz: {number(evaluation.accel_rms)} m/s² rms"
        + ("." if evaluation.fit_percent is None else f"; fit {percent(evaluation.fit_percent)}."),
        f"Largest residual: {evaluation.worst}.",
        *(as_sentence(score.sentence) for score in evaluation.noise_scores),
        *map(as_sentence, evaluation.not_carried),
        *(outside_notes(evaluation) or map(as_sentence, evaluation.remarks)),
    ]


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
            "The worst region of each variable: mean residual, its share of the mean square residual, and p adjusted "
            "for the number of all regions.",
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
    factor, unit = (1.0, row["unit"])
    if unit not in ("s", "Hz"):
        factor, unit = prefixed(unit, row["low"], row["high"])
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


def length_column(key: str, head: str) -> Column:
    """Column of lengths, each with the prefix that fits it; an interval where the row has its ends."""
    return Column(key, head, lambda r: length_text(r, key), "m")


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
    """What noise of the sensor alone would give, as the end of a sentence."""
    spread = measure.floor(evaluation)
    if spread is None:
        return ""
    if measure.band is not None:
        return f"; limit of detection {error_size(spread.high, measure.unit)}"
    return f"; noise alone {length(spread.low)} to {length(spread.high)}"


def floor_notes(floor: NoiseFloor | None) -> list[str]:
    """Source of the noise floor, and what it leaves out."""
    if floor is None:
        return []
    return [
        f"Noise alone: {source_of_noise(floor.sensor)}; 95 % prediction intervals for a record of this length; "
        f"{ONLY_WHITE}."
    ]


def source_of_noise(sensor: SensorNoise) -> str:
    """Source and size of the noise density of a sensor, and the declared one where it differs."""
    beside = "" if sensor.declared is None else f"; declared {density(sensor.declared)}"
    return f"{SOURCES[sensor.source]} {density(sensor.density)}{beside}"


def density(value: float) -> str:
    """A noise density in the unit of data sheets."""
    return f"{number(value / MICRO_G, 3)} µg/√Hz"


def outside_notes(evaluation: Evaluation) -> list[str]:
    """One sentence for each variable that leaves the trained range: how often, and the errors inside and outside."""
    return [outside_note(part) for part in evaluation.outside if part.count and part.range is not None]


def outside_note(part: Outside) -> str:
    """Readings outside the trained range of one variable, and the errors on both sides."""
    assert part.range is not None
    low, high = part.range
    errors = [f"{'–' if y is None else length(y)} {side}" for y, side in zip(part.one_step, SIDES, strict=True)]
    drifts = [
        f"; drift after {h:g} s "
        + ", ".join(
            f"{length(y)} {side} ({n})" if n and y is not None else f"none {side}"
            for y, side, n in zip(part.coast[h], SIDES, counts, strict=True)
        )
        for h, counts in part.starts.items()
        if counts[1]
    ]
    return (
        f"{part.count} of {part.of} readings lie outside the trained range of {part.variable} "
        f"[{number(low)}, {number(high)}] {part.unit}: one-step error {', '.join(errors)}{''.join(drifts)}."
    )


SIDES = ("inside", "outside")


Part = tuple[str, Sequence[Evaluation], Sequence[HeldOutChange | None]]
"""Name of a recording, empty for all together; evaluation of each model on it, and the change of its error."""


@table.register
def _(result: Comparison, which: str = "") -> Table:
    require(which, "changes", "regions", "budget")
    if which in ("changes", "budget"):
        return changes(result) if which == "changes" else budgets(result)
    every = [
        (name, recording, evaluation)
        for recording, evaluations in zip(result.recordings, result.seen, strict=True)
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
            for number, (recording, evaluations) in enumerate(zip(result.recordings, result.seen, strict=True))
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
        alarms=[f"Suspect data: {text}" for text in suspect(*(evaluations[-1] for evaluations in result.seen))],
    )


@table.register
def _(result: Improvement, which: str = "") -> Table:
    require(which)
    last, steps = result.diagnosis, [step.heldout for step in result.steps]
    same = "the end of the same run, which does not reveal set-up and slow-drift errors"
    return error_reduction(
        f"Improvement: {VERDICTS[last.verdict]}; held out: {same if result.same_run else 'another recording'}",
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


def unresolved_note(evaluation: Evaluation) -> list[str]:
    """What the systematic error leaves out, and what counts as such."""
    if (systematic := evaluation.systematic) is None:
        return []
    size, largest = error_size(systematic.unresolved, "m/s²"), ""
    if evaluation.largest is not None:
        variable, span = evaluation.largest
        value, low, high = (error_size(y, "m/s²") for y in (span.value, span.low, span.high))
        largest = f"Largest mean error in a region: {value}, over {variable} (all regions at once: {low} to {high})."
        if span.low == 0.0:
            largest = f"Mean error in no region above {high} (all at once)."
    return [
        "Systematic error: functions of time and motion, errors of the fitted parameters among them. What is no such "
        f"function, as a narrow bump, may reach {size} rms. {largest}".rstrip()
    ]


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
            *([Column("systematic", "systematic error", systematic_text, "m/s²")] if measure.band is not None else []),
            *(length_column(f"drift_{k:g}s", f"drift, {k:g} s") for k in horizons),
            length_column("simulation", "simulation"),
            Column("one_step", "one step", lambda r: length_text(r, "one_step") if "one_step" in r else "", "m"),
            Column("change", f"change of {changed}, %", step_text),
            Column("change_std"),
        ),
        rows=tuple(rows),
        alarms=tuple(alarms),
        notes=(
            *notes,
            *unresolved_note(steps[-1]),
            *floor_notes(steps[0].noise_floor),
            ruler_note(ruler, steps[0].band),
            *(as_sentence(score.sentence) for score in steps[-1].noise_scores),
            *dict.fromkeys(as_sentence(text) for evaluation in steps for text in evaluation.not_carried),
            *outside_notes(steps[-1]),
        ),
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


def ruler_note(ruler: Ruler, band: float) -> str:
    """The filter and the band that all models of a table share."""
    usual = ruler.noise.usual
    return (
        f"One filter for all rows: {density(math.sqrt(2.0 * usual.q))}, {length(math.sqrt(usual.r))}; residuals up to "
        f"{number(band)} Hz; changes are paired, with their standard error."
    )


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
            Column("stretches", "stretches"),
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
        for recording, evaluations in zip(result.recordings, result.seen, strict=True)
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
        notes=("Squares add up; 95 % intervals in brackets. Start and bias: state at the start, constant re-zeroed.",),
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
    if row["missing"] > alone:
        return (
            f"{where}: what it lacks moves the result by {length(row['missing'])}, more than all else, {length(alone)}."
        )
    return f"{where}: nobody would notice what it lacks, {length(row['missing'])} beside {length(alone)}."


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
