"""The page of a running measurement: a form of what to follow, then what is known of it, several times a second."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from nicegui import background_tasks, ui

from accelcal import io
from accelcal._support import errors
from accelcal.app import mapping, widgets, workers
from accelcal.app.screens import files
from accelcal.app.sessions import KINDS, Asked, Follower, Followers, Kind, recording_path
from accelcal.app.workbench import Workbench
from accelcal.effects import spelled
from accelcal.live.session import LiveEvent
from accelcal.live.tracker import Innovation, Interval
from accelcal.model import Estimate
from accelcal.plots.timeline import live_tracks
from accelcal.results.words import number

PLACES = {
    "TCP server": ("Host and port", "192.168.1.7:5025"),
    "serial port": ("Device", "/dev/ttyUSB0"),
    "file": ("Path of the file", "/home/me/today.csv"),
}
"""Label and example of the address, by the kind of source."""
SIDECAR = """[sensor]
noise = "250 ug/sqrt(Hz)"
[channels]
time = { column = "t", unit = "s" }
accel = { column = "accel", unit = "m/s^2" }
position = { column = "position", unit = "mm", resolution = "1 um" }
"""
"""What a sidecar must say where no model tells the noise; to be changed."""
BAUD = 115_200
MOST_BYTES = 16_000_000
"""Largest sidecar or model that is dropped."""


class Form:
    """The fields, with what was entered before.

    Parameters
    ----------
    bench : of the session; it keeps the files and tells what is refused.
    """

    def __init__(self, bench: Workbench) -> None:
        self.bench = bench
        self.folder = Path.cwd()
        """Where recordings go: where the server was started."""
        self.kind: Kind = KINDS[0]
        self.address, self.baud, self.follow = "", BAUD, True
        self.sidecar = SIDECAR
        self.model: Path | None = None

    def source(self) -> None:
        """Kind and address of the source."""
        choice = ui.toggle({kind: kind for kind in KINDS}, value=self.kind).props('no-caps aria-label="Source"')
        choice.bind_value(self, "kind")
        with ui.row().classes("line full"):
            for kind, (label, example) in PLACES.items():
                field = ui.input(label, placeholder=example).props("dense outlined").classes("grow")
                field.bind_value(self, "address").bind_visibility_from(choice, "value", value=kind)
            ui.number("Baud", format="%d").props("dense outlined").classes("time").bind_value(
                self, "baud"
            ).bind_visibility_from(choice, "value", value="serial port")
        ui.checkbox("Wait for further lines at its end").bind_value(self, "follow").bind_visibility_from(
            choice, "value", value="file"
        )
        ui.label(
            "One line for each instant, t,accel,position; an empty field was not sampled. A header is optional."
        ).classes("note")

    def recording(self) -> None:
        """Name of the recording, and where it goes."""
        self.name = time.strftime("live-%Y%m%d-%H%M%S")
        ui.input("Name of the recording").props("dense outlined suffix=.parquet").classes("full").bind_value(
            self, "name"
        )
        ui.label(f"Written while it runs, with its sidecar, to {self.folder}.").classes("note")

    def declared(self) -> None:
        """Sidecar and model."""
        files.area(self.bench, "Drop the sidecar (.toml) and, if there is one, a model (.json)", self._take, "declared")
        ui.textarea("Sidecar (TOML)").props("outlined autogrow").classes("code full").bind_value(self, "sidecar")
        ui.label(
            "Without a model, bias and scale factor are estimated from nothing, and the sidecar must declare the noise "
            "of the sensor and the resolution of the position. A model brings parameters, uncertainty and both noises."
        ).classes("note")
        with ui.row().classes("line") as chosen:
            ui.label().bind_text_from(self, "model", lambda path: f"Model: {path.name}" if path else "")
            widgets.button("Remove the model", "close", self._without_model, flat=True)
        chosen.bind_visibility_from(self, "model")
        if self.bench.state.step is not None:
            widgets.button("Use the model of the workbench", "tune", self._with_current, flat=True)

    def asked(self) -> Asked | None:
        """What was entered, its sidecar written; None where something is missing, which is then told."""
        if not self.address.strip():
            self.bench.refuse(f"the field {PLACES[self.kind][0]!r} is empty; enter where the lines come from")
            return None
        recording = recording_path(self.folder, self.name, self.bench.folder)
        there = next((p for p in (recording, io.sidecar_of(recording)) if p.exists()), None)
        if there is not None:
            self.bench.refuse(
                f"{there}: there is such a file already, and a measurement replaces none; give another name"
            )
            return None
        rig = self.bench.upload_folder() / "rig.toml"
        io.atomic_write(rig, self.sidecar)
        return Asked(
            self.kind, self.address.strip(), rig, recording, self.model, int(self.baud or BAUD), bool(self.follow)
        )

    async def _take(self, event: Any) -> None:
        folder = self.bench.upload_folder()
        for file in event.files:
            ending = Path(file.name).suffix.lower()
            if ending not in (".toml", ".json") or file.size() > MOST_BYTES:
                self.bench.refuse(f"{file.name[-40:]!r}: drop a sidecar (.toml) or a model (.json)")
                continue
            path = folder / f"given{ending}"
            await file.save(path)
            if ending == ".toml":
                self.sidecar = mapping.text_in(path)
            else:
                self.model = path

    def _with_current(self) -> None:
        path = self.bench.upload_folder() / "current.json"
        io.atomic_write(path, self.bench.model_text())
        self.model = path

    def _without_model(self) -> None:
        self.model = None


COUNTS = {
    "used": "lines",
    "broken": "broken",
    "out_of_order": "out of order",
    "missing": "missing",
    "dropped_bytes": "bytes dropped",
    "refused": "refused by the filter",
    "recorded": "rows recorded",
}
"""Counts by their key, as they are named on the page."""
BADGES = {
    None: ("Waiting for innovations", ""),
    True: ("The model holds", "good"),
    False: ("The model does not hold", "bad"),
}
SHOWN_ALARMS = 5


class Readout:
    """Cards for state, parameters and counts of one measurement.

    Parameters
    ----------
    follower : of which they tell.
    """

    def __init__(self, follower: Follower) -> None:
        self.follower = follower
        self._values: dict[str, ui.label] = {}
        self._bands: dict[str, ui.label] = {}
        asked = follower.asked
        with widgets.card(asked.address):
            self.badge = ui.label().classes("badge").props("data-live role=status aria-live=polite")
            self.when = ui.label().classes("note")
            self.nis = ui.label().classes("note")
            self.innovation = ui.label().classes("note")
            self.alarms = ui.element("div").classes("stack").props('role=log aria-label="Alarms"')
        with widgets.card("Parameters"):
            self.parameters = ui.element("div").classes("full")
            with self.parameters:
                ui.label("None yet.").classes("note")
            self.bias = ui.label().classes("warning").props("role=status")
        with widgets.card("Lines"):
            self.counts = {key: self._count(name) for key, name in COUNTS.items()}
            ui.label(f"Recording: {asked.recording}").classes("note")
        self._alarms_seen: tuple[Any, ...] = ()

    def update(self) -> None:
        """Show the newest state; the lock of the follower is held."""
        newest = self.follower.history.newest
        text, kind = BADGES[None if newest is None else newest.state.holds]
        self.badge.set_text("Stopped" if self.follower.ended and newest is None else text)
        self.badge.classes(replace=f"badge {kind}")
        if newest is None:
            self.when.set_text("Starting …" if not self.follower.ended else "")
            return
        self.when.set_text(self._when(newest))
        state = newest.state
        self.nis.set_text(nis_text(state.nis))
        self.innovation.set_text(innovation_text(state.innovation))
        self._show_parameters(state.estimates)
        self.bias.set_text(" ".join(state.sentences))
        self.bias.set_visibility(bool(state.sentences))
        for key, label in self.counts.items():
            label.set_text(f"{getattr(state, key):,}".replace(",", " "))
        self._show_alarms()

    def _when(self, newest: LiveEvent) -> str:
        t = newest.state.t
        when = "No row yet" if t is None else f"t = {t:.3f} s"
        blocks = f"{newest.state.alarms} of {newest.state.blocks} blocks of innovations raised an alarm"
        ended = f"; {newest.ended}" if newest.ended else ""
        return f"{when}{ended}; {blocks}."

    def _show_parameters(self, parameters: Sequence[Estimate]) -> None:
        names = [p.name for p in parameters]
        if names != list(self._values):
            self._values.clear()
            self._bands.clear()
            self.parameters.clear()
            with self.parameters:
                self._table(parameters)
        for p in parameters:
            self._values[p.name].set_text(number(p.value, 6))
            self._bands[p.name].set_text(f"± {number(2.0 * p.std, 2)}" if math.isfinite(p.std) else "")

    def _table(self, parameters: Sequence[Estimate]) -> None:
        def cells(name: str, unit: str) -> list[widgets.Cell]:
            def value() -> None:
                self._values[name] = ui.label().props(f'data-parameter="{name}"')

            def band() -> None:
                self._bands[name] = ui.label()

            return [spelled(name), value, band, unit.replace("^2", "²")]

        widgets.table(
            ["parameter", "estimate", "± 2 σ", "unit"], [cells(p.name, p.unit) for p in parameters], "Parameters"
        )

    def _count(self, name: str) -> ui.label:
        with ui.row().classes("line spread"):
            ui.label(name)
            return ui.label("0").classes("strong").props(f'data-count="{name}"')

    def _show_alarms(self) -> None:
        newest = list(self.follower.history.alarms)[-SHOWN_ALARMS:]
        shown_alarms = tuple(alarm.t for alarm in newest)
        if shown_alarms == self._alarms_seen:
            return
        self._alarms_seen = shown_alarms
        self.alarms.clear()
        with self.alarms:
            for alarm in reversed(newest):
                ui.label(f"Alarm: {alarm.sentence}").classes("warning")


def nis_text(nis: Interval | None) -> str:
    """The running NIS with its interval."""
    if nis is None:
        return "NIS: no innovation yet, or a position that stays on one count"
    return f"NIS {nis.value:.3f}; 99 % in {nis.low:.3f} to {nis.high:.3f} ({nis.readings} readings)"


def innovation_text(innovation: Innovation | None) -> str:
    """The newest innovation with what is expected."""
    if innovation is None or not math.isfinite(innovation.e):
        return "Innovation: none yet"
    e, std = 1e6 * innovation.e, 2e6 * math.sqrt(innovation.variance)
    return f"Innovation {number(e, 3)} µm, expected ± {number(std, 3)} µm"


TICK = 0.5
"""Time between two pictures, s."""
ABOUT = (
    "Follow a measurement while it runs: what the parameters are now and how sure that is, how far each position "
    "reading lies from what the model expects, and an alarm as soon as the model no longer holds."
)


class LivePage(widgets.Frame):
    """One browser tab on the running measurement of a session."""

    def __init__(self, bench: Workbench, name: str, followers: Followers) -> None:
        self.bench = bench
        self.name = name
        self.followers = followers
        self.form = Form(bench)
        self._readout: Readout | None = None
        self._plot: ui.plotly | None = None
        self._seen: tuple[Follower | None, int, str] | None = None
        self._shown: tuple[Follower | None, bool] | None = None

    def tools(self) -> None:
        """The way back to the workbench."""
        widgets.button("Workbench", "arrow_back", self._leave, flat=True, label="Back to the workbench")

    async def fill(self) -> None:
        """Show what there is, and follow it from now on."""
        await self.ask_browser()
        client = ui.context.client
        ui.on_exception(lambda error: self.bench.refuse(errors.sentence(error)))
        client.on_delete(lambda: self._closed(client.id))
        if self.follower is not None:
            self.follower.show(client.id)
        self.rebuild()
        ui.timer(TICK, self._tick)

    def rebuild(self) -> None:
        """Draw the page anew: the form, or what is followed."""
        follower = self.follower
        self._shown = (follower, follower is not None and follower.ended)
        self._seen, self._readout, self._plot = None, None, None
        self.body.clear()
        with self.body:
            if follower is None:
                self._ask()
            else:
                self._follow(follower)
        self._tick()

    @property
    def follower(self) -> Follower | None:
        """What this session follows."""
        return self.followers.find(self.name)

    def _ask(self) -> None:
        with ui.element("div").classes("halves"):
            with ui.element("section").classes("sheet"):
                widgets.heading("Live measurement", 1)
                ui.label(ABOUT).classes("note")
                self.form.source()
                self.form.recording()
                with ui.row().classes("line"):
                    widgets.button("Start", "play_arrow", self._start, primary=True)
            with widgets.card("Units, sensor and model"):
                self.form.declared()

    def _follow(self, follower: Follower) -> None:
        widgets.heading(f"Live: {follower.asked.address}", 1).classes("unseen-text")
        with ui.element("div").classes("two"):
            with ui.element("div").classes("stack"):
                with ui.row().classes("line"):
                    if not follower.ended:
                        widgets.button("Stop", "stop", follower.stop, primary=True)
                    else:
                        self._afterwards(follower)
                self._readout = Readout(follower)
            with widgets.card():
                self._box = ui.element("div").classes("pictures").style("min-height: 420px")

    def _afterwards(self, follower: Follower) -> None:
        if follower.has_recording:
            recording = follower.asked.recording
            widgets.button("Open in the workbench", "insert_chart", self._open, primary=True)
            widgets.button(
                "Download recording", "download", lambda: ui.download.file(recording, recording.name), flat=True
            )
        widgets.button("New measurement", "restart_alt", self._again, flat=True)

    def _closed(self, page: str) -> None:
        if self.follower is not None:
            self.follower.forget(page)

    async def _start(self) -> None:
        asked = await workers.act(self.form.asked)
        if asked is not None:
            self.bench.refuse("")
            self.followers.start(self.name, asked).show(ui.context.client.id)
            self.rebuild()

    def _again(self) -> None:
        self.followers.clear(self.name)
        self.rebuild()

    def _leave(self) -> None:
        ui.navigate.to(f"/bench/{self.name}")

    def _open(self) -> None:
        """Load the recording; the workbench shows how far that is."""
        if self.follower is not None:
            loading: Callable[..., Any] = self.bench.load
            background_tasks.create(workers.act(loading, self.follower.asked.recording))
            self._leave()

    def _tick(self) -> None:
        follower = self.follower
        if self._shown != (follower, follower is not None and follower.ended):
            self.rebuild()
            return
        version = 0 if follower is None else follower.version
        sentence = self.bench.sentence or ("" if follower is None else self.bench.plain(follower.sentence))
        if self._seen == (follower, version, sentence):
            return
        self._seen = (follower, version, sentence)
        self.tell(sentence)
        if follower is not None and self._readout is not None:
            with follower.lock:
                self._readout.update()
                self._draw(follower)

    def _draw(self, follower: Follower) -> None:
        """Draw the figure once there is something to see; from then on feed it."""
        history = follower.history
        if not history.parameters:
            return
        picture = self.sized(widgets.picture(live_tracks(history), self.themes.theme))
        if self._plot is not None:
            self._plot.update_figure(picture.figure)
            return
        with self._box, ui.element("figure"):
            with ui.element("figcaption"):
                ui.label(picture.headline).classes("headline")
            self._plot = ui.plotly(picture.figure).classes("plot")
