"""The Data screen: load recordings, map their columns, give them roles, check and divide them, fit."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any, get_args

from nicegui import ui

from accelcal.app import mapping, widgets
from accelcal.app.page import Page
from accelcal.app.screens import files
from accelcal.app.state import ROLES, Run, State, Stretch, time_span
from accelcal.data import ANGLE, Dwells, RecordingError, instant
from accelcal.data.rig import CORNERED, Mount
from accelcal.data.units import SCALE_EXAMPLES
from accelcal.diagnosis.left_out import MILLISECOND
from accelcal.estimation.remarks import Remark
from accelcal.io.sidecar import KEYS
from accelcal.plots import timeline
from accelcal.results.words import amount, number

NAMED = (*mapping.ESSENTIAL, *mapping.ORIENTATION, mapping.NOT_USED)
CHOICES = [*mapping.ESSENTIAL, "other", mapping.NOT_USED, *mapping.ORIENTATION]
TEXTS = ("sensor.model", "sensor.scale", "sensor.zero", "sensor.noise", "sensor.range")
AXIS, MOUNT, GRAVITY_ALONG = "rig.axis", "rig.mount", "rig.gravity_along_axis"
"""Keys of the sidecar that have a field in the form."""
AT_AN_ANGLE = "at an angle"
AXES = {"": "not declared", "level": "level", "up": "up", "down": "down", AT_AN_ANGLE: "at an angle"}
"""Axes of a stage: as the sidecar has them, and as the form shows them."""
MOUNTS = {"": "not declared"} | {word: word for word in get_args(Mount)}
"""The same of mounts of the sensor."""


def ask(page: Page) -> None:
    """Ask what the columns of a new file are; it is an error only where the user has said so already."""
    run = page.bench.state.run
    assert run is not None
    text = mapping.text_of(run.file, run.sidecar, run.template)
    unknown = mapping.unknown(mapping.choices(run.columns, text, run.template), text)
    is_first = run.sidecar is None and text == run.template and len(run.columns) > 1 and unknown
    with widgets.card(f"{run.name}: what is in its columns?"):
        if is_first:
            ui.label(f"Their names do not say everything yet. Choose below: {', '.join(unknown)}.")
        else:
            ui.label(run.problem).classes("problem").props("role=alert")
        lines = mapping.first_lines(run.file)
        if lines:
            ui.label("The file begins with").classes("note")
            ui.label("\n".join(lines)).classes("beginning").props(
                'tabindex=0 role=group aria-label="First lines of the file"'
            )
        form(page, rig=True)


@dataclass(slots=True)
class Fields:
    """The widgets of the form; each list has an entry for each column."""

    choices: Sequence[mapping.Choice]
    roles: list[ui.select] = field(default_factory=list)
    names: list[ui.input] = field(default_factory=list)
    units: list[ui.input] = field(default_factory=list)

    @property
    def chosen(self) -> list[mapping.Choice]:
        """What the user has chosen for each column."""
        fields = zip(self.choices, self.roles, self.names, self.units, strict=True)
        return [
            mapping.Choice(
                choice.column, str(name.value if role.value == "other" else role.value), str(unit.value).strip()
            )
            for choice, role, name, unit in fields
        ]

    def row(self, choice: mapping.Choice) -> list[widgets.Cell]:
        """A line of the table of columns."""
        role_name = choice.channel if choice.channel in NAMED else "other"
        column = widgets.attribute(choice.column)

        def role() -> None:
            selector = ui.select(CHOICES, value=role_name)
            self.roles.append(selector.props(f'dense outlined aria-label="Role of {column}"'))

        def name() -> None:
            entry = ui.input(value=choice.channel if role_name == "other" else choice.column)
            entry.bind_visibility_from(self.roles[-1], "value", value="other")
            self.names.append(entry.props(f'dense outlined aria-label="Name of {column}"'))

        def unit() -> None:
            entry = ui.input(value=choice.unit, placeholder="unit")
            self.units.append(entry.props(f'dense outlined aria-label="Unit of {column}"').classes("unit"))

        return [choice.column, role, unit, name]


class Declarations:
    """The widgets that say what sensor and rig are.

    Parameters
    ----------
    text : of the sidecar, which fills them.
    """

    def __init__(self, text: str) -> None:
        self.text = text
        ui.label("An output or a position in volts or counts needs its scale. The rest may stay empty.").classes("note")
        low_pass, axis = mapping.LowPassEntry.of(text), mapping.declared(text, AXIS)
        with ui.element("div").classes("fields"):
            self.texts = {path: self._entry(path, *labelled(path)) for path in TEXTS}
            self.kind = ui.select(list(mapping.LOW_PASSES), value=low_pass.kind, label="Low-pass of the output")
            self.kind.props('dense outlined aria-label="Low-pass of the output"')
            self.corner = ui.input("Corner (−3 dB)", value=low_pass.corner, placeholder="500 Hz")
            self.order = ui.input("Order", value=low_pass.order, placeholder="4")
            for field, kinds in ((self.corner, CORNERED), (self.order, CORNERED[1:])):
                field.props("dense outlined stack-label")
                field.bind_visibility_from(self.kind, "value", backward=partial(operator.contains, kinds))
            turned = ANGLE in mapping.channels(text)
            moved, kind = (ANGLE, "angle") if turned else ("position", "length")
            scale = f"channels.{moved}.scale"
            self.texts[scale] = self._entry(scale, f"Scale of the {moved}", SCALE_EXAMPLES[kind]["count"])
            if turned:
                self.texts |= {path: self._entry(path, *labels) for path, labels in mapping.ON_ARM.items()}
            self.texts[mapping.RESOLUTION] = self._entry(mapping.RESOLUTION, "Encoder resolution", "1 um")
            angle = mapping.declared(text, GRAVITY_ALONG)
            self.axis = ui.select(AXES, value=AT_AN_ANGLE if angle else axis if axis in AXES else "")
            self.axis.props('dense outlined label="Axis of the stage" aria-label="Axis of the stage"')
            mount = mapping.declared(text, MOUNT)
            self.mount = ui.select(MOUNTS, value=mount if mount in MOUNTS else "")
            self.mount.props('dense outlined label="Mount of the sensor" aria-label="Mount of the sensor"')
            self.gravity = self._entry(GRAVITY_ALONG, *labelled(GRAVITY_ALONG))
            self.gravity.bind_visibility_from(self.axis, "value", value=AT_AN_ANGLE)

    def _entry(self, path: str, label: str, example: str) -> ui.input:
        entry = ui.input(label, value=mapping.declared(self.text, path), placeholder=example)
        return entry.props("dense outlined stack-label")  # so that the example is in sight

    @property
    def changes(self) -> dict[str, Any]:
        """What the user has declared anew, for `mapping.sidecar_from`."""
        axis = str(self.axis.value or "")
        angle = axis == AT_AN_ANGLE
        entered = {path: str(entry.value or "").strip() for path, entry in self.texts.items()}
        entered[MOUNT] = str(self.mount.value or "")
        entered |= {AXIS: "" if angle else axis, GRAVITY_ALONG: str(self.gravity.value or "").strip() if angle else ""}
        entries = (str(field.value or "").strip() for field in (self.kind, self.corner, self.order))
        changed = {path: value for path, value in entered.items() if value != mapping.declared(self.text, path)}
        return changed | mapping.LowPassEntry(*entries).changed(self.text)


def labelled(path: str) -> tuple[str, str]:
    """Name of a field, and an example of what it holds."""
    table, key = path.split(".")
    return KEYS[table][key].label, KEYS[table][key].example.strip('"')


def declarations(page: Page, run: Run) -> None:
    """Fields for sensor and rig of a file whose columns are known."""
    text = mapping.text_of(run.file, run.sidecar, run.template)
    fields = Declarations(text)

    async def use() -> None:
        await declare(
            page, lambda: (text, mapping.choices(run.columns, text, run.template)), changes=lambda: fields.changes
        )

    widgets.button("Use these declarations", "check", use)


async def declare(
    page: Page,
    columns: Callable[[], tuple[str, Sequence[mapping.Choice]]],
    axis: tuple[str, str] = ("", ""),
    changes: Callable[[], dict[str, Any]] = dict,
) -> None:
    """Read a file again with what the form says; what cannot be written as a sidecar is told."""
    try:
        sidecar = mapping.sidecar_from(*columns(), *axis, changes())
    except RecordingError as error:
        page.bench.refuse(str(error))
        return
    await page.act(page.bench.declare, sidecar)


def form(page: Page, *, rig: bool) -> None:
    """Fields for columns and orientation, for sensor and rig where they are asked, and the sidecar as text."""
    bench, run = page.bench, page.bench.state.run
    assert run is not None
    text = mapping.text_of(run.file, run.sidecar, run.template)
    fields = Fields(mapping.choices(run.columns, text, run.template))
    widgets.table(
        ["column", "role", "unit", "channel name"], [fields.row(choice) for choice in fields.choices], "Columns"
    )
    declared = None
    if rig:
        widgets.heading("Sensor and rig", 3)
        declared = Declarations(text)
    with ui.expansion("The body can turn", icon="360").classes("full"):
        direction, sense = turning()
    with ui.expansion("Everything else: the sidecar", icon="description").classes("full"):
        sheet = ui.textarea("Sidecar (TOML)", value=text).props("outlined autogrow").classes("code full")
        widgets.button("Use the sidecar as written", "description", lambda: page.act(bench.declare, str(sheet.value)))

    async def use_columns() -> None:
        await declare(
            page,
            lambda: (str(sheet.value), fields.chosen),
            (str(direction.value or ""), str(sense.value or "")),
            lambda: declared.changes if declared else {},
        )

    with ui.row():
        widgets.button("Use this assignment", "check", use_columns, primary=bool(run.problem))


def turning() -> tuple[ui.input, ui.select]:
    """Fields for a body that turns: the input axis, and what a quaternion maps."""
    ui.label(
        "Then gravity along the axis changes: map the angle of an arm, what that axis would read at rest "
        "(gravity_along_axis), a gyroscope (gyr_x, gyr_y, gyr_z), or place and attitude (position_e, position_n, "
        "position_u, no position, and q_w to q_z), and say which axis of them the sensor measures."
    ).classes("note")
    with ui.row().classes("line"):
        direction = ui.input("Input axis of a body that turns", placeholder="x, y, z or 0, 0.6, 0.8")
        direction.props("dense outlined")
        sense = ui.select(["", "sensor to ENU", "ENU to sensor"], value="", label="The quaternion maps")
        sense.props('dense outlined aria-label="The quaternion maps"').classes("short")
    return direction, sense


def card(page: Page) -> None:
    """Files with their roles; of a single one only the places to drop more."""
    state = page.bench.state
    with widgets.card("Recordings"):
        if len(state.runs) > 1:
            widgets.table(
                ["file", "use", "length", "held out", "time line", "remove"],
                [row(page, at, run) for at, run in enumerate(state.runs)],
                "Recordings and their use",
            )
            ui.label(
                "Models are fitted to all files with the use fit together, and compared with what is held out."
            ).classes("note")
            widgets.lines(
                [f"{run.name}: sensor and rig as declared for {run.lender}." for run in state.runs if run.lender]
            )
        files.drop(page, "Add recordings or dwells", more=True)
        with ui.expansion("Begin anew with others", icon="restart_alt").classes("full"):
            files.drop(page, "Drop the recordings here")


def row(page: Page, at: int, run: Run) -> list[widgets.Cell]:
    """A file with what can be done with it."""
    return [run.name, use(page, at, run), length(run), held_out(run), show_button(page, at, run), remove(page, at, run)]


def use(page: Page, at: int, run: Run) -> Callable[[], None]:
    """The choice of a role; dwells cannot be held out."""

    def build() -> None:
        roles = [role for role in ROLES if run.dwells is None or role != "hold out"]

        async def choose(event: object) -> None:
            role = chosen.value
            if role != run.role:
                await page.act(page.bench.assign, at, role)
            if page.bench.state.runs[at].role == run.role:
                chosen.set_value(run.role)

        chosen = ui.select(roles, value=run.role, on_change=choose)
        chosen.props(f'dense outlined aria-label="Use of {widgets.attribute(run.name)}"').classes("role")

    return build


def length(run: Run) -> str:
    """How long a recording is, or how many dwells there are."""
    if run.dwells is not None:
        return "1 dwell" if len(run.dwells) == 1 else f"{len(run.dwells)} dwells"
    if run.recording is None:
        return "columns unknown"
    begin, end = time_span(run.recording)
    return f"{number(end - begin, 4)} s"


def held_out(run: Run) -> str:
    """Which part is held out."""
    if run.role == "hold out":
        return "all of it"
    return "" if run.held_out is None else f"{run.held_out[0]:.6g} s to {run.held_out[1]:.6g} s"


def show_button(page: Page, at: int, run: Run) -> widgets.Cell:
    """A button that brings a file to the time line."""
    if at == page.bench.state.shown:
        return "shown"
    return lambda: widgets.button(
        "Show", "insert_chart", lambda: page.act(page.bench.show, at), flat=True, label=f"Show {run.name}"
    )


def remove(page: Page, at: int, run: Run) -> Callable[[], object]:
    """A button that removes a file."""
    return lambda: widgets.button(
        "Remove", "delete", lambda: page.act(page.bench.remove, at), flat=True, label=f"Remove {run.name}"
    )


def show(page: Page) -> None:
    """Build the screen."""
    state, run, arriving = page.bench.state, page.bench.state.run, page.bench.arriving
    if arriving is not None:
        with widgets.card(arriving.name):
            ui.label("Checking for breaks and faults …").classes("note")
            page.pictures(
                ("arriving", id(arriving), arriving.digest),
                lambda theme: [timeline.linked(arriving)],
                height=420,
            )
        return
    if state.opened is not None:
        with widgets.card("One file is missing", "welcome"):
            files.ask(page)
            files.drop(page, "Drop the recording here, or click to choose it")
        return
    if run is None:
        files.welcome(page)
        return
    if run.problem:
        ask(page)
        with widgets.card("Another recording"):
            files.drop(page, "Drop another recording here")
            if len(state.runs) > 1:
                ui.label("Or go on without this file:").classes("note")
                remove(page, state.shown, run)()
        return
    with ui.element("div").classes("two"):
        with ui.element("div").classes("stack"):
            with widgets.card("Fit"):
                fitting(page)
            if run.recording is not None:
                with widgets.card("Sensor and rig"):
                    rig(page, run)
                with widgets.card("Held-out and excluded data"):
                    division(page, run)
            if len(state.runs) == 1:
                card(page)
        with ui.element("div").classes("stack"):
            if len(state.runs) > 1:
                card(page)
            if run.dwells is not None:
                with widgets.card(f"Dwells of {run.name}"):
                    dwells(run.dwells)
            else:
                time_line(page, run)
            box = ui.expansion("Columns, units and sidecar", icon="table_chart").classes("sheet")
            widgets.later(box, lambda: form(page, rig=run.dwells is not None))  # it reads the file
    widgets.copies(page)


def time_line(page: Page, run: Run) -> None:
    """The recording over time, and its check."""
    several = len(page.bench.state.runs) > 1
    with widgets.card(f"The recording {run.name}" if several else "The recording"):
        ui.label("Drag across the plot to select a stretch to hold out or exclude.").classes("note")
        key = ("data", id(run.recording), run.held_out, run.excluded)
        page.pictures(
            key,
            lambda theme: [widgets.data(run, theme)],
            prepare=lambda plot, redraw: brushing(page, plot),
            height=420,
        )
    with widgets.card("Data check"):
        check(page, run)


def dwells(result: Dwells) -> None:
    """Every dwell of a table."""
    rows = [
        [f"{number(math.degrees(angle), 6)}°", amount(mean, std / math.sqrt(samples), "m/s²"), f"{number(long, 4)} s"]
        for angle, mean, std, samples, long in zip(
            result.angle, result.mean, result.std, result.samples, result.duration, strict=True
        )
    ]
    widgets.table(["attitude", "mean output", "duration"], rows, "Dwells")
    widgets.lines(result.assumptions)


def check(page: Page, run: Run) -> None:
    """Faults with a button that excludes what they spoil, warnings and notes; channels of the recording."""
    summary = run.summary
    widgets.lines(summary.get("suspect", ()), "problem")
    faults = [] if run.marks is None else [(widgets.remark_text(r), spoilt(r, run)) for r in run.marks.remarks]
    for text, stretch in faults:
        with ui.row().classes("line"):
            ui.label(text).classes("warning grow")
            if stretch is not None:
                span = " to ".join(f"{instant(at)} s" for at in stretch)
                widgets.button(f"Exclude {span}", "content_cut", partial(page.act, page.bench.exclude, *stretch))
    for severity in ("warning", "note"):
        widgets.lines([f["text"] for f in summary["findings"] if f["severity"] == severity], severity)
    rows = [
        [
            name,
            f"{c['samples']:,}".replace(",", " "),
            f"{c['rate_hz']:.6g} Hz" if c["rate_hz"] else "",
            f"{number(c['start_s'], 6)} s to {number(c['end_s'], 6)} s",
            f"{number(c['min'])} to {number(c['max'])} {c['unit'].replace('^2', '²')}",
        ]
        for name, c in summary["channels"].items()
    ]
    widgets.table(["channel", "samples", "rate", "span", "range"], rows, "Channels")


AT_THE_EDGE = 0.1
"""Share of a record at either end within which a jump of the position stands for a start before homing."""


def spoilt(fault: Remark, run: Run) -> Stretch | None:
    """The stretch that a fault spoils where it is one; of a jump of the position near an end what lies beyond it."""
    assert run.recording is not None
    begin, end = time_span(run.recording)
    at, last = (fault.values.get(name) for name in ("time", "end"))
    if not isinstance(at, float):
        return None
    if isinstance(last, float) and fault.values.get("stretches", 1) == 1:
        return max(begin, at - MILLISECOND), min(end, last + MILLISECOND)
    if fault.code == "position_step" and fault.values.get("count") == 1:
        share = (at - begin) / (end - begin)
        return (begin, at) if share < AT_THE_EDGE else (at, end) if share > 1.0 - AT_THE_EDGE else None
    return None


def rig(page: Page, run: Run) -> None:
    """What is not declared of sensor and rig, and fields that declare it."""
    assumed = run.summary["assumptions"]
    if run.lender:
        ui.label(f"Columns, sensor and rig as declared for {run.lender}.").classes("note")
    count = f"{len(assumed)} assumption{'s' if len(assumed) > 1 else ''}" if assumed else "All is declared"
    with ui.expansion(count, icon="tune").classes("full"):
        widgets.lines(assumed)
        declarations(page, run)


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
    files, end = page.brushed or (None, None)
    with ui.row().classes("line"):
        first = ui.number("From, s", value=files, format="%.6g").props("dense outlined").classes("time")
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
        ui.label(
            "Changing what is fitted discards the models, which must be fitted again; Undo restores them."
        ).classes("note")


def fitting(page: Page) -> None:
    """Fit the base model."""
    bench, state = page.bench, page.bench.state
    if state.step is None:
        ui.label(
            f"Estimates bias, scale factor and time offset{what_is_fitted(state)}, then searches for missing effects."
        )
    else:
        ui.label(f"Current model: {' '.join(step.change.label for step in state.path)}.")
    with ui.row().classes("line"):
        widgets.button(
            "Fit" if state.step is None else "Refit",
            "play_arrow",
            lambda: page.improve(bench.fit, "linear"),
            primary=state.step is None,
            label="Fit the linear model",
        )
        widgets.button("Fit with K2, K3", "add_chart", lambda: page.improve(bench.fit, "cubic"), flat=True)


def what_is_fitted(state: State) -> str:
    """Words for the recordings that are fitted; empty for a single one."""
    fitted = [run for run in state.runs if run.role == "fit" and run.source is not None]
    count = sum(run.recording is not None for run in fitted)
    motions = "one recording" if count == 1 else f"{count} recordings"
    at_rest = len(fitted) > count
    return f" from {motions}{' and dwells' if at_rest else ''}" if len(fitted) > 1 else ""
