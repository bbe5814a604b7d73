"""Recordings examined before any fit: without readings known to be wrong, up to a break, with the faults in them.

Every door asks here, `check` among them: what one of them lists, all list.
"""

from __future__ import annotations

import pickle
from collections import OrderedDict
from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import blake2b

from accelcal._support.values import listing
from accelcal.data import Recording
from accelcal.diagnosis.faults import (
    Fault,
    RelationColumns,
    Usable,
    fault_remarks,
    faults,
    usable,
    with_position_steps,
)
from accelcal.diagnosis.left_out import cut_without, left_out_remarks, without_wrong_readings
from accelcal.estimation.remarks import Remark, remark
from accelcal.estimation.run import PreparedRun, Source, prepare, prepared


@dataclass(frozen=True, slots=True)
class TimeSpan:
    """The part of a recording on which one model can hold, and the faults in it."""

    start: float
    """s"""
    end: float
    """s"""
    breaks: tuple[float, ...]
    """s"""
    remarks: tuple[Remark, ...]
    """Faults, several of one kind as one."""
    chosen: bool = False
    """Whether the user chose it, for all recordings; else it is that of the first."""


class Examined:
    """A recording without readings that are known to be wrong, prepared once, and what it shows before any fit.

    Parameters
    ----------
    recording : as it was read.
    start, end : s, optional; a part that the user chose, which is taken as it is.
    before : the same without a part, where that has been examined.
    """

    def __init__(
        self,
        recording: Recording,
        start: float | None = None,
        end: float | None = None,
        before: Examined | None = None,
    ) -> None:
        self.chosen, self.asked, self.before = start is not None or end is not None, (start, end), before
        whole = before.whole if before else as_prepared(recording)
        clean = recording if before else without_wrong_readings(whole)
        self.whole: Source = whole if clean is recording else as_prepared(clean)
        """Every reading; the recording where only a part of it can be used."""

    @cached_property
    def run(self) -> PreparedRun:
        """The part that is used.

        Raises
        ------
        RecordingError
            If it cannot be.
        """
        return prepared(self.whole, start=self.asked[0], end=self.asked[1])

    @cached_property
    def stepped(self) -> tuple[Source, RelationColumns | None]:
        """The whole with the jumps of its position, and the columns of every reading, if available."""
        if self.before:
            return self.before.stepped
        return with_position_steps(self.whole) if isinstance(self.whole, PreparedRun) else (self.whole, None)

    @cached_property
    def source(self) -> PreparedRun:
        """What a model is fitted to: the part that is used or more, with the jumps of the position."""
        stepped = self.stepped[0]
        return self.run if stepped is self.whole or not isinstance(stepped, PreparedRun) else stepped

    @cached_property
    def usable(self) -> Usable:
        """The part before the first break."""
        return usable(self.source, self.stepped[1])

    @property
    def breaks(self) -> tuple[float, ...]:
        """Instants from which no relation holds, s; none is sought in a part that the user chose."""
        return () if self.chosen else self.usable.breaks

    @property
    def span(self) -> tuple[float | None, float | None]:
        """Start and end of what is used, s: as chosen, or up to a break; None where nothing breaks."""
        return (self.usable.start, self.usable.end) if self.breaks else self.asked

    @cached_property
    def part(self) -> PreparedRun:
        """What is used, up to a break."""
        start, end = self.span
        if not self.breaks or start is None or end is None:
            return self.source
        recording = self.source.recording
        return prepare(replace(recording.part(start, end), digest=recording.digest))

    def _release(self) -> None:
        """Free the columns of the relation, which nothing needs once breaks and faults are known."""
        for columns in (self.stepped[1], None if self.chosen else self.usable.columns):
            if columns is not None:
                columns.release()

    @cached_property
    def judged(self) -> PreparedRun:
        """The part on which one model can hold."""
        return prepared(self.source, start=self.span[0], end=self.span[1])

    @cached_property
    def faults(self) -> tuple[Fault, ...]:
        """Faults in that part."""
        columns = None if self.chosen or self.breaks else self.usable.columns
        listed = faults(self.source.recording, self.judged, columns)
        self._release()
        return listed

    def remarks(self, place: str = "") -> list[Remark]:
        """What was noticed in it: its break, what was left out, and other faults; `place` stands before its name."""
        run, recording = self.judged, self.source.recording
        name = f"{place}{recording.name or 'recording'}"
        end = float(recording.accel.t[-1])
        broken = [
            remark("break", recording=name, time=at, cut=cut_without(recording, [(at, end)])) for at in self.breaks
        ]
        gone = left_out_remarks([recording], place, *self.span)
        return [*broken, *gone, *fault_remarks(self.faults, float(run.t[-1] - run.t[0]), name)]

    @cached_property
    def stretch(self) -> TimeSpan:
        """Begin and end of that part, and the faults in it."""
        t = self.judged.t
        return TimeSpan(float(t[0]), float(t[-1]), self.breaks, tuple(self.remarks()), self.chosen)


MOST_SAMPLES, MOST_RECORDINGS = 1 << 20, 4
"""Samples of all channels of a recording up to which what was learnt of it stays, and number of those."""
_examined: OrderedDict[bytes, Examined] = OrderedDict()
"""By the content of the recording; the last one that was asked for is at the end."""


def examine(recording: Recording, start: float | None = None, end: float | None = None) -> Examined:
    """A recording as examined by this process before, where it is one of the last that are short enough."""
    channels = recording.accel, recording.position, *recording.side.values()
    if sum(map(len, channels)) > MOST_SAMPLES:
        return Examined(recording, start, end)
    try:
        content = pickle.dumps(recording, pickle.HIGHEST_PROTOCOL)
    except (TypeError, AttributeError, pickle.PicklingError):  # a mapping of the user's own, or a channel
        return Examined(recording, start, end)
    digest = blake2b(content).digest()
    # A copy stays: the arrays of the caller may change.
    whole = _examined[digest] = _examined.pop(digest) if digest in _examined else Examined(pickle.loads(content))
    while len(_examined) > MOST_RECORDINGS:
        _examined.popitem(last=False)
    return whole if start is None and end is None else Examined(recording, start, end, whole)


def as_prepared(recording: Recording) -> Source:
    """The recording prepared; itself where it cannot be used as a whole: the fit says why."""
    try:
        return prepare(recording)
    except ValueError:
        return recording


__dir__ = listing(globals())
