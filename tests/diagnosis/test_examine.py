"""What is kept of a recording that was examined: by content, whatever happens to the arrays of the caller."""

from dataclasses import replace
from types import MappingProxyType

import numpy as np

import accelcal as ac
from accelcal.data import Recording
from accelcal.diagnosis.faults import MOST_RECORDINGS, examine
from accelcal.simulation import ADXL105_RIG, simulate


def recorded(seed: int) -> Recording:
    """Ten seconds of moves."""
    rng = np.random.default_rng(seed)
    return simulate("moves", seconds=10.0, rig=ADXL105_RIG, parameters={"bias": 0.05}, rng=rng).recording


def test_equal_recordings_are_examined_once_and_only_the_last_ones_are_kept() -> None:
    first = examine(recorded(0))
    assert examine(recorded(0)) is first
    assert examine(recorded(0), start=1.0).whole is first.whole
    for seed in range(1, MOST_RECORDINGS + 1):
        examine(recorded(seed))
    assert examine(recorded(0)) is not first


def test_a_recording_that_changes_is_examined_anew_and_changes_nothing_that_is_kept() -> None:
    recording = recorded(100)
    bias = ac.fit(recording)["bias"].value
    recording.accel.y[:] += 0.3
    recording.position.y[:] *= 1.5
    assert abs(ac.fit(recording)["bias"].value - bias) > 0.2
    assert ac.fit(recorded(100))["bias"].value == bias


def test_a_recording_without_bytes_of_its_own_is_examined_all_the_same() -> None:
    recording = replace(recorded(7), side=MappingProxyType({}))
    assert ac.fit(recording)["bias"].value == ac.fit(recorded(7))["bias"].value
