"""The loop: what is missing, Add, and the error falling on data that no fit has seen."""

from __future__ import annotations

from nicegui import ui

from accelcal import formatting
from accelcal.app import figures, widgets, wording
from accelcal.app.page import Page
from accelcal.app.state import Step

LIMITS = 6
"""Detection limits that are spelled out at once."""


def show(page: Page) -> None:
    """Build the screen."""
    state = page.bench.state
    if state.step is None:
        widgets.empty("Fit a model first, on the screen Data." if state.recording else "Load a recording first.")
        return
    with ui.element("div").classes("two"):
        with ui.element("div").classes("stack"):
            with widgets.card("What is missing", "verdict"):
                verdict(page)
            with widgets.card("Models"):
                tree(page)
        with ui.element("div").classes("stack"):
            with widgets.card("The error on held-out data"):
                error(page)
                page.pictures(
                    ("falling", state.current),
                    lambda theme: [figures.falling(state, theme)],
                )
            with widgets.card("What is left over on held-out data"):
                if state.previous is not None:
                    ui.label(f"Faint: before {state.step.label}.").classes("note")
                page.pictures(
                    ("left", state.current),
                    lambda theme: [
                        figures.residual(state, page.bench.before(), theme),
                        figures.one_step(state, theme),
                    ],
                    height=620,
                )
            with widgets.card("Unaided drift"):
                page.pictures(("coast", state.current), lambda theme: [figures.coasting(state, theme)])
    widgets.copies(page)


def error(page: Page) -> None:
    """The held-out error in numbers."""
    state = page.bench.state
    nested, found = figures.nested_of(state), page.bench.diagnosis
    now, floor = nested.errors[-1], nested.floor
    with ui.row().classes("numbers"):
        figure("error now", now, "error")
        if len(nested.errors) > 1:
            figure("before", nested.errors[-2], "before")
        unsure = found is None or found.verdict != "adequate"
        figure("noise, as this model sees it" if unsure else "noise alone", floor, "floor")
    what = "another recording" if state.other is not None else "the held-out part of this run"
    ui.label(f"{nested.measure[:1].upper()}{nested.measure[1:]}, on {what}.").classes("note")
    if found is not None and found.verdict not in ("adequate", "too_short"):
        ui.label("What a model lacks passes for noise, so its noise line is too high until that is added.").classes(
            "note"
        )


def figure(name: str, value: float, mark: str) -> None:
    """A number with its name; its full digits stand in the page."""
    with ui.element("div").classes("number"):
        ui.label(formatting.length(value)).classes("large").props(f"data-number={mark} data-value={value!r}")
        ui.label(name).classes("note")


def verdict(page: Page) -> None:
    """The verdict, the candidates with their cards, and Add."""
    bench, found = page.bench, page.bench.diagnosis
    if found is None:
        if bench.job is None and not page.asking:
            ui.label("Not asked yet.")
            widgets.button("Look for what is missing", "search", page.ask, primary=True)
        else:
            ui.label("Every effect of the catalogue is being tried …")
        return
    nothing = not wording.may_add(bench.state, found)
    ui.label(wording.badge(found)).classes("badge").classes("good" if found.verdict == "adequate" else "bad").props(
        f"role=status data-verdict={found.verdict}"
    )
    ui.label(wording.sentence(found)).classes("verdict-text")
    widgets.lines(wording.asides(bench.state, found), "warning")
    if found.verdict == "adequate":
        ui.label("Nothing missing larger than").classes("strong")
        widgets.table(["effect", "seen from"], wording.limits(found)[:LIMITS], "Detection limits")
        if wording.limits(found)[LIMITS:]:
            with ui.expansion("More limits", icon="list").classes("full"):
                widgets.table(["effect", "seen from"], wording.limits(found)[LIMITS:], "More detection limits")
    if nothing:
        made = widgets.button("Add", "add", lambda: None, label="Nothing to add")
        made.set_enabled(False)
    near, further, rest = wording.offered(found)
    for one in near:
        candidate(page, one)
    if further:
        text = f"{len(further)} more stand out, most of them only until the right one is added"
        with ui.expansion(text, icon="playlist_add").classes("full"):
            for one in further:
                candidate(page, one)
    if rest:
        with ui.expansion(f"Looked at, no evidence: {len(rest)} of the best others", icon="list").classes("full"):
            for one in rest:
                ui.label(one.title).classes("strong")
                ui.label("; ".join(one.facts)).classes("note")
    several = wording.ties(found)
    if several:
        with ui.expansion("Cannot be told apart, and the experiment that would", icon="balance").classes("full"):
            for members, experiment in several:
                ui.label(members).classes("strong")
                ui.label(experiment).classes("note")


def candidate(page: Page, one: wording.Card) -> None:
    """One candidate with its card and its button."""
    with ui.element("article").classes("candidate").classes("first" if one.first else ""):
        with ui.row().classes("line spread"):
            ui.label(one.title).classes("strong large-name")
            widgets.button(
                "Add",
                "add",
                lambda: page.improve(page.bench.add, one.effect),
                primary=one.first,
                label=f"Add {one.title}",
            ).set_enabled(page.bench.job is None)
        ui.label(one.about)
        widgets.lines(one.facts)
        if one.rivals:
            more = f" and {len(one.rivals) - 4} more" if len(one.rivals) > 4 else ""
            ui.label(f"Cannot be told apart from: {', '.join(one.rivals[:4])}{more}.").classes("warning")
        with ui.expansion("Its card", icon="badge").classes("full"):
            for label, text in one.lines:
                ui.label(label).classes("strong")
                ui.label(text).classes("note")


def tree(page: Page) -> None:
    """Every model with its error; press one to go on from there."""
    bench, state = page.bench, page.bench.state
    depth: dict[int | None, int] = {None: -1}
    children: dict[int | None, list[Step]] = {}
    for step in state.steps:
        depth[step.key] = depth[step.parent] + 1
        children.setdefault(step.parent, []).append(step)
    horizon = figures.nested_of(state).horizon

    def line(step: Step) -> None:
        value = step.heldout.simulated_rms if horizon is None else step.heldout.coast_rms[horizon]
        here = step.key == state.current
        text = f"{step.label.replace('_', ' ')} · {'too short' if value is None else formatting.length(value)}"
        made = ui.button(text, icon="radio_button_checked" if here else "radio_button_unchecked", color=None)
        made.on_click(lambda: page.change(lambda: bench.look_at(step.key)))
        made.props(f"flat no-caps align=left aria-pressed={'true' if here else 'false'}").classes("node")
        made.style(f"margin-left: {18 * depth[step.key]}px")
        for child in children.get(step.key, []):
            line(child)

    for base in children.get(None, []):
        line(base)
    ui.label("Press a model to look at it; what is added then begins a branch.").classes("note")
