"""Many simulated runs of one setting, fitted: errors, reported covariances, and the paper's ACI filter beside them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from scipy import special

import accelcal as ac
from accelcal._core import FilterError
from accelcal.data.rig import Rig
from accelcal.estimation.estimate import estimate
from accelcal.filters.choice import FilterChoice
from accelcal.model import Model
from accelcal.simulation.motion import Motion, Tones
from accelcal.simulation.sensor import ADXL105_RIG, CXL02_RIG, Simulated, simulate
from accelcal.validation.consistency import nees
from tests.consistency.cramer_rao import bound

Array = NDArray[np.float64]

LINEAR = {"bias": 0.05, "scale_factor": 0.01, "time_offset": 2e-4}
CUBIC = {**LINEAR, "quadratic": -1e-4, "cubic": 1e-5}
"""K2 and K3 as in the paper, III-A2."""


def shake(seconds: float, rng: np.random.Generator) -> Motion:
    """Eight steady tones between 6 and 18 Hz: strong acceleration at little speed."""
    frequency = rng.uniform(6.0, 18.0, 8)
    tones = Tones(1.0 / (2.0 * np.pi * frequency) ** 2, frequency, rng.uniform(0.0, 2.0 * np.pi, 8))
    return Motion((tones,), seconds, name="shake")


@dataclass(frozen=True, eq=False)
class Setting:
    """One rig, one kind of motion, one model."""

    name: str
    motion: str
    a_rms: float
    rig: Rig
    seconds: float = 60.0
    model: Model = field(default_factory=Model.linear)
    truth: dict[str, float] = field(default_factory=lambda: dict(LINEAR))
    accel_rate: float = 1667.0
    position_rate: float = 833.5
    accel_phase: float = 0.0
    position_phase: float = 0.0
    missing: float = 0.0
    position_noise: float = 1e-6

    @property
    def names(self) -> tuple[str, ...]:
        """Parameters in the order of the errors."""
        return self.model.effects

    def simulate(self, run: int) -> Simulated:
        """Run number `run`; motion, noise and losses are its own."""
        rng = np.random.default_rng([2007, sum(self.name.encode()), run])
        motion: Motion | str = self.motion
        sized: dict[str, float] = {"a_rms": self.a_rms}
        if self.motion == "shake":
            planned = shake(self.seconds, rng)
            motion, sized = planned.scaled(self.a_rms / planned.acceleration_rms), {}
        return simulate(
            motion,
            seconds=self.seconds,
            rig=self.rig,
            parameters=self.truth,
            rng=rng,
            accel_rate=self.accel_rate,
            position_rate=self.position_rate,
            accel_phase=self.accel_phase,
            position_phase=self.position_phase,
            missing=self.missing,
            position_noise=self.position_noise,
            **sized,
        )


SETTINGS = (
    Setting(
        "0.5 m/s² 225 ug, encoder 0.3 um",
        "interleaved",
        0.5,
        replace(ADXL105_RIG, resolution=None),
        position_noise=0.3e-6,
    ),
    Setting("1 m/s² 225 ug, 10 % missing", "interleaved", 1.0, ADXL105_RIG, missing=0.1),
    Setting("3 m/s² 225 ug", "shake", 3.0, ADXL105_RIG),
    Setting("0.5 m/s² 20 ug", "interleaved", 0.5, CXL02_RIG),
    Setting(
        "1 m/s² 20 ug, 1667 against 700 Hz",
        "interleaved",
        1.0,
        CXL02_RIG,
        position_rate=700.0,
        accel_phase=1.3e-4,
        position_phase=4.1e-4,
    ),
    Setting("3 m/s² 20 ug, encoder at 2.5 kHz", "tones", 3.0, CXL02_RIG, position_rate=2500.0),
)
"""Settings of declared noise.

Interleaved and shake stay near the 0.1 m/s of the paper's encoder; the tones need a faster one.
"""

BOUNDED = (
    Setting("linear, 0.5 m/s² 225 ug", "interleaved", 0.5, ADXL105_RIG, seconds=30.0),
    Setting("linear, 1 m/s² 20 ug", "interleaved", 1.0, CXL02_RIG, seconds=30.0),
    Setting("cubic, 4 m/s² 225 ug", "tones", 4.0, ADXL105_RIG, seconds=30.0, model=Model.cubic(), truth=CUBIC),
    Setting("cubic, 4 m/s² 20 ug", "tones", 4.0, CXL02_RIG, seconds=30.0, model=Model.cubic(), truth=CUBIC),
)
"""Settings whose low-pass is declared with a tolerance."""


@dataclass(frozen=True)
class Outcome:
    """Fits of one setting: N runs, m parameters."""

    names: tuple[str, ...]
    error: Array
    """(N, m) estimate minus truth, SI."""
    covariance: Array
    """(N, m, m) as reported."""

    @property
    def sigma(self) -> Array:
        """(N, m) reported standard deviations."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))

    def nees(self, *names: str) -> Array:
        """(N,) NEES of some parameters, marginal over the others."""
        rows = [self.names.index(name) for name in names]
        return nees(self.error[:, rows], self.covariance[:, rows][:, :, rows])


def one_fit(setting: Setting, run: int, *, share: float = 1.0) -> tuple[Array, Array]:
    """Error and covariance of the default fit, on the first `share` of the record."""
    sim = setting.simulate(run)
    end = None if share == 1.0 else share * setting.seconds
    fit = estimate(setting.model, sim.recording, end=end)
    return np.array([fit[name].value - sim.truth.parameters[name] for name in setting.names]), fit.covariance


def one_aci(setting: Setting, run: int) -> tuple[Array, Array]:
    """Error and covariance of (K0, k) by the paper's ACI filter, whose regressor is the noisy output itself.

    The output is continued by cubics, so that no error of interpolation is mistaken for that of the regressor.
    """
    sim = setting.simulate(run)
    fit = ac.fit(sim.recording, method=FilterChoice("aci", "linear", interpolation="cubic"))
    names = [e.name for e in fit.free]
    return np.array([fit[name].value - sim.truth.parameters[name] for name in names]), fit.covariance


def aci_or_none(setting: Setting, run: int) -> tuple[Array, Array] | None:
    """`one_aci`, None when the filter itself gives up: it may diverge while its parameters are still wide open."""
    try:
        return one_aci(setting, run)
    except FilterError:
        return None


def collect(names: tuple[str, ...], fits: Iterable[tuple[Array, Array]]) -> Outcome:
    """Fits as arrays."""
    errors, covariances = zip(*fits, strict=True)
    return Outcome(names, np.array(errors), np.array(covariances))


def bounds(setting: Setting, runs: Iterable[int]) -> Array:
    """(runs, m) standard deviations of the Cramer-Rao bound for the motion of each run."""
    sims = [setting.simulate(run) for run in runs]
    resolution = setting.rig.resolution or 0.0
    variance = sims[0].truth.position_noise ** 2 + resolution**2 / 12.0
    covariance = bound([sim.truth for sim in sims], setting.names, sims[0].recording.position.t, variance)
    return np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))


def slice_of(setting: Setting, seconds: float) -> Setting:
    """The same setting with shorter records."""
    return replace(setting, seconds=seconds)


def rms_region(runs: int, probability: float) -> tuple[float, float]:
    """Two-sided region of an rms of `runs` standard normal numbers."""
    tail = 0.5 * (1.0 - probability)
    low, high = special.gammaincinv(0.5 * runs, tail), special.gammainccinv(0.5 * runs, tail)
    return math.sqrt(2.0 * low / runs), math.sqrt(2.0 * high / runs)
