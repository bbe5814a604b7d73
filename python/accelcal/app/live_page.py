"""The page of a running measurement: what to follow, then what is known of it, several times a second."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui import background_tasks, ui

from accelcal._support import internal_error
from accelcal.app import background, figures, look, widgets
from accelcal.app.follower import Follower, Followers
from accelcal.app.live_form import Form
from accelcal.app.live_readout import Readout
from accelcal.app.workbench import Workbench

TICK = 0.5
"""Time between two pictures, s."""
ABOUT = (
    "Follow a measurement while it runs: what the parameters are now and how sure that is, how far each position "
    "reading lies from what the model expects, and an alarm as soon as the model no longer holds."
)


class LivePage(look.Frame):
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
        ui.on_exception(lambda error: self.bench.refuse(internal_error.sentence(error)))
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
        asked = await background.act(self.form.asked)
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
            background_tasks.create(background.act(loading, self.follower.asked.recording))
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
        picture = self.sized(figures.live(history, self.themes.theme))
        if self._plot is not None:
            self._plot.update_figure(picture.figure)
            return
        with self._box, ui.element("figure"):
            with ui.element("figcaption"):
                ui.label(picture.headline).classes("headline")
            self._plot = ui.plotly(picture.figure).classes("plot")
