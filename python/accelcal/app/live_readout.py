"""What is known of a running measurement, in words and numbers that change in place."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from nicegui import ui

from accelcal.app import widgets
from accelcal.app.follower import Follower
from accelcal.effects import spelled
from accelcal.live.monitor import Interval
from accelcal.live.session import LiveEvent
from accelcal.live.tracker import Innovation
from accelcal.model import Estimate
from accelcal.results.words import number

COUNTS = {
    "used": "lines",
    "broken": "broken",
    "out_of_order": "out of order",
    "missing": "missing",
}
"""Counts of lines by their key, as they are named on the page."""
MORE = {
    "dropped_bytes": "bytes dropped",
    "untested": "readings not tested",
    "refused": "refused by the filter",
    "recorded": "rows recorded",
}
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
            self.counts = {key: self._count(name) for key, name in (COUNTS | MORE).items()}
            ui.label(f"Recording: {asked.recording}").classes("note")
        self._alarms_seen: tuple[Any, ...] = ()

    def update(self) -> None:
        """Show the newest state; the lock of the follower is held."""
        history = self.follower.history
        newest = history.newest
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
        sentence = state.regressor_bias.sentence if state.regressor_bias else ""
        self.bias.set_text(sentence)
        self.bias.set_visibility(bool(sentence))
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
        if not self._values:
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

        rows = [cells(p.name, p.unit) for p in parameters]
        widgets.table(["parameter", "estimate", "± 2 σ", "unit"], rows, "Parameters")

    def _count(self, name: str) -> ui.label:
        with ui.row().classes("line spread"):
            ui.label(name)
            return ui.label("0").classes("strong").props(f'data-count="{name}"')

    def _show_alarms(self) -> None:
        newest = list(self.follower.history.alarms)[-SHOWN_ALARMS:]
        seen = tuple(alarm.t for alarm in newest)
        if seen == self._alarms_seen:
            return
        self._alarms_seen = seen
        self.alarms.clear()
        with self.alarms:
            for alarm in reversed(newest):
                ui.label(f"Alarm: {alarm.sentence}").classes("warning")


def nis_text(nis: Interval | None) -> str:
    """The running NIS with its interval."""
    if nis is None:
        return "NIS: no innovation yet"
    return f"NIS {nis.value:.3f}; 99 % in {nis.low:.3f} to {nis.high:.3f} ({nis.readings} readings)"


def innovation_text(innovation: Innovation | None) -> str:
    """The newest innovation with what is expected."""
    if innovation is None or not math.isfinite(innovation.e):
        return "Innovation: none yet"
    e, std = 1e6 * innovation.e, 2e6 * math.sqrt(innovation.variance)
    return f"Innovation {number(e, 3)} µm, expected ± {number(std, 3)} µm"
