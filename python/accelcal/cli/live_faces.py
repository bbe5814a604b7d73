"""How a live view shows itself: a screen in a terminal, lines elsewhere, JSON lines for programs."""

from __future__ import annotations

import math
import time
from collections import deque
from types import TracebackType
from typing import TYPE_CHECKING, Self

from accelcal._support.errors import visible
from accelcal.cli.common import print_json, print_status, say_line
from accelcal.live.session import LiveEvent, LiveState
from accelcal.live.tracker import Alarm
from accelcal.model import Estimate
from accelcal.results.json import content
from accelcal.results.words import number, with_unit

if TYPE_CHECKING:
    from rich.console import Group

REFRESH = 0.25
"""Time between two pictures of the screen, s."""
MOST_ALARMS = 3
"""Alarms on the screen."""


class Lines:
    """A line from time to time; alarms on stderr."""

    def __init__(self, source: str, every: float) -> None:
        self.source, self.every = source, every
        self._next = time.monotonic() + every

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Nothing is left to do."""

    @property
    def due(self) -> bool:
        """Whether it is time to show something; asked often."""
        now = time.monotonic()
        if now < self._next:
            return False
        self._next = max(self._next + self.every, now)
        return True

    def show(self, state: LiveState) -> None:
        """One line of what is known."""
        say_line(line_of(state), flush=True)

    def alarm(self, alarm: Alarm, state: LiveState) -> None:
        """Say that the model no longer holds, once for blocks in a row."""
        if alarm.t == alarm.since:
            print_status(f"alarm: {alarm.sentence}")

    def end(self, state: LiveState, ended: str) -> None:
        """Say what came of it all."""
        for text in summary_of(state, self.source, ended):
            say_line(text, flush=True)


class JsonLines(Lines):
    """JSON, one object a line."""

    def _print(self, event: LiveEvent) -> None:
        print_json(content(event), indent=None)

    def show(self, state: LiveState) -> None:
        """One object of what is known."""
        self._print(LiveEvent("state", self.source, state))

    def alarm(self, alarm: Alarm, state: LiveState) -> None:
        """One object of the alarm."""
        self._print(LiveEvent("alarm", self.source, state, alarm))

    def end(self, state: LiveState, ended: str) -> None:
        """The last object."""
        self._print(LiveEvent("end", self.source, state, ended=ended))


class Screen(Lines):
    """A table that is drawn anew several times a second."""

    def __init__(self, source: str) -> None:
        from rich.live import Live

        super().__init__(source, REFRESH)
        self._live = Live(auto_refresh=False)
        self._alarms: deque[Alarm] = deque(maxlen=MOST_ALARMS)

    def __enter__(self) -> Self:
        self._live.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._live.__exit__(kind, error, trace)

    def show(self, state: LiveState) -> None:
        """Draw what is known."""
        self._live.update(picture(state, self.source, list(self._alarms)), refresh=True)

    def alarm(self, alarm: Alarm, state: LiveState) -> None:
        """Keep it for the next picture."""
        self._alarms.append(alarm)

    def end(self, state: LiveState, ended: str) -> None:
        """Leave the last picture, and say why it is the last."""
        self.show(state)
        self._live.stop()
        say_line(f"{self.source}: {ended}")


def picture(state: LiveState, source: str, alarms: list[Alarm]) -> Group:
    """Parameters, innovations and counts, for a terminal."""
    from rich.console import Group
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False)
    for head in ("parameter", "estimate", "± 2 sigma", "unit"):
        table.add_column(head, justify="left" if head in ("parameter", "unit") else "right")
    for e in state.estimates:
        table.add_row(e.name, number(e.value, 6), number(2.0 * e.std, 2), e.unit)
    held = {None: ("waiting for innovations", ""), True: ("the model holds", "green"), False: ("ALARM", "bold red")}
    word, style = held[state.holds]
    title = f"{source}, t = {'-' if state.t is None else f'{state.t:.3f} s'}"
    return Group(
        Text(visible(title, one_line=True), style="bold"),
        table,
        *(Text(text, style="yellow") for text in bias_of(state)),
        Text(innovation_of(state)),
        Text.assemble((word, style), f" ({state.alarms} of {state.blocks} blocks alarmed)"),
        Text(counts_of(state)),
        *(Text(alarm.sentence, style="red") for alarm in alarms),
    )


def line_of(state: LiveState) -> str:
    """What is known, in one line."""
    parameters = ", ".join(map(with_band, state.estimates))
    when = "no row yet" if state.t is None else f"t = {state.t:.3f} s"
    return f"{when}: {parameters}; {innovation_of(state)}; {counts_of(state)}"


def bias_of(state: LiveState) -> list[str]:
    """The sentence on a scale factor that noise of the output biases by more than it is uncertain; empty else."""
    bias = state.regressor_bias
    return [] if bias is None or not bias.sentence else [bias.sentence]


def with_band(e: Estimate) -> str:
    """A parameter with two standard deviations."""
    return f"{e.name} {with_unit(f'{number(e.value, 6)} ± {number(2.0 * e.std, 2)}', e.unit)}"


def innovation_of(state: LiveState) -> str:
    """The newest innovation and the running NIS."""
    if state.innovation is None or state.nis is None:
        return "no innovation yet"
    e, nis = state.innovation, state.nis
    std = math.sqrt(e.variance)
    return (
        f"innovation {number(1e6 * e.e, 3)} µm, expected ± {number(2e6 * std, 3)}; NIS {nis.value:.3f}, 99 % in "
        f"{nis.low:.3f} .. {nis.high:.3f} ({nis.readings} readings)"
    )


def counts_of(state: LiveState) -> str:
    """What became of the lines."""
    counts = {
        "broken": state.broken,
        "out of order": state.out_of_order,
        "missing": state.missing,
        "bytes dropped": state.dropped_bytes,
    }
    more = {"not tested": state.untested, "refused by the filter": state.refused, "recorded": state.recorded}
    listed = [f"{count} {name}" for name, count in counts.items()]
    return ", ".join([f"{state.used} lines", *listed, *(f"{count} {name}" for name, count in more.items() if count)])


def summary_of(state: LiveState, source: str, ended: str) -> list[str]:
    """What came of a live view."""
    judged = (
        "too few readings to say whether the model holds"
        if state.holds is None
        else f"{state.alarms} of {state.blocks} blocks of innovations raised an alarm"
    )
    lines = [f"{source}: {ended}", line_of(state), *bias_of(state), judged]
    return [*lines, f"the filter refused {state.refused} events: {state.refusal}"] if state.refused else lines
