"""Detection limits of a motion that is only planned, with the noise of the data sheet: they need no measurement."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from accelcal._support.errors import AccelcalError
from accelcal.data import Array, Channel, Recording, Rig
from accelcal.diagnosis.experiment.detectability import Power
from accelcal.diagnosis.experiment.power_analysis import detectability_of, with_drift
from accelcal.diagnosis.policy import FAMILYWISE_ALPHA
from accelcal.effects import Effect
from accelcal.estimation.drive import DriveIntegrals, run_filter
from accelcal.estimation.estimate import require_motion
from accelcal.estimation.noise import NoiseSearch
from accelcal.estimation.run import prepare
from accelcal.estimation.run_state import RunState
from accelcal.estimation.smoothing import SmoothedMotion as Sampled
from accelcal.estimation.smoothing import Thinning, sensor_signals
from accelcal.estimation.values import Noise, Values
from accelcal.model import Model
from accelcal.signals.processing import low_pass, motion_bandwidth
from accelcal.simulation.motion import Motion

ACCEL_RATE = 1667.0
"""Rate of the output unless another is given, Hz."""
POSITION_RATE = 833.5
"""Rate of the encoder readings unless another is given, Hz."""
DEGREE = 7
"""Degree of the spline through set-points: its third derivative is smooth."""


@dataclass(frozen=True, slots=True)
class SetPoints:
    """A part of a motion that runs through set-points, smooth through jerk."""

    spline: Any
    """Interpolating B-spline of position, m over s."""
    end: float
    """Time of the last set-point, s; the stage stays there."""

    start = -math.inf
    stop = math.inf
    final = 0.0

    def derivatives(self, t: Array) -> Array:
        inside = np.clip(t, 0.0, self.end)
        return np.stack([np.asarray(self.spline(inside, nu)) for nu in range(4)])


def through(t: Array, p: Array, name: str = "") -> Motion:
    """The motion through set-points, a spline of degree 7; its time begins at 0.

    Parameters
    ----------
    t : (n,) s, rising.
    p : (n,) m.
    name : name of the motion in messages.

    Raises
    ------
    ValueError
        If there are too few set-points.
    """
    from scipy.interpolate import make_interp_spline

    if len(t) <= DEGREE:
        raise AccelcalError(f"{name or 'motion'}: {len(t)} set-points; at least {DEGREE + 1} are needed")
    end = float(t[-1] - t[0])
    return Motion((SetPoints(make_interp_spline(t - t[0], p, k=DEGREE), end),), end, name=name)


def power_of_motion(
    motion: Motion,
    rig: Rig,
    *,
    seconds: float | None = None,
    model: Model | None = None,
    accel_rate: float = ACCEL_RATE,
    position_rate: float = POSITION_RATE,
    encoder_noise: float | None = None,
    alpha: float = FAMILYWISE_ALPHA,
) -> Power:
    """Detection limits of a planned motion: smallest detectable size of every effect, and the effects that it
    confounds.

    Parameters
    ----------
    motion : the plan; `through` makes one from set-points.
    rig : noise density of the sensor, its low-pass and mount, resolution of the encoder.
    seconds : length of the record, s; the planned length by default.
    model : what is known already; the linear model by default.
    accel_rate, position_rate : Hz.
    encoder_noise : standard deviation of a reading before it is rounded, m; by default as declared, else one step of
        the encoder.
    alpha : family-wise false-alarm rate of `diagnose`.

    Raises
    ------
    ValueError
        If the rig declares no noise density, or neither resolution nor encoder noise are known.
    NotIdentifiable
        If the plan does not move.

    Examples
    --------
    >>> from accelcal.simulation.motion import motion
    >>> from accelcal.simulation.sensor import ADXL105_RIG
    >>> seen = power_of_motion(motion("bursts", 20.0, np.random.default_rng(1)), ADXL105_RIG)
    >>> bool(seen["quadratic"].smallest[0] < seen["odd_quadratic"].smallest[0])
    True
    """
    model = Model.linear() if model is None else model
    length = motion.seconds if seconds is None else seconds
    noise = planned_noise(rig, encoder_noise)
    state = planned_state(motion, rig, length, noise, model, accel_rate, position_rate)
    return with_drift(detectability_of(state, model, alpha=alpha))


def power_of_set_points(
    recording: Recording, *, extra: Sequence[Effect] | None = None, alpha: float = FAMILYWISE_ALPHA
) -> Power:
    """Detection limits of a file of set-points, with a reading at each of them and two outputs between readings.

    Parameters
    ----------
    recording : position (n,) m; the output is not used.
    extra : effects of the user's own, next to the catalogue.
    alpha : family-wise false-alarm rate of `diagnose`.
    """
    t, p = recording.position.t, recording.position.y
    motion = through(t, p, recording.name)
    rate = 1.0 / float(np.median(np.diff(t)))
    model, noise = Model.linear(), planned_noise(recording.rig, name=recording.name)
    state = planned_state(motion, recording.rig, motion.seconds, noise, model, 2.0 * rate, rate)
    return with_drift(detectability_of(state, model, extra, alpha))


def planned_noise(rig: Rig, encoder_noise: float | None = None, *, name: str = "planned motion") -> Noise:
    """Noise of the data sheet: q = N²/2 for a one-sided density N, R = noise² + resolution²/12.

    Raises
    ------
    ValueError
        If one of them is not declared; messages call the motion `name`.
    """
    if rig.sensor.noise is None:
        raise AccelcalError(
            f"{name}: the noise density of the sensor is not declared, so nothing can be said of a planned motion. "
            'Write in the sidecar\n[sensor]\nnoise = "225 ug/sqrt(Hz)"'
        )
    encoder_noise = rig.reading_noise if encoder_noise is None else encoder_noise
    if rig.resolution is None and encoder_noise is None:
        raise AccelcalError(
            f"{name}: neither resolution nor noise of the encoder are known, so nothing can be said of a planned "
            "motion. Write in the sidecar\n"
            '[channels]\nposition = { column = "position_m", unit = "m", noise = "1 um" }'
        )
    step = rig.resolution or 0.0
    position_noise = step if encoder_noise is None else encoder_noise
    return Noise(0.5 * rig.sensor.noise**2, position_noise**2 + step**2 / 12.0)


def planned_state(
    motion: Motion,
    rig: Rig,
    seconds: float,
    noise: Noise,
    model: Model,
    accel_rate: float = ACCEL_RATE,
    position_rate: float = POSITION_RATE,
) -> RunState:
    """The fitted run that a planned motion would give, with exact signals and the gains of the declared noise.

    The coefficients are those of a perfect sensor: detection limits change by the scale error only, a percent or two.
    Nothing measured enters, so the filter is run over readings of zero and the innovations are zero.
    """
    t = np.arange(0.0, seconds, 1.0 / accel_rate)
    p, v, a, jerk = motion.derivatives(t)
    readings = np.arange(0.0, seconds, 1.0 / position_rate)
    recording = Recording(
        accel=Channel("accel", t, rig.polarity * (a + rig.gravity), "m/s²"),
        position=Channel("position", readings, motion.position(readings), "m"),
        rig=rig,
        name=motion.name,
    )
    run = prepare(recording)
    require_motion(run)
    values = Values({term.name: model.fixed.get(term.name, 0.0) for term in model.terms}, model.terms)
    still = np.zeros_like(run.t)
    integrals = DriveIntegrals(run.t, still, still, still, np.arange(len(run.t)) == 0, still)
    track = run_filter(run, integrals, noise)
    density, crossover = noise.r * run.reading_step, run.crossover(noise)
    cutoff, _ = motion_bandwidth(a, accel_rate, q=noise.q, reading_density=density, crossover=crossover)
    grid = Thinning.of(t, run.accel_step, cutoff)
    a, jerk = (low_pass(y, accel_rate, cutoff) for y in (a, jerk))  # as the signals of a real run are
    signals = sensor_signals(run, grid.t, Sampled(*(grid.thin(y) for y in (p, v, a, jerk))), values, cutoff)
    return RunState(run, values, noise, integrals, track, signals, None, NoiseSearch(noise))
