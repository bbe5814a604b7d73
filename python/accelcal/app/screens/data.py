"""The data: load a recording, map its columns, check it, divide it, fit."""

from __future__ import annotations

import math
from typing import Any

from nicegui import ui

from accelcal.app import figures, widgets
from accelcal.app.page import Page
from accelcal.app.run import Run
from accelcal.app.screens import columns, recordings, session, start, uploads
from accelcal.app.state import State
from accelcal.data.dwells import Dwells
from accelcal.results.words import amount, number


def show(page: Page) -> None:
    """Build the screen."""
    state, run, arriving = page.bench.state, page.bench.state.run, page.bench.arriving
    if arriving is not None:
        with widgets.card(arriving.name):
            ui.label("Checking for breaks and faults …").classes("note")
            page.pictures(
                ("arriving", id(arriving), arriving.digest),
                lambda theme: [figures.arriving(arriving, theme)],
                height=420,
            )
        return
    if state.opened is not None:
        with widgets.card("One file is missing", "welcome"):
            session.ask(page)
            uploads.drop(page, "Drop the recording here, or click to choose it")
        return
    if run is None:
        start.show(page)
        return
    if run.problem:
        columns.ask(page)
        with widgets.card("Another recording"):
            uploads.drop(page, "Drop another recording here")
            if len(state.runs) > 1:
                ui.label("Or go on without this file:").classes("note")
                recordings.remove(page, state.shown, run)()
        return
    with ui.element("div").classes("two"):
        with ui.element("div").classes("stack"):
            with widgets.card("Fit"):
                fitting(page)
            if run.recording is not None:
                with widgets.card("Held-out and excluded data"):
                    division(page, run)
            if len(state.runs) == 1:
                recordings.card(page)
        with ui.element("div").classes("stack"):
            if len(state.runs) > 1:
                recordings.card(page)
            if run.dwells is not None:
                with widgets.card(f"Dwells of {run.name}"):
                    dwells(run.dwells)
            else:
                time_line(page, run)
            later(ui.expansion("Columns, units, sensor and rig", icon="table_chart").classes("sheet"), page)
    widgets.copies(page)


def time_line(page: Page, run: Run) -> None:
    """The recording over time, and its check."""
    several = len(page.bench.state.runs) > 1
    with widgets.card(f"The recording {run.name}" if several else "The recording"):
        ui.label("Drag across the plot to select a stretch to hold out or exclude.").classes("note")
        key = ("data", id(run.recording), run.held_out, run.excluded)
        page.pictures(
            key,
            lambda theme: [figures.data(run, theme)],
            prepare=lambda plot, redraw: brushing(page, plot),
            height=420,
        )
    with widgets.card("Data check"):
        check(run)


def dwells(found: Dwells) -> None:
    """Every dwell of a table."""
    rows = [
        [f"{number(math.degrees(angle), 6)}°", amount(mean, std / math.sqrt(samples), "m/s²"), f"{number(long, 4)} s"]
        for angle, mean, std, samples, long in zip(
            found.angle, found.mean, found.std, found.samples, found.duration, strict=True
        )
    ]
    widgets.table(["attitude", "mean output", "duration"], rows, "Dwells")
    widgets.lines(found.assumptions)


def check(run: Run) -> None:
    """Channels, warnings, notes and assumptions of the recording."""
    seen = run.summary
    rows = [
        [
            name,
            f"{c['samples']:,}".replace(",", " "),
            f"{c['rate_hz']:.6g} Hz" if c["rate_hz"] else "",
            f"{number(c['start_s'], 6)} s to {number(c['end_s'], 6)} s",
            f"{number(c['min'])} to {number(c['max'])} {c['unit'].replace('^2', '²')}",
        ]
        for name, c in seen["channels"].items()
    ]
    widgets.table(["channel", "samples", "rate", "span", "range"], rows, "Channels")
    if run.marks is not None:
        widgets.lines([f"Suspect data: {remark.sentence}" for remark in run.marks.remarks], "warning")
    for severity, kind in (("warning", "warning"), ("note", "note")):
        widgets.lines([f["text"] for f in seen["findings"] if f["severity"] == severity], kind)
    if seen["assumptions"]:
        count = len(seen["assumptions"])
        with ui.expansion(f"{count} assumption{'s' if count > 1 else ''}", icon="help_outline").classes("full"):
            widgets.lines(seen["assumptions"])


def later(box: ui.expansion, page: Page) -> None:
    """Build the table of columns when it is first opened, because that reads the file."""

    def opened(event: Any) -> None:
        if event.value and not box.default_slot.children:
            with box:
                columns.form(page)

    box.on_value_change(opened)


def brushing(page: Page, plot: ui.plotly) -> None:
    """Copy a selected stretch into the two fields."""

    def selected(event: Any) -> None:
        span = next((v for k, v in ((event.args or {}).get("range") or {}).items() if k.startswith("x")), None)
        if span:
            page.brushed = (round(min(span), 4), round(max(span), 4))
            for field, value in zip(page.fields, page.brushed, strict=False):
                field.set_value(value)

    plot.on("plotly_selected", selected, ["range"])


def division(page: Page, run: Run) -> None:
    """Choose the held-out part, and stretches to exclude."""
    bench, state = page.bench, page.bench.state
    low, high = run.used
    if len(state.runs) > 1:
        ui.label(f"Of {run.name}:").classes("strong")
    if run.role == "hold out":
        ui.label("All of it is held out: no fit uses it, and the error is computed on it.")
    elif run.role == "leave out":
        ui.label("It is left out: neither fitted nor compared with.")
    elif run.held_out is not None:
        a, b = run.held_out
        ui.label(f"Held out: {a:.6g} s to {b:.6g} s. It is not fitted; the error is computed on it.")
        if len(state.unseen_runs) > 1:
            widgets.button("Fit it whole", "undo", lambda: page.act(bench.fit_whole), flat=True)
    else:
        ui.label("It is fitted whole.")
    if run.breaks:
        ui.label(f"Used: {low:.6g} s to {high:.6g} s, up to the break.").classes("warning")
    for i, (a, b) in enumerate(run.excluded):
        with ui.row().classes("line"):
            ui.label(f"Excluded: {a:.6g} s to {b:.6g} s")
            widgets.button(
                "Include",
                "undo",
                lambda i=i: page.act(bench.use_again, i),
                flat=True,
                label=f"Include {a:.6g} s to {b:.6g} s again",
            )
    start, end = page.brushed or (None, None)
    with ui.row().classes("line"):
        first = ui.number("From, s", value=start, format="%.6g").props("dense outlined").classes("time")
        last = ui.number("To, s", value=end, format="%.6g").props("dense outlined").classes("time")
    page.fields = (first, last)

    async def mark(action: Any) -> None:
        if first.value is None or last.value is None:
            bench.refuse("select a stretch first: drag across the plot, or fill in From and To")
            return
        page.brushed = None
        await page.act(action, float(first.value), float(last.value))

    with ui.row().classes("line"):
        widgets.button("Hold out", "visibility_off", lambda: mark(bench.hold_out), label="Hold this stretch out")
        widgets.button("Exclude", "content_cut", lambda: mark(bench.exclude), label="Exclude this stretch")
    if state.steps:
        text = "Changing what is fitted discards the models, which must be fitted again; Undo restores them."
        ui.label(text).classes("note")


def fitting(page: Page) -> None:
    """Fit the base model."""
    bench, state = page.bench, page.bench.state
    if state.step is None:
        ui.label(f"Estimates bias, scale factor and time offset{together(state)}, then searches for missing effects.")
    else:
        ui.label(f"Current model: {' '.join(s.label for s in state.path)}.")
    with ui.row().classes("line"):
        widgets.button(
            "Fit" if state.step is None else "Refit",
            "play_arrow",
            lambda: page.improve(bench.fit, "linear"),
            primary=state.step is None,
            label="Fit the linear model",
        )
        widgets.button("Fit with K2, K3", "add_chart", lambda: page.improve(bench.fit, "cubic"), flat=True)


def together(state: State) -> str:
    """What is fitted, where that is more than one recording."""
    fitted = [run for run in state.runs if run.role == "fit" and run.known is not None]
    count = sum(run.recording is not None for run in fitted)
    motions = "one recording" if count == 1 else f"{count} recordings"
    at_rest = len(fitted) > count
    return f" from {motions}{' and dwells' if at_rest else ''}" if len(fitted) > 1 else ""
