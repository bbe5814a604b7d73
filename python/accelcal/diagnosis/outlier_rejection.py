"""Readings that are wild, left out: samples and readings that the noise of their channel does not allow.

A wild reading counts with the weight of a good one and raises the fitted noise of its channel for all others, so it is
taken out of the record and the fit is made again. Two periods of the motion's bandwidth at either end are not tested:
what is sharp there cannot be told from the end itself.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from accelcal.data.arrays import Array
from accelcal.data.recording import Channel, Recording
from accelcal.diagnosis.noise_tests.noise_test import NoiseTest
from accelcal.diagnosis.noise_tests.run_all import run_noise_tests
from accelcal.diagnosis.policy import NOISE_TEST_ALPHA, REJECTION_ROUNDS
from accelcal.effects import HOUSE
from accelcal.estimation.gauss_newton import Solution

CHANNEL_OF = {e.name: e.traits.noise.rejects for e in HOUSE if e.traits.noise and e.traits.noise.rejects}
"""Which channel a test takes readings from."""


@dataclass(frozen=True, slots=True)
class RejectedReadings:
    """How many readings of one channel were left out as wild."""

    recording: str
    channel: str
    count: int
    of: int
    """Readings that the channel had."""

    @property
    def sentence(self) -> str:
        """For people."""
        name = self.recording or "recording"
        return f"{name}: {self.count} of {self.of} readings of {self.channel} are left out as wild"


@dataclass(frozen=True, slots=True)
class CleanFit:
    """Recordings without wild readings, the fit to them, and every test on its noise."""

    recordings: tuple[Recording, ...]
    solution: Solution
    tests: tuple[NoiseTest, ...]
    """On the gated recordings; the tests that found wild readings as they were before these were left out."""

    def dropped(self, original: Sequence[Recording]) -> tuple[RejectedReadings, ...]:
        """What is missing from the recordings as they were read, channel by channel."""
        found = []
        for before, after in zip(original, self.recordings, strict=True):
            for name in CHANNEL_OF.values():
                have, kept = len(getattr(before, name)), len(getattr(after, name))
                if kept < have:
                    found.append(RejectedReadings(before.name, name, have - kept, have))
        return tuple(found)


def clean_fit(
    recordings: Sequence[Recording],
    solve: Callable[[Sequence[Recording]], Solution],
    before: Sequence[NoiseTest] = (),
) -> CleanFit:
    """Fit, leave wild readings out, and fit again until no more are found, at most three times.

    Parameters
    ----------
    recordings : what was measured.
    solve : fits a model to recordings.
    before : tests that found wild readings in these recordings earlier, and are still to be told of.

    Raises
    ------
    NotIdentifiable, RecordingError
        From the fit.
    """
    recordings, told = list(recordings), {test.effect: test for test in before}
    solution = solve(recordings)
    for left in reversed(range(REJECTION_ROUNDS + 1)):
        several = [run_noise_tests(one) for one in solution.passes]
        tests = [test for each in several for test in each]
        loud = [outliers_found(each) for each in several]
        if not left or not any(loud):
            break
        for number, found in enumerate(loud):
            for test in found:
                told.setdefault(test.effect, test)
                recordings[number] = without(recordings[number], test)
        solution = solve(recordings)
    kept = [test for test in tests if test.effect not in told]
    return CleanFit(tuple(recordings), solution, (*kept, *told.values()))


def outliers_found(tests: Sequence[NoiseTest]) -> list[NoiseTest]:
    """The tests that found wild readings and know where they are."""
    return [test for test in tests if test.effect in CHANNEL_OF and test.p_value < NOISE_TEST_ALPHA and test.at]


def without(recording: Recording, test: NoiseTest) -> Recording:
    """The recording without the readings that a test found wild."""
    of_output = CHANNEL_OF[test.effect] == "accel"
    channel = recording.accel if of_output else recording.position
    kept = np.ones(len(channel), dtype=np.bool_)
    kept[nearest(channel.t, np.asarray(test.at))] = False
    left = Channel(channel.name, channel.t[kept], channel.y[kept], channel.unit)
    return replace(recording, accel=left) if of_output else replace(recording, position=left)


def nearest(t: Array, at: Array) -> NDArray[np.intp]:
    """Index of the stamp that is nearest to each instant, (m,)."""
    right = np.clip(np.searchsorted(t, at), 1, len(t) - 1)
    return np.asarray(np.where(at - t[right - 1] < t[right] - at, right - 1, right))
