"""Results as text for a terminal: the tables of `accelcal.results`, alarms in red, verdicts in bold."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from accelcal.cli.common import UsageError, parse_quantity, say, say_line, show_table
from accelcal.cli.lazy import catalogue, data, experiment, exports, pages, summary, words
from accelcal.cli.overwriting import writing

DRIFT_ROWS = 8
"""Frequencies of the drift bandwidth that are printed."""

if TYPE_CHECKING:
    from accelcal._support.result import Result
    from accelcal.diagnosis.experiment.drift_bandwidth import DriftBandwidth
    from accelcal.diagnosis.select.curve_formulas import FormulaSet
    from accelcal.diagnosis.select.improvement import Improvement
    from accelcal.estimation.estimate import Fit
    from accelcal.validation.differences import Comparison


def show(result: Result, *more: str) -> None:
    """Print the table of a result, then its further tables by name."""
    for which in ("", *more):
        shown = result.table(which)
        further = len(shown.detail)
        shown = shown.explained if writing.get().explain else shown.brief
        say(shown.title)
        for text in shown.alarms:
            say(text, style="bold red")
        if which in ("", "budget"):
            say(shown.sentence, style="bold")
        head, rows = shown.cells
        if rows:
            show_table(head, rows)
        for text in shown.notes:
            say(text)
        if further and not writing.get().explain:
            say(f"--explain prints {further} more {'note' if further == 1 else 'notes'}.", style="dim")


def show_comparison(comparison: Comparison) -> None:
    """Print the errors first, then the changes between models, or where a single one fails."""
    fails = any(" between " in evaluation.worst for evaluations in comparison.evaluations for evaluation in evaluations)
    split = any(evaluation.budget for evaluations in comparison.evaluations for evaluation in evaluations)
    more = ["changes"] if len(comparison) > 1 else ["regions"] if fails else []
    show(comparison, *more, *(["budget"] if split else []))


def show_improvement(result: Improvement) -> None:
    """Print the errors on held-out data, then the parameters of the last model."""
    show(result)
    show(result.best)


def show_fit(fit: Fit, *recordings: data.Recording) -> None:
    """Print a fit, with warnings on its recordings that the fit has no remark on, electrical parameters and dwells."""
    remarked = {note.code for note in fit.remarks}
    for recording in recordings:
        for finding in recording.findings:
            if finding.severity == "warning" and finding.kind not in remarked:
                say(f"warning: {recording.name}: {finding.text}", style="bold red")
    show(fit)
    for key, quantity in fit.electrical.items():
        value, std, unit = quantity.value, quantity.std, quantity.unit
        say(f"{catalogue.spelled(key)}: {words.plain(unit, value, std)} ({words.concise(value, std)} {unit})")
    show_dwells(fit)


def show_export(calibration: exports.Calibration) -> None:
    """Print what was exported: its range, its error bounds, omitted effects."""
    from accelcal.calibration.export.calibration import upwards

    low, high = calibration.domain.acceleration
    say_line(calibration.equation)
    say_line(f"valid for {low:.6g} to {high:.6g} m/s²", end="")
    warm = calibration.domain.temperature
    say_line("" if warm is None else f", {warm[0]:.4g} to {warm[1]:.4g} degC")
    for code in calibration.codes:
        kind, terms = code.inverse.format.name, sum(len(row) for s in code.inverse.segments for row in s.coefficients)
        say_line(f"{kind}: within {upwards(code.bound)} m/s² of the exact inverse, {terms} coefficients")
    least, most = calibration.std
    say_line(f"standard uncertainty from the fit: {least:.2g} to {most:.2g} m/s²")
    for missing in calibration.left_out:
        say_line(f"not exported: {missing.effect} {missing.why}")
    for text in calibration.remarks:
        say_line(f"note: {text}")


def show_agreement(result: pages.Agreement) -> None:
    """Print the verdict on two calibrations, their parameters and what changed between them."""
    from accelcal.report.page import agreement_view

    shown = agreement_view(result)
    say(shown["sentence"], "bold")
    for text in shown["notes"]:
        say(text)
    keys = ("name", "first", "second", "difference", "en")
    rows = [[row[key] for key in keys] for row in shown["parameters"]]
    show_table(["parameter", *shown["names"], "difference", "En"], rows)
    if shown["changes"]:
        show_table(["changed", *shown["names"]], shown["changes"], wrapped=True)


def limit(text: str, kind: str, option: str) -> float:
    """A limit of the stage in SI; a bare number is refused, because both 20 cm and 20 m are plausible."""
    if text.strip().replace(".", "", 1).replace("e", "", 1).lstrip("+-").isdigit():
        example = {"length": "0.2 m", "speed": "0.1 m/s", "acceleration": "20 m/s^2"}[kind]
        raise UsageError(f'{option} {text!r} has no unit; expected a {kind} with one, as in {option} "{example}"')
    return parse_quantity(text, kind, option) or 0.0


def show_power(result: experiment.Power) -> None:
    """Print the smallest detectable size of every effect, then what is confounded, then the drift bandwidth."""
    show(result)
    if result.drift is not None:
        show_drift_bandwidth(result.drift)


def show_drift_bandwidth(drift: DriftBandwidth) -> None:
    """Print the smallest sinusoidal changes of bias and scale factor that a record shows, and those of a tumble."""
    from accelcal.diagnosis.experiment.drift_bandwidth import SIGMA

    frequency, tumble, curves = drift.frequency, drift.tumble, (drift.bias, drift.scale_factor)
    say_line(f"smallest sinusoidal change that this record shows at {SIGMA:g} sigma, whatever its phase")
    rows = [
        (f"{frequency[i]:.3g}", *(f"{y[i]:.2g}" if math.isfinite(y[i]) else "-" for y in curves))
        for i in range(0, len(frequency), max(1, len(frequency) // DRIFT_ROWS))
    ]
    slow = (f"below {tumble.frequency:.1g}", f"{tumble.bias:.2g}", f"{tumble.scale_factor:.2g}")
    show_table(("frequency, Hz", "bias, m/s²", "scale_factor"), [*rows, slow])
    say_line(
        f"  the last row: a tumble test of {tumble.seconds / 60:.0f} min with this noise and angles to 0.001 degrees"
    )


def show_formulas(result: FormulaSet) -> None:
    """Print the answer, then the numbers of each formula."""
    say_line(result.sentence)
    rows = []
    for formula in result.formulas:
        for c, std, unit, text in zip(formula.coefficients, formula.std, formula.units, formula.texts(4), strict=True):
            rows.append((text, words.plain(unit, c, std), words.concise(c, std), unit))
        if formula.inner is not None and formula.inner_interval is not None:
            low, high = formula.inner_interval
            span = f"{formula.inner:.3g} ({low:.3g} .. {high:.3g})"
            rows.append(
                (
                    f"  its {'time constant' if formula.mechanism else 'length'}, 68 % interval",
                    words.with_unit(span, formula.inner_unit),
                    "",
                    "",
                )
            )
        held = "" if formula.held_out is None else f", held out {formula.held_out:.1f}"
        rows.append((f"  gain {formula.gain:.1f}{held}", f"lack of fit p = {formula.lack_of_fit:.2g}", "", ""))
    if rows:
        show_table(("summand", "value", "SI value (u)", "SI unit"), rows)


def show_plan(result: experiment.Plan) -> None:
    """Print what a planned motion would detect, and whether it separates the requested effects."""
    names, limits = ", ".join(result.effects), result.limits
    separated = "can be separated from one another" if len(result.effects) > 1 else "alone was asked for"
    verdict = separated if result.separated else "cannot all be separated within these limits"
    say(
        f"{names} {verdict}; {result.tried} motions of {result.seconds:g} s tried within "
        f"{limits.stroke:g} m, {limits.speed:g} m/s, {limits.acceleration:g} m/s²",
        style="bold",
    )
    show(result)
    for first, second, correlation in result.correlations:
        say(f"{first} and {second}: correlation {correlation:.3f}")


def show_next(result: experiment.NextExperiments) -> None:
    """Print the causes with their weights, then the further runs."""
    show(result, "causes")


def show_dwells(result: Fit) -> None:
    """Print what a fit leaves of each dwell, its standard deviation, and the angle zeros."""
    if result.dwells is None:
        return
    of = result.dwells
    of_pose = [f"{math.degrees(angle):+.6g}" for angle in of.angle] or [str(k + 1) for k in range(len(of.residual))]
    rows = [
        (pose, f"{left:+.3g}", f"{std:.2g}", f"{left / std:+.1f}")
        for pose, left, std in zip(of_pose, of.residual, of.std, strict=True)
    ]
    show_table(("attitude (deg)" if of.angle else "position", "residual (m/s²)", "std", "sigma"), rows)
    for group, zero in of.zeros:
        say_line(f"angle zero{f' of group {group}' if len(of.zeros) > 1 else ''}: {math.degrees(zero):+.4g} deg")
    if of.freedom > 0:
        say_line(
            f"scatter between dwells over noise within them: {of.ratio:.3g}; "
            f"p {words.probability(of.p_value)} under all that is declared"
        )


def show_fleet(result: summary.Fleet) -> None:
    """Print the population of every parameter, then one line a sensor, then what is remarkable."""
    rows = [
        (
            name,
            words.plain(result.parameters[name], of_sensors.mean, of_sensors.mean_std),
            words.concise(of_sensors.mean, of_sensors.mean_std),
            result.parameters[name],
            *(
                f"{std.value:.3g} ({std.low:.2g} .. {std.high:.2g})"
                for std in (of_sensors.between_sensors, of_sensors.run_to_run)
            ),
            f"{2.0 * of_sensors.next_run_std:.2g}",
        )
        for name, of_sensors in result.populations.items()
    ]
    if rows:
        head = ("parameter", "mean", "SI mean (u)", "SI unit", "between sensors", "run to run", "next run ±")
        show_table(head, rows)
    show_table(("sensor", "runs", *result.populations), [result.cells(i) for i in range(len(result.sensors))])
    for text in result.sentences:
        say_line(f"note: {text}")
    for file, error in result.errors.items():
        say_line(f"not fitted: {file}: {error.strip().splitlines()[-1]}")
