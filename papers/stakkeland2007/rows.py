"""One claim with its result in our runs, and the statistics that decide it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Literal, TypeVar
from zlib import crc32

import numpy as np
from scipy import special

from accelcal.data import Array, Recording, Rig
from accelcal.filters.choice import FilterChoice, GaussMarkov
from accelcal.filters.record import FilterRun, run
from accelcal.simulation.motion import Motion
from accelcal.simulation.sensor import ADXL105_RIG, CXL02_RIG, Truth

Result = TypeVar("Result")

ALPHA = 1e-3
"""False-alarm rate of every statistical row, two-sided."""
SIGMAS = 3.2905
"""Normal deviate of that rate."""


@dataclass(frozen=True, slots=True)
class Row:
    """A claim with its expected and measured values."""

    by: Literal["paper", "us"]
    """Source of the claim. A claim of the paper may fail in our runs, which is then the result; one of ours may not."""
    claim: str
    expected: str
    measured: str
    """With its unit."""
    value: float
    """The number behind `measured`."""
    n: int
    """Runs, or samples, that it rests on."""
    threshold: str
    """Criterion of the claim."""
    holds: bool
    remark: str = ""


@dataclass(frozen=True, slots=True)
class Item:
    """One table, figure or statement of the paper."""

    name: str
    """One word, for the command line and JSON."""
    title: str
    source: str
    """Where the paper says it."""
    rows: tuple[Row, ...]


@dataclass(frozen=True, slots=True)
class Plan:
    """How much to run: `quick` is a slice of the same experiments with fewer or shorter runs."""

    quick: bool
    seed: int
    workers: int = 2
    """Threads; the filters run outside Python's lock."""

    def runs(self, quick: int, full: int) -> int:
        """Number of runs (or seconds, or whatever is scaled)."""
        return quick if self.quick else full

    def repeat(self, name: str, count: int, once: Callable[[np.random.Generator], Result]) -> list[Result]:
        """`once` for `count` independent generators that depend on the seed and `name` alone, not on the threads."""
        generators = np.random.default_rng([self.seed, crc32(name.encode())]).spawn(count)
        with ThreadPoolExecutor(self.workers) as pool:
            return list(pool.map(once, generators))


@dataclass(frozen=True, slots=True)
class Paired:
    """Two error figures from the same records."""

    ratio: float
    """rms of the first over rms of the second."""
    deviate: float
    """Mean of log(first/second) over its standard error."""

    @property
    def verdict(self) -> str:
        """Which of the two is smaller; below 2 % the difference is irrelevant, significant or not."""
        if abs(self.deviate) < SIGMAS or abs(np.log(self.ratio)) < 0.02:
            return "no difference"
        return "smaller" if self.ratio < 1.0 else "larger"


def paired(first: Array, second: Array) -> Paired:
    """Compares errors (n,) and (n,) of two filters on the same n records."""
    log_ratio = np.log(first / second)
    spread = float(np.std(log_ratio, ddof=1)) / np.sqrt(len(first))
    ratio = float(np.sqrt(np.mean(first**2) / np.mean(second**2)))
    return Paired(ratio, float(np.mean(log_ratio) / max(spread, 1e-300)))


def sign_test(wins: int, losses: int) -> float:
    """Probability of at least `wins` of wins + losses fair coins."""
    return float(special.bdtrc(wins - 1, wins + losses, 0.5)) if wins else 1.0


ACI = FilterChoice("aci")
CWPA = FilterChoice("cwpa")

ACCEL_RATE = 1667.0
"""Of every record in the reproduction, Hz (paper II-A)."""
PLAIN_ADXL105 = replace(ADXL105_RIG, lowpass=None)
PLAIN_CXL02 = replace(CXL02_RIG, lowpass=None)
"""The rigs without the low-pass, which no model of the paper knows."""
LINEAR_SENSOR = {"bias": 0.05, "scale_factor": 0.01}
PAPER_SENSOR = {**LINEAR_SENSOR, "quadratic": -1e-4, "cubic": 1e-5}
"""K2 and K3 as in III-A2."""
CURVED_SENSOR = {**LINEAR_SENSOR, "quadratic": -1e-3, "cubic": 1e-4}
"""Ten times as nonlinear: that of a 1 %FS part, so that Fig. 5 has something to show."""
LARGEST = 4.0
"""Standard deviations that an error of one of these fits may have: four parameters together are beyond it in 3 of
10 000 fits."""

POSITION_SIGMA = 1e-4
"""Standard deviation of the start position, m."""
VELOCITY_SIGMA = 1e-2
"""m/s; larger values make RK2 lose positive definiteness."""
ACCELERATION_SIGMA = 0.1
"""m/s²."""
PARAMETER_SIGMAS = np.array([0.05, 0.2, 1e-3, 1e-4])
"""Of k, K0 (m/s²), K2 ((m/s²)⁻¹), K3 ((m/s²)⁻²): a sensor that is known to 5 % and 20 mg."""


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
    return float(np.mean(motion.jerk(np.arange(0.0, motion.seconds, 1e-3)) ** 2))


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
    return np.asarray(track.states[np.maximum(np.searchsorted(track.times, t, side="right") - 1, 0)])
