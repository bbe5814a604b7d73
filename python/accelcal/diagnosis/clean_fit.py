"""A fit without outliers, which its residual finds.

An outlier counts with the weight of a good sample and raises the fitted noise of its channel for all others, so it is
removed from the record and the fit is repeated. Two periods of the motion's bandwidth at either end are not tested:
sharp features there are confounded with the end itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from accelcal._support.process import give_back_memory
from accelcal._support.values import listing
from accelcal.data import Array, Channel
from accelcal.diagnosis.noise.counts import held_samples, quantisation, rounded_stamps
from accelcal.diagnosis.noise.motion_noise import motion_noise
from accelcal.diagnosis.noise.noise_test import POSITION_JUMPS, NoiseTest
from accelcal.diagnosis.noise.outliers import accelerometer_outliers, encoder_outliers
from accelcal.diagnosis.noise.position import encoder_cyclic, whiteness
from accelcal.diagnosis.noise.residuals import Residuals
from accelcal.diagnosis.noise.spectra import tones, vibration
from accelcal.diagnosis.policy import NOISE_TEST_ALPHA, REJECTION_ROUNDS
from accelcal.effects import BUILT_IN
from accelcal.estimation.bands import TRIALS, in_its_band
from accelcal.estimation.gauss_newton import Solution
from accelcal.estimation.remarks import Remark, remark
from accelcal.estimation.run import LONG, PreparedRun
from accelcal.estimation.run_state import RunState
from accelcal.signals.processing import forget_plans


def position_jumps(residuals: Residuals) -> NoiseTest:
    """Report the position steps behind which the replay started anew; the innovations do not show them any more.

    The largest is reported with the p value of its detection (`accelcal.diagnosis.faults.position_steps`), which counts
    every reading of the record.
    """
    run = residuals.run
    steps = run.accounted_steps
    if not steps:
        return NoiseTest(POSITION_JUMPS, 0.0, 1.0, 0.0, "m", math.inf, "no jump of the position")
    largest = max(steps, key=lambda step: abs(step.size))
    more = f"; {len(steps)} such jumps in all" if len(steps) > 1 else ""
    return NoiseTest(
        POSITION_JUMPS,
        abs(largest.size),
        min(step.p_value for step in steps),
        abs(largest.size),
        "m",
        math.sqrt(run.reading_variance_guess),
        largest.sentence + more,
        {"count": float(len(steps))},
    )


def run_noise_tests(state: RunState) -> tuple[NoiseTest, ...]:
    """Run every test on a fitted state.

    Parameters
    ----------
    state : after `accelcal.estimation.gauss_newton.iterate`; it is not changed.

    Returns
    -------
    One finding for each of vibration, timing_jitter, accelerometer_outliers, encoder_outliers, quantisation,
    rounded_stamps, held_samples, encoder_cyclic, encoder_step, whiteness, and one for each of at most five lines
    (`tone`; at least one, the most significant). Those of the position only where the reference is one.
    """
    residuals = Residuals(state)
    line_tests = tones(residuals)
    above, jitter = motion_noise(residuals, line_tests)
    strongest = vibration(residuals, line_tests, above)
    residuals.release()
    of_output = accelerometer_outliers(residuals), quantisation(residuals)
    of_stamps = rounded_stamps(residuals), held_samples(residuals)
    of_position = (
        (encoder_outliers(residuals), encoder_cyclic(residuals), position_jumps(residuals))
        if residuals.reads_position
        else ()
    )
    lines = tuple(line for line in line_tests if not line.parts["follows_motion"])
    return (strongest, jitter, *of_output, *of_stamps, *lines, *of_position, whiteness(residuals))


def run_outlier_tests(state: RunState) -> tuple[NoiseTest, ...]:
    """Run only the tests that reject samples; a fit needs no others.

    Parameters
    ----------
    state : as of `run_noise_tests`.

    Returns
    -------
    accelerometer_outliers and encoder_outliers, equal to those among all.
    """
    return accelerometer_outliers(Residuals(state)), encoder_outliers(Residuals(state))  # nothing serves both


__all__ = ["NoiseTest", "run_noise_tests", "run_outlier_tests"]


CHANNEL_OF = {e.name: e.traits.noise.rejects for e in BUILT_IN if e.traits.noise and e.traits.noise.rejects}
"""Channel from which each noise test rejects samples."""


@dataclass(frozen=True, slots=True)
class RejectedReadings:
    """Number of samples of one channel that were rejected as outliers."""

    recording: str
    channel: str
    count: int
    of: int
    """Samples that the channel had."""

    @property
    def remark(self) -> Remark:
        """For people."""
        name = self.recording or "recording"
        return remark("outliers_rejected", recording=name, count=self.count, of=self.of, channel=self.channel)

    @property
    def sentence(self) -> str:
        """Its text."""
        return self.remark.sentence


@dataclass(frozen=True, slots=True)
class CleanFit:
    """Recordings without outliers, the fit to them, and the noise tests on it."""

    runs: tuple[PreparedRun, ...]
    solution: Solution
    tests: tuple[NoiseTest, ...]
    """On the cleaned runs; tests that found outliers as they were before these were removed."""

    def rejected(self, original: Sequence[PreparedRun]) -> tuple[RejectedReadings, ...]:
        """Samples that are missing compared with the original runs, by recording and channel."""
        samples = []
        for before, after in zip(original, self.runs, strict=True):
            for name in CHANNEL_OF.values():
                have, left = (len(getattr(run.recording, name)) for run in (before, after))
                if left < have:
                    samples.append(RejectedReadings(before.recording.name, name, have - left, have))
        return tuple(samples)


def clean_fit(
    runs: Sequence[PreparedRun],
    solve: Callable[[Sequence[PreparedRun]], Solution],
    before: Sequence[NoiseTest] = (),
    solved: Solution | None = None,
    test: Callable[[RunState], tuple[NoiseTest, ...]] = run_noise_tests,
) -> CleanFit:
    """Fit, reject outliers and fit again until no more are found, at most three times.

    Parameters
    ----------
    runs : what was measured.
    solve : fits a model to runs.
    before : tests that found outliers in these runs earlier; they are reported too.
    solved : the fit to these runs, where it was made already; it is used up where there are outliers.
    test : the noise tests; `run_outlier_tests` where the fit alone is asked for.

    Raises
    ------
    NotIdentifiable, RecordingError
        From the fit.
    """
    runs, found_earlier = list(runs), {test.effect: test for test in before}
    solution = solved or solve(runs)
    for rounds_left in reversed(range(REJECTION_ROUNDS + 1)):
        give_back(solution.states)
        tests_of_runs = [test(state) for state in solution.states]
        give_back(solution.states)
        tests = [test for of_run in tests_of_runs for test in of_run]
        outlier_tests = [outliers_found(of_run) for of_run in tests_of_runs]
        if not rounds_left or not any(outlier_tests):
            break
        for number, tests_of_run in enumerate(outlier_tests):
            for outlier_test in tests_of_run:
                found_earlier.setdefault(outlier_test.effect, outlier_test)
                runs[number] = without_outliers(runs[number], outlier_test)
        again = [
            run if of_run or state.band is None else in_its_band(run, solution.model, state)
            for run, of_run, state in zip(runs, outlier_tests, solution.states, strict=True)
        ]
        solution.states.clear()  # one set of filters at a time
        solution = solve(again)
    new = [test for test in tests if test.effect not in found_earlier]
    return CleanFit(tuple(runs), solution, (*new, *found_earlier.values()))


def give_back(states: Sequence[RunState]) -> None:
    """Give back the memory in which long runs were solved and tested."""
    if sum(len(state.run.accel) for state in states) > LONG:
        forget_plans()
        give_back_memory()


def outliers_found(tests: Sequence[NoiseTest]) -> list[NoiseTest]:
    """Tests that found outliers and know their instants."""
    return [test for test in tests if test.effect in CHANNEL_OF and test.p_value < NOISE_TEST_ALPHA and test.at]


def without_outliers(run: PreparedRun, test: NoiseTest) -> PreparedRun:
    """The run without the samples that a test rejects."""
    recording, name = run.recording, CHANNEL_OF[test.effect]
    channel = recording.accel if name == "accel" else recording.position
    good = np.ones(len(channel), dtype=np.bool_)
    good[nearest(channel.t, np.asarray(test.at))] = False
    cleaned = Channel(channel.name, channel.t[good], channel.y[good], channel.unit)
    less = run.anew(replace(recording, accel=cleaned) if name == "accel" else replace(recording, position=cleaned))
    less.answers.update(
        {key: answer for key, answer in run.answers.items() if isinstance(key, tuple) and key[0] == TRIALS}
    )
    return less


def nearest(t: Array, at: Array) -> NDArray[np.intp]:
    """Index of the time stamp nearest to each instant, (m,)."""
    right = np.clip(np.searchsorted(t, at), 1, len(t) - 1)
    return np.asarray(np.where(at - t[right - 1] < t[right] - at, right - 1, right))


__dir__ = listing(globals())
