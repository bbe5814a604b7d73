"""A slow residual: a sensor that turns, so that gravity along its axis changes in a way that neither channel records, a
drift of either channel, or a stretch in which something disturbed the record."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from accelcal.data.arrays import Array
from accelcal.data.orientation import DERIVED
from accelcal.data.recording import Recording
from accelcal.data.references import ACCELERATION
from accelcal.data.rig import STANDARD_GRAVITY, Rig
from accelcal.data.units import instant
from accelcal.diagnosis.evidence import Evidence
from accelcal.diagnosis.noise_tests.noise_test import LINE
from accelcal.diagnosis.policy import (
    DATA_SHEET_NOISE_RATIO,
    DISTURBED_SHARE,
    DISTURBED_STRETCHES,
    DRIFT_BAND,
    TURNING_BAND,
    TURNING_LEAST_PERIODS,
    TURNING_MOST_DEGREES,
    UNDECLARED_BIAS_INSTABILITY,
)
from accelcal.diagnosis.search.confounding import DetectedEffect
from accelcal.effects import BUILT_IN, OF_TIME, find
from accelcal.estimation.estimate import Fit, result, solve_runs
from accelcal.estimation.remarks import Remark, Value, remark
from accelcal.estimation.run import PreparedRun
from accelcal.model import Model
from accelcal.signals.processing import low_pass
from accelcal.signals.series import widened
from accelcal.validation.evaluation import accel_residual, compare
from accelcal.validation.prediction import Prediction

PROCESSES = frozenset(effect.name for effect in BUILT_IN if effect.port == "process")
FOLLOW_TIME = PROCESSES | {LINE, *(name for name in OF_TIME if find(name).family)}
"""Effects that follow any function of time, the turning of a sensor and a touched cable among them."""
TILT = find("tilt").name
DRIFTS = OF_TIME | {name for name in PROCESSES if find(name).traits.changes == "bias"}
"""Drifts of the bias: what a slow tilt looks like, and does."""


def turning_sensor(e: Evidence) -> Iterator[Remark]:
    """Slow residual beyond the bias instability that a tilt can cause; not beside a scale factor that none has.

    Notes
    -----
    What counts is left by a model with every effect that was found, those excepted that follow any function of time: a
    bias that wanders follows a tilt as well. Where it lives in a few stretches they are named, unless such are left out
    already. Else a drift of the bias that explains it stands beside the tilt, if all of it is as slow as a bias drifts;
    where none does no name is certain. No null: the limit is the declared bias instability, noise subtracted
    (tests/diagnosis/test_turning.py).
    """
    model, found, recording = e.model, e.scan.found, e.recording
    if e.forbidden or not e.scan.enough or gravity_is_recorded(recording):
        return
    slow = SlowResidual.of(recording, e.where.accel_residual, e.where.band)
    following = [n for n in model.effects if n in FOLLOW_TIME and n in e.sizes and e.sizes[n].value > slow.ordinary]
    if not following and slow.rms <= slow.ordinary:
        return
    begin, end = float(e.runs[0].t[0]), float(e.runs[0].t[-1])

    def left_by(reference: Model, entering: Sequence[DetectedEffect], span: tuple[float, float]) -> SlowResidual:
        for finding in entering:
            reference = finding.enter(reference)
        fitted = result(solve_runs(reference, e.sources, start=begin, end=end, others_whole=True))
        seen = compare(fitted, e.sources[0], start=span[0], end=span[1])
        return SlowResidual.of(recording, seen.accel_residual, seen.band)

    certain = [finding for finding in found if finding.effect not in FOLLOW_TIME]
    left = slow
    if certain or following:
        try:
            left = left_by(model.drop(*following) if following else model, certain, e.span)
        except ValueError:
            if following:
                return
    if left.rms <= left.ordinary:
        if slow.rms > slow.ordinary and any(finding.effect in DRIFTS for finding in found):
            yield from slow.remark("tilt_or_drift")
        return
    if left.stretches and all(one.code != "disturbed" for one in e.stretch.remarks):
        yield left.apart(recording.name)
        return
    wandering = [finding for finding in found if finding.effect in FOLLOW_TIME & DRIFTS]
    code = "turning_sensor"
    if left.faster <= left.ordinary and (wandering or (following and DRIFTS.issuperset(following))):
        try:  # a process says nothing of what lies beyond the fitted part
            explained = left_by(model, [*certain, *wandering], (begin, end))
            code = "tilt_or_drift" if explained.rms <= left.ordinary else code
        except ValueError:
            pass
    yield from left.remark(code)


def beside_tilt(found: Sequence[DetectedEffect]) -> tuple[DetectedEffect, ...]:
    """Effects that were found, with a tilt in the class of each drift of the bias."""
    return tuple(replace(one, members=(*one.members, TILT)) if one.effect in DRIFTS else one for one in found)


def slow_residual(fit: Fit, run: PreparedRun, *, stretches: bool = True) -> Iterator[Remark]:
    """Slow residual of a fit alone, beyond the bias instability and within what a tilt can cause; `stretches` says
    whether the few in which it lives are named."""
    recording = run.recording
    if gravity_is_recorded(recording):
        return
    try:
        ahead = Prediction.on(fit, run)
    except ValueError:
        return
    band = min(ahead.crossover, 0.2 / run.reading_step)
    t, residual, _ = accel_residual(ahead, band)
    slow = SlowResidual.of(recording, (t, residual), band)
    if slow.stretches and stretches:
        yield slow.apart(recording.name)
    else:
        yield from slow.remark("slow_residual")


@dataclass(frozen=True, slots=True)
class SlowResidual:
    """A residual up to the frequency of a turning sensor, as far as noise does not explain it."""

    rig: Rig
    rms: float
    """m/s²; 0 where the record is too short for one."""
    faster: float
    """The part of it that is faster than a bias drifts, m/s² rms."""
    band: float
    """Hz"""
    ordinary: float
    """Slow change of the bias that is ordinary for the sensor, rms, m/s²."""
    stretches: tuple[tuple[float, float], ...]
    """Begin and end of the few stretches in which it lives, s: without them it is ordinary."""

    @classmethod
    def of(cls, recording: Recording, residual_at: tuple[Array, Array], highest: float) -> SlowResidual:
        """The slow part of a residual: times (n,) s, residual (n,) m/s², and its bandwidth, Hz."""
        limit, floor = ordinary(recording.rig), output_noise(recording.rig, recording.accel.t, recording.accel.y)
        rms = excess(residual_at, highest, floor)
        if rms <= limit:
            return cls(recording.rig, rms, 0.0, min(TURNING_BAND, highest), limit, ())
        t, residual = residual_at
        drifting = low_pass(residual, 1.0 / float(np.median(np.diff(t))), DRIFT_BAND)
        faster, apart = excess((t, residual - drifting), highest, floor), disturbed(residual_at, highest, floor, limit)
        return cls(recording.rig, rms, faster, min(TURNING_BAND, highest), limit, apart)

    def remark(self, code: str) -> Iterator[Remark]:
        """The remark on a tilt that would explain it; none where it is ordinary, or no sensor tilts as much."""
        degrees = tilt(self.rms, self.rig)
        if self.rms > self.ordinary and degrees <= TURNING_MOST_DEGREES:
            yield remark(code, tilt_deg=degrees, rms=self.rms, band=self.band, bias_instability=self.ordinary)

    def apart(self, name: str) -> Remark:
        """The remark on its stretches, with the command that cuts them out of a file of this name."""
        pieces = [(instant(begin), instant(end)) for begin, end in self.stretches]
        file = Path(name or "FILE")
        values: dict[str, Value] = {
            "stretches": " ".join(f"{begin}:{end}" for begin, end in pieces),
            "between": " and ".join(f"between {begin} and {end} s" for begin, end in pieces),
            "rms": self.rms,
            "band": self.band,
            "bias_instability": self.ordinary,
            "without": " ".join(f"--without {begin}:{end}" for begin, end in pieces),
            "file": str(file),
            "cut": f"{file.stem}_cut{file.suffix}",
        }
        return remark("disturbed", **values)


def stretches_of(disturbed: Remark) -> list[tuple[float, float]]:
    """Begin and end of the stretches that a remark names, s."""
    return [
        (float(begin), float(end))
        for begin, _, end in (piece.partition(":") for piece in str(disturbed.values["stretches"]).split())
    ]


def gravity_is_recorded(recording: Recording) -> bool:
    """Whether a channel says how the axis turns, or a reference on the same body feels gravity as the sensor does."""
    reference = recording.reference
    return any(name in recording.side for name in DERIVED) or (reference is not None and reference.name == ACCELERATION)


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


def disturbed(
    residual_at: tuple[Array, Array], highest: float, floor: float, limit: float
) -> tuple[tuple[float, float], ...]:
    """Begin and end of the few stretches without which a slow residual is within `limit`, s; empty where it is spread
    over the record.

    Parameters
    ----------
    residual_at, highest, floor : as of `excess`.
    limit : m/s² rms.
    """
    t, residual = residual_at
    step, band = float(np.median(np.diff(t))), min(TURNING_BAND, highest)
    slow = low_pass(residual, 1.0 / step, band)
    slow = np.abs(slow - np.median(slow))
    usual = math.hypot(limit, DATA_SHEET_NOISE_RATIO * floor * math.sqrt(band))
    marked = np.concatenate([[False], widened(slow > usual, math.ceil(0.5 / (band * step))), [False]])
    edges = np.flatnonzero(np.diff(marked.astype(np.int8))).reshape(-1, 2)
    high = [(b, e) for b, e in edges.tolist() if np.max(slow[b:e]) > usual / math.sqrt(DISTURBED_SHARE)]
    rest = np.ones(len(t), dtype=np.bool_)
    for begin, end in high:
        rest[begin:end] = False
    few = len(high) <= DISTURBED_STRETCHES and np.mean(rest) >= 1.0 - DISTURBED_SHARE
    if not (few and high) or float(np.mean(slow[rest] ** 2)) > usual**2:
        return ()
    tail = 0.5 / band  # what is below the limit there still adds up to a jump of the position over the hole
    return tuple((float(t[begin]) - tail, float(t[end - 1]) + tail) for begin, end in high)


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
