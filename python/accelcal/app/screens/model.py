"""The model: hold parameters, remove effects, define effects of your own."""

from __future__ import annotations

from functools import partial

from nicegui import ui

from accelcal.app import widgets
from accelcal.app.page import Page
from accelcal.app.screens import per_run, side_by_side
from accelcal.effects import BUILT_IN, spelled
from accelcal.effects.formula import FUNCTIONS, MOTION
from accelcal.model import Estimate


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
    per_run.fitted(page)
    side_by_side.card(page)
    with ui.element("div").classes("halves"):
        with widgets.card("Effects of this model"):
            added(page)
        with widgets.card("Define an effect"):
            own(page)
    widgets.copies(page)


def parameters(page: Page) -> None:
    """Every parameter with its uncertainty, and a button that fixes or frees it."""
    step = page.bench.state.step
    assert step is not None
    shown = step.fit.table()
    head, cells = shown.cells
    rows = [
        [spelled(first), *rest, *([partial(fix_or_free, page, row["estimate"])] if "estimate" in row else [""])]
        for row, (first, *rest) in zip(shown.rows, cells, strict=True)
    ]
    widgets.table([*head, "fix at (SI)"], rows, "Parameters")
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
    known = [e.name for e in BUILT_IN if e.traits.visible and e.name not in step.fit.model.effects]
    known += [o.effect.name for o in bench.state.own if o.effect.name not in step.fit.model.effects]
    with ui.row().classes("line"):
        chosen = ui.select(
            {name: spelled(name) for name in known},
            label="Add any effect, significant or not",
            with_input=True,
        )
        chosen.props("dense outlined").classes("grow")

        async def add() -> None:
            if chosen.value:
                await page.improve(bench.add, str(chosen.value))

        widgets.button("Add to model", "playlist_add", add)


def own(page: Page) -> None:
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
            bench.own_effect, str(name.value or ""), str(text.value or ""), str(unit.value or "1"), port.value
        )
        if not bench.sentence:
            await page.act(bench.diagnose, then="improve")

    widgets.button("Add to the candidates", "functions", enter)
    for own in state.own:
        ui.label(f"{own.effect.name}: {own.expression}").classes("note")
