"""A live view without a face: bytes in, estimates and alarms out, rows to a file; moments of its states over time."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Literal, Self

import numpy as np

from accelcal._support.result import Storable
from accelcal._support.values import amount_of
from accelcal.data import Array
from accelcal.estimation.triad import absent_faces
from accelcal.filters.live_model import Suspicion
from accelcal.filters.stream import Readings
from accelcal.io.dwells import Rest
from accelcal.io.sidecar import Clock, Sidecar, Source, sidecar_of
from accelcal.io.stream import ByteSource, Intake, LineReader, Rows
from accelcal.io.write import GrowingParquet, write_sidecar
from accelcal.live.tracker import (
    SETTLING,
    Alarm,
    Innovation,
    InnovationMonitor,
    Interval,
    LiveSettings,
    ModelTracker,
    Naming,
    NoiseShare,
    Tracker,
)
from accelcal.model import Estimate

GROUP_TIME = 2.0
"""Most time that rows wait for the file, s; more in a long recording, whose table of row groups grows."""
LONGEST_GROUP_TIME = 30.0
GROUP_SHARE = 0.01
"""Time between row groups over the length of the recording, between the two."""
UNITS = {"t": "s", "accel": "m/s^2", "position": "m"}
"""Columns of the recording."""
BEHIND = 1.0
"""Seconds by which the newest line is late from which this is said."""


@dataclass(frozen=True, slots=True)
class LiveState:
    """What a live view knows at one moment."""

    t: float | None = None
    """Stamp of the newest row, s."""
    estimates: tuple[Estimate, ...] = ()
    """Of the parameters that hold: see `noise_share`."""
    noise_share: NoiseShare | None = None
    """Noise of the output over motion; None while nothing is known of the scale factor."""
    innovation: Innovation | None = None
    """The newest."""
    nis: Interval | None = None
    holds: bool | None = None
    """Whether the newest block of innovations is what the model expects; None before the first."""
    blocks: int = 0
    alarms: int = 0
    remark: str = ""
    """Of the newest block, where it has less noise than declared."""
    watched: tuple[Suspicion, ...] = ()
    """What the readings say for each suspect."""
    naming: Naming | None = None
    """Suspects that a watch has named, the newest."""
    outputs: int = 0
    readings: int = 0
    used: int = 0
    broken: int = 0
    out_of_order: int = 0
    missing: int = 0
    restarts: int = 0
    dropped_bytes: int = 0
    behind: float = 0.0
    """Time that the clock of the machine has gained on the stamps since no line waited, s: lines come faster than they
    are filtered."""
    refused: int = 0
    refusal: str = ""
    outputs_left_out: int = 0
    """Those that jump and return."""
    readings_left_out: int = 0
    recorded: int = 0

    @property
    def is_late(self) -> bool:
        """Whether lines wait so long that it is worth a word."""
        return self.behind >= BEHIND

    @property
    def sentences(self) -> list[str]:
        """What the declared noise of output and readings leads to, what is left out or waits, and what a watch has
        named."""
        share = "" if self.noise_share is None else self.noise_share.sentence
        named = "" if self.naming is None else f"watch: {self.naming.sentence}"
        counts = (("output", self.outputs_left_out), ("position reading", self.readings_left_out))
        left_out = [
            f"{amount_of(n, f'{name} that jumps and returns is', f'{name}s that jump and return are')} left out"
            for name, n in counts
            if n
        ]
        late = f"{self.behind:.1f} s behind: lines come faster than they are filtered" if self.is_late else ""
        return [sentence for sentence in (share, self.remark, late, *left_out, named) if sentence]


@dataclass(frozen=True, slots=True)
class LiveEvent(Storable):
    """One line of `accelcal live --json`."""

    event: Literal["state", "alarm", "name", "end"]
    source: str
    """Name of the source."""
    state: LiveState
    alarm: Alarm | None = None
    naming: Naming | None = None
    ended: str | None = None
    """Why the source ended."""


class LiveSession:
    """Reads a source, feeds the filter, tests its innovations and records the rows.

    Parameters
    ----------
    source : of the bytes; closed at the end.
    declared : sidecar of the lines.
    settings : of the filter.
    recording : Parquet file to write, with a sidecar beside it; None for none.

    Raises
    ------
    OSError
        If the recording cannot be written.
    """

    def __init__(
        self, source: ByteSource, declared: Sidecar, settings: LiveSettings, recording: Path | None = None
    ) -> None:
        self.source, self.declared = source, declared
        self.lines = LineReader(declared, source.name, source.from_its_start, settings.needs)
        self.tracker = Tracker(settings) if settings.model is None else ModelTracker(settings)
        self.monitor = InnovationMonitor(
            resolution=settings.sharp_resolution, settling=1 if settings.begun else SETTLING
        )
        self._newest: Innovation | None = None
        self._named: Naming | None = None
        self._t: float | None = None
        self._caught_up: tuple[float, float | None] = (time.monotonic(), None)
        """When no line waited last, by the clock of the machine, s, and the newest stamp then."""
        self._recorder = None if recording is None else _Recorder(recording, declared, self.lines)
        self._stack = ExitStack()
        self._intake: Intake | None = None
        self._stopped = False

    def __enter__(self) -> Self:
        with ExitStack() as opened:
            opened.callback(self.source.close)
            if self._recorder is not None:
                opened.enter_context(self._recorder.file)
            self._stack = opened.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            # Such as nobody reading the output, a second signal or a defect; a disk that refuses would do so again.
            waits = error is not None and not isinstance(error, OSError)
            if waits and self._recorder is not None and not self._recorder.file.broken:
                self._recorder.write()
        finally:
            self._stack.close()

    def run(
        self, *, ends: Callable[[], bool], on_alarm: Callable[[Alarm | Naming], None], show: Callable[[], None]
    ) -> None:
        """Follow the source to its end, or until `ends`; every row that was read is then in filter and file.

        Parameters
        ----------
        ends : asked between chunks, several times a second.
        on_alarm : called with each alarm, and with what a watch names.
        show : called between chunks.

        Raises
        ------
        RecordingError
            If the columns cannot be told from header and sidecar.
        OSError
            If the recording cannot be written; what is in the file stays readable.
        """
        intake = self._intake = Intake(self.source)
        self._stack.callback(intake.stop)  # before its source is closed
        while not (intake.ended or ends()):
            chunks = intake.take(patience=0.1)
            if intake.caught_up:
                self._caught_up = time.monotonic(), self._t
            for chunk in chunks:
                self._take(self.lines.feed(chunk), on_alarm)
                show()
            if self._recorder is not None:
                self._recorder.write_if_due()
            show()
        self._stopped = not intake.ended
        intake.stop()
        for chunk in intake.take(patience=0.0):
            self._take(self.lines.feed(chunk), on_alarm)
        self._take(self.lines.finish(whole=self.source.ends_lines and intake.error is None), on_alarm)
        self._judge(self.tracker.finish(), on_alarm)
        self._caught_up = time.monotonic(), self._t
        if self._recorder is not None:
            self._recorder.write()

    @property
    def ended(self) -> str:
        """Why nothing more came."""
        error = None if self._intake is None else self._intake.error
        if error is not None:
            reason = error.strerror if isinstance(error, OSError) else None
            return f"the source broke off ({reason or error or type(error).__name__})"
        return "stopped" if self._stopped else "the source has ended"

    @property
    def state(self) -> LiveState:
        """Everything there is to show now."""
        counts, tracker, monitor = self.lines.counts, self.tracker, self.monitor
        return LiveState(
            t=self._t,
            estimates=tracker.estimates,
            noise_share=tracker.noise_share,
            innovation=self._newest,
            nis=monitor.nis,
            holds=monitor.holds,
            blocks=monitor.blocks,
            alarms=monitor.alarms,
            remark=monitor.remark,
            watched=tracker.watched,
            naming=self._named,
            outputs=tracker.outputs,
            readings=tracker.readings,
            used=counts.used,
            broken=counts.broken,
            out_of_order=counts.out_of_order,
            missing=counts.missing,
            restarts=counts.restarts,
            dropped_bytes=0 if self._intake is None else self._intake.dropped,
            behind=self.behind,
            refused=tracker.refused,
            refusal=tracker.refusal,
            outputs_left_out=tracker.excursions.outputs,
            readings_left_out=tracker.excursions.readings,
            recorded=0 if self._recorder is None else self._recorder.file.rows,
        )

    @property
    def behind(self) -> float:
        """Seconds by which the newest stamp lags, as far as the clock of the machine shows."""
        (at, stamp), newest = self._caught_up, self._t
        if stamp is None or newest is None:
            return 0.0
        return max(0.0, time.monotonic() - at - (newest - stamp))

    def _take(self, rows: Rows, on_alarm: Callable[[Alarm | Naming], None]) -> None:
        if not len(rows):
            return
        self._t = float(rows.t[-1])
        if self._caught_up[1] is None:
            self._caught_up = self._caught_up[0], float(rows.t[0])
        if self._recorder is not None:
            self._recorder.add(rows)
        self._judge(self.tracker.feed(rows), on_alarm)

    def _judge(self, readings: Readings, on_alarm: Callable[[Alarm | Naming], None]) -> None:
        for alarm in self.monitor.add(readings):
            on_alarm(alarm)
        if (naming := self.tracker.naming()) is not None:
            self._named = naming
            on_alarm(naming)
        if len(readings.t):
            self._newest = Innovation(float(readings.t[-1]), float(readings.e[-1]), float(readings.variance[-1]))


class _Recorder:
    """Rows to a file that is whole at any time."""

    def __init__(self, path: Path, declared: Sidecar, lines: LineReader) -> None:
        self.path, self.declared, self.lines = path, declared, lines
        self.file = GrowingParquet(path, UNITS)
        self._rows: list[Rows] = []
        self._began = self._last = time.monotonic()

    def add(self, rows: Rows) -> None:
        """Keep rows for the next row group."""
        self._rows.append(rows)

    def write_if_due(self) -> None:
        """Write a row group when it is time; asked often, also while no row comes."""
        now = time.monotonic()
        if now - self._last > min(max(GROUP_TIME, GROUP_SHARE * (now - self._began)), LONGEST_GROUP_TIME):
            self.write()

    def write(self) -> None:
        """Write what waits as a row group; with the first of them, the sidecar."""
        self._last = time.monotonic()
        if not self._rows:
            return
        first, rows = not self.file.rows, Rows.joined(self._rows)
        self._rows.clear()
        self.file.units |= self.lines.units
        self.file.append({"t": rows.t, "accel": rows.accel, "position": rows.position, **rows.side})
        if first:
            channels = {name: Source(name, unit) for name, unit in self.file.units.items() if name != "t"}
            write_sidecar(
                self.declared.rig,
                {"time": Clock("t", "s"), **channels},
                sidecar_of(self.path),
                labels=self.declared.labels,
                prior_sizes=self.declared.prior_sizes,
            )


MOST_ALARMS = 20
"""Alarms that are kept; blocks in a row are one."""


class LiveHistory:
    """Moments of a live view from its events, the newest among them.

    Parameters
    ----------
    most : moments that are kept; they stay evenly spread over the whole run.

    Examples
    --------
    >>> from accelcal.live.session import LiveEvent, LiveState
    >>> history = LiveHistory(most=4)
    >>> for t in range(100):
    ...     history.add(LiveEvent("state", "lines", LiveState(float(t))))
    >>> len(history.moments) <= 5, history.moments[0].t, history.moments[-1].t
    (True, 0.0, 99.0)
    """

    def __init__(self, most: int = 300) -> None:
        self.most = most
        self.newest: LiveEvent | None = None
        """The newest state, or the end."""
        self._parameters: dict[str, Estimate] = {}
        self.alarms: deque[Alarm] = deque(maxlen=MOST_ALARMS)
        """The newest alarms; of blocks in a row the last, whose `since` tells the first."""
        self._kept: list[LiveState] = []
        self._last: LiveState | None = None
        self._stride, self._count = 1, 0

    def add(self, event: LiveEvent) -> None:
        """Take in a state, an alarm or the end."""
        if event.alarm is not None:
            self._alarm(event.alarm)
            return
        if event.naming is not None:
            return
        self.newest = event
        t = event.state.t
        if t is None or (self._last is not None and t <= (self._last.t or 0.0)):
            return
        self._parameters |= {e.name: e for e in event.state.estimates}
        self._last = event.state
        if self._count % self._stride == 0:
            self._kept.append(self._last)
        self._count += 1
        if len(self._kept) > self.most:
            self._kept = self._kept[::2]
            self._stride *= 2

    @property
    def moments(self) -> list[LiveState]:
        """The moments that are kept, in order of time, and the newest."""
        moments = list(self._kept)
        return moments if self._last is None or (moments and moments[-1] is self._last) else [*moments, self._last]

    @property
    def parameters(self) -> tuple[Estimate, ...]:
        """Every parameter that was told at some time, as it was last."""
        return tuple(self._parameters.values())

    @property
    def columns(self) -> Columns:
        """Moments as arrays."""
        return Columns.of(self.moments, tuple(self._parameters))

    def _alarm(self, alarm: Alarm) -> None:
        if self.alarms and self.alarms[-1].since == alarm.since:
            self.alarms.pop()
        self.alarms.append(alarm)


@dataclass(frozen=True, slots=True)
class Columns:
    """States over time, (n,) each, or (n, m) for m parameters; NaN where there is no innovation or no estimate."""

    t: Array
    """s"""
    values: Array
    """Parameters, SI."""
    stds: Array
    e: Array
    """The newest innovation, m."""
    std: Array
    """That the model expects, m."""
    nis: Array
    low: Array
    high: Array
    """Interval of the running NIS."""

    @classmethod
    def of(cls, states: list[LiveState], parameters: tuple[str, ...]) -> Columns:
        """From states, the parameters of these names in this order."""
        n, none = len(states), math.nan
        values = [{e.name: (e.value, e.std) for e in s.estimates} for s in states]
        rows = [[by_name.get(name, (none, none)) for name in parameters] for by_name in values]
        both = np.array(rows, float).reshape(n, len(parameters), 2)
        read = [(none, none) if (e := s.innovation) is None else (e.e, math.sqrt(e.variance)) for s in states]
        nis = [
            (none,) * 3 if (running := s.nis) is None else (running.value, running.low, running.high) for s in states
        ]
        errors, runs = np.array(read, float).reshape(n, 2), np.array(nis, float).reshape(n, 3)
        return cls(np.array([s.t for s in states]), both[..., 0], both[..., 1], *errors.T, *runs.T)


BLOCK = 0.5
"""Length of the blocks of which each is at rest or not, s."""
STILL, STILLEST = 3.0, 0.5
"""Standard deviation of a block at rest: over that of the stillest block, and at most, m/s²."""
SAME = 0.3
"""Change of the mean of a block within one rest at most, m/s²: a turn by 2 degrees."""
APART = math.cos(math.radians(30.0))
"""Cosine of the angle by which a position must differ from all others."""


class DwellGuide:
    """Leads through the positions of a triad: rows in; rests, and what is to be done next, out.

    Parameters
    ----------
    least : shortest rest that is used, s.
    positions : how many rests are wanted, at least six, in which each axis points up and down.
    """

    def __init__(self, least: float, positions: int) -> None:
        self.least, self.positions = least, positions
        self.rests: list[Rest] = []
        self._rows, self._still = np.empty((0, 4)), np.empty((0, 4))
        self._floor = math.inf
        self._left = 0

    @property
    def next(self) -> str:
        """What the next position is; empty when there are enough."""
        absent = absent_faces(np.array([rest.mean for rest in self.rests]).reshape(-1, 3), centre=np.zeros(3))
        if absent:
            return f"turn it so that another axis points up or down; not yet: {', '.join(absent)}"
        if len(self.rests) < self.positions:
            return "turn it to a position in between, more than 30 degrees from all before"
        return ""

    def feed(self, rows: Array) -> list[str]:
        """Sentences on rows (n, 4), time in s and three outputs in m/s²; a rest that is long enough joins `rests`."""
        sentences, self._rows = [], np.concatenate([self._rows, rows])
        while len(self._rows) and self.next:
            size = int(np.searchsorted(self._rows[:, 0], self._rows[0, 0] + BLOCK))
            if size == len(self._rows):
                break
            block, self._rows = self._rows[:size], self._rows[size:]
            sentences += self._judge(block) if size > 2 else []
        return sentences

    def _judge(self, block: Array) -> list[str]:
        spread, mean = float(np.max(np.std(block[:, 1:], axis=0, ddof=1))), np.mean(block[:, 1:], axis=0)
        self._floor = min(self._floor, max(spread, 1e-6))
        begun = len(self._still) > 0
        if not spread <= min(STILL * self._floor, STILLEST):  # nor is one with an empty cell at rest
            self._still = self._still[:0]
            return ["hold still"] if begun else []
        if begun and np.linalg.norm(mean - np.mean(self._still[:, 1:], axis=0)) > SAME:
            self._still = self._still[:0]
        self._still = np.concatenate([self._still, block])
        lasts = float(self._still[-1, 0] - self._still[0, 0])
        if any(mean @ rest.mean > APART * np.linalg.norm(mean) * np.linalg.norm(rest.mean) for rest in self.rests):
            return []  # where it was before, or still is
        left = math.ceil(self.least - lasts)
        if left > 0:
            announced, self._left = left == self._left and begun, left
            return [] if announced else [f"hold still, {left} s"]
        y = self._still[:, 1:]
        still = Rest(
            float(self._still[0, 0]),
            float(self._still[-1, 0]),
            len(y),
            tuple(y.mean(axis=0).tolist()),
            tuple(y.std(axis=0, ddof=1).tolist()),
            None,
        )
        # One that was measured before the stillest block was known may have been none.
        self.rests = [rest for rest in (*self.rests, still) if max(rest.std) <= 2.0 * STILL * self._floor]
        return [f"position {len(self.rests)} is measured; {self.next or 'done'}"]
