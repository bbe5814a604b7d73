"""What a session has in its catalogue of effects beyond the built-in ones; no other session of the server sees it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from accelcal.app.session_content import Formula
from accelcal.app.state import State
from accelcal.data.recording import Recording
from accelcal.effects import CATALOGUE, side_channels


@dataclass(frozen=True, slots=True)
class Known:
    """Effects of one session, as they are sent to a worker."""

    formulas: tuple[Formula, ...] = ()
    """Effects of the user."""
    channels: tuple[tuple[str, str], ...] = ()
    """Side channels of its recordings, and their units."""

    @classmethod
    def to(cls, state: State) -> Known:
        """What a state holds."""
        recordings = [run.recording for run in state.runs if run.recording is not None]
        units = dict(pair for recording in recordings for pair in units_of(recording))
        return cls(tuple(Formula.of(own) for own in state.own), tuple(units.items()))

    @contextmanager
    def catalogue(self) -> Iterator[None]:
        """The catalogue of this session; what is entered inside is forgotten behind it."""
        with CATALOGUE.apart():
            for formula in self.formulas:  # first: a channel that comes later makes way
                formula.enter()
            side_channels(self.channels)
            yield


def units_of(recording: Recording) -> tuple[tuple[str, str], ...]:
    """Side channels with their units."""
    return tuple((channel.name, channel.unit) for channel in recording.side.values())
