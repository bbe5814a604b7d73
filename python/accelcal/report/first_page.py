"""The first page of a report, for whoever receives the sensor: parameters, conditions, and what is not known."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from accelcal.calibration.budget import COVERAGE_FACTOR, expanded_uncertainty, standard_uncertainty
from accelcal.data.recording import Recording
from accelcal.data.rig import Rig
from accelcal.effects import BUILT_IN, spelled
from accelcal.estimation.estimate import tied_sum
from accelcal.estimation.run_fit import RunFit
from accelcal.report.content import Content
from accelcal.results.parameters import parameter_rows
from accelcal.results.table import Row
from accelcal.results.words import about, amount, at_full_scale, grouped, number, plain, prefixed, with_unit

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


def with_budget(content: Content, row: Row) -> Row:
    """One parameter with its expanded uncertainty, that of the budget where there is one."""
    e = row.get("estimate")
    named = {"name": f"{spelled(row['name'])}{row['parameter'].removeprefix(row['name'])}", "symbol": row["symbol"]}
    if e is None:
        return named | {"shown": row["worded"], "at_full_scale": "", "si": row["si"]}
    std = standard_uncertainty(content.budget, e)
    expanded = expanded_uncertainty(content.fit, content.budget, e)
    full_scale = content.fit.rig.sensor.range
    return named | {
        "value": e.value,
        "expanded": expanded,
        "shown": f"{plain(e.unit, e.value, 0.0)} (held)" if row["held"] else plain(e.unit, e.value, expanded),
        "at_full_scale": at_full_scale(e.name, e.unit, e.value, expanded, full_scale),
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
    step = "resolution not declared"
    if rig.resolution:
        step = f"resolution {number(rig.resolution * factor)} {unit}"
    filters = [f"RC low-pass {number(rig.lowpass.cutoff)} Hz"] if rig.lowpass else []
    filters += [one.kind for one in rig.filters]
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
    found = valid.get("temperature") or recorded_temperature(content.described["channels"])
    warmth = f"{number(found[0])} °C to {number(found[1])} °C" if found else "not recorded"
    share = content.described["range_used"]
    used = "" if share is None else f" ({100.0 * share:.0f} % of full scale)"
    return [("range of motion", f"{', '.join(parts)}{used}"), ("temperature", warmth)]


def recorded_temperature(channels: Mapping[str, Any]) -> tuple[float, float] | None:
    """Range of the temperature channel, degC."""
    found = channels.get("temperature")
    return None if found is None else (found["min"], found["max"])


def span(unit: str, low: float, high: float) -> str:
    """A range in a unit with a fitting prefix."""
    factor, shown = prefixed(unit, low, high) if unit.startswith("m") else (1.0, unit)
    return f"{number(low * factor, 3)} to {with_unit(number(high * factor, 3), shown)}"


def files(content: Content) -> list[dict[str, str]]:
    """Recordings with the SHA-256 of their files, by what they were used for."""
    fit = content.fit
    found = [of_file("fit", run) for run in fit.runs]
    found += [{"use": "fit", "name": one.name or "dwells", "digest": one.digest} for one in (fit.dwells,) if one]
    known = {run.digest for run in fit.runs}
    for use, run in (("evaluation", content.recording), ("held out", content.holdout)):
        if run is not None and run.digest not in known:
            found.append(of_file(use, run))
    kept = found[:MOST_FILES]
    if len(found) > MOST_FILES:
        kept.append({"use": "", "name": f"and {len(found) - MOST_FILES} more, see Provenance", "digest": ""})
    return kept


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
    sums = dict.fromkeys(tied_sum(content.fit, e.name) for e in content.fit.estimates)
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
    found = [one for one in content.power.detectabilities if one.effect in mine and one.seen and len(one.smallest) == 1]
    found.sort(key=lambda one: (not mine[one.effect].common, not mine[one.effect].static))
    return [f"{spelled(one.effect)} {about(one.unit, one.smallest[0])}" for one in found[:MOST_LIMITS]]


def not_tested(content: Content) -> Iterator[str]:
    """What the data cannot show: missing channels, other mountings and days, data that the fit has used."""
    missing = [
        QUANTITIES.get(channel, spelled(channel))
        for effect in BUILT_IN
        for channel in effect.needs
        if effect.owner == "sensor" and channel not in content.recording.side
    ]
    if missing:
        yield f"Not tested, because not recorded: effects of {', '.join(dict.fromkeys(missing))}."
    if not content.unseen:
        yield "Not tested on data that the fit has not used."
    if not content.fit.spreads:
        yield "The uncertainties do not include differences between mountings and between days."
