"""A sensor that turns: gravity along its axis changes in a way that neither channel records."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from accelcal.data.arrays import Array
from accelcal.data.orientation import DERIVED
from accelcal.data.recording import Recording
from accelcal.data.rig import STANDARD_GRAVITY, Rig
from accelcal.diagnosis.contribution import Size
from accelcal.diagnosis.noise_tests.noise_test import LINE
from accelcal.diagnosis.policy import (
    DATA_SHEET_NOISE_RATIO,
    TURNING_BAND,
    TURNING_LEAST_PERIODS,
    TURNING_MOST_DEGREES,
    UNDECLARED_BIAS_INSTABILITY,
)
from accelcal.diagnosis.remarks import Remark, remark
from accelcal.diagnosis.search.confounding import DetectedEffect
from accelcal.effects import BUILT_IN, OF_TIME
from accelcal.estimation.estimate import Fit, result, solve_runs
from accelcal.estimation.run import PreparedRun
from accelcal.model import Model
from accelcal.validation.comparison import Comparison
from accelcal.validation.evaluation import accel_residual, compare
from accelcal.validation.prediction import Prediction

FOLLOW_TIME = OF_TIME | {LINE, *(effect.name for effect in BUILT_IN if effect.port == "process")}
"""Effects that follow time alone, as the turning of a sensor does."""


@dataclass(frozen=True, slots=True)
class FittedSpan:
    """What a model was fitted to."""

    recordings: tuple[Recording, ...]
    start: float
    """Of the first recording, s."""
    end: float

    def slow_residual(self, model: Model, span: tuple[float, float]) -> Comparison:
        """The residual that another model leaves in a span of the first recording, s."""
        fitted = result(solve_runs(model, self.recordings, start=self.start, end=self.end, others_whole=True))
        return compare(fitted, self.recordings[0], start=span[0], end=span[1])


def turning_sensor(
    model: Model,
    found: Sequence[DetectedEffect],
    where: Comparison,
    sizes: Mapping[str, Size],
    fitted: FittedSpan,
    span: tuple[float, float],
) -> Remark | None:
    """The remark on a sensor that turns; None where the slow residual is within the bias instability.

    Parameters
    ----------
    model : that was judged.
    found : effects that it lacks.
    where : its residual over the used part of the first recording.
    sizes : largest contribution of each effect.
    fitted, span : what it was fitted to; the used part, s.

    Notes
    -----
    What counts is left by a model with every effect that was found, functions of time alone excepted: a bias that
    follows any function of time follows a tilt as well.
    """
    if orientation_recorded(fitted.recordings[0]):
        return None
    rig, accel = fitted.recordings[0].rig, fitted.recordings[0].accel
    limit = ordinary(rig)
    floor = output_noise(rig, accel.t, accel.y)
    following = [n for n in model.effects if n in FOLLOW_TIME and n in sizes and sizes[n].value > limit]
    if not following and excess(where.accel_residual, where.band, floor) <= limit:
        return None
    reference = model.drop(*following) if following else model
    for finding in found:
        if finding.effect not in FOLLOW_TIME:
            reference = finding.enter(reference)
    if reference is not model:
        try:
            where = fitted.slow_residual(reference, span)
        except ValueError:
            if following:
                return None
    return _remark_on("turning_sensor", rig, excess(where.accel_residual, where.band, floor), where.band)


def slow_residual(fit: Fit, run: PreparedRun) -> Remark | None:
    """What is said beside a fit of whose first run nobody asked what the model lacks; None where its slow residual is
    within the bias instability, or orientation was recorded."""
    recording = run.recording
    if orientation_recorded(recording):
        return None
    try:
        ahead = Prediction.on(fit, run)
    except ValueError:
        return None
    band = min(ahead.crossover, 0.2 / run.reading_step)
    t, residual, _ = accel_residual(ahead, band)
    floor = output_noise(fit.rig, recording.accel.t, recording.accel.y)
    return _remark_on("slow_residual", fit.rig, excess((t, residual), band, floor), band)


def _remark_on(code: str, rig: Rig, rms: float, band: float) -> Remark | None:
    """A remark on a slow residual of `rms` m/s² up to `band` Hz, where a tilt that a sensor may have explains it."""
    limit, degrees = ordinary(rig), tilt(rms, rig)
    if rms <= limit or degrees > TURNING_MOST_DEGREES:
        return None
    return remark(code, tilt_deg=degrees, rms=rms, band=min(TURNING_BAND, band), bias_instability=limit)


def orientation_recorded(recording: Recording) -> bool:
    """Whether a channel says how the axis turns."""
    return any(name in recording.side for name in DERIVED)


def ordinary(rig: Rig) -> float:
    """Slow change of the bias that is ordinary for a sensor, rms, m/s²."""
    return rig.sensor.bias_instability or UNDECLARED_BIAS_INSTABILITY


def excess(residual_at: tuple[Array, Array], highest: float, floor: float) -> float:
    """Slow residual beyond the noise, m/s² rms about its mean; 0 where the record is too short for one.

    Parameters
    ----------
    residual_at : times (n,) s and residual (n,) m/s².
    highest : its bandwidth, Hz.
    floor : one-sided noise density of the output, (m/s²)/sqrt(Hz).
    """
    t, residual = residual_at
    if len(t) < 16:
        return 0.0
    step, band = float(np.median(np.diff(t))), min(TURNING_BAND, highest)
    if len(t) * step * band < TURNING_LEAST_PERIODS:
        return 0.0
    f = np.fft.rfftfreq(len(residual), step)
    power = 2.0 * np.abs(np.fft.rfft(residual - np.mean(residual))) ** 2 / len(residual) ** 2
    slow = float(np.sum(power[f <= band]))
    return math.sqrt(max(slow - DATA_SHEET_NOISE_RATIO**2 * floor**2 * band, 0.0))


def output_noise(rig: Rig, t: Array, y: Array) -> float:
    """One-sided white density of the output, (m/s²)/sqrt(Hz): declared, or from third differences if they show more."""
    third = np.diff(y, 3)
    variance = (float(np.median(np.abs(third - np.median(third)))) / 0.6745) ** 2 / 20.0
    return max(math.sqrt(2.0 * variance * float(np.median(np.diff(t)))), rig.sensor.noise or 0.0)


def tilt(rms: float, rig: Rig) -> float:
    """Turning about the mean attitude that changes gravity along the input axis by `rms`, degrees rms; 90 where none
    does.

    On a level axis gravity enters by the sine of the angle, along a vertical one by the cosine.
    """
    share = min(rms / STANDARD_GRAVITY, 1.0)
    vertical = abs(rig.gravity) > math.sqrt(0.5) * STANDARD_GRAVITY
    return math.degrees(math.acos(1.0 - share) if vertical else math.asin(share))
