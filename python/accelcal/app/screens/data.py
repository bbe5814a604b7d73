"""The data: drop a recording, map its columns, read the check, divide it, fit."""

from __future__ import annotations

from typing import Any

from nicegui import ui

from accelcal.app import figures, mapping, widgets
from accelcal.app.page import Page
from accelcal.app.workbench import MOST_BYTES, Refused
from accelcal.data import summary
from accelcal.data.recording import RecordingError
from accelcal.formatting import number


def show(page: Page) -> None:
    """Build the screen."""
    state, arriving = page.bench.state, page.bench.arriving
    if arriving is not None:
        with widgets.card(arriving.name):
            ui.label("Breaks and faults are being looked for …").classes("note")
            page.pictures(
                ("arriving", id(arriving), arriving.digest),
                lambda theme: [figures.arriving(arriving, theme)],
                height=420,
            )
        return
    if state.file is None:
        with widgets.card("Drop a recording", "welcome"):
            ui.label(
                "CSV, Parquet, MAT, npz or HDF5 with the accelerometer's output and the encoder's position; drop its "
                "sidecar (.toml) along with it if there is one. Nothing leaves this machine."
            )
            drop(page, "Drop a recording here, or press + to choose")
            widgets.button("Try a simulated recording", "science", lambda: page.act(page.bench.example), flat=True)
        return
    if state.recording is None:
        with widgets.card(f"{state.file.name} is not understood yet"):
            ui.label(state.trouble).classes("trouble").props("role=alert")
            columns(page)
        with widgets.card("Another recording"):
            drop(page, "Drop another recording here")
        return
    with ui.element("div").classes("two"):
        with ui.element("div").classes("stack"):
            with widgets.card("Fit"):
                fitting(page)
            with widgets.card("Held out and left out"):
                division(page)
            with widgets.card("Recordings"):
                drop(page, "Drop another recording here")
                ui.label("Hold out a whole recording instead of a part of this one:").classes("note")
                drop(page, "Drop a held-out recording here", other=True)
        with ui.element("div").classes("stack"):
            with widgets.card("The recording"):
                ui.label("Drag over the picture to choose a stretch to hold out or to leave out.").classes("note")
                key = ("data", id(state.recording), state.held_out, state.left_out)
                page.pictures(
                    key,
                    lambda theme: [figures.data(state, theme)],
                    prepare=lambda plot, redraw: brushing(page, plot),
                    height=420,
                )
            with widgets.card("Data check"):
                check(page)
            later(ui.expansion("Columns, units, sensor and rig", icon="table_chart").classes("sheet"), page)
    widgets.copies(page)


def drop(page: Page, label: str, *, other: bool = False) -> None:
    """A place to drop files on; a recording and its sidecar may come together."""

    async def take(event: Any) -> None:
        bench = page.bench
        drawer = bench.drawer()
        kept = []
        for file in event.files:
            try:
                if file.size() > MOST_BYTES:
                    raise Refused(
                        f"{file.name}: {file.size() / 1e6:.0f} MB; the workbench takes {MOST_BYTES / 1e6:.0f} MB"
                    )
                path = bench.accept(file.name, drawer)
            except Refused as error:
                bench.refuse(str(error))
                continue
            await file.save(path)
            kept.append(path)
        sidecars = [p for p in kept if p.suffix.lower() == ".toml"]
        recordings = [p for p in kept if p not in sidecars]
        if recordings:
            for path in sidecars[:1]:
                path.rename(recordings[0].with_suffix(".toml"))
            await page.act(bench.load_other if other else bench.load, recordings[0])
        elif sidecars and bench.state.file is not None:
            text = sidecars[0].read_text(encoding="utf-8", errors="replace")
            await page.act(bench.load, bench.state.file, text)
        elif sidecars:
            bench.refuse(f"{sidecars[0].name}: drop the recording that it belongs to along with it")

    def rejected() -> None:
        page.bench.refuse(f"the file is larger than {MOST_BYTES / 1e6:.0f} MB, which is what the workbench takes")

    made = ui.upload(
        label=label,
        multiple=True,
        auto_upload=True,
        max_file_size=MOST_BYTES,
        on_multi_upload=take,
        on_rejected=rejected,
    )
    made.props("flat bordered hide-upload-btn").classes("drop")
    made.mark("other" if other else "recording")


def check(page: Page) -> None:
    """What was understood, warnings first."""
    state = page.bench.state
    assert state.recording is not None
    seen = summary.describe(state.recording)
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
    widgets.table(["channel", "samples", "rate", "from, to", "least, largest"], rows, "Channels")
    if state.marks is not None:
        widgets.lines([f"Suspect data: {fault.sentence}" for fault in state.marks.faults], "warning")
    for severity, kind in (("warning", "warning"), ("note", "note")):
        widgets.lines([f["text"] for f in seen["findings"] if f["severity"] == severity], kind)
    if seen["assumptions"]:
        count = len(seen["assumptions"])
        with ui.expansion(f"{count} thing{'s are' if count > 1 else ' is'} assumed", icon="help_outline").classes(
            "full"
        ):
            widgets.lines(seen["assumptions"])


def later(box: ui.expansion, page: Page) -> None:
    """Fill the table of columns in when it is opened first: the file is looked into for it."""

    def opened(event: Any) -> None:
        if event.value and not box.default_slot.children:
            with box:
                columns(page)

    box.on_value_change(opened)


def columns(page: Page) -> None:
    """Which column is which channel, and everything else that the sidecar says."""
    bench, state = page.bench, page.bench.state
    assert state.file is not None
    try:
        text = mapping.text_of(state.file, state.sidecar)
        found = mapping.choices(state.file, text)
    except RecordingError as error:
        ui.label(bench.plain(str(error))).classes("trouble")
        return
    roles, names, units = [], [], []
    rows: list[list[widgets.Cell]] = []
    for one in found:
        known = one.channel if one.channel in (*mapping.ESSENTIAL, mapping.NOT_USED) else "other"

        def role(one: mapping.Choice = one, known: str = known) -> None:
            made = ui.select([*mapping.ESSENTIAL, "other", mapping.NOT_USED], value=known)
            roles.append(made.props(f'dense outlined aria-label="Role of {widgets.attribute(one.column)}"'))

        def name(one: mapping.Choice = one, known: str = known) -> None:
            made = ui.input(value=one.channel if known == "other" else one.column)
            names.append(made.props(f'dense outlined aria-label="Name of {widgets.attribute(one.column)}"'))

        def unit(one: mapping.Choice = one) -> None:
            made = ui.input(value=one.unit, placeholder="unit")
            units.append(made.props(f'dense outlined aria-label="Unit of {widgets.attribute(one.column)}"'))

        rows.append([one.column, role, name, unit])
    widgets.table(["column", "is", "named (if other)", "unit"], rows, "Columns")
    sheet = ui.textarea("Sidecar: sensor, rig and columns", value=text).props("outlined autogrow").classes("code full")

    async def use_columns() -> None:
        chosen = [
            mapping.Choice(
                one.column,
                str(names[i].value if roles[i].value == "other" else roles[i].value),
                str(units[i].value).strip(),
            )
            for i, one in enumerate(found)
        ]
        try:
            made = mapping.sidecar_from(str(sheet.value), chosen)
        except RecordingError as error:
            bench.refuse(str(error))
            return
        await page.act(bench.load, state.file, made)

    with ui.row():
        widgets.button("Use these columns", "check", use_columns, primary=state.recording is None)
        widgets.button(
            "Use the sidecar as written", "description", lambda: page.act(bench.load, state.file, str(sheet.value))
        )


def brushing(page: Page, plot: ui.plotly) -> None:
    """A stretch that is dragged over lands in the two fields."""

    def selected(event: Any) -> None:
        span = next((v for k, v in ((event.args or {}).get("range") or {}).items() if k.startswith("x")), None)
        if span:
            page.brushed = (round(min(span), 4), round(max(span), 4))
            for field, value in zip(page.fields, page.brushed, strict=False):
                field.set_value(value)

    plot.on("plotly_selected", selected, ["range"])


def division(page: Page) -> None:
    """Choose what no fit sees, and what is not used at all."""
    bench, state = page.bench, page.bench.state
    low, high = state.used
    if state.other is not None:
        ui.label(f"Held out: the recording {state.other.name}.")
    elif state.held_out is not None:
        a, b = state.held_out
        ui.label(f"Held out: {a:.6g} s to {b:.6g} s. No fit sees it; the error is judged on it.")
    if state.breaks:
        ui.label(f"Used: {low:.6g} s to {high:.6g} s, up to the break.").classes("warning")
    for i, (a, b) in enumerate(state.left_out):
        with ui.row().classes("line"):
            ui.label(f"Left out: {a:.6g} s to {b:.6g} s")
            widgets.button(
                "Use again",
                "undo",
                lambda i=i: page.act(bench.take_back, i),
                flat=True,
                label=f"Use {a:.6g} s to {b:.6g} s again",
            )
    start, end = page.brushed or (None, None)
    with ui.row().classes("line"):
        first = ui.number("From, s", value=start, format="%.6g").props("dense outlined").classes("time")
        last = ui.number("To, s", value=end, format="%.6g").props("dense outlined").classes("time")
    page.fields = (first, last)

    async def mark(action: Any) -> None:
        if first.value is None or last.value is None:
            bench.refuse("choose a stretch first: drag over the picture, or fill in from and to")
            return
        page.brushed = None
        await page.act(action, float(first.value), float(last.value))

    with ui.row().classes("line"):
        widgets.button("Hold out", "visibility_off", lambda: mark(bench.hold_out), label="Hold this stretch out")
        widgets.button("Leave out", "content_cut", lambda: mark(bench.leave_out), label="Leave this stretch out")
    if state.steps:
        ui.label("Another division needs another fit: models begin anew; Undo brings them back.").classes("note")


def fitting(page: Page) -> None:
    """Fit the base model."""
    bench, state = page.bench, page.bench.state
    if state.step is None:
        ui.label("Bias, scale factor and time offset are estimated first; then the page asks what is missing.")
    else:
        ui.label(f"The model that is looked at: {' '.join(s.label for s in state.path)}.")
    with ui.row().classes("line"):
        widgets.button(
            "Fit" if state.step is None else "Fit again",
            "play_arrow",
            lambda: page.improve(bench.fit, "linear"),
            primary=state.step is None,
            label="Fit the linear model",
        )
        widgets.button("Fit with K2, K3", "add_chart", lambda: page.improve(bench.fit, "cubic"), flat=True)
