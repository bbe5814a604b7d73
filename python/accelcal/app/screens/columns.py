"""Assignment of columns: what each column is, what the sensor is, and the rest of the sidecar."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from nicegui import ui

from accelcal.app import mapping, widgets
from accelcal.app.page import Page
from accelcal.data.recording import RecordingError
from accelcal.io.sidecar import KEYS

NAMED = (*mapping.ESSENTIAL, *mapping.ORIENTATION, mapping.NOT_USED)
CHOICES = [*mapping.ESSENTIAL, "other", mapping.NOT_USED, *mapping.ORIENTATION]
SENSOR = ("scale", "zero", "noise", "range")
"""Keys of the sidecar that have a field in the form."""


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
            beginning = ui.label("\n".join(lines)).classes("beginning")
            beginning.props('tabindex=0 role=group aria-label="First lines of the file"')
        form(page)


@dataclass(slots=True)
class Fields:
    """The widgets of the form; each list has an entry for each column."""

    found: Sequence[mapping.Choice]
    roles: list[ui.select] = field(default_factory=list)
    names: list[ui.input] = field(default_factory=list)
    units: list[ui.input] = field(default_factory=list)

    @property
    def chosen(self) -> list[mapping.Choice]:
        """What the user has chosen for each column."""
        fields = zip(self.found, self.roles, self.names, self.units, strict=True)
        return [
            mapping.Choice(
                one.column, str(name.value if role.value == "other" else role.value), str(unit.value).strip()
            )
            for one, role, name, unit in fields
        ]

    def row(self, one: mapping.Choice) -> list[widgets.Cell]:
        """A line of the table of columns."""
        known = one.channel if one.channel in NAMED else "other"
        column = widgets.attribute(one.column)

        def role() -> None:
            made = ui.select(CHOICES, value=known)
            self.roles.append(made.props(f'dense outlined aria-label="Role of {column}"'))

        def name() -> None:
            made = ui.input(value=one.channel if known == "other" else one.column)
            made.bind_visibility_from(self.roles[-1], "value", value="other")
            self.names.append(made.props(f'dense outlined aria-label="Name of {column}"'))

        def unit() -> None:
            made = ui.input(value=one.unit, placeholder="unit")
            self.units.append(made.props(f'dense outlined aria-label="Unit of {column}"').classes("unit"))

        return [one.column, role, unit, name]


def form(page: Page) -> None:
    """Fields for columns, sensor and orientation, and the sidecar as text."""
    bench, run = page.bench, page.bench.state.run
    assert run is not None
    text = mapping.text_of(run.file, run.sidecar, run.template)
    fields = Fields(mapping.choices(run.columns, text, run.template))
    titles = ["column", "role", "unit", "channel name"]
    widgets.table(titles, [fields.row(one) for one in fields.found], "Columns")
    widgets.heading("Sensor", 3)
    ui.label("An output in volts or counts needs its scale. The rest may stay empty.").classes("note")
    declared = mapping.sensor_in(text)
    sensor = {}
    with ui.row().classes("line"):
        for key in SENSOR:
            label, example = KEYS["sensor"][key].label, KEYS["sensor"][key].example.strip('"')
            made = ui.input(label, value=declared.get(key, ""), placeholder=example).props("dense outlined")
            sensor[key] = made.classes("short")
    with ui.expansion("The body can turn", icon="360").classes("full"):
        direction, sense = turning()
    with ui.expansion("Everything else: the sidecar", icon="description").classes("full"):
        sheet = ui.textarea("Sidecar (TOML)", value=text).props("outlined autogrow").classes("code full")
        widgets.button("Use the sidecar as written", "description", lambda: page.act(bench.declare, str(sheet.value)))

    async def use_columns() -> None:
        try:
            axis = str(direction.value or ""), str(sense.value or "")
            entered = {key: str(one.value or "").strip() for key, one in sensor.items()}
            made = mapping.sidecar_from(str(sheet.value), fields.chosen, *axis, entered)
        except RecordingError as error:
            bench.refuse(str(error))
            return
        await page.act(bench.declare, made)

    with ui.row():
        widgets.button("Use this assignment", "check", use_columns, primary=bool(run.problem))


def turning() -> tuple[ui.input, ui.select]:
    """Fields for a body that turns: the input axis, and what a quaternion maps."""
    ui.label(
        "Then gravity along the axis changes: map what that axis would read at rest (gravity_along_axis), a gyroscope "
        "(gyr_x, gyr_y, gyr_z), or place and attitude (position_e, position_n, position_u, no position, and q_w to "
        "q_z), and say which axis of them the sensor measures."
    ).classes("note")
    with ui.row().classes("line"):
        direction = ui.input("Input axis of a body that turns", placeholder="x, y, z or 0, 0.6, 0.8")
        direction.props("dense outlined")
        sense = ui.select(["", "sensor to ENU", "ENU to sensor"], value="", label="The quaternion maps")
        sense.props('dense outlined aria-label="The quaternion maps"').classes("short")
    return direction, sense
