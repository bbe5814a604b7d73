"""The model: hold parameters, remove effects, define effects, two models side by side, values by run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from nicegui import ui

from accelcal.app import widgets
from accelcal.app.page import Page
from accelcal.app.screens import files
from accelcal.app.state import State, Step
from accelcal.data import RecordingError, require_same_sensor
from accelcal.diagnosis.policy import HOMOGENEITY_ALPHA
from accelcal.diagnosis.runs import RunValues
from accelcal.effects import BUILT_IN, spelled
from accelcal.effects.own import FUNCTIONS, MOTION
from accelcal.estimation.dwell_fit import DwellFit
from accelcal.estimation.estimate import Fit
from accelcal.estimation.noise import NoiseEffect
from accelcal.model import Estimate
from accelcal.results.comparisons import density, quoted
from accelcal.results.words import amount, error_size, number, plain, probability, with_unit
from accelcal.validation.comparison import Evaluation
from accelcal.validation.differences import Measure


def errors_by_run(page: Page) -> None:
    """Where several recordings are held out: the error of every model on each, and whose curves are drawn."""
    state = page.bench.state
    held = state.unseen_runs
    if len(held) < 2 or state.step is None:
        return
    alone = widgets.path_of(state).headline.alone
    titles = ["held out", *(widgets.labelled(step) for step in state.path), alone, "bias less that of the fit"]
    rows = [error_row(state, number, run.name) for number, run in enumerate(held)]
    widgets.table(titles, [*rows, error_row(state, None, "together")], "Error on each held-out recording")
    names = {number: run.name for number, run in enumerate(held)}

    async def look(event: object) -> None:
        if chosen.value != state.looked_at:
            await page.act(page.bench.look_at_heldout, int(chosen.value))

    chosen = ui.select(names, value=state.looked_at, label="Recording of the curves below", on_change=look)
    chosen.props("dense outlined").classes("grow")


def error_row(state: State, number: int | None, name: str) -> list[widgets.Cell]:
    """Errors of the models on the path on one recording, and what noise alone would give."""
    compared = widgets.path_of(state, number)
    measure = widgets.path_of(state).headline
    evaluations = [step.heldout if number is None else step.heldouts[number] for step in state.path]
    floor = measure.floor(evaluations[0]) or compared.floor
    bias = "" if number is None else amount(*evaluations[-1].setup_bias, "m/s²")
    sizes = ["too short" if math.isnan(measure.error(e)) else quoted(measure, e) for e in evaluations]
    return [name, *sizes, error_size(floor.value, measure.unit), bias]


def fitted(page: Page) -> None:
    """Where several files are fitted: whether they agree, and the parameters that each would have alone."""
    state = page.bench.state
    step = state.step
    if step is None or len(state.fitted_files) < 2:
        return
    values = page.bench.run_values
    with widgets.card("Do the recordings agree?"):
        if values is not None:
            ui.label(agreement(values)).classes("verdict-text")
            names = (*values.parameters, *(spread.name for spread in step.fit.spreads), *own_names(step))
            widgets.table(
                ["recording", *map(spelled, names), "noise"], rows_of(step, values), "Parameters of each recording"
            )
            ui.label(
                "Each value is that of one recording alone, with its standard uncertainty; p is the probability of "
                "such differences if all have one value."
            ).classes("note")
        elif len(step.fit.runs) > 1:
            ui.label(
                "Compared as soon as the model is diagnosed."
                if page.bench.diagnosis is None or page.bench.job is not None
                else "Not compared: they could not be fitted one by one."
            )
        widgets.lines([spread.sentence(step.fit[spread.name].value) + "." for spread in step.fit.spreads], "warning")
        if step.fit.dwells is not None:
            widgets.lines([dwells_sentence(step.fit.dwells)])


def agreement(values: RunValues) -> str:
    """Whether recordings agree, in a sentence."""
    pairs = zip(values.parameters, values.p_values, strict=True)
    unlike = [f"{spelled(name)} (p {probability(float(p))})" for name, p in pairs if p <= HOMOGENEITY_ALPHA]
    if unlike:
        return f"They disagree in {', '.join(unlike)}."
    return f"The {len(values.runs)} recordings agree in every parameter that they share."


def own_names(step: Step) -> list[str]:
    """Parameters that belong to each run by their nature: the timing."""
    return list(dict.fromkeys(e.name for e in step.fit.estimates if e.run is not None))


def rows_of(step: Step, values: RunValues) -> list[list[widgets.Cell]]:
    """A row for each recording, and the probabilities below."""
    rows: list[list[widgets.Cell]] = []
    for r, run in enumerate(values.runs):
        shared = [
            amount(float(value), float(std), unit)
            for value, std, unit in zip(values.value[r], values.std[r], values.units, strict=True)
        ]
        spreads = [with_unit(number(spread.runs[r]), spread.unit) for spread in step.fit.spreads]
        of_run = {e.name: amount(e.value, e.std, e.unit) for e in step.fit.estimates if e.run == r}
        values_of_run = [of_run.get(name, "") for name in own_names(step)]
        rows.append([run, *shared, *spreads, *values_of_run, density(step.fit.runs[r].noise.all.density)])
    p_values = (*values.p_values, *(spread.p_value for spread in step.fit.spreads))
    in_all = [f"p {probability(float(p))}" for p in p_values]
    return [*rows, ["one value in all", *in_all, *[""] * (len(own_names(step)) + 1)]]


def dwells_sentence(fit: DwellFit) -> str:
    """What the fit leaves of its dwells."""
    rms = math.sqrt(sum(value**2 for value in fit.residual) / max(1, len(fit.residual)))
    scatter = f"; p {probability(fit.p_value)} under all that is declared" if fit.freedom > 0 else ""
    held = f"{len(fit.residual)} {'dwells' if fit.angle else 'positions'}"
    return f"{fit.name or 'Dwells'}: {held}, rms residual {number(1e3 * rms, 3)} mm/s²{scatter}."


@dataclass(frozen=True, slots=True)
class Difference:
    """One parameter of two models."""

    name: str
    unit: str
    first: Estimate | NoiseEffect | None
    """None where the model does not have it."""
    second: Estimate | NoiseEffect | None

    @property
    def value(self) -> float | None:
        """Second less first, SI; None where one of them does not have it."""
        return None if self.first is None or self.second is None else self.second.value - self.first.value

    @property
    def std(self) -> float:
        """Joint standard uncertainty of two independent fits, SI."""
        return math.hypot(*(e.std for e in (self.first, self.second) if e is not None))

    @property
    def sigma(self) -> float | None:
        """The difference in joint standard uncertainties; None where there is none."""
        return None if self.value is None or not self.std > 0.0 else self.value / self.std


def differences(first: Fit, second: Fit) -> list[Difference]:
    """Parameters of two models, in the order of the first; those of timing are of the first recording."""
    before, two = by_name(first), by_name(second)
    names = [*before, *(name for name in two if name not in before)]
    return [Difference(name, (before.get(name) or two[name]).unit, before.get(name), two.get(name)) for name in names]


def by_name(fit: Fit) -> dict[str, Estimate | NoiseEffect]:
    """Parameters by name, effects on noise among them."""
    return {e.name: fit[e.name] for e in (*fit.estimates, *fit.shapes)} | {e.name: e for e in fit.noise_effects}


def same_sensor(fits: Sequence[Fit], state: State) -> bool:
    """Whether models can be compared with the held-out data of a session: no other sensor is declared."""
    try:
        for fit in fits:
            for recording in state.unseen:
                require_same_sensor(recording, fit.rig, "the model")
    except RecordingError:
        return False
    return True


def card(page: Page) -> None:
    """Choose two models, and see their parameters and errors."""
    state = page.bench.state
    with widgets.card("Two models side by side"):
        names = list(state.models)
        if len(names) > 1:
            if page.pair is None or not set(page.pair) <= set(names):
                page.pair = (names[0], names[-1])
            pair = page.pair
            with ui.row().classes("line"):
                select(page, names, 0)
                select(page, names, 1)
            compared(state, pair)
            errors(page, pair)
        else:
            ui.label("A second model of the tree, or one of another sensor, can stand beside this one.").classes("note")
        files.drop(page, "Drop a model (.json) or another session (.accelcal)", guest=True)


def select(page: Page, names: list[str], side: int) -> None:
    """The choice of one of the two."""
    assert page.pair is not None

    def choose() -> None:
        first, second = page.pair or ("", "")
        page.pair = (str(selector.value), second) if side == 0 else (first, str(selector.value))
        page.rebuild()

    selector = ui.select(names, value=page.pair[side], label=("First model", "Second model")[side], on_change=choose)
    selector.props("dense outlined").classes("grow")


def compared(state: State, pair: tuple[str, str]) -> None:
    """Parameters of both, and how they differ."""
    first, second = (state.models[name] for name in pair)
    rows = [row(difference) for difference in differences(first, second)]
    widgets.table(["parameter", "first", "second", "difference", "in joint σ"], rows, "Parameters of two models")
    note = "Joint σ is the root of the sum of both variances, that of independent fits."
    if {digest for _, digest in first.sources} & {digest for _, digest in second.sources}:
        note += " These two share recordings and their noise, so that it is too large for most of their differences."
    ui.label(note).classes("note")


def row(change: Difference) -> list[widgets.Cell]:
    """One parameter."""
    difference = "" if change.value is None else plain(change.unit, change.value, change.std)
    sigma = "" if change.sigma is None else f"{number(change.sigma, 3)} σ"
    return [spelled(change.name), text(change.first), text(change.second), difference, sigma]


def text(e: Estimate | NoiseEffect | None) -> str:
    """A value with its uncertainty, or that the model has none."""
    return "not in it" if e is None else amount(e.value, e.std, e.unit)


def errors(page: Page, pair: tuple[str, str]) -> None:
    """Errors of both on what is held out here, and of guests on what their own session holds out."""
    bench, state = page.bench, page.bench.state
    for guest in state.guests:
        if guest.name in pair and guest.own is not None:
            ui.label(f"{guest.name}: {own_error(guest.own)} on what its own session holds out ({guest.own.recording}).")
    if not same_sensor([state.models[name] for name in pair], state):
        ui.label("One of them is of another sensor: its errors on the recordings of this session mean nothing.")
        return
    evaluations = bench.pair(pair)
    if evaluations is None:
        widgets.button("Compare on held-out data", "compare_arrows", lambda: page.act(bench.compare_pair, pair))
        return
    for which, label in (("", "Errors of two models on held-out data"), ("changes", "Changes of the errors")):
        table = evaluations.table(which)
        head, rows = table.cells
        widgets.lines([*table.alarms, *([] if which else [table.sentence]), *table.notes])
        widgets.table(head, rows, label)


def own_error(evaluation: Evaluation) -> str:
    """The error of a model on its own held-out data, in words."""
    measure = Measure.of([evaluation])
    return f"{measure.name}: {quoted(measure, evaluation)}"


def show(page: Page) -> None:
    """Build the screen."""
    step = page.bench.state.step
    if step is None:
        widgets.empty(
            "Fit a model first, on the Data tab." if page.bench.state.recording else "Load a recording first."
        )
        return
    with widgets.card("Parameters", "parameters"):
        parameters(page)
    fitted(page)
    card(page)
    with ui.element("div").classes("halves"):
        with widgets.card("Effects of this model"):
            added(page)
        with widgets.card("Define an effect"):
            own_effects(page)
    widgets.copies(page)


def parameters(page: Page) -> None:
    """Every parameter with its uncertainty, and a button that fixes or frees it."""
    step = page.bench.state.step
    assert step is not None
    if step.fit.axes:
        head, values = step.fit.table("axes").cells
        widgets.table(head, values, "Outputs side by side")
        ui.label("Below, Fix holds a parameter at one value on all outputs.").classes("note")
    shown = step.fit.table()
    rows = [
        [
            f"{spelled(row['parameter'])}{row.get('where', '')}",
            row["symbol"],
            f"{row['worded']}, {row['si']}" if row["kind"] == "curve" else row["worded"],
            row["at_full_scale"] if row["at_full_scale"].removesuffix(" FS") != row["worded"] else "",
            with_unit(row["span"], row["unit"]) if row["span"] else "",
            row["includes"] if row["includes"] != row["symbol"] else "",
            partial(fix_or_free, page, row["estimate"]) if row["kind"] in ("coefficient", "shape") else "",
        ]
        for row in shown.rows
    ]
    titles = ["parameter", "symbol", "value", "at full scale", "95 % interval", "includes on this rig", "fix at (SI)"]
    widgets.table(titles, rows, "Parameters")
    widgets.lines(shown.alarms, "warning")
    widgets.lines(shown.notes)


def fix_or_free(page: Page, e: Estimate) -> None:
    """A button that frees a parameter that is fixed, or a value to fix it at."""
    bench, step = page.bench, page.bench.state.step
    assert step is not None
    if e.name in step.fit.model.fixed:
        widgets.button(
            "Free", "lock_open", lambda: page.improve(bench.release, e.name), flat=True, label=f"Free {e.name}"
        )
        return
    with ui.row().classes("line tight"):
        value = ui.input(value=f"{e.value:.4g}").props(
            f'dense outlined aria-label="Value to fix {widgets.attribute(spelled(e.name))} at"'
        )

        async def fix() -> None:
            try:
                number = float(str(value.value).replace("−", "-"))
            except ValueError:
                bench.refuse(f"{e.name}: {value.value!r} is not a number; give a value in {e.unit}")
                return
            await page.improve(bench.freeze, e.name, number)

        widgets.button("Fix", "lock", fix, flat=True, label=f"Fix {e.name}")


def added(page: Page) -> None:
    """Effects beyond the base, each with a button that removes it; any other can be added by hand."""
    bench, step = page.bench, page.bench.state.step
    assert step is not None
    if not step.fit.model.added:
        ui.label("None: this is the base model.")
    for name in step.fit.model.added:
        with ui.row().classes("line spread"):
            ui.label(spelled(name)).classes("strong")
            widgets.button(
                "Remove",
                "remove",
                lambda name=name: page.improve(bench.drop, name),
                label=f"Remove {spelled(name)}",
            )
    names = [e.name for e in BUILT_IN if e.traits.visible and e.name not in step.fit.model.effects]
    names += [o.effect.name for o in bench.state.own if o.effect.name not in step.fit.model.effects]
    with ui.row().classes("line"):
        chosen = ui.select(
            {name: spelled(name) for name in names},
            label="Add any effect, significant or not",
            with_input=True,
        )
        chosen.props("dense outlined").classes("grow")

        async def add() -> None:
            if chosen.value:
                await page.improve(bench.add, str(chosen.value))

        widgets.button("Add to model", "playlist_add", add)


def own_effects(page: Page) -> None:
    """Turn a formula of the user into a candidate."""
    bench, state = page.bench, page.bench.state
    side = ", ".join(state.data.side)
    ui.label(
        f"A formula of {', '.join(MOTION)}{', ' + side if side else ''} in SI units, with + - * / ** and "
        f"{', '.join(FUNCTIONS)}; its coefficient is estimated."
    ).classes("note")
    with ui.row().classes("line"):
        name = ui.input("Name", placeholder="air_drag").props("dense outlined").classes("short")
        unit = ui.input("Unit of the coefficient", placeholder="1/m").props("dense outlined").classes("short")
        port = ui.select({"output": "adds to the output", "position": "adds to the position"}, value="output")
        port.props('dense outlined aria-label="Where it adds"')
    text = ui.input("Formula", placeholder="v * abs(v)").props("dense outlined").classes("full code")

    async def enter() -> None:
        await page.act(
            bench.own_effect, str(name.value or ""), str(text.value or ""), str(unit.value or ""), port.value
        )
        if not bench.sentence:
            await page.act(bench.diagnose, then="improve")

    widgets.button("Add to the candidates", "functions", enter)
    for entry in state.own:
        ui.label(f"{entry.effect.name}: {entry.expression}").classes("note")
