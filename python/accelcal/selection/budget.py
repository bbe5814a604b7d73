"""Processor time of a search: no further model is begun that would exceed it."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from accelcal.data.recording import Recording
from accelcal.diagnosis.policy import SEARCH_MODELS, SEARCH_SAMPLES, SEARCH_SECONDS, SEARCH_SPAN

MARGIN = 1.5
"""Cost of the next model over that of the dearest so far: models grow."""


@dataclass(slots=True)
class SearchBudget:
    """Processor time that a search may use, and what it has used."""

    seconds: float
    """s"""
    clock: Callable[[], float] = time.thread_time
    """Of the thread of the search alone: others may search in the same process."""
    begun: float = field(init=False)
    models: int = 1
    """Models that were fitted and judged, the base model included."""
    stopped: bool = False
    """Whether a model was not begun."""
    longest: float = 0.0
    """Of one model, s."""
    last: float = field(init=False)
    """When the last model was begun, s."""

    def __post_init__(self) -> None:
        self.begun = self.last = self.clock()

    @classmethod
    def of(cls, recordings: Sequence[Recording]) -> SearchBudget:
        """The budget of some recordings: that of a minute, and in proportion where they are longer and hold more
        samples."""
        samples = sum(len(recording.accel) for recording in recordings)
        span = sum(float(recording.accel.t[-1] - recording.accel.t[0]) for recording in recordings)
        return cls(SEARCH_SECONDS * max(1.0, min(span / SEARCH_SPAN, samples / SEARCH_SAMPLES)))

    def allows_another(self) -> bool:
        """Whether one more model may be begun; it is then counted."""
        now = self.clock()
        if self.models == 1 and not self.stopped:  # the base model says how dear the models of this record are
            self.seconds = max(self.seconds, SEARCH_MODELS * (now - self.begun))
        self.longest = max(self.longest, now - self.last)
        self.last = now
        if self.stopped or now - self.begun + MARGIN * self.longest > self.seconds:
            self.stopped = True
            return False
        self.models += 1
        return True
