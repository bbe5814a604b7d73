"""Results in a notebook: one sentence, a small table, and remarks, as HTML.

Everything is escaped, and only opacity is set, no colour, so that light and dark notebooks both stay readable.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import singledispatch
from html import escape

import numpy as np

from accelcal import formatting
from accelcal._support.listing import listing
from accelcal.app.wording import cards, limits, value
from accelcal.calibration.budget import COVERAGE_FACTOR
from accelcal.data.dwells import Dwells
from accelcal.data.recording import Recording
from accelcal.data.summary import describe
from accelcal.data.units import instant
from accelcal.diagnosis.dwells import DwellDiagnosis
from accelcal.diagnosis.verdict import Diagnosis
from accelcal.effects import Effect, spelled
from accelcal.effects.registry import CARD
from accelcal.estimation.estimate import Fit, tied_sum
from accelcal.experiment.detectability import Power
from accelcal.filters.choice import STATE_UNITS
from accelcal.filters.record import FilterRun
from accelcal.formatting import amount, at_full_scale, number, plain, probability, typeset, with_unit
from accelcal.model import Estimate, Model
from accelcal.report.view import VERDICTS
from accelcal.selection.improvement import History, Improvement
from accelcal.validation.comparison import Comparison
from accelcal.validation.differences import PairedComparison
from accelcal.validation.paired import HeldOutChange
from accelcal.validation.sensor_noise import ONLY_WHITE
from accelcal.validation.stretches import headline_horizon, quoted_error

CANDIDATES = 6
"""Candidates that a diagnosis shows."""
DETECTABLE = 8
"""Detection limits that are shown."""
TERMS = 12
"""Coefficients of a model that are shown."""
LONGEST_BAR = 150.0
"""Pixels."""
SHORT = 26
"""Letters that a cell holds in one line; longer texts may break."""
CELL = "text-align:left;vertical-align:top;padding:2px 14px 2px 0"
TABLE = 'style="border-collapse:collapse;margin:4px 0"'
MUTED = 'style="opacity:.75;margin:2px 0"'


@dataclass(frozen=True, slots=True)
class Card:
    """Content shown for one result; plain text throughout."""

    title: str
    sentence: str
    head: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()
    notes: tuple[str, ...] = ()
    bars: tuple[float, ...] = ()
    """One for each row, as shares of the longest, drawn in an extra column; empty without bars."""


def html(result: object) -> str:
    """Return a result as a fragment of HTML that needs nothing else.

    Parameters
    ----------
    result : a Recording, Dwells, Model, Fit, Estimate, Comparison, Diagnosis, History, Improvement, ...: see `CARDS`.

    Raises
    ------
    TypeError
        If it is anything else.
    """
    shown = card(result)
    head = (*shown.head, "") if shown.bars else shown.head
    parts = [f"<p {MUTED}>{escape(shown.title)}</p>", f'<p style="margin:2px 0"><b>{escape(shown.sentence)}</b></p>']
    if shown.rows:
        titles = "".join(cell("th", text) for text in head)
        rows = "".join(
            f"<tr>{''.join(cell('td', text) for text in row)}{bar(shown.bars, i)}</tr>"
            for i, row in enumerate(shown.rows)
        )
        parts.append(f"<table {TABLE}><thead><tr>{titles}</tr></thead><tbody>{rows}</tbody></table>")
    parts += [f"<p {MUTED}>{escape(text)}</p>" for text in shown.notes]
    return f'<div class="accelcal" style="overflow-x:auto">{"".join(parts)}</div>'


def text(result: object) -> str:
    """Return a result as plain text: title, sentence, table and remarks, the content of `html`.

    Parameters and errors are those of `html`.
    """
    shown = card(result)
    rows = [shown.head, *shown.rows] if shown.rows else []
    widths = [max(len(row[k]) for row in rows) for k in range(len(shown.head))] if rows else []
    table = ["  ".join(t.ljust(w) for t, w in zip(row, widths, strict=True)).rstrip() for row in rows]
    return "\n".join([shown.title, shown.sentence, *table, *shown.notes])


def cell(kind: str, text: str) -> str:
    """One cell of a table."""
    together = ";white-space:nowrap" if len(text) <= SHORT else ""
    return f'<{kind} style="{CELL}{together}">{escape(text)}</{kind}>'


def bar(shares: Sequence[float], row: int) -> str:
    """The cell with the bar of one row; nothing where there are no bars."""
    if not shares:
        return ""
    look = f"width:{LONGEST_BAR * shares[row]:.0f}px;height:9px;background:currentColor;opacity:.55"
    return f'<td style="{CELL};vertical-align:middle"><div style="{look}"></div></td>'


@singledispatch
def card(result: object) -> Card:
    """Content shown for a result."""
    raise TypeError(f"a {type(result).__name__} has no card; expected one of {', '.join(CARDS)}")


@card.register
def _(recording: Recording) -> Card:
    seen = describe(recording)
    warnings = [f.text for f in recording.findings if f.severity == "warning"]
    used = "" if seen["range_used"] is None else f"; {100.0 * seen['range_used']:.0f} % of the sensor's range used"
    noticed = f"{len(warnings)} warning{'s' if len(warnings) != 1 else ''}" if warnings else "no warnings"
    rest = sum(end - start for start, end in seen["rest_s"])
    notes = [f"warning: {text}" for text in warnings]
    notes += [f.text for f in recording.findings if f.severity != "warning"]
    return Card(
        title=f"Recording {recording.name}".strip(),
        sentence=f"{instant(duration(recording))} s, at rest for {instant(rest)} s{used}; {noticed}.",
        head=("channel", "samples", "rate", "from", "to", "least", "largest"),
        rows=tuple(
            (
                name,
                formatting.grouped(c["samples"]),
                f"{c['rate_hz']:.6g} Hz" if c["rate_hz"] else "",
                f"{instant(c['start_s'])} s",
                f"{instant(c['end_s'])} s",
                measured(c["min"], c["unit"]),
                measured(c["max"], c["unit"]),
            )
            for name, c in seen["channels"].items()
        ),
        notes=(*notes, *(f"assumed: {text}" for text in seen["assumptions"])),
    )


@card.register
def _(dwells: Dwells) -> Card:
    degrees = np.degrees(dwells.angle)
    several = len(set(dwells.group))
    return Card(
        title=f"{dwells.name or 'Dwells'}",
        sentence=f"{len(dwells)} dwells in {several} group{'s' if several > 1 else ''} that share an angle zero.",
        head=("", "least", "greatest"),
        rows=(
            ("attitude", f"{number(float(degrees.min()), 5)} deg", f"{number(float(degrees.max()), 5)} deg"),
            ("mean", measured(float(dwells.mean.min()), "m/s²"), measured(float(dwells.mean.max()), "m/s²")),
            (
                "duration",
                f"{number(float(dwells.duration.min()), 4)} s",
                f"{number(float(dwells.duration.max()), 4)} s",
            ),
            (
                "standard deviation of a mean",
                measured(float(np.sqrt(dwells.variance.min())), "m/s²"),
                measured(float(np.sqrt(dwells.variance.max())), "m/s²"),
            ),
        ),
        notes=tuple(f"assumed: {text}" for text in dwells.assumptions),
    )


@card.register
def _(fit: Fit) -> Card:
    names = ", ".join(name for name, _ in fit.sources)
    readings = formatting.grouped(sum(run.readings for run in fit.runs))
    made_from = [f"{readings} readings of position"] * bool(fit.runs)
    made_from += [f"{len(fit.dwells.angle)} dwells"] if fit.dwells else []
    agreement = "".join(
        f", normalised innovation squared {run.nis:.3f} (1 when consistent)" for run in fit.runs if run.nis is not None
    )
    return Card(
        title=f"Fit of {names}, {fit.method}",
        sentence=f"{len(fit.free)} parameters from {' and '.join(made_from)}{agreement}.",
        head=("parameter", "value", "at full scale", "SI value (u)", "U", "sum estimated on this rig"),
        rows=tuple(
            (
                e.name if e.run is None else f"{e.name} [{fit.runs[e.run].name}]",
                plain(e.unit, e.value, e.std),
                at_full_scale(e.name, e.unit, e.value, e.std, fit.rig.sensor.range),
                f"{e.symbol} = {value(e)}",
                with_unit(number(fit.expanded(e, COVERAGE_FACTOR), 2), e.unit) if e.std > 0.0 else "held",
                tied_sum(fit, e.name),
            )
            for e in (*fit.estimates, *fit.shapes)
        ),
        notes=(
            "(u): standard uncertainty of the last digits; U: expanded uncertainty, coverage factor 2.",
            *fit.remarks,
        ),
    )


@card.register
def _(seen: Comparison) -> Card:
    setup, std = seen.setup_bias
    return Card(
        title=f"Model against {seen.recording or 'recording'}",
        sentence=drift(seen),
        head=("unaided drift after", "bias re-estimated", "all from the fit", "noise floor", "start points"),
        rows=tuple(
            (
                f"{h:g} s",
                length(seen.coast_rms[h]),
                length(seen.coast_frozen_rms[h]),
                length(seen.drift_floors[h]),
                str(seen.coast_starts[h]),
            )
            for h in seen.coast_rms
        ),
        notes=(
            as_sentence(ONLY_WHITE),
            f"One-step prediction error {formatting.length(seen.one_step_rms)} rms; accelerometer residual up to "
            f"{number(seen.band)} Hz {number(seen.accel_rms)} m/s² rms; change of set-up or turn-on bias "
            f"{number(setup)} ± {number(std, 2)} m/s².",
            as_sentence(seen.worst),
            *map(as_sentence, seen.not_carried),
            *seen.remarks,
        ),
    )


@card.register
def _(found: Diagnosis) -> Card:
    notes = [f"Suspect data: {text}" for text in found.suspect]
    notes += map(as_sentence, found.notes)
    notes += [as_sentence(rejected.sentence) for rejected in found.dropped]
    notes += [as_sentence(test.sentence) for test in found.channels]
    tied = [tie for tie in found.classes if len(tie.members) > 1]
    notes += [
        f"Confounded on this record: {', '.join(tie.members)}. To separate them: {tie.experiment.rstrip('.')}."
        for tie in tied
    ]
    missing = found.verdict != "adequate"  # a ranking of insignificant candidates would mislead
    return Card(
        title=f"Diagnosis: {VERDICTS[found.verdict]}",
        sentence=typeset(found.sentence),
        head=(
            ("candidate", "coefficient (u)", "largest contribution", "significance")
            if missing
            else ("effect", "detection limit (95 % probability)")
        ),
        rows=(
            tuple(
                (c.title, size, most.removeprefix("at most "), evidence)
                for c in cards(found, CANDIDATES)
                for size, most, evidence in (c.facts,)
            )
            if missing
            else tuple((effect, size) for effect, size in limits(found)[:CANDIDATES])
        ),
        notes=tuple(notes),
    )


@card.register
def _(history: History) -> Card:
    return error_reduction(
        f"History on {history.steps[0].recording or 'recording'}",
        history.names,
        history.steps,
        *map(as_sentence, history.steps[-1].not_carried),
    )


@card.register
def _(found: PairedComparison) -> Card:
    return Card(
        title=f"{len(found.fits)} models on {', '.join(found.recordings)}",
        sentence=" ".join(as_sentence(typeset(one.sentence)) for one in found.differences),
        head=("model", "recording", found.names[0], "this model", "change, % (95 % interval)"),
        rows=tuple(
            (one.name, name, *change_cells(change))
            for one in found.differences
            for name, change in (
                *(zip(found.recordings, one.recordings, strict=True) if len(found.recordings) > 1 else ()),
                ("all", one.pooled),
            )
        ),
        notes=("Changes are paired: all models run with one filter from the same start points.",),
    )


def change_cells(change: HeldOutChange | None) -> tuple[str, str, str]:
    """Errors of two models, and the change with its interval."""
    if change is None:
        return "–", "–", "too short"
    low, high = change.percent_interval
    before, after = (formatting.length(x) if change.unit == "m" else number(x) for x in (change.before, change.after))
    return (before, after, typeset(f"{change.percent:+.3g} ({low:+.3g} to {high:+.3g})"))


@card.register
def _(found: Improvement) -> Card:
    names = [" + ".join(("base", *step.effects)) for step in found.steps]
    same = "the end of the same run" if found.same_run else "another recording"
    last = found.diagnosis
    return error_reduction(
        f"Improvement: {VERDICTS[last.verdict]}; held out: {same}",
        names,
        [step.heldout for step in found.steps],
        typeset(found.sentence),
        *(f"Suspect data: {text}" for text in last.suspect),
        *map(as_sentence, last.notes),
        *map(as_sentence, found.steps[-1].heldout.not_carried),
    )


@card.register
def _(found: DwellDiagnosis) -> Card:
    return Card(
        title=f"Diagnosis of dwells: {found.verdict}",
        sentence=as_sentence(typeset(found.sentence)),
        head=("candidate", "value", "SI value (u)", "significance"),
        rows=tuple(
            (
                spelled(c.effect),
                plain(c.unit, c.estimate, c.std),
                amount(c.estimate, c.std, c.unit),
                f"{c.sigma:.1f} σ, p {probability(c.p_value)}",
            )
            for c in found.candidates[:CANDIDATES]
        ),
        notes=tuple(map(as_sentence, found.remarks)),
    )


@card.register
def _(found: Power) -> Card:
    seen = [each for each in found.detectabilities if each.seen]
    return Card(
        title=f"Detection limits of {found.name or 'a recording'}",
        sentence=f"{len(seen)} of {len(found.detectabilities)} effects would be detected at some size "
        f"({found.examined} candidates, false alarms {100.0 * found.alpha:.2g} % per record).",
        head=("effect", "smallest size (95 % probability)", "largest contribution at that size"),
        rows=tuple(
            (
                spelled(each.effect),
                with_unit(number(min(each.smallest), 3), each.unit),
                with_unit(number(each.largest, 2), each.largest_unit),
            )
            for each in seen[:DETECTABLE]
        ),
        notes=(f"The {DETECTABLE} first; to_dataframe() has all.",) if len(seen) > DETECTABLE else (),
    )


@card.register
def _(model: Model) -> Card:
    return Card(
        title="Model",
        sentence=f"{len(model.terms)} coefficients, {len(model.free)} of them free.",
        head=("coefficient", "symbol", "unit", "owner", "state"),
        rows=tuple((spelled(t.name), t.symbol, t.unit, t.owner, state_of(model, t.name)) for t in model.terms[:TERMS]),
        notes=(
            *(f"{spelled(e.name)} acts on the noise." for e in model.noise_effects),
            *((f"{len(model.terms) - TERMS} more coefficients.",) if len(model.terms) > TERMS else ()),
        ),
    )


@card.register
def _(e: Estimate) -> Card:
    return Card(
        title=f"Estimate of {spelled(e.name)}",
        sentence=f"{e.symbol} = {plain(e.unit, e.value, e.std)}.",
        head=("SI value (u)", "standard uncertainty", "owner"),
        rows=((amount(e.value, e.std, e.unit), with_unit(number(e.std, 2), e.unit) if e.std else "held", e.owner),),
    )


@card.register
def _(effect: Effect) -> Card:
    about = " ".join(effect.card.split("\nEquation:")[0].split())
    rows = [(label, written) for label in CARD if (written := effect.line(label))]
    rows.append(("Unit", f"{effect.unit}; owner: {effect.owner}"))
    return Card(title=f"Effect {effect.name}", sentence=about, head=("", ""), rows=tuple(rows))


@card.register
def _(run: FilterRun) -> Card:
    return Card(
        title=f"Filter {run.choice.system}, {run.choice.model} model",
        sentence=f"{formatting.grouped(len(run.times))} events, {instant(run.times[0])} s to "
        f"{instant(run.times[-1])} s; {len(run.rejections)} readings rejected.",
        head=("state", "last value", "SI value (u)"),
        rows=tuple(
            (name, plain(unit, x, std), amount(x, std, unit))
            for name, x, v in zip(run.names, run.states[-1].tolist(), run.variances[-1].tolist(), strict=True)
            for unit, std in ((STATE_UNITS[name], math.sqrt(max(v, 0.0))),)
        ),
    )


def state_of(model: Model, name: str) -> str:
    """Whether a coefficient is free, held, has a prior, or differs from run to run."""
    if name in model.fixed:
        return f"held at {number(model.fixed[name])}"
    prior = model.priors.get(name)
    text = "free" if prior is None else f"free, prior {number(prior.mean)} ± {number(prior.std)}"
    return f"{text}, one for each run" if name in model.per_run else text


CARDS = (
    *("Recording", "Dwells", "Fit", "Comparison", "Diagnosis", "History", "Improvement", "DwellDiagnosis", "Power"),
    *("Model", "Estimate", "Effect", "FilterRun", "PairedComparison"),
)


def error_reduction(title: str, names: Sequence[str], steps: Sequence[Comparison], *notes: str) -> Card:
    """Several models on one held-out recording, one row each."""
    h = headline_horizon(*steps)
    errors = [quoted_error(seen, h) for seen in steps]
    measure = "Simulation error" if h is None else f"Unaided drift after {h:g} s"
    fall = " → ".join(formatting.length(error) for error in (errors[0], errors[-1])[: len(errors)])
    floor = floor_of(steps[0], h)
    return Card(
        title=title,
        sentence=f"{measure} on held-out data: {fall}{floor}.",
        head=("model", *(f"drift, {k:g} s" for k in steps[0].coast_rms), "simulation", "one step"),
        rows=tuple(
            (name, *map(length, seen.coast_rms.values()), length(seen.simulated_rms), length(seen.one_step_rms))
            for name, seen in zip(names, steps, strict=True)
        ),
        notes=notes,
        bars=tuple(error / (max(errors) or 1.0) for error in errors),
    )


def drift(seen: Comparison) -> str:
    """The drift that is quoted first and its noise floor, in a sentence."""
    h = headline_horizon(seen)
    if h is None:
        return f"Simulation error {formatting.length(seen.simulated_rms)} rms; too short for a drift."
    return f"Unaided drift after {h:g} s: {length(seen.coast_rms[h])} rms{floor_of(seen, h)}."


def floor_of(seen: Comparison, horizon: float | None) -> str:
    """What noise of the sensor alone would give, as the end of a sentence."""
    spread = None if seen.noise_floor is None else seen.noise_floor.at(horizon)
    if spread is None:
        return ""
    return f"; noise alone {formatting.length(spread.low)} to {formatting.length(spread.high)}"


def as_sentence(text: str) -> str:
    """A text with a capital and a full stop."""
    return f"{text[:1].upper()}{text[1:].rstrip('.')}."


def duration(recording: Recording) -> float:
    """From the first to the last sample of either channel, s."""
    clocks = [channel.t for channel in (recording.accel, recording.position) if len(channel)]
    return float(max(t[-1] for t in clocks) - min(t[0] for t in clocks))


def measured(y: float, unit: str) -> str:
    """A sample in its unit."""
    return with_unit(number(y), formatting.label("", unit).strip(" ()"))


def length(metres: float | None) -> str:
    """A length, or that there is none."""
    return "–" if metres is None else formatting.length(metres)


__dir__ = listing(globals())
