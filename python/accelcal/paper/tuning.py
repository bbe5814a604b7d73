"""How the paper's filters are set up on a record: their noise, their prior, and what is read off their tracks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from accelcal.data.arrays import Array
from accelcal.data.recording import Recording
from accelcal.data.rig import Rig
from accelcal.filters.choice import FilterChoice, GaussMarkov
from accelcal.filters.record import FilterRun, run
from accelcal.simulation.motion import Motion
from accelcal.simulation.sensor import ADXL105_RIG, CXL02_RIG, Truth

ACI = FilterChoice("aci")
CWPA = FilterChoice("cwpa")

ACCEL_RATE = 1667.0
"""Of every record in the reproduction, Hz (paper II-A)."""
PLAIN_ADXL105 = replace(ADXL105_RIG, lowpass=None)
PLAIN_CXL02 = replace(CXL02_RIG, lowpass=None)
"""The rigs without the low-pass, which no model of the paper knows."""
PAPER_SENSOR = {"bias": 0.05, "scale_factor": 0.01, "quadratic": -1e-4, "cubic": 1e-5}
"""K2 and K3 as in III-A2."""

POSITION_SIGMA = 1e-4
"""Standard deviation of the start position, m."""
VELOCITY_SIGMA = 1e-2
"""m/s; larger values make RK2 lose positive definiteness."""
ACCELERATION_SIGMA = 0.1
"""m/s²."""
PARAMETER_SIGMAS = np.array([0.05, 0.2, 1e-3, 1e-4])
"""Of k, K0 (m/s²), K2 ((m/s²)⁻¹), K3 ((m/s²)⁻²): a sensor that is known to 5 % and 20 mg."""

_GRID = 1000.0
"""Rate at which mean squares of a motion are taken, Hz."""


@dataclass(frozen=True, slots=True)
class Noise:
    """The four noise settings of the two systems."""

    acceleration: float
    """Two-sided density of the control's noise (ACI), (m/s²)² s."""
    jerk: float
    """Two-sided density of the jerk (CWPA), m²/s⁵."""
    position: float
    """Variance of a position reading, m²."""
    output: float
    """Variance of an accelerometer reading (CWPA), (m/s²)²."""


def tuned(truth: Truth, rig: Rig, vibration_power: float = 0.0) -> Noise:
    """Settings for a simulated rig, as the paper describes them.

    Control noise N²/2. Jerk by q T = (delta a)² (II-E2, dimensions corrected), with delta a taken as 5.5 times the rms
    change of acceleration per sample, since the changes of a smooth motion keep their sign over many samples. Vibration
    raises the variances by its mean power (II-F).

    Parameters
    ----------
    truth : Truth
        Of the record: the sensor's noise and the motion.
    rig : Rig
        Encoder resolution.
    vibration_power : float
        Mean square of the vibration, (m/s²)².
    """
    dt = 1.0 / ACCEL_RATE
    rounding = (rig.resolution or 0.0) ** 2 / 12.0
    return Noise(
        acceleration=0.5 * truth.noise**2 + vibration_power * dt,
        jerk=30.0 * mean_square_jerk(truth.motion) * dt,
        position=truth.position_noise**2 + rounding,
        output=0.5 * truth.noise**2 * ACCEL_RATE + vibration_power,
    )


def mean_square_jerk(motion: Motion) -> float:
    """Over the planned length, (m/s³)²."""
    return float(np.mean(motion.jerk(np.arange(0.0, motion.seconds, 1.0 / _GRID)) ** 2))


def motion_states(choice: FilterChoice) -> int:
    """2 (p, v) in ACI, 3 (p, v, a) in CWPA."""
    return 2 if choice.system == "aci" else 3


def prior_sigmas(choice: FilterChoice) -> Array:
    """Standard deviations (N,) of the usual prior."""
    moving = [POSITION_SIGMA, VELOCITY_SIGMA, ACCELERATION_SIGMA][: motion_states(choice)]
    return np.concatenate([moving, PARAMETER_SIGMAS[: 2 if choice.model == "linear" else 4]])


def start(choice: FilterChoice, truth: Truth, tau: float = 0.0) -> Array:
    """The usual estimate (N,) at t = 0: the true motion, as a low-pass of `tau` s shows it, and a perfect sensor."""
    moving, parameters = motion_states(choice), 2 if choice.model == "linear" else 4
    motion = truth.motion.derivatives(np.zeros(1))[:, 0]
    return np.concatenate([motion[:moving] - tau * motion[1 : moving + 1], np.zeros(parameters)])


def filtered(
    choice: FilterChoice,
    recording: Recording,
    noise: Noise,
    mean: Array,
    sigma: Array,
    *,
    tau: float = 0.0,
    parameters: Mapping[str, GaussMarkov] | None = None,
) -> FilterRun:
    """Runs a filter with independent prior errors.

    Parameters
    ----------
    choice : FilterChoice
    recording : Recording
    noise : Noise
        The settings that the system uses are taken from it.
    mean, sigma : (N,)
        Prior.
    tau : float
        Low-pass that the filter models, s; 0 = none, as in the paper.
    parameters : mapping of str to GaussMarkov
        Parameters that are not constant.
    """
    aci = choice.system == "aci"
    return run(
        choice,
        recording.accel,
        recording.position,
        q=noise.acceleration if aci else noise.jerk,
        r_position=noise.position,
        r_accel=None if aci else noise.output,
        x0=mean,
        P0=np.diag(sigma**2),
        tau=tau,
        parameters=parameters,
    )


def paper_choice(choice: FilterChoice) -> FilterChoice:
    """The integrators of II-G: RK2 for the first order (12), RK4 for the second (14); CWPA is discrete and exact."""
    if choice.system == "cwpa":
        return choice
    return replace(choice, form="inverse", integrator="rk2" if choice.order == 1 else "rk4")


def label(choice: FilterChoice) -> str:
    """As in the tables."""
    return f"{choice.system.upper()} {choice.model}, order {choice.order}"


def sampled(track: FilterRun, t: Array) -> Array:
    """Estimates (m, N) after the last event not later than t (m,) s."""
    return np.asarray(track.states[_last(track, t)])


def _last(track: FilterRun, t: Array) -> NDArray[np.intp]:
    return np.maximum(np.searchsorted(track.times, t, side="right") - 1, 0)
