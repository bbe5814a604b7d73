"""The loop: what is missing, in words, Add, the error on held-out data after each step, and the residuals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from nicegui import ui

from accelcal.app import widgets
from accelcal.app.page import Page, Zoom
from accelcal.app.screens import files, model
from accelcal.app.state import State, Step
from accelcal.app.tasks import example_of
from accelcal.calibration.export import Laboratory
from accelcal.data import usual_step
from accelcal.data.rig import low_passes
from accelcal.diagnosis.findings import Size
from accelcal.diagnosis.noise.noise_test import WHITENESS
from accelcal.diagnosis.search.scan import Candidate
from accelcal.diagnosis.verdict import AxesDiagnosis, Diagnosis
from accelcal.effects import find, spelled
from accelcal.model import Estimate
from accelcal.plots import comparison, timeline
from accelcal.plots.diagnosis import added_variable
from accelcal.plots.figure import ThemeName
from accelcal.plots.residuals import before_after
from accelcal.plots.response import (
    FIT_HEAD,
    LINEARITY_HEAD,
    RESPONSE_HEAD,
    fit_rows,
    linearity_rows,
    response_note,
    response_rows,
    response_sentences,
    sensitivity,
)
from accelcal.report.view import size_text
from accelcal.response import FrequencyResponse
from accelcal.response.export import draft_response, to_csv
from accelcal.results.comparisons import quoted
from accelcal.results.diagnoses import VERDICTS, candidate_groups, contribution
from accelcal.results.table import as_sentence
from accelcal.results.words import error_size, plain, probability, readable
from accelcal.validation.comparison import ONLY_WHITE, Evaluation
from accelcal.validation.regions import worst_stretches


@dataclass(frozen=True, slots=True)
class Card:
    """One candidate for the page."""

    effect: str
    title: str
    about: str
    """First sentence of its card."""
    facts: tuple[str, ...]
    """Size, evidence."""
    rivals: tuple[str, ...]
    """Effects that the record does not tell from it."""
    nearest: str
    """What is said of the nearest rival where it tells all of them from it; empty where there is none."""
    lines: tuple[tuple[str, str], ...]
    """Label and text of the rest of its card."""
    significant: bool
    """Whether it may be added."""
    first: bool
    """Whether it explains most."""


def cards(diagnosis: Diagnosis, most: int = 8) -> list[Card]:
    """Candidates, best first, confounded ones together."""
    named = [f.effect for f in diagnosis.scan.detected]
    return [card(diagnosis, c, named) for group in candidate_groups(diagnosis, most) for c in group]


def by_output(diagnosis: Diagnosis | AxesDiagnosis) -> list[tuple[str, Diagnosis]]:
    """Axis and diagnosis of each output; one without an axis of a sensor with one."""
    if isinstance(diagnosis, Diagnosis):
        return [("", diagnosis)]
    return list(zip(diagnosis.axes, diagnosis.by_axis, strict=True))


def card(diagnosis: Diagnosis, c: Candidate, named: list[str]) -> Card:
    """One candidate."""
    effect = find(c.effect)
    significant = c.p_value < diagnosis.alpha and diagnosis.verdict not in ("adequate", "too_short")
    others = [name for name in c.members if name != c.effect and significant]
    return Card(
        effect=c.effect,
        title=spelled(c.effect),
        about=" ".join(effect.card.split("\n\n")[0].split("\nEquation:")[0].split()),
        facts=(
            size_text(c),
            f"at most {contribution(Size(c.largest, effect.port == 'position'), diagnosis.fit.rig.sensor.range)}",
            f"{c.snr:.1f} σ, p {probability(c.p_value)}",
        ),
        rivals=tuple(map(spelled, others)),
        nearest=readable(diagnosis.scan.nearest_rival(c.effect).strip()) if significant and not others else "",
        lines=tuple(
            (label, text)
            for label in ("Looks like", "Easily confused with", "Separate by", "Equation")
            if (text := effect.line(label))
        ),
        significant=significant,
        first=bool(named) and c.effect == named[0],
    )


def badge(diagnosis: Diagnosis) -> tuple[str, str]:
    """The verdict in a few words, and its colour."""
    colour = {"adequate": "good", "unexplained": "bad", "too_short": "bad"}.get(diagnosis.verdict, "found")
    return VERDICTS[diagnosis.verdict].capitalize(), colour


def offered(diagnosis: Diagnosis) -> tuple[list[Card], list[Card], list[Card]]:
    """Candidates in three groups: the best one and its rivals; others that are significant; the rest.

    Where no effect is missing, all are in the last group.
    """
    every = cards(diagnosis)
    first = next((c for c in every if c.first), None)
    if first is None:
        return [], [c for c in every if c.significant], [c for c in every if not c.significant]
    near = [first, *(c for c in every if c.title in first.rivals and c.significant)]
    return near, [c for c in every if c.significant and c not in near], [c for c in every if not c.significant]


def remarks(state: State, diagnosis: Diagnosis) -> list[str]:
    """What must be read with the verdict; gaps that the user made are not mentioned."""
    cut = any(run.excluded or run.held_out for run in state.runs)
    notes = (r for r in diagnosis.remarks if r.place == "data" and not (cut and r.code == "dropout"))
    return [
        *(widgets.remark_text(r) for r in notes),
        *(readable(text) for text in diagnosis.notes),
        *(f"{d.sentence}." for d in diagnosis.dropped),
        *(as_sentence(test.sentence) for test in diagnosis.channels if test.effect == WHITENESS),
    ]


LAG_SIGMA, NEAR = 5.0, 0.02
"""Standard deviations of a lag beyond what is declared from which it is one, and how far a round corner may be off."""


def undeclared_low_pass(state: State) -> float | None:
    """Corner of the RC low-pass that would make the lag of the output, Hz, rounded; None where none can.

    The lag of an RC is its time constant 1/(2 pi fc) for motion far below fc. It is none below the corner that the
    sampling shows, and where a low-pass is declared.
    """
    lag = lag_of(state)
    if lag is None or state.axis:
        return None
    recording = state.first_fitted.data
    rig = recording.rig
    if low_passes(rig.passed_by_output) or not lag.std > 0.0 or lag.value < rig.offset_tolerance + LAG_SIGMA * lag.std:
        return None
    corner = 1.0 / (2.0 * math.pi * lag.value)
    if corner > 0.5 / usual_step(recording.accel.t):
        return None
    rounded = (float(f"{corner:.{digits}g}") for digits in (1, 2, 3))
    return next(value for value in rounded if abs(value / corner - 1.0) < NEAR)


def lag_of(state: State) -> Estimate | None:
    """Time by which the output lags under the current model; None where that is not estimated."""
    estimates = state.step.fit.estimates if state.step is not None else ()
    return next((e for e in estimates if e.name == "time_offset"), None)


def low_pass(page: Page) -> None:
    """Where the output lags as an undeclared low-pass would make it: a button that declares it."""
    state = page.bench.state
    corner, lag = undeclared_low_pass(state), lag_of(state)
    if corner is None or lag is None:
        return
    text = (
        f"The output lags by {plain(lag.unit, lag.value, lag.std)}, which is not declared. An RC low-pass at "
        f"{corner:g} Hz lags so; if the sensor or the logger has one, declare it. The model estimates the lag already."
    )
    ui.label(text).classes("warning")
    declare = partial(page.improve, page.bench.declare_low_pass, corner)
    at_rest(page, widgets.button(f"Declare RC {corner:g} Hz", "filter_alt", declare))


def at_rest(page: Page, button: ui.button) -> None:
    """Disable a button while something else is under way."""
    button.set_enabled(page.bench.job is None)
    page.of_rest.append(button)


def found_in_noise(state: State, diagnosis: Diagnosis) -> list[tuple[str, str, str]]:
    """Effects that noise tests found and that can be added: name, title, sentence; one for each."""
    model = state.step.fit.model.effects if state.step else ()
    offered = {c.effect for c in diagnosis.scan.candidates if c.p_value < diagnosis.alpha}
    first = {test.effect: test for test in reversed(diagnosis.channels) if test.effect != WHITENESS}
    return [
        (name, spelled(name), as_sentence(test.sentence))
        for name, test in reversed(first.items())
        if name not in model and name not in offered
    ]


def ties(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    """Confounded effects, and the experiment that separates them."""
    several = [t for t in diagnosis.classes if len(t.members) > 1]
    return [(", ".join(spelled(m) for m in t.members), t.experiment) for t in (*several, *diagnosis.inseparable)]


LIMITS = 6
"""Rows of a table that are shown without a click."""


def shortened(head: Sequence[str], rows: Sequence[Sequence[widgets.Cell]], label: str, more: str, others: str) -> None:
    """The first rows of a table, and the others, if there are any, behind a click on `more`."""
    widgets.table(head, rows[:LIMITS], label)
    if rows[LIMITS:]:
        with ui.expansion(more, icon="list").classes("full"):
            widgets.table(head, rows[LIMITS:], others)


def not_diagnosed(page: Page, waiting: str) -> None:
    """A button that begins the diagnosis, or that it is under way."""
    if page.bench.job is None and not page.asking:
        ui.label("Not diagnosed yet.")
        widgets.button("Diagnose", "search", page.ask, primary=True)
    else:
        ui.label(waiting)


def show(page: Page) -> None:
    """Build the screen."""
    state = page.bench.state
    if state.step is None:
        widgets.empty("Fit a model first, on the Data tab." if state.recording else "Load a recording first.")
        return
    # Adding a model may compare the others anew: a figure belongs to the comparisons that it shows.
    evaluation = state.step.heldouts[state.looked_at]
    outputs, previous = state.beside(state.step), state.previous
    before_outputs = {} if previous is None else state.beside(previous)
    shown = (state.looked_at, *(id(step.heldouts) for step in state.path))

    def of_diagnosis() -> None:
        place.clear()
        page.of_rest[:] = [button for button in page.of_rest if not button.is_deleted]
        with place, widgets.card("Diagnosis", "verdict"):
            verdict(page)

    with widgets.card("Error on held-out data", "ruler"):
        error(page)
    with ui.element("div").classes("two"):
        with ui.element("div").classes("stack"):
            place = ui.element("div")
            of_diagnosis()
            with widgets.card("Models"):
                tree(page)
            example = example_of(state.file)
            if example is not None:
                with widgets.card("An example"):
                    files.answer(example)
        with ui.element("div").classes("stack"):
            if state.axis and any(find(name).port == "process" for name in state.step.fit.model.added):
                ui.label("What changes during the run is in the report, output by output.").classes("note")
            if state.step.moving:
                with widgets.card("What changes during the run", "paths"):
                    followed(page, state.step)
            with ui.element("div").classes("wall"):
                with widgets.card("The error of each model"):
                    page.pictures(
                        ("falling", shown),
                        lambda theme: [widgets.falling(state, theme)],
                    )
                before = page.bench.before()
                if before is not None:
                    with widgets.card("Before and after"):
                        step = widgets.labelled(state.step)
                        page.pictures(
                            ("step", shown),
                            lambda theme: [
                                widgets.picture(before_after(before, evaluation, step), theme, displayModeBar=False)
                            ],
                        )
            with widgets.card("Model and measurement on held-out data"):
                overlay(page, evaluation, shown)
            with ui.element("div").classes("wall"):
                with widgets.card("Residuals on held-out data"):
                    if state.previous is not None:
                        ui.label(f"Grey: before {widgets.labelled(state.step)}.").classes("note")
                    page.pictures(
                        ("left", shown),
                        lambda theme: [
                            comparison.residual_of_axes(outputs, previous=before_outputs),
                            comparison.one_step(evaluation, previous=page.bench.before()),
                        ],
                        behind=("falling", shown),
                        height=620,
                    )
                with widgets.card("Unaided drift"):
                    page.pictures(
                        ("coast", shown),
                        lambda theme: [comparison.coasting_of_axes(outputs)],
                        behind=("falling", shown),
                    )
    widgets.copies(page)
    page.of_diagnosis = of_diagnosis


def followed(page: Page, step: Step) -> None:
    """Coefficients that processes and mechanisms of the model move, and the drivers that a random one may follow."""
    page.pictures(("paths", step.key), lambda theme: [timeline.paths(step.moving)], height=PATH * len(step.moving))
    if step.moving and len(page.bench.state.fitted_files) > 1:
        ui.label(f"Over {page.bench.state.first_fitted.name}, fitted alone.").classes("note")
    for path in step.moving:
        shown = path.table()
        ui.label(shown.sentence).classes("verdict-text")
        head, worded = shown.cells
        rows: list[list[widgets.Cell]] = [
            [*cells, partial(add_button, page, follower.mechanism)]
            for cells, follower in zip(worded, path.followers, strict=True)
        ]
        if not rows:
            continue
        ui.label(FOLLOWING).classes("note")
        label = f"What {spelled(path.coefficient)} may follow"
        shortened([*head, ""], rows, label, "More drivers", f"{label}, further drivers")


FOLLOWING = (
    "A random process describes the change and predicts no other motion; a mechanism does. Add puts the mechanism in "
    "place of a process that it explains."
)
PATH = 300
"""Height of the figure of one path, px."""


def add_button(page: Page, effect: str, *, primary: bool = False) -> None:
    """The button that adds an effect, disabled while something else is under way."""
    label = f"Add {spelled(effect)}"
    add = partial(page.improve, page.bench.add, effect)
    at_rest(page, widgets.button("Add", "add", add, primary=primary, label=label))


def overlay(page: Page, evaluation: Evaluation, shown: tuple[int, ...]) -> None:
    """What was measured and what every model says over each other, and where the current one fails."""
    zoom = Zoom(page, partial(widgets.overlay, page.bench.state), worst_stretches(*evaluation.accel_residual))
    ui.label("Click a model in the legend to hide it; drag to zoom; click a shaded stretch to see it closer.").classes(
        "note"
    )
    page.pictures(("overlay", shown), zoom.whole, behind=("falling", shown), prepare=zoom.follow, height=660)
    zoom.places()
    if evaluation.worst_regions:
        with ui.expansion("Where it fails", icon="troubleshoot").classes("full"):
            zoom.table(evaluation)


def error(page: Page) -> None:
    """The held-out error in numbers."""
    state = page.bench.state
    compared = widgets.path_of(state)
    with ui.row().classes("numbers"):
        for name, evaluation, mark in (("current error", -1, "error"), ("previous error", -2, "before")):
            if len(compared) >= -evaluation:
                shown = quoted(compared.headline, compared[evaluation])
                figure(name, compared.errors[evaluation], mark, shown)
        figure(
            compared.headline.alone,
            compared.floor.value,
            "floor",
            error_size(compared.floor.value, compared.headline.unit),
        )
    ui.label(f"{compared.headline.name[:1].upper()}{compared.headline.name[1:]}, on {held_out(state)}.").classes("note")
    if compared.headline.band is None:
        ui.label(f"{ONLY_WHITE[:1].upper()}{ONLY_WHITE[1:]}.").classes("note")
    model.errors_by_run(page)
    widgets.lines(compared[-1].not_carried)
    widgets.lines(noise_scores(state))


def held_out(state: State) -> str:
    """What is held out, in words."""
    several = len(state.unseen_runs)
    if state.axis:
        return f"the outputs {', '.join(dict.fromkeys(run.name for run in state.unseen_runs))} held out, together"
    if several > 1:
        return f"{several} held-out {'parts' if state.holds_out_parts else 'recordings'} together"
    return "the held-out part of this run" if state.holds_out_parts else "another recording"


def noise_scores(state: State) -> list[str]:
    """What effects on noise gain on each held-out recording, a sentence each; its name where there are several."""
    assert state.step is not None
    several = len(state.unseen_runs) > 1
    return [
        f"Held out{f' ({run.name})' if several else ''}, {score.sentence}."
        for run, evaluation in zip(state.unseen_runs, state.step.heldouts, strict=True)
        for score in evaluation.noise_scores
    ]


def figure(name: str, value: float, mark: str, shown: str) -> None:
    """A number with its name; the page holds all its digits."""
    with ui.element("div").classes("number"):
        ui.label(shown.partition(" (")[0]).classes("large").props(f"data-number={mark} data-value={value!r}")
        ui.label(name).classes("note")


def verdict(page: Page) -> None:
    """The verdict, the candidates with their cards, and Add."""
    diagnosis = page.bench.diagnosis
    if diagnosis is None:
        not_diagnosed(page, "Testing every effect of the catalogue …")
        return
    for axis, judged in by_output(diagnosis):
        if axis:
            widgets.heading(f"Output {axis}", 3)
        verdict_of(page, axis, judged)


def verdict_of(page: Page, axis: str, diagnosis: Diagnosis) -> None:
    """The verdict on one output, its candidates and Add."""
    text, colour = badge(diagnosis)
    ui.label(text).classes(f"badge {colour}").props(f"role=status data-verdict={diagnosis.verdict}")
    ui.label(readable(diagnosis.sentence)).classes("verdict-text")
    widgets.lines(remarks(page.bench.state, diagnosis), "warning")
    low_pass(page)
    if diagnosis.verdict == "adequate":
        ui.label("Detection limits: no missing effect is larger than").classes("strong")
        limits = diagnosis.table("limits").cells[1]
        names = "Detection limits", "More limits", "More detection limits"
        shortened(["effect", "detected from"], limits, *names)
    for name, title, text in found_in_noise(page.bench.state, diagnosis):
        with ui.element("article").classes("candidate"):
            heading(page, axis, name, title)
            ui.label(text)
    leading, further, rest = offered(diagnosis)
    for card in leading:
        candidate(page, axis, diagnosis, card)
    if further:
        text = f"{len(further)} more significant, most of them only until the right effect is added"
        with ui.expansion(text, icon="playlist_add").classes("full"):
            for card in further:
                candidate(page, axis, diagnosis, card)
    if rest:
        with ui.expansion(f"Not significant: the {len(rest)} best of the others", icon="list").classes("full"):
            for card in rest:
                ui.label(card.title).classes("strong")
                ui.label("; ".join(card.facts)).classes("note")
    several = ties(diagnosis)
    if several:
        with ui.expansion("Effects that look alike, and how to separate them", icon="balance").classes("full"):
            for members, experiment in several:
                ui.label(members).classes("strong")
                ui.label(experiment).classes("note")


def heading(page: Page, axis: str, effect: str, title: str, *, primary: bool = False) -> None:
    """Title of a card, and the button that adds its effect, on that axis alone where it is one of the sensor."""
    diagnosis = page.bench.diagnosis
    with ui.row().classes("line spread"):
        ui.label(title).classes("strong large-name")
        name = diagnosis.entering(axis, effect) if isinstance(diagnosis, AxesDiagnosis) else effect
        add_button(page, name, primary=primary)


def candidate(page: Page, axis: str, diagnosis: Diagnosis, card: Card) -> None:
    """One candidate with its card and its button."""
    with ui.element("article").classes("candidate").classes("first" if card.first else ""):
        heading(page, axis, card.effect, card.title, primary=card.first)
        ui.label(card.about)
        widgets.lines(card.facts)
        if card.rivals:
            more = f" and {len(card.rivals) - 4} more" if len(card.rivals) > 4 else ""
            ui.label(f"Confounded on this record with {', '.join(card.rivals[:4])}{more}.").classes("warning")
        widgets.lines([card.nearest] if card.nearest else [])
        evidence(page, axis, diagnosis, card)
        with ui.expansion("About this effect", icon="badge").classes("full"):
            for label, text in card.lines:
                ui.label(label).classes("strong")
                ui.label(text).classes("note")


def evidence(page: Page, axis: str, diagnosis: Diagnosis, card: Card) -> None:
    """What the model leaves of the output on held-out data against the effect, and against its best rival."""
    state = page.bench.state
    assert state.step is not None
    evaluation = state.beside(state.step)[axis]

    def build() -> None:
        key = ("evidence", card.effect, id(diagnosis), id(evaluation))
        page.pictures(key, lambda theme: [picture(evaluation, theme)], narrow=True, height=460)

    def picture(evaluation: Evaluation, theme: ThemeName) -> widgets.Picture:
        return widgets.picture(added_variable(diagnosis, evaluation, card.effect), theme, displayModeBar=False)

    box = ui.expansion("The error against this effect", icon="scatter_plot", value=card.first).classes("full")
    if card.first:
        with box:
            build()
    else:
        widgets.later(box, build)


def tree(page: Page) -> None:
    """Every model with its error; clicking one makes it the current model."""
    bench, state = page.bench, page.bench.state
    depth: dict[int | None, int] = {None: -1}
    children: dict[int | None, list[Step]] = {}
    for step in state.steps:
        depth[step.key] = depth[step.parent] + 1
        children.setdefault(step.parent, []).append(step)
    measure = widgets.path_of(state).headline

    def line(step: Step) -> None:
        short = math.isnan(measure.error(step.heldout))
        here = step.key == state.current
        text = f"{widgets.labelled(step)} · {'too short' if short else quoted(measure, step.heldout)}"
        button = ui.button(text, icon="radio_button_checked" if here else "radio_button_unchecked", color=None)
        button.on_click(lambda: page.change(lambda: bench.look_at(step.key)))
        button.props(f"flat no-caps align=left aria-pressed={'true' if here else 'false'}").classes("node")
        button.style(f"margin-left: {18 * depth[step.key]}px")
        for child in children.get(step.key, []):
            line(child)

    for base in children.get(None, []):
        line(base)
    ui.label("Click a model to make it current; adding an effect to it starts a new branch.").classes("note")


def response(page: Page) -> None:
    """A button that computes it, or what was found."""
    bench, run = page.bench, page.bench.state.run
    if run is None or run.recording is None:
        return
    result = bench.response
    with widgets.card("Frequency response", "response"):
        if result is None:
            ui.label(
                f"Magnitude and phase of the sensitivity of {run.name} by frequency, with uncertainties: by sine "
                "approximation where the motion is steps of sines, else by spectral estimation."
            ).classes("note")
            widgets.button("Compute the frequency response", "graphic_eq", lambda: page.act(bench.respond)).set_enabled(
                bench.job is None
            )
            return
        page.pictures(("response", id(result)), lambda theme: [sensitivity(result)], height=700)
        widgets.lines(response_sentences(result), "")
        if result.model is not None:
            widgets.table(FIT_HEAD, fit_rows(result), "Parametric fit")
        with ui.expansion("Table by frequency", icon="table_rows").classes("full"):
            widgets.table(RESPONSE_HEAD, response_rows(result), "Frequency response")
            ui.label(response_note(result)).classes("note")
        if result.terms:
            with ui.expansion("Amplitude linearity", icon="show_chart").classes("full"):
                widgets.table(LINEARITY_HEAD, linearity_rows(result), "Amplitude linearity")
        downloads(page, result)


def downloads(page: Page, result: FrequencyResponse) -> None:
    """The table as CSV, and all of it as a draft certificate."""
    data = page.bench.state.drawn
    stem, sensor = data.file.stem, data.data.rig.sensor
    with ui.row().classes("line"):
        widgets.button(
            "Response (.csv)", "table_rows", lambda: ui.download.content(to_csv(result), f"{stem}_response.csv")
        )
        widgets.button(
            "Draft certificate of the response (.xml)",
            "workspace_premium",
            lambda: ui.download.content(draft_response(result, sensor, Laboratory()).text, f"{stem}_response.xml"),
        )


def show_residuals(page: Page) -> None:
    """Build the screen."""
    bench, state = page.bench, page.bench.state
    if state.step is None:
        widgets.empty("Fit a model first, on the Data tab." if state.recording else "Load a recording first.")
        response(page)
        return

    zoom = Zoom(page, lambda window, chosen: widgets.linked(state, bench.whole(), window, chosen))
    with widgets.card("Position, acceleration, residual, temperature"):
        ui.label("Drag to zoom; all panels follow, at full resolution. Double-click to reset.").classes("note")
        if state.axis:
            ui.label(f"Output {state.axis}; another one is chosen on the Improve tab, with its curves.").classes("note")
        page.pictures(
            ("linked", state.current, state.shown, state.data.digest, state.axis),
            zoom.whole,
            first=bench.whole,
            prepare=zoom.follow,
            height=600,
        )
        zoom.places()
    judged = None if bench.diagnosis is None else dict(by_output(bench.diagnosis)).get(state.axis)
    with widgets.card("Where it fails"):
        if judged is None:
            not_diagnosed(page, "Diagnosis is running …")
        else:
            worst = judged.where.worst
            ui.label(f"{worst[:1].upper()}{worst[1:]}.".replace(" sigma", " σ")).classes("verdict-text")
            regions(state, zoom, judged.where)
    response(page)
    if judged is not None:
        with widgets.card("Residual against each variable", "many"):
            page.pictures(("where", id(judged)), lambda theme: widgets.where(judged, theme), height=1500)
    widgets.copies(page)


def regions(state: State, zoom: Zoom, evaluation: Evaluation) -> None:
    """Where the model fails on the first fitted recording; its ranges lead into the figure only if that is drawn."""
    first = state.first_fitted
    if state.drawn is not first:
        text = f"On {first.name}, the first fitted recording; bring it to the time line to see these ranges."
        ui.label(text).classes("note")
    zoom.table(evaluation, leads=state.drawn is first)
