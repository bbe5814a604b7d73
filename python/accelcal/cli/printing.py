"""Results as text for a terminal."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from accelcal.cli.common import UsageError, parse_quantity
from accelcal.cli.terminal import say, say_line, show_table, show_wrapped_table
from accelcal.data.units import instant
from accelcal.formatting import at_full_scale, interval, millionths, percent, plain, plus_minus, short, with_unit

MOST_COLUMNS = 4
"""Coefficients of one effect that are printed one by one; those of a curve or a random process are summarised."""
DRIFT_ROWS = 8
"""Frequencies of the drift bandwidth that are printed."""

MOST_CANDIDATES = 8
"""Candidates on dwells that are printed; --json lists all."""

if TYPE_CHECKING:
    from accelcal.data.recording import Recording
    from accelcal.diagnosis.dwells import DwellDiagnosis
    from accelcal.estimation.estimate import Fit
    from accelcal.fleet.summary import Fleet
    from accelcal.model import Estimate, Model
    from accelcal.selection.curve_formulas import FormulaSet
    from accelcal.selection.improvement import Improvement


def show_export(content: dict[str, Any]) -> None:
    """Print what was exported: its range, its error bounds, omitted effects."""
    from accelcal.calibration.export.words import upwards

    low, high = content["validity"]["acceleration_m_per_s2"]
    say_line(content["model"])
    say_line(f"valid for {low:.6g} to {high:.6g} m/s²", end="")
    warm = content["validity"]["temperature_degC"]
    say_line("" if warm is None else f", {warm[0]:.4g} to {warm[1]:.4g} degC")
    for kind in ("double", "float"):
        code = content[kind]
        terms = sum(len(row) for s in code["segments"] for row in s["coefficients"])
        say_line(f"{kind}: within {upwards(code['bound_m_per_s2'])} m/s² of the exact inverse, {terms} coefficients")
    least, most = content["std_m_per_s2"]
    say_line(f"standard uncertainty from the fit: {least:.2g} to {most:.2g} m/s²")
    for one in content["left_out"]:
        say_line(f"not exported: {one['effect']} {one['why']}")
    for text in content["remarks"]:
        say_line(f"note: {text}")


def show_agreement(shown: dict[str, Any]) -> None:
    """Print the verdict on two calibrations, their parameters and what changed between them."""
    say(shown["sentence"], "bold")
    for text in shown["notes"]:
        say(text)
    keys = ("name", "first", "second", "difference", "en")
    rows = [[row[key] for key in keys] for row in shown["parameters"]]
    show_table(["parameter", *shown["names"], "difference", "En"], rows)
    if shown["changes"]:
        show_wrapped_table(["changed", *shown["names"]], shown["changes"])


def limit(text: str, kind: str, option: str) -> float:
    """A limit of the stage in SI; a bare number is refused, because both 20 cm and 20 m are plausible."""
    if text.strip().replace(".", "", 1).replace("e", "", 1).lstrip("+-").isdigit():
        example = {"length": "0.2 m", "speed": "0.1 m/s", "acceleration": "20 m/s^2"}[kind]
        raise UsageError(f'{option} {text!r} has no unit; expected a {kind} with one, as in {option} "{example}"')
    return parse_quantity(text, kind, option) or 0.0


def show_power(content: dict[str, Any]) -> None:
    """Print the smallest detectable size of every effect, then confounded effects."""
    share = f"{100 * content['probability']:.0f} %"
    say(
        f"{content['name'] or 'recording'}: smallest sizes detected with {share} probability among "
        f"{content['candidates_examined']} candidates, false alarms {100 * content['alpha']:.2g} % per record",
        style="bold",
    )
    rows = []
    for each in content["effects"]:
        sizes = each["smallest_detectable"]
        every = sizes if isinstance(sizes, list) else [sizes]
        known = [v for v in every if v is not None]
        # Two coefficients are printed one by one; of the many of a curve, the one that is detected best.
        sized = every if len(every) <= 2 else [min(known, default=None)]
        largest = each["largest_contribution"]
        rows.append(
            (
                each["effect"],
                " / ".join("-" if v is None else f"{v:.3g}" for v in sized) if known else "not detectable",
                each["unit"],
                f"{largest:.2g} {each['largest_contribution_unit']}" if largest is not None else "",
            )
        )
    show_table(("effect", "smallest size", "unit", "largest contribution"), rows)
    if any(not each["class"][1:] and each["smallest_detectable"] is None for each in content["effects"]):
        say("not detectable: absorbed by the base model, or it would have to be as large as the motion itself")
    for tie in content["ties"]:
        say(f"confounded: {', '.join(tie['members'])}. {tie['experiment']}")
    show_drift_bandwidth(content.get("drift_bandwidth"))


def show_drift_bandwidth(content: dict[str, Any] | None) -> None:
    """Print the smallest sinusoidal changes of bias and scale factor that a record shows, and those of a tumble."""
    if content is None:
        return
    say_line(f"smallest sinusoidal change that this record shows at {content['sigma']:g} sigma, whatever its phase")
    frequency, tumble = content["frequency_Hz"], content["tumble"]
    names = [name for name in tumble if name in content and name != "frequency_Hz"]
    few = range(0, len(frequency), max(1, len(frequency) // DRIFT_ROWS))
    rows = [
        (f"{frequency[i]:.3g}", *("-" if content[name][i] is None else f"{content[name][i]:.2g}" for name in names))
        for i in few
    ]
    slow = (f"below {tumble['frequency_Hz']:.1g}", *(f"{tumble[name]:.2g}" for name in names))
    show_table(("frequency, Hz", "bias, m/s²", "scale_factor"), [*rows, slow])
    say_line(
        f"  the last row: a tumble test of {tumble['seconds'] / 60:.0f} min with this noise and angles to 0.001 degrees"
    )


def show_formulas(found: FormulaSet) -> None:
    """Print the answer, then the numbers of each formula."""
    say_line(found.sentence)
    rows = []
    for each in found.formulas:
        for c, std, unit, text in zip(each.coefficients, each.std, each.units, each.texts(4), strict=True):
            rows.append((text, plain(unit, c, std), short(c, std), unit))
        if each.inner is not None and each.inner_interval is not None:
            low, high = each.inner_interval
            span = f"{each.inner:.3g} ({low:.3g} .. {high:.3g})"
            rows.append(("  its length, 68 % interval", with_unit(span, each.inner_unit), "", ""))
        held = "" if each.held_out is None else f", held out {each.held_out:.1f}"
        rows.append((f"  gain {each.gain:.1f}{held}", f"lack of fit p = {each.lack_of_fit:.2g}", "", ""))
    if rows:
        show_table(("summand", "value", "SI value (std)", "SI unit"), rows)


def show_plan(content: dict[str, Any]) -> None:
    """Print what a planned motion would detect, and whether it separates the requested effects."""
    names = ", ".join(each["effect"] for each in content["effects"])
    limits = content["limits"]
    verdict = "can be separated" if content["separated"] else "cannot all be separated within these limits"
    say(
        f"{names} {verdict}; {content['motions_tried']} motions of {content['seconds']:g} s tried within "
        f"{limits['stroke_m']:g} m, {limits['speed_m_per_s']:g} m/s, {limits['acceleration_m_per_s2']:g} m/s²",
        style="bold",
    )
    show_power({**content, "name": "this motion", "probability": 0.95, "ties": []})
    for each in content["effects"]:
        if each["class"][1:]:
            say(f"{each['effect']} is confounded with {', '.join(each['class'][1:])}")
    for pair in content["correlations"]:
        say(f"{' and '.join(pair['effects'])}: correlation {pair['correlation']:.3f}")


def show_improvement(found: Improvement, content: dict[str, Any]) -> None:
    """Print what was found and what the final model lacks, its parameters, and the held-out errors."""
    show_diagnosis(content)
    show_parameters(found.diagnosis.fit)
    if found.same_run:
        say_line("held out: the end of the same run, which does not reveal set-up and slow-drift errors")
    for text in content["steps"][-1]["heldout"]["not_carried"]:
        say_line(f"note: {text}")
    show_steps([(" + ".join(["base", *step["effects"]]), step["heldout"]) for step in content["steps"]], content)


def show_diagnosis(content: dict[str, Any]) -> None:
    """Print the verdict, then the candidates and confounded effects."""

    from accelcal.diagnosis.remarks import KINDS

    by_place: dict[str, list[str]] = {}
    for one in content["remarks"]:
        by_place.setdefault(KINDS[one["code"]].place, []).append(one["sentence"])
    lines = [(f"suspect data: {text}", "bold red") for text in by_place.get("data", ())]
    lines.insert(0 if "verdict" in by_place else len(lines), (content["sentence"], "bold"))
    for text, style in lines:
        say(text, style=style)
    for text in by_place.get("beside", ()):
        if text in content["sentence"]:
            continue
        say(f"note: {text}")
    if content.get("candidates"):
        rows = [
            (
                c["effect"],
                *(
                    (plain(c["unit"], c["estimate"], c["std"]), short(c["estimate"], c["std"]))
                    if isinstance(c["estimate"], float)
                    else (f"{len(c['estimate'])} coefficients", "")
                ),
                c["unit"],
                f"{c['snr']:.1f}",
                f"{c['p_value']:.2g}" if c["p_value"] > 0.0 else "<1e-300",
                contribution(c["largest_contribution"]).split(" m/s²")[0],
            )
            for c in content["candidates"][:8]
        ]
        show_table(("candidate", "estimate", "SI value (std)", "SI unit", "sigma", "p", "largest, m/s²"), rows)
        say(
            f"p is the family-wise p-value over {content['candidates_examined']} candidates; largest is the largest "
            "contribution over the used range",
        )
    for text in contribution_lines(content):
        say(text)
    for one in content["dropped"]:
        say(f"note: {one['sentence']}")
    if "where" in content:
        say(f"largest residual: {content['where']['worst']}")
    for tie in content["classes"]:
        if len(tie["members"]) > 1:
            say(
                f"confounded on this record: {', '.join(tie['members'])}. To separate them: {tie['experiment']}.",
            )
    for tie in content["inseparable"]:
        say(
            f"confounded on this rig: {', '.join(tie['members'])}. To separate them: {tie['experiment']}.",
        )


def contribution(size: dict[str, float | None]) -> str:
    """A largest contribution in m/s², mg and percent of full scale, or in um at the encoder."""
    if size["m_per_s2"] is None:
        return f"{1e6 * (size['m'] or 0.0):.3g} um"
    share = size["percent_of_full_scale"]
    full = "" if share is None else f", {share:.3g} %FS"
    return f"{size['m_per_s2']:.3g} m/s², {size['mg']:.3g} mg{full}"


def contribution_lines(content: dict[str, Any]) -> list[str]:
    """One line for each named effect: its largest contribution over the used range, and whether that matters."""
    from accelcal.data.rig import STANDARD_GRAVITY

    judged, lines = content["tolerance"], []
    small = [] if judged is None else judged["below"]
    for name in sorted(content["effects"], key=lambda name: name in small):
        size = content["largest_contributions"].get(name)
        text = f"{name}: " + ("no contribution of its own" if size is None else f"at most {contribution(size)}")
        if judged is not None:
            limit = f"{1e3 * judged['m_per_s2'] / STANDARD_GRAVITY:.3g} mg"
            kind = next(kind for kind in ("matters", "below", "not_comparable") if name in judged[kind])
            text += {
                "matters": f"; matters (tolerance {limit})",
                "below": f"; below tolerance ({limit})",
                "not_comparable": "; not comparable with the tolerance, which applies to the output",
            }[kind]
        lines.append(text)
    return lines


def show_steps(steps: list[tuple[str, dict[str, Any]]], table: dict[str, Any] | None = None) -> None:
    """Print the errors on held-out data, and what noise alone would give.

    Parameters
    ----------
    steps : name and comparison of each model.
    table : of several models: the filter that they share, and the change from each step to the next.
    """
    rows = []
    changes = [None for _ in steps] if table is None else [step["change"] for step in table["steps"]]
    for (name, seen), change in zip(steps, changes, strict=True):
        drift = [seen["coast_rms_m"][h] for h in ("1", "5", "10")]
        cells = ["-" if v is None else f"{1e3 * v:.4g}" for v in drift]
        fallen = "" if change is None else f"{change['percent']:+.3g} ± {change['percent_std']:.2g}"
        rows.append((name, *cells, f"{1e6 * seen['one_step_rms_m']:.4g}", fallen))
    floor = steps[0][1]["noise_floor"]
    if floor is not None:
        rows.append(("noise alone", *(spread_cell(floor["drift_rms_m"].get(h)) for h in ("1", "5", "10")), "", ""))
    head = ["model", "1 s, mm", "5 s, mm", "10 s, mm", "one step, um"]
    measure = next((change["measure"] for change in changes if change is not None), None)
    width = len(head) if measure is None else len(head) + 1
    say("rms unaided drift on held-out data (rezeroed) after")
    show_table((*head, f"change of {measure}, %")[:width], [row[:width] for row in rows])
    if floor is not None:
        say(floor_line(floor))
    if table is not None:
        say(ruler_line(table["ruler"]))
    scores = [score["sentence"] for score in steps[-1][1]["noise_scores"]]
    for text in (*scores, *broken_lines(steps[-1][1]), *outside_lines(steps[-1][1])):
        say(f"held out: {text}")


def spread_cell(spread: dict[str, float] | None) -> str:
    """The interval of a root mean square, mm."""
    return "-" if spread is None else f"{1e3 * spread['low']:.3g} to {1e3 * spread['high']:.3g}"


def floor_line(floor: dict[str, Any]) -> str:
    """Where the noise of the floor comes from."""
    from accelcal.plots.numbers import source_of_noise
    from accelcal.validation.sensor_noise import ONLY_WHITE

    source = source_of_noise(floor["source"], floor["density_m_per_s2_rthz"], floor["declared_m_per_s2_rthz"])
    return f"noise alone: {source}; 95 % prediction intervals for a record of this length; {ONLY_WHITE}"


def ruler_line(ruler: dict[str, float]) -> str:
    """The filter and the band that all models of a table share."""
    from accelcal.data.units import MICRO_G

    return (
        f"one filter for all rows: {ruler['noise_m_per_s2_rthz'] / MICRO_G:.4g} ug/sqrt(Hz), "
        f"{1e6 * ruler['reading_std_m']:.4g} um; residuals up to {ruler['band_hz']:.4g} Hz; changes are paired, with "
        "their standard error"
    )


def broken_lines(seen: dict[str, Any]) -> list[str]:
    """Sentences on what is left out of a recording, and on each instant at which a comparison ends before it does."""
    return [
        *seen["left_out"],
        *(
            f"from t = {instant(at)} s on no relation of output and position holds; only the part before is used"
            for at in seen["breaks"]
        ),
    ]


def show_fit(found: Fit, *recordings: Recording) -> None:
    """Print a fit as a table, with noise, warnings and remarks."""

    from accelcal.calibration.electrical import electrical
    from accelcal.effects import spelled

    say(f"{', '.join(name for name, _ in found.sources)}: {found.method}", style="bold")
    first = found.remarks[:1] if found.tilt > 0.0 else ()
    for text in first:
        say(text, style="bold")
    show_parameters(found)
    rig = recordings[0].rig if recordings else found.rig
    for key, one in (electrical(found, rig) or {}).items():
        plainly, value = plain(one["unit"], one["value"], one["std"]), short(one["value"], one["std"])
        say(f"{spelled(key)}: {plainly} ({value} {one['unit']})")
    for run in found.runs:
        for line in noise_lines(run.noise):
            say(line)
    for recording in recordings:
        for finding in recording.findings:
            if finding.severity == "warning":
                say(f"warning: {recording.name}: {finding.text}", style="bold red")
    show_dwells(found)
    for text in (*(recordings[0].rig.assumptions if recordings else ()), *found.remarks[len(first) :]):
        say(f"note: {text}")


def show_dwells(found: Fit) -> None:
    """Print what a fit leaves of each dwell, its standard deviation, and the angle zeros."""
    if found.dwells is None:
        return
    of = found.dwells
    rows = [
        (f"{math.degrees(angle):+.6g}", f"{left:+.3g}", f"{std:.2g}", f"{left / std:+.1f}")
        for angle, left, std in zip(of.angle, of.residual, of.std, strict=True)
    ]
    show_table(("attitude (deg)", "residual (m/s²)", "std", "sigma"), rows)
    for group, zero in of.zeros:
        say_line(f"angle zero{f' of group {group}' if len(of.zeros) > 1 else ''}: {math.degrees(zero):+.4g} deg")
    if of.freedom > 0:
        say_line(
            f"scatter between dwells over noise within them: {of.ratio:.3g}; "
            f"p = {of.p_value:.2g} under all that is declared"
        )


def show_fleet(found: Fleet) -> None:
    """Print the population of every parameter, then one line a sensor, then what is remarkable."""
    rows = []
    for name in found.populations:
        one = found.parameter_to_dict(name)
        spread = [
            f"{one[k]['value']:.3g} ({one[k]['low']:.2g} .. {one[k]['high']:.2g})"
            for k in ("between_sensors", "run_to_run")
        ]
        rows.append(
            (
                name,
                plain(one["unit"], one["mean"], one["mean_std"]),
                short(one["mean"], one["mean_std"]),
                one["unit"],
                *spread,
                f"{2.0 * one['next_run_std']:.2g}",
            )
        )
    if rows:
        head = ("parameter", "mean", "SI mean (std)", "SI unit", "between sensors", "run to run", "next run +-")
        show_table(head, rows)
    lines = []
    for i in range(len(found.sensors)):
        content = found.sensor_to_dict(i)
        each = [short(one["value"], one["std"]) for one in content["parameters"].values()]
        lines.append((content["sensor"], str(content["runs"]), *each))
    show_table(("sensor", "runs", *found.populations), lines)
    for text in found.sentences:
        say_line(f"note: {text}")
    for file, error in found.errors.items():
        say_line(f"not fitted: {file}: {error.strip().splitlines()[-1]}")


def show_dwell_diagnosis(found: DwellDiagnosis) -> None:
    """Print what a model lacks on dwells."""
    say_line(f"{found.verdict}: {found.sentence}")
    rows = [
        (
            one.effect,
            plain(one.unit, one.estimate, one.std),
            short(one.estimate, one.std),
            one.unit,
            f"{one.sigma:.1f}",
            f"{one.p_value:.2g}",
        )
        for one in found.candidates[:MOST_CANDIDATES]
    ]
    show_table(("candidate", "value", "SI value (std)", "SI unit", "sigma", "p"), rows)
    for text in found.remarks:
        say_line(f"note: {text}")


def show_parameters(found: Fit) -> None:
    """Print every parameter with its uncertainty, a curve in one line, and the sum that it estimates on this rig."""
    from accelcal.effects import CATALOGUE, find
    from accelcal.estimation.estimate import tied_sum

    full_scale = found.rig.sensor.range
    rows, estimated = [], {}
    without = [e for e in found.estimates if e.std <= 0.0 and e.value == 0.0 and find(e.name.partition(".")[0]).family]
    of_effect = Counter(e.name.partition(".")[0] for e in found.estimates if e not in without)
    summarised = {name: number for name, number in of_effect.items() if number > MOST_COLUMNS and name in CATALOGUE}
    for e in (*found.estimates, *found.shapes):
        if e in without or (e.name.partition(".")[0] in summarised and e not in found.shapes):
            continue
        held = e.std <= 0.0
        rows.append(
            (
                e.name if e.run is None else f"{e.name} ({found.runs[e.run].name})",
                plain(e.unit, e.value, e.std),
                at_full_scale(e.name, e.unit, e.value, e.std, full_scale),
                f"{e.value:.6g} (held)" if held else short(e.value, e.std),
                e.unit,
                "" if held else interval_of(found, e),
            )
        )
        total = tied_sum(found, e.name)
        if total != e.symbol:
            estimated[e.name] = total
    for noise in found.noise_effects:
        if noise.value <= 0.0:
            rows.append((noise.name, "none seen", "", "", noise.unit, ""))
            continue
        exact = noise.std <= 0.0
        value = f"{noise.value:.6g} (read off)" if exact else short(noise.value, noise.std)
        span = "" if exact else interval(noise.value, noise.std)
        rows.append((noise.name, plain(noise.unit, noise.value, noise.std), "", value, noise.unit, span))
    head = ("parameter", "value", "at full scale", "SI value (std)", "SI unit", "95 % interval")
    show_table(*without_empty(head, rows))
    for noise in found.noise_effects:
        say_line(f"  {noise.name}: {noise.sentence}")
    for spread in found.spreads:
        each = zip(found.runs, spread.runs, strict=True)
        say_line(f"  {spread.name} by run: " + ", ".join(f"{run.name or 'recording'} {y:.6g}" for run, y in each))
    for name, total in estimated.items():
        say_line(f"  {name} estimates {total} on this rig")
    for name, number in summarised.items():
        size = process_size(found.model, name) or f"{number} coefficients, at most {largest_coefficient(found, name)}"
        say_line(f"  {name}: {size}; --json lists them")
    for name, number in Counter(e.name.partition(".")[0] for e in without).items():
        say_line(f"  {name}: {number} of its columns are not needed")


def without_empty(head: Sequence[str], rows: Sequence[Sequence[str]]) -> tuple[list[str], list[list[str]]]:
    """A table without the columns in which every cell is empty."""
    kept = [k for k in range(len(head)) if any(row[k] for row in rows)]
    return [head[k] for k in kept], [[row[k] for k in kept] for row in rows]


def process_size(model: Model, name: str) -> str:
    """Size of a random process of a model, and its correlation time; empty for all other effects."""
    from accelcal.effects import find

    effect = find(name)
    prior = next((model.priors[t.name] for t in model.terms if t.effect is effect and t.name in model.priors), None)
    if effect.port != "process" or prior is None:
        return ""
    if "tau" not in effect.shapes:
        return f"random walk of {prior.std:.3g} {effect.unit}"
    unit = "" if effect.unit == "1" else f" {effect.unit}"
    return f"standard deviation {prior.std:.3g}{unit}, correlation time {model.shapes[name]['tau']:.3g} s"


def interval_of(found: Fit, e: Estimate) -> str:
    """The 95 % interval of an estimate; empty where the runs do not say how much they differ."""
    halves = [spread.mean_half for spread in found.spreads if spread.name == e.name]
    if not all(math.isfinite(half) for half in halves):
        return ""
    return interval(e.value, e.std, *(half / e.std for half in halves))


def largest_coefficient(found: Fit, name: str) -> str:
    """The coefficient of an effect that is furthest from zero, with its uncertainty and unit."""
    own = [e for e in found.estimates if e.name.startswith(f"{name}.")]
    largest = max(own, key=lambda e: abs(e.value))
    shown = short(largest.value, largest.std) if largest.std > 0.0 else f"{largest.value:.4g}"
    return f"{shown} {largest.unit}".removesuffix(" 1")


def noise_lines(report: Any) -> list[str]:
    """Noise of one run: overall, at rest, in motion, and as declared."""
    from accelcal.data.references import ACCELERATION, UNITS
    from accelcal.data.units import MICRO_G

    lines, by_position = [], report.reference == "position"
    counted = "readings" if by_position else "rows"
    whole = "noise beside the effects above" if report.noise.growth else "noise"
    for label, level in ((whole, report.all), ("  at rest", report.rest), ("  in motion", report.motion)):
        if level is not None:
            density = plus_minus(level.density / MICRO_G, level.density_std / MICRO_G)
            reading = plus_minus(1e6 * level.reading, 1e6 * level.reading_std)
            read = (
                f"encoder {reading} um" if by_position else f"{report.reference} {reading} u{UNITS[report.reference]}"
            )
            lines.append(f"{label}: {density} ug/sqrt(Hz), {read}, {level.count} {counted}")
    if report.declared is not None:
        lines.append(
            f"  declared: {report.declared / MICRO_G:.4g} ug/sqrt(Hz); estimated is {report.ratio:.3g} times that"
        )
    edge = f"band {report.band:.4g} Hz" if report.band is not None else f"crossover {report.crossover:.4g} Hz"
    below = "encoder" if by_position else "reference"
    if report.reference != ACCELERATION:
        lines.append(f"  {edge}: below it the {below}, above it the accelerometer measures acceleration more precisely")
    return lines


def show_comparison(content: dict[str, Any]) -> None:
    """Print a comparison: unaided drift first."""

    def millimetres(value: float | None) -> str:
        return "-" if value is None else f"{1e3 * value:.4g}"

    say(f"{content['recording'] or 'recording'}", style="bold")
    floor = content["noise_floor"]
    rows = [
        (
            f"{horizon} s",
            millimetres(value),
            millimetres(content["coast_frozen_rms_m"][horizon]),
            "-" if floor is None else spread_cell(floor["drift_rms_m"].get(horizon)),
            str(content["coast_starts"][horizon]),
        )
        for horizon, value in content["coast_rms_m"].items()
    ]
    show_table(
        ("rms unaided drift after", "rezeroed, mm", "frozen, mm", "noise alone, mm", "start points"),
        rows,
    )
    if floor is not None:
        say(floor_line(floor))
    setup = content["setup_bias_m_per_s2"]
    if setup["std"] is not None:
        say(f"change of set-up or turn-on bias: {plus_minus(setup['value'], setup['std'])} m/s²")
    nis = "" if content["nis"] is None else f", normalised innovation squared {content['nis']:.4f} (1 when consistent)"
    say(f"one-step prediction error: {1e6 * content['one_step_rms_m']:.4g} um rms{nis}")
    steps = ", ".join(f"{k}: {1e6 * v:.4g} um" for k, v in content["k_step_rms_m"].items() if v is not None)
    say(f"k-step-ahead prediction error, k in readings: {steps}")
    say(
        f"accelerometer residual up to {content['band_hz']:.4g} Hz: {content['accel_rms_m_per_s2']:.4g} m/s² rms",
    )
    if content["fit_percent"] is not None:
        say(f"output within that band: fit {percent(content['fit_percent'])}")
    say(f"largest residual: {content['worst']}")
    show_regions(content["where_it_fails"])
    for score in content["noise_scores"]:
        say(score["sentence"])
    for text in broken_lines(content):
        say(f"suspect data: {text}", style="bold red")
    for text in (*content["not_carried"], *(outside_lines(content) or content["remarks"])):
        say(f"note: {text}")


def show_regions(regions: list[dict[str, Any]]) -> None:
    """Print where a model fails: the worst region of every variable."""
    from accelcal.plots.numbers import REGION_HEAD, REGION_NOTE, region_cells
    from accelcal.serialization.model_file import region_from_dict

    if regions:
        say("where it fails")
        show_table(REGION_HEAD, [region_cells(region_from_dict(each)) for each in regions])
        say(REGION_NOTE)


def show_paired(content: dict[str, Any]) -> None:
    """Print whether each model is better than the first, by how much, on which recording and after which time."""
    first, rows = content["models"][0], []
    for one in content["differences"]:
        say(one["sentence"], style="bold")
        several = len(one["recordings"]) > 1
        each = [(part["recording"], part["change"]) for part in one["recordings"] if several]
        together = "all" if several else one["recordings"][0]["recording"]
        each.append((together, one["change"]))
        shown = None if one["change"] is None else one["change"]["measure"]
        each += [(together, change) for change in one["horizons"] if change["measure"] != shown]
        rows += [(one["model"], where, *change_cells(change)) for where, change in each]
    show_table(("model", "recording", "rms of", first, "this model", "change, % (95 % interval)", "stretches"), rows)
    say(f"changes are paired, against {first}; the interval is that of these recordings")
    say(ruler_line(content["recordings"][0]["ruler"]))
    for each_run in content["recordings"]:
        for name, seen in zip(content["models"], each_run["comparisons"], strict=True):
            for text in (*broken_lines(seen), *seen["not_carried"]):
                say(f"note: {name} on {each_run['recording'] or 'recording'}: {text}")


def change_cells(change: dict[str, Any] | None) -> tuple[str, str, str, str, str]:
    """What is compared, errors before and after, the change with its interval, and what it rests on."""
    if change is None:
        return "-", "-", "-", "too short", "-"
    low, high = change["percent_low"], change["percent_high"]
    reach = "" if low is None or high is None else f" ({low:+.3g} to {high:+.3g})"
    before, after = (
        f"{1e3 * change[side]:.4g} mm" if change["unit"] == "m" else f"{change[side]:.4g}"
        for side in ("before", "after")
    )
    return change["measure"], before, after, f"{change['percent']:+.3g}{reach}", str(change["stretches"])


def outside_lines(content: dict[str, Any]) -> list[str]:
    """One line for each variable that leaves the trained range: how often, and the errors inside and outside."""
    lines = []
    for one in content["outside"]:
        if one["readings_outside"] == 0 or one["range"] is None:
            continue
        low, high = one["range"]
        text = (
            f"{one['readings_outside']} of {one['readings']} readings lie outside the trained range of "
            f"{one['variable']} [{low:.4g}, {high:.4g}] {one['unit']}".rstrip()
            + ": "
        )
        one_step = [millionths(one["one_step_rms_m"][side]) for side in ("inside", "outside")]
        text += f"one-step error {one_step[0]} inside, {one_step[1]} outside"
        for horizon, drift in one["coast_rms_m"].items():
            windows = one["coast_starts"][horizon]
            if windows["outside"]:
                sides = [
                    f"{1e3 * drift[side]:.4g} mm {side} ({windows[side]})" if windows[side] else f"none {side}"
                    for side in ("inside", "outside")
                ]
                text += f"; drift after {horizon} s {', '.join(sides)}"
        lines.append(text)
    return lines
