"""Tables by kind of result, parameters among them: importing this module makes all of them known to `table`."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from operator import methodcaller

import numpy as np

from accelcal._support.values import listing
from accelcal.data import ACCELERATION, MICRO_G, NORMAL_95, VELOCITY, Dwells, Recording, describe, instant
from accelcal.effects import CATALOGUE, Effect, find, spelled
from accelcal.effects.mechanisms import driver_of
from accelcal.effects.registry import CARD
from accelcal.estimation.allan import DETERMINED, USUAL, NoiseTerm, OutputNoise, RestNoise, Trend, WarmUp
from accelcal.estimation.estimate import WITH_ANGLE, Fit, tied_sum
from accelcal.estimation.noise import Level, NoiseEffect, NoiseReport
from accelcal.estimation.tracks import Path, Track
from accelcal.filters.choice import STATE_UNITS
from accelcal.filters.record import FilterRun
from accelcal.model import Estimate, Model
from accelcal.results.comparisons import length_column
from accelcal.results.table import Column, Row, Table, as_sentence, require, table
from accelcal.results.words import amount, at_full_scale, decimal, grouped, interval, label, number, plain, with_unit
from accelcal.signals.signals import Signals
from accelcal.validation.comparison import Coast

MOST_COLUMNS = 4
"""Coefficients of one effect that a table shows one by one; more are one row."""


@table.register
def _(fit: Fit, which: str = "") -> Table:
    require(which, "coefficients", *["axes"] * bool(fit.axes))
    if which == "axes":
        return axes_table(fit)
    readings = grouped(sum(run.readings for run in fit.runs))
    turned = any(name in fit.model.effects for name in WITH_ANGLE)  # the position of an arm is a path from its angle
    named = ("angle" if turned else run.noise.reference.replace("_", " ") for run in fit.runs)
    references = ", ".join(dict.fromkeys(named))
    made_from = [f"{readings} readings of {references}"] * bool(fit.runs)
    made_from += [f"{len(fit.dwells.residual)} {'dwells' if fit.dwells.angle else 'positions'}"] if fit.dwells else []
    nis = [f"{squared:.3f}" for run in fit.runs if (squared := run.nis) is not None]
    span = " to ".join(dict.fromkeys((min(nis, key=float), max(nis, key=float)))) if nis else ""
    agreement = f", normalised innovation squared {span} (1 when consistent)" if nis else ""
    names = ", ".join(name for name, _ in fit.sources)
    loud = [
        note for note in fit.remarks if note.place != "data" and (note.code == "slow_residual" or note.forbids_names)
    ]
    statements = (
        *(f"{effect.name}: {effect.sentence}." for effect in fit.noise_effects),
        *(f"{spread.name} by run: {by_run(fit, spread.runs)}." for spread in fit.spreads),
        *(as_sentence(text) for run in fit.runs for text in rest_notes(run.noise)),
        *(as_sentence(note.sentence) for note in fit.remarks if note.place != "data" and note not in loud),
    )
    return Table(
        title=f"Fit of {names}, {METHODS.get(fit.method, fit.method)}",
        sentence=f"{len(fit.free)} parameters from {' and '.join(made_from)}{agreement}.",
        columns=PARAMETER_COLUMNS,
        rows=parameter_rows(fit, in_full=which == "coefficients"),
        alarms=(
            *(f"Suspect data: {note.sentence}." for note in fit.remarks if note.place == "data"),
            *(as_sentence(note.sentence) for note in loud),
        ),
        notes=(
            *(noise_note(run.noise, run.name if len(fit.runs) > 1 else "") for run in fit.runs),
            *statements[:MOST_NOTES],
        ),
        detail=(
            *statements[MOST_NOTES:],
            *(crossover_note(run.noise) for run in fit.runs if run.noise.reference != ACCELERATION),
            *(f"Assumed: {text}." for text in fit.rig.assumptions),
        ),
        about={"name": names},
    )


METHODS = {"weak": "weak form"}
"""Words for methods whose names are short."""
MOST_NOTES = 3
"""Notes on a fit beside its noise; further ones are details."""


PARAMETER_COLUMNS = (
    Column("parameter", "parameter", lambda r: f"{r['parameter']}{r.get('where', '')}"),
    Column("symbol", "symbol"),
    Column("", "value ± u", lambda r: r["worded"]),
    Column("", "at full scale", lambda r: r["at_full_scale"]),
    Column("", "SI value (u)", lambda r: r["si"], exact=lambda r: r.get("value")),
    Column("", "95 % interval", lambda r: r["span"], detail=True),
    Column("", "includes on this rig", lambda r: r["includes"] if r["includes"] != r["symbol"] else "", detail=True),
    *(Column(key) for key in ("value", "std", "low", "high", "unit", "owner", "kind", "held", "run")),
)
"""Columns of parameters: what people read, then values in SI units."""


def parameter_rows(fit: Fit, *, in_full: bool = False) -> tuple[Row, ...]:
    """Parameters of a fit: coefficients, those at the mean of a run, shapes and effects on noise, in this order.

    An effect with more than MOST_COLUMNS coefficients is one row, unless `in_full`. Columns of a curve that are held at
    zero, because a simpler curve suffices, are no parameters.
    """
    fit = fit.given_choice
    unused = [e for e in fit.estimates if e.std <= 0.0 and e.value == 0.0 and find(owner_of(e)).family]
    named = {e.name: e for e in fit.estimates if e not in unused}  # a time offset of each run is no curve
    counts = Counter(map(owner_of, named.values()))
    summed = {name for name, count in counts.items() if count > MOST_COLUMNS and name in CATALOGUE and not in_full}
    rows: list[Row] = []
    first = {owner_of(e): e for e in reversed(fit.estimates)}
    for e in fit.estimates:
        name = owner_of(e)
        if name in summed:
            rows += [curve_row(fit, name, counts[name])] if e is first[name] else []
        elif counts[name] and (in_full or e not in unused):
            rows.append({**estimate_row(fit, e), "where": at_zero(fit, e.name)})
            rows += [mean_row(fit, mean) for mean in fit.at_mean if mean.name == e.name and e.run in (None, mean.run)]
    return (
        *rows,
        *(mean_row(fit, mean) for mean in fit.at_mean if mean.name not in counts),
        *(estimate_row(fit, e, "shape") for e in fit.shapes),
        *map(noise_row, fit.noise_effects),
    )


def axes_table(fit: Fit, worded: Callable[[Row], str] = lambda row: row["worded"]) -> Table:
    """Parameters of a sensor with several outputs, a row each and a column for each output; those that the outputs
    share stand once. `worded` words a row of `parameter_rows`."""
    rows: dict[str, Row] = {}
    for row in parameter_rows(fit):
        e, axis = row.get("estimate"), row.get("axis") or SHARED
        name = row["parameter"] if e is None else f"{fit.label(replace(e, axis=''))}{row.get('where', '')}"
        rows[name] = {
            **rows.get(name, {"parameter": name, "symbol": row["symbol"], "unit": row["unit"]}),
            **{axis: row.get("value"), f"{axis}_std": row.get("std"), f"{axis}_worded": worded(row)},
        }
    columns = [
        Column("parameter", "parameter", lambda r: spelled(r["parameter"])),
        Column("symbol", "symbol"),
        Column("unit"),
    ]
    for axis in (*fit.axes, SHARED):
        worded_cell = methodcaller("get", f"{axis}_worded", "")
        columns += [Column(axis, axis, worded_cell, exact=methodcaller("get", axis)), Column(f"{axis}_std")]
    return replace(table(fit), columns=tuple(columns), rows=tuple(rows.values()))


SHARED = "all outputs"
"""Column of what the outputs of a sensor share."""


def owner_of(e: Estimate) -> str:
    """Effect that a coefficient belongs to."""
    return e.name.partition(".")[0]


def estimate_row(fit: Fit, e: Estimate, kind: str = "coefficient") -> Row:
    """Row of one coefficient or shape parameter."""
    held, half = e.std <= 0.0, fit.expanded(e, NORMAL_95)
    determined = not held and math.isfinite(half)
    return {
        "parameter": fit.label(e),
        "name": e.name,
        "symbol": e.symbol,
        "value": e.value,
        "std": e.std,
        "low": e.value - half if determined else None,
        "high": e.value + half if determined else None,
        "unit": e.unit,
        "owner": e.owner,
        "kind": kind,
        "held": held,
        "run": e.run,
        "axis": e.axis,
        "worded": plain(e.unit, e.value, e.std),
        "at_full_scale": at_full_scale(e.name, e.unit, e.value, e.std, fit.rig.sensor.range, used_acceleration(fit)),
        "si": amount(e.value, e.std, e.unit),
        "span": interval(e.value, e.std, half / e.std) if determined else "",
        "includes": tied_sum(fit, e),
        "estimate": e,
    }


def mean_row(fit: Fit, e: Estimate) -> Row:
    """Row of a coefficient that mechanisms move, at the mean of a run."""
    run = "this run" if e.run is None else fit.runs[e.run].name
    return {**estimate_row(fit, e, "mean"), "parameter": f"{e.name}, at the mean of {run}"}


def at_zero(fit: Fit, coefficient: str) -> str:
    """Where that is zero which moves a coefficient, a driver or the temperature; empty where nothing moves it."""
    added = [find(name) for name in fit.model.added]
    moving = [of for of in (effect.mechanism for effect in added) if of and of.carrier == coefficient]
    static, warm = find(coefficient.partition(".")[0]).traits.static, f"at {fit.origins.temperature:.1f} °C"
    thermal = [effect.traits.static.power for effect in added if effect.traits.static and effect.traits.static.thermal]
    zero = np.zeros(2)
    still = Signals(t=zero, p=zero, v=zero, a=zero, jerk=zero, scale=1.0, rig=fit.rig)
    places = [warm] if static and static.power in thermal and not static.thermal else []
    for of in moving:
        driver = driver_of(of.driver)
        if driver.at_rest is not None:
            places.append("at rest" if driver.at_rest(still) == 0.0 else f"at {of.text} = 0")
        elif of.driver in driver.needs:
            places.append(warm if of.driver == "temperature" else f"at the mean of {of.text}")
        else:
            places.append(
                f"at {of.text} = {with_unit(number(fit.origins.p if of.driver == 'position' else 0.0), driver.unit)}"
            )
    return "".join(f", {place}" for place in dict.fromkeys(places))


def curve_row(fit: Fit, name: str, count: int) -> Row:
    """Row of an effect with many coefficients."""
    effect = find(name)
    every = [e for e in fit.estimates if owner_of(e) == name]
    largest = max(every, key=lambda e: abs(e.value))
    size = process_size(fit.model, effect)
    return {
        "parameter": name,
        "name": name,
        "symbol": effect.symbol,
        "unit": effect.unit,
        "owner": effect.owner,
        "kind": "process" if size else "curve",
        "held": False,
        "worded": size or f"{count} coefficients",
        "at_full_scale": "",
        "si": "" if size else f"largest {amount(largest.value, largest.std, largest.unit)}",
        "span": "",
        "includes": "",
    }


def noise_row(effect: NoiseEffect) -> Row:
    """Row of an effect on noise."""
    absent, exact = effect.value <= 0.0, effect.std <= 0.0
    read_off = with_unit(f"{number(effect.value, 6)}", effect.unit)
    return {
        "parameter": effect.name,
        "name": effect.name,
        "symbol": effect.symbol,
        "value": effect.value,
        "std": effect.std,
        "low": None if exact else effect.value - NORMAL_95 * effect.std,
        "high": None if exact else effect.value + NORMAL_95 * effect.std,
        "unit": effect.unit,
        "owner": effect.owner,
        "kind": "noise",
        "held": False,
        "worded": "none" if absent else plain(effect.unit, effect.value, effect.std),
        "at_full_scale": "",
        "si": "" if absent else f"{read_off} (read off)" if exact else amount(effect.value, effect.std, effect.unit),
        "span": "" if absent or exact else interval(effect.value, effect.std),
        "includes": "",
    }


def process_size(model: Model, effect: Effect) -> str:
    """Size of a random process of a model, and its correlation time; empty for all other effects."""
    prior = next((model.priors[t.name] for t in model.terms if t.effect is effect and t.name in model.priors), None)
    if effect.port != "process" or prior is None:
        return ""
    size = with_unit(f"{prior.std:.3g}", effect.unit)
    if "tau" not in effect.shapes:
        return f"random walk of {size}"
    return f"standard deviation {size}, correlation time {model.shapes[effect.name]['tau']:.3g} s"


def by_run(fit: Fit, values: Sequence[float]) -> str:
    """Values of one parameter with the names of their runs."""
    return ", ".join(f"{run.name or 'recording'} {number(y, 6)}" for run, y in zip(fit.runs, values, strict=True))


@table.register
def _(e: Estimate, which: str = "") -> Table:
    require(which)
    return Table(
        title=f"Estimate of {spelled(e.name)}",
        sentence=f"{e.symbol} = {plain(e.unit, e.value, e.std)}.",
        columns=(
            Column("name"),
            Column("", "SI value (u)", lambda r: amount(r["value"], r["std"], r["unit"])),
            Column("owner", "owner"),
            *(Column(key) for key in ("value", "std", "unit", "symbol")),
        ),
        rows=({key: getattr(e, key) for key in ("name", "value", "std", "unit", "symbol", "owner")},),
    )


def used_acceleration(fit: Fit) -> float:
    """Largest acceleration of the recordings of a fit, m/s²; infinite where it is not known."""
    return max(map(abs, fit.validity["a"])) if "a" in fit.validity else math.inf


def noise_note(report: NoiseReport, name: str) -> str:
    """Noise of the output and of the reference in one run, beside what is declared, in one line."""
    level, reference = report.all, report.reference
    reader = "encoder" if reference == "position" else reference.replace("_", " ")
    text = (
        f"noise{' beside the effects above' if report.noise.growth else ''}{f' of {name}' if name else ''}: "
        f"{density_text(level)}, {reader} {plain(CHANNEL_UNITS[reference], level.reading, level.reading_std)}"
    )
    if report.declared is not None:
        text += f"; {number(report.ratio or 0.0, 3)} times the declared {number(report.declared / MICRO_G)} µg/√Hz"
    return as_sentence(text)


CHANNEL_UNITS = {"position": "m", VELOCITY: "m/s", ACCELERATION: "m/s²"}
"""Unit of a reading of each reference."""


def density_text(level: Level) -> str:
    """Noise density of the output with its uncertainty."""
    return f"{decimal(level.density / MICRO_G, level.density_std / MICRO_G)} µg/√Hz"


def rest_notes(report: NoiseReport) -> list[str]:
    """Noise at rest and in motion, where these differ."""
    rest, motion = report.rest, report.motion
    if (
        rest is None
        or motion is None
        or abs(motion.density - rest.density) < DIFFERENT * math.hypot(motion.density_std, rest.density_std)
    ):
        return []
    return [f"noise at rest {density_text(rest)}, in motion {density_text(motion)}"]


DIFFERENT = 3.0
"""Standard deviations from which noise at rest and in motion differ."""


def crossover_note(report: NoiseReport) -> str:
    """Frequency at which the better of the two channels changes."""
    at = f"band {report.band:.4g} Hz" if report.band is not None else f"crossover {report.crossover:.4g} Hz"
    below = "encoder" if report.reference == "position" else "reference"
    return as_sentence(f"{at}: below it the {below}, above it the accelerometer measures acceleration more precisely")


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


@table.register
def _(rest: RestNoise, which: str = "") -> Table:
    require(which)
    several, first = len(rest.outputs) > 1, rest.outputs[0]
    rows = [
        {"output": output.output if several else "", "unit": SI_OF_NOISE[term.name], "term": term}
        | {key: getattr(term, key) for key in ("name", "value", "low", "high")}
        for output in rest.outputs
        for term in output.terms
    ]
    return Table(
        title=f"{rest.name or 'Record'} at rest",
        sentence=f"{instant(first.seconds)} s at {first.rate:.6g} Hz.",
        columns=(
            Column("output", "output"),
            Column("name", "parameter"),
            Column("", "value", lambda r: noise_value(r["term"])),
            Column("", "95 % interval", lambda r: noise_interval(r["term"])),
            *(Column(key) for key in ("value", "low", "high", "unit")),
        ),
        rows=tuple(rows),
        notes=tuple(
            as_sentence(f"{f'{output.output}: ' if several else ''}{text}")
            for output in rest.outputs
            for text in rest_sentences(output)
        ),
    )


SI_OF_NOISE = {"noise": "(m/s²)/√Hz", "bias_instability": "m/s²", "random_walk": "(m/s²)/√s"}
"""Units of the terms of a sensor at rest."""


def noise_value(term: NoiseTerm) -> str:
    """Value of a term in its usual unit, or its upper limit."""
    unit, size = USUAL[term.name]
    return f"{number(term.value / size, 4) if term.determined else f'below {number(term.high / size, 2)}'} {unit}"


def noise_interval(term: NoiseTerm) -> str:
    """95 % interval of a term in its usual unit."""
    unit, size = USUAL[term.name]
    return f"{number(term.low / size, 4)} .. {number(term.high / size, 4)} {unit}"


def rest_sentences(output: OutputNoise) -> list[str]:
    """Sentences on one output at rest beside its terms."""
    sentences, lowest = list(output.notes), output.minimum
    tau = 0.5 * output.seconds if lowest is None else lowest[0]
    sentences.append(
        "the Allan deviation has no minimum within half of the record"
        if lowest is None
        else f"the Allan deviation is smallest at {number(tau, 2)} s, {number(lowest[1] / MICRO_G, 3)} µg"
    )
    if missing := " and ".join(term.name for term in output.terms if not term.determined):
        least = "at least " if lowest is None else ""
        sentences.append(
            f"{missing}: the record gives an upper limit; {DETERMINED:g} times the Allan minimum, {least}"
            f"{number(DETERMINED * tau / 3600.0, 2)} h, determine it in 19 of 20 records"
        )
    return sentences if output.warm_up is None else [*sentences, *warm_up_sentences(output.warm_up)]


def warm_up_sentences(warm_up: WarmUp) -> list[str]:
    """The bias over temperature, and what one cycle leaves open."""
    trend, slope = warm_up.trend, decimal(warm_up.slope / MICRO_G, warm_up.std / MICRO_G)
    curved = f", along a polynomial of order {trend.order}" if trend.order > 1 else ""
    low, high = warm_up.temperature.min(), warm_up.temperature.max()
    sentences = [
        f"K0 over temperature, {low:.4g} to {high:.4g} °C: {slope} µg/K in the middle{curved}; this is subtracted "
        "before the Allan deviation, which would take a warm-up for a random walk"
    ]
    if trend.memory:
        does = "lags behind" if trend.memory == "lag" else "settles beside"
        sentences.append(f"K0 {does} the temperature with a time constant of {number(trend.time, 2)} s")
    if trend != Trend():
        sentences.append(
            "one warm-up hardly distinguishes a lag, a settling after switch-on and a curve over temperature: record a "
            "second cycle, with falling temperature"
        )
    return sentences


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


@table.register
def _(path: Path, which: str = "") -> Table:
    require(which)
    name, low, high = spelled(path.coefficient), float(path.value.min()), float(path.value.max())
    ends = [(low, float(path.std[path.value.argmin()])), (high, float(path.std[path.value.argmax()]))]
    several = [(path.itself, path.itself_std), (path.mean, path.mean_std), *ends]
    rest, middle, least, most = (plain(path.unit, y, std) for y, std in several)
    sentence = f"{name}: {rest} by itself, {middle} at the mean of this run, from {least} to {most}."
    best = path.followers[0] if path.followers else None
    if best is not None and best.share < EXPLAINED:
        most_likely = f"{spelled(best.mechanism)} {100.0 * best.share:.0f} % of its variance"
        sentence += f" No recorded quantity explains it: {most_likely}."
    return Table(
        title=f"Path of {name}",
        sentence=sentence,
        columns=(
            Column("mechanism", "what it may follow", lambda r: spelled(r["mechanism"])),
            Column("share", "explains of its variance", lambda r: f"{100.0 * r['share']:.0f} %"),
            Column("tau", "memory", lambda r: f"{number(r['tau'], 2)} s", "s"),
        ),
        rows=tuple({key: getattr(f, key) for key in ("mechanism", "share", "tau")} for f in path.followers),
    )


EXPLAINED = 0.8
"""Share of a path's variance from which a driver is said to explain it."""


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


__all__ = ["table"]


__dir__ = listing(globals())
