"""What a running measurement is followed with: source, recording, sidecar and model, as fields of the page."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from nicegui import ui

from accelcal import io
from accelcal.app import mapping, widgets
from accelcal.app.follower import KINDS, Asked, Kind, recording_path
from accelcal.app.screens import uploads
from accelcal.app.workbench import Workbench

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
            baud = ui.number("Baud", format="%d").props("dense outlined").classes("time").bind_value(self, "baud")
            baud.bind_visibility_from(choice, "value", value="serial port")
        follow = ui.checkbox("Wait for further lines at its end").bind_value(self, "follow")
        follow.bind_visibility_from(choice, "value", value="file")
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
        uploads.area(
            self.bench, "Drop the sidecar (.toml) and, if there is one, a model (.json)", self._take, "declared"
        )
        sheet = ui.textarea("Sidecar (TOML)").props("outlined autogrow").classes("code full")
        sheet.bind_value(self, "sidecar")
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
        baud = int(self.baud or BAUD)
        return Asked(self.kind, self.address.strip(), rig, recording, self.model, baud, bool(self.follow))

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
